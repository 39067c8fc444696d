#!/usr/bin/env python3
"""Two fingers that hold a tumbling satellite of 300 kg for 20 s: fuyu against MuJoCo, in one run.

The scene is that of `capture_gripper.json`. fuyu's run is the test `gripper::a_gripper_holds_300_kg_and_keeps_momentum`, which
measures its processor time by itself; MuJoCo's uses the settings that its documentation recommends for grasps (`implicitfast`, elliptic
cones, `impratio` 10) with steps of `--step` seconds. The programs alternate; the ratio is the median of those of neighbours in time. Drift is
that of the momentum of robot and satellite together, which nothing acts on.

    pip install ./python mujoco gymnasium numpy
    python scripts/compare_gripper.py
"""

from __future__ import annotations

import argparse
import json
import re
import statistics
import subprocess
import sys
import time
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "python/benches"))
from mujoco_model import mjcf  # noqa: E402

FIXTURE = ROOT / "crates/fuyu-physics/tests/capture/fixtures/capture_gripper.json"
#: Of the run [s].
DURATION = 20.0
#: Angular velocity of the satellite in axes of the tool, and velocity of its bar relative to the tool, in the same axes [rad/s, m/s].
TUMBLE = np.array([0.03, 0.04, -0.036])
APPROACH = np.array([3e-3, 3.6e-3, 2.7e-3])
#: Rates of the base and the joints at the start [m/s, rad/s].
BASE_V, BASE_W = np.array([0.002, -0.001, 0.001]), np.array([0.0, 0.001, -0.002])
JOINT_RATES = np.array([1e-3, -2e-3, 1e-3, 2e-3, -1e-3, 1e-3])


def text(values: np.ndarray) -> str:
    return " ".join(repr(float(v)) for v in np.atleast_1d(values))


def scene(step: float) -> str:
    """Servicer, gripper and satellite for MuJoCo."""
    fixture = json.loads(FIXTURE.read_text())
    gripper = fixture["gripper"]
    top = ElementTree.fromstring(mjcf((ROOT / "urdf/servicer.urdf").read_text(), step))
    option = top.find("option")
    option.clear()
    for key, value in {
        "timestep": repr(step), "integrator": "implicitfast", "gravity": "0 0 0", "cone": "elliptic", "impratio": "10",
    }.items():  # fmt: skip
        option.set(key, value)
    damping = iter(gripper["joint_damping"])
    for joint in top.iter("joint"):
        joint.set("damping", repr(next(damping)))
    tool = next(body for body in top.iter("body") if body.get("name") == "tool0")

    def add(parent: ElementTree.Element, tag: str, **attributes: str) -> ElementTree.Element:
        return ElementTree.SubElement(parent, tag, attributes)

    def cuboid(mass: float, half: list[float]) -> str:
        x, y, z = np.square(half) * mass / 3
        return text(np.array([y + z, x + z, x + y]))

    palm = add(tool, "body", name="palm", pos=text(np.array(gripper["palm_at"])))
    add(palm, "inertial", pos="0 0 0", mass=repr(gripper["palm_mass"]), diaginertia=cuboid(gripper["palm_mass"], gripper["palm_half"]))
    friction = f"{gripper['mu']} 0.005 0.0001"
    for name, side in ("left", 1.0), ("right", -1.0):
        finger = add(tool, "body", name=name, pos=text(np.array([gripper["finger_at_x"], side * gripper["finger_open_y"], 0.0])))
        mass, half = gripper["finger_mass"], gripper["finger_half"]
        add(finger, "inertial", pos="0 0 0", mass=repr(mass), diaginertia=cuboid(mass, half))
        add(finger, "joint", name=f"{name}_joint", type="slide", axis=text(np.array([0.0, -side, 0.0])), damping=repr(gripper["finger_damping"]))
        add(finger, "geom", type="box", size=text(np.array(half)), friction=friction)
        add(top.find("actuator"), "motor", joint=f"{name}_joint")
    add(add(top, "equality"), "joint", joint1="left_joint", joint2="right_joint")
    target = add(top.find("worldbody"), "body", name="target")
    add(target, "freejoint")
    add(target, "inertial", pos="0 0 0", mass=repr(gripper["target_mass"]), diaginertia=text(np.array(gripper["target_inertia"])))
    size = text(np.array([gripper["bar_radius"], gripper["bar_half"]]))
    add(target, "geom", type="capsule", size=size, pos=text(np.array([-gripper["com_behind_bar"], 0.0, 0.0])), friction=friction)
    return ElementTree.tostring(top, encoding="unicode")


def started(model: mujoco.MjModel) -> mujoco.MjData:
    """The bar between the open fingers, moving a little."""
    fixture = json.loads(FIXTURE.read_text())
    gripper = fixture["gripper"]
    data = mujoco.MjData(model)
    joints = [model.joint(f"joint{k}") for k in range(1, 7)]
    for joint, q, rate in zip(joints, fixture["q0"], JOINT_RATES):
        data.qpos[joint.qposadr[0]], data.qvel[joint.dofadr[0]] = q, rate
    # The free joint of the base: velocity in the world's axes, angular velocity in its own.
    data.qpos[:7], data.qvel[:6] = [0, 0, 0, 1, 0, 0, 0], np.r_[BASE_V, BASE_W]
    mujoco.mj_forward(model, data)
    tool = model.body("tool0").id
    p, R = data.xpos[tool].copy(), data.xmat[tool].reshape(3, 3).copy()
    twist = np.zeros(6)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, tool, twist, 0)
    bar, behind = R @ [gripper["bar_at_x"], 0, 0], R @ [gripper["com_behind_bar"], 0, 0]
    w = R @ TUMBLE
    velocity = twist[3:] + np.cross(twist[:3], bar) + R @ APPROACH + np.cross(w, behind)
    free = model.joint(model.body("target").jntadr[0])
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, R.ravel())
    data.qpos[free.qposadr[0] :][:7] = np.r_[p + bar + behind, quaternion]
    data.qvel[free.dofadr[0] :][:6] = np.r_[velocity, TUMBLE]
    data.ctrl[-2:] = gripper["grip_force"]
    mujoco.mj_forward(model, data)
    return data


def momentum(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
    """Linear and angular momentum of everything about the world's origin [N s, N m s]."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_comVel(model, data)
    mujoco.mj_subtreeVel(model, data)
    linear = data.subtree_linvel[0] * model.body_subtreemass[0]
    return linear.copy(), data.subtree_angmom[0] + np.cross(data.subtree_com[0], linear)


def mujoco_run(model: mujoco.MjModel) -> tuple[float, float, float]:
    """Simulated time per processor time; drift of linear and angular momentum."""
    data = started(model)
    before = momentum(model, data)
    steps = round(DURATION / model.opt.timestep)
    begin = time.thread_time()
    # The loop over steps is in C.
    mujoco.mj_step(model, data, nstep=steps)
    factor = DURATION / (time.thread_time() - begin)
    if data.ncon == 0:
        raise SystemExit("MuJoCo's gripper has lost the bar")
    drift = [np.linalg.norm(now - then) for now, then in zip(momentum(model, data), before)]
    return factor, drift[0], drift[1]


def fuyu_run() -> tuple[float, float, float]:
    """The same of fuyu's test."""
    name = "gripper::a_gripper_holds_300_kg_and_keeps_momentum"
    command = ["cargo", "test", "--release", "-p", "fuyu-physics", "--test", "capture", "--", "--exact", name, "--nocapture"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    found = re.search(r"(\d+) times real time .*dP (\S+), dL (\S+),", done.stdout)
    if done.returncode or not found:
        raise SystemExit(f"{' '.join(command)} failed:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    factor, dP, dL = map(float, found.groups())
    return factor, dP, dL


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--step", type=float, default=1e-3, help="MuJoCo's step [s]")
    args = parser.parse_args()
    model = mujoco.MjModel.from_xml_string(scene(args.step))
    mujoco_run(model)
    fuyu_run()
    runs = [(fuyu_run(), mujoco_run(model)) for _ in range(args.rounds)]
    print("| program | simulated by processor time | drift of linear, angular momentum |")
    print("| --- | ---: | --- |")
    for i, name in enumerate(("fuyu, error-controlled", f"MuJoCo {mujoco.__version__}, {1e3 * args.step:g} ms")):
        factor = statistics.median(run[i][0] for run in runs)
        print(f"| {name} | {factor:.0f} | {runs[-1][i][1]:.1e} N s, {runs[-1][i][2]:.1e} N m s |")
    ratios = sorted(ours[0] / theirs[0] for ours, theirs in runs)
    print(f"\nfuyu by MuJoCo: {statistics.median(ratios):.2f} ({ratios[0]:.2f}-{ratios[-1]:.2f})")


if __name__ == "__main__":
    main()
