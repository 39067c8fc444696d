"""What Pinocchio computes of real robots.

Reads a JSON list of questions from stdin: the URDF, the joints that move with the coordinate that each follows, its ratio and
offset, the positions of the coordinates, a tip, and, if moments of inertia were repaired, mass properties of the bodies.
Pinocchio reads the same URDF with every joint free. Joints that fuyu holds are locked, and mimic joints are coupled by
multiplying the whole-body matrices with the coupling.
"""

import json
import sys

import numpy as np
import pinocchio as pin


def configuration(model, positions):
    q = pin.neutral(model)
    for name, x in positions.items():
        joint = model.joints[model.getJointId(name)]
        # Continuous joints are a cosine and a sine.
        q[joint.idx_q : joint.idx_q + joint.nq] = [x] if joint.nq == 1 else [np.cos(x), np.sin(x)]
    return q


def answer(case):
    try:
        model = pin.buildModelFromXML(case["urdf"], pin.JointModelFreeFlyer())
    except Exception as error:  # urdfdom's own limits
        return {"error": str(error)[:200]}
    joints = case["joints"]
    moving = list(model.names)[2:]
    held = [name for name in moving if name not in joints]
    at = {}
    for name in held:
        joint = model.joints[model.getJointId(name)]
        if joint.nq == 1:
            lower, upper = (limit[joint.idx_q] for limit in (model.lowerPositionLimit, model.upperPositionLimit))
            at[name] = min(max(0.0, lower), upper) if lower <= upper else 0.0
    if held:
        ids = [model.getJointId(name) for name in held]
        model = pin.buildReducedModel(model, ids, configuration(model, at))
    for name, mass, com, about_com in case["bodies"]:
        joint = model.getJointId(name) if name else 1
        model.inertias[joint] = pin.Inertia(mass, np.array(com), np.array(about_com))

    coordinates = case["names"]
    values = dict(zip(coordinates, case["q"]))
    data = model.createData()
    q = configuration(model, {name: ratio * values[of] + offset for name, (of, ratio, offset) in joints.items()})
    S = np.zeros((model.nv - 6, len(coordinates)))
    for name, (of, ratio, _) in joints.items():
        S[model.joints[model.getJointId(name)].idx_v - 6, coordinates.index(of)] = ratio

    M = np.array(pin.crba(model, data, q))
    M = np.triu(M) + np.triu(M, 1).T
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    tip = model.getFrameId(case["tip"], pin.FrameType.BODY)
    J = pin.getFrameJacobian(model, data, tip, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
    twist = -np.linalg.solve(M[:6, :6], M[:6, 6:])
    reduced = M[6:, 6:] + M[:6, 6:].T @ twist
    return {
        "total_mass": pin.computeTotalMass(model),
        "com": pin.centerOfMass(model, data, q).tolist(),
        "fixed_base_jacobian": (J[:, 6:] @ S).tolist(),
        "generalized_jacobian": ((J[:, 6:] + J[:, :6] @ twist) @ S).tolist(),
        "reduced_inertia": (S.T @ reduced @ S).tolist(),
    }


json.dump([answer(case) for case in json.load(sys.stdin)], sys.stdout)
