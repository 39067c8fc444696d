"""What Pinocchio computes of free-floating robots.

Reads a JSON list of cases (urdf, tip, q, qd, tau by joint name, base_twist of the base's centre of mass)
from stdin and writes the list of answers with the keys of `fuyu inspect --json`, joint vectors by name. Mimic joints are free
joints of Pinocchio's model, coupled by multiplying the whole-body matrices with the coupling S.
Everything comes from Pinocchio's whole-body mass matrix and articulated-body algorithm with the base at the
origin: no formula of the reduced system is used.
"""

import json
import sys

import numpy as np
import pinocchio as pin


def answer(case):
    model = pin.buildModelFromXML(case["urdf"], pin.JointModelFreeFlyer())
    model.gravity.setZero()
    data = model.createData()
    mimics = case["mimics"]
    moving = list(model.names)[2:]  # after the universe and the free base
    joints = [name for name in moving if name not in mimics]
    q, v, tau = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
    S = np.zeros((model.nv - 6, len(joints)))
    for name in moving:
        joint = model.joints[model.getJointId(name)]
        leader, ratio, offset = mimics.get(name, (name, 1.0, 0.0))
        x = ratio * case["q"][leader] + offset
        # Continuous joints are a cosine and a sine.
        q[joint.idx_q : joint.idx_q + joint.nq] = [x] if joint.nq == 1 else [np.cos(x), np.sin(x)]
        v[joint.idx_v] = ratio * case["qd"][leader]
        tau[joint.idx_v] = case["tau"].get(name, 0.0) - case["damping"][name] * v[joint.idx_v]
        S[joint.idx_v - 6, joints.index(leader)] = ratio
    model.damping[:] = 0  # it is in tau

    base_com = model.inertias[1].lever
    M = np.array(pin.crba(model, data, q))
    M = np.triu(M) + np.triu(M, 1).T
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    J = pin.getFrameJacobian(
        model, data, model.getFrameId(case["tip"]), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    )
    # Twist of the base frame (linear, angular) per joint rate at zero momentum.
    twist = -np.linalg.solve(M[:6, :6], M[:6, 6:])
    at_com = twist.copy()
    at_com[:3] -= np.cross(base_com, twist[3:], axis=0) if joints else 0

    base_twist = np.array(case["base_twist"])
    v[:3] = base_twist[:3] + np.cross(base_com, base_twist[3:])
    v[3:6] = base_twist[3:]
    momentum = pin.computeCentroidalMomentum(model, data, q, v)
    energy = pin.computeKineticEnergy(model, data, q, v)
    if mimics:
        # T maps base twist and coordinates to all velocities; the forces of the couplings do no work along it.
        T = np.block([[np.eye(6), np.zeros((6, len(joints)))], [np.zeros((model.nv - 6, 6)), S]])
        bias = pin.rnea(model, data, q, v, np.zeros(model.nv))
        a = np.linalg.solve(T.T @ M @ T, T.T @ (tau - bias))[6:]
    else:
        a = (S.T @ pin.aba(model, data, q, v, tau)[6:])

    reduced = M[6:, 6:] + M[:6, 6:].T @ twist
    return {
        "joints": joints,
        "total_mass": pin.computeTotalMass(model),
        "com": pin.centerOfMass(model, data, q).tolist(),
        "fixed_base_jacobian": (J[:, 6:] @ S).tolist(),
        "generalized_jacobian": ((J[:, 6:] + J[:, :6] @ twist) @ S).tolist(),
        "base_map": (at_com @ S).tolist(),
        "reduced_inertia": (S.T @ reduced @ S).tolist(),
        "momentum": {
            "linear": momentum.linear.tolist(),
            "angular": momentum.angular.tolist(),
        },
        "kinetic_energy": energy,
        "qdd": a.tolist(),
    }


json.dump([answer(case) for case in json.load(sys.stdin)], sys.stdout)
