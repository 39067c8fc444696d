"""What Pinocchio computes of free-floating robots.

Reads a JSON list of cases (urdf, tip, q, qd, tau by joint name, base_twist of the base's centre of mass)
from stdin and writes the list of answers with the keys of `fuyu inspect --json`, joint vectors by name.
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
    joints = list(model.names)[2:]  # after the universe and the free base
    q, v, tau = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
    for name in joints:
        joint = model.joints[model.getJointId(name)]
        x = case["q"][name]
        # Continuous joints are a cosine and a sine.
        q[joint.idx_q : joint.idx_q + joint.nq] = [x] if joint.nq == 1 else [np.cos(x), np.sin(x)]
        v[joint.idx_v] = case["qd"][name]
        damping = case["damping"][name]
        tau[joint.idx_v] = case["tau"][name] - damping * v[joint.idx_v]
    model.damping[:] = 0  # it is in tau

    columns = [model.joints[model.getJointId(name)].idx_v for name in joints]
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
    a = pin.aba(model, data, q, v, tau)

    pick = [c - 6 for c in columns]
    reduced = M[6:, 6:] + M[:6, 6:].T @ twist
    return {
        "joints": joints,
        "total_mass": pin.computeTotalMass(model),
        "com": pin.centerOfMass(model, data, q).tolist(),
        "fixed_base_jacobian": J[:, columns].tolist(),
        "generalized_jacobian": (J[:, 6:] + J[:, :6] @ twist)[:, pick].tolist(),
        "base_map": at_com[:, pick].tolist(),
        "reduced_inertia": reduced[np.ix_(pick, pick)].tolist(),
        "momentum": {
            "linear": momentum.linear.tolist(),
            "angular": momentum.angular.tolist(),
        },
        "kinetic_energy": pin.computeKineticEnergy(model, data, q, v),
        "qdd": a[columns].tolist(),
    }


json.dump([answer(case) for case in json.load(sys.stdin)], sys.stdout)
