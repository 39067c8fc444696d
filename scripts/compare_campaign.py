#!/usr/bin/env python3
"""Campaigns of the positioning scenario: fuyu against `mujoco.rollout` of the same robot under the same law, in one run.

fuyu computes what `fuyu campaign` does: camera with noise and latency, controller with all that it monitors, plant, and the figures
of each run: those that the campaign keeps, or "tip alone", the errors of the tip at the end. MuJoCo computes the plant by
`mujoco.rollout`, many robots in a call, and the law in numpy on all of them at once, with numpy's poses of the links; its camera is
ideal, and it keeps no figures. "rollout, plant alone" is the same without any law: the least that MuJoCo needs. Both use one thread.

Times are processor times, of all processes. The programs alternate, and the ratios are those of neighbours in time: medians of
`--rounds` of them. Errors are those of the base's attitude at the end against a run with an eighth of the step, the law sampled as
before: MuJoCo's is with the fewest steps per period whose error is at most twice fuyu's, and with one.

    pip install ./python mujoco numpy
    python scripts/compare_campaign.py
"""

from __future__ import annotations

import argparse
import os
import re
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import mujoco
import mujoco.rollout
import numpy as np

import fuyu

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "python/benches"))
from mujoco_model import check, mjcf  # noqa: E402

#: Control period [s].
PERIOD = 0.01
#: Of config/positioning.yaml.
POSTURE = np.radians([65.0, 99.0, -95.0, -22.0, 3.0, -42.0])
GOAL = np.array([3.662078985521887, 5.4440225463358125, 0.37996776327278203])
GOAL_XYZW = np.array([0.7701167439055318, 0.2742138532588425, 0.1334195108859386, -0.5602911721169955])
K_P, K_O = 75.0, 100.0
K_V = np.array([400.0, 100.0, 200.0, 10.0, 2.0, 2.0])
E_P_MAX, E_O_MAX = 0.2, 0.1


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Vector products of the last axes; numpy.cross is several times slower."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def matrices(wxyz: np.ndarray) -> np.ndarray:
    """Rotation matrices of quaternions w, x, y, z."""
    w, x, y, z = np.moveaxis(wxyz, -1, 0)
    rows = [
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ]  # fmt: skip
    return np.stack(rows, axis=-1).reshape(*wxyz.shape[:-1], 3, 3)


class Law:
    """The transpose-Jacobian law with the generalized Jacobian, on many robots at once; all in world axes."""

    def __init__(self, model: mujoco.MjModel, goal: np.ndarray, goal_R: np.ndarray, limits: np.ndarray) -> None:
        self.goal, self.goal_R = goal, goal_R
        moving = [b for b in range(1, model.nbody) if model.body_mass[b] > 0]
        self.bodies = moving
        self.mass = model.body_mass[moving]
        self.com = model.body_ipos[moving]
        inertial = matrices(model.body_iquat[moving])
        self.inertia = inertial @ (model.body_inertia[moving][:, :, None] * inertial.transpose(0, 2, 1))
        joints = range(1, model.njnt)
        self.axes = model.jnt_axis[1:]
        #: Index among the moving bodies of the one that a joint moves.
        self.moved = [moving.index(model.jnt_bodyid[j]) for j in joints]
        self.limits = limits

    def efforts(self, p: np.ndarray, R: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Joint efforts of poses of bodies and tip, the tip last, and joint rates (m, n)."""
        count = len(self.bodies)
        com = p[:, :count] + np.einsum("mbij,bj->mbi", R[:, :count], self.com)
        mass = self.mass.sum()
        centre = np.einsum("b,mbi->mi", self.mass, com) / mass
        inertia = R[:, :count] @ self.inertia @ R[:, :count].swapaxes(-1, -2)
        # About the system's centre of mass.
        arm = com - centre[:, None]
        square = np.einsum("mbi,mbi->mb", arm, arm)[..., None, None] * np.eye(3)
        about = inertia + self.mass[:, None, None] * (square - arm[..., :, None] * arm[..., None, :])
        total = about.sum(axis=1)
        # Of the links from each joint outward.
        outer_mass = self.mass[::-1].cumsum()[::-1][self.moved]
        moment = (self.mass[:, None] * arm)[:, ::-1].cumsum(axis=1)[:, ::-1][:, self.moved]
        outer = about[:, ::-1].cumsum(axis=1)[:, ::-1][:, self.moved]
        axes = np.einsum("mbij,bj->mbi", R[:, self.moved], self.axes)
        hinge = p[:, self.moved] - centre[:, None]
        linear = cross(axes, moment - outer_mass[:, None] * hinge)
        # About the centre of mass: the inertia there times the axis, less the moment of the hinge's velocity.
        angular = np.einsum("mbij,mbj->mbi", outer, axes) - cross(moment, cross(axes, hinge))
        reaction = np.linalg.solve(total, angular.swapaxes(-1, -2)).swapaxes(-1, -2)
        tip = p[:, count] - centre
        J_linear = cross(axes, tip[:, None] - hinge) - linear / mass - cross(reaction, np.broadcast_to(tip[:, None], reaction.shape))
        J_angular = axes - reaction
        force, torque = self.wrench(p[:, count], R[:, count])
        efforts = np.einsum("mji,mi->mj", J_linear, K_P * force) + np.einsum("mji,mi->mj", J_angular, K_O * torque)
        return np.clip(efforts - K_V * qd, -self.limits, self.limits)

    def wrench(self, p: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Saturated deviations of position and attitude."""
        off = self.goal - p
        distance = np.linalg.norm(off, axis=-1, keepdims=True)
        force = off * np.minimum(1.0, E_P_MAX / np.maximum(distance, 1e-300))
        e, d = R.swapaxes(-1, -2), np.broadcast_to(self.goal_R.T, R.shape)
        turn = 0.5 * cross(e, d).sum(axis=-2)
        size = np.sqrt(((d - e) ** 2).sum(axis=(-1, -2)))[..., None] / np.sqrt(2.0)
        return force, turn * np.minimum(1.0, E_O_MAX / np.maximum(size, 1e-300))


class Poses:
    """Poses of the moving bodies and of the tip of many robots: a serial chain."""

    def __init__(self, model: mujoco.MjModel, bodies: list[int]) -> None:
        self.chain = [*bodies[1:], model.body("tool0").id]
        self.position = model.body_pos[self.chain]
        self.rotation = matrices(model.body_quat[self.chain])
        for before, body in zip(bodies, self.chain):
            if model.body_parentid[body] != before:
                raise SystemExit("the robot is no serial chain")
        self.skew = []
        for j in range(1, model.njnt):
            x, y, z = model.jnt_axis[j]
            self.skew.append(np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]))

    def of(self, qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (m, bodies + 1, 3) and rotation matrices of positions (m, 7 + n)."""
        p, R = [qpos[:, :3]], [matrices(qpos[:, 3:7])]
        sines, cosines = np.sin(qpos[:, 7:]), np.cos(qpos[:, 7:])
        for k, (position, rotation) in enumerate(zip(self.position, self.rotation)):
            p.append(p[-1] + R[-1] @ position)
            turned = R[-1] @ rotation
            if k < len(self.skew):
                K = self.skew[k]
                turn = np.eye(3) + sines[:, k, None, None] * K + (1 - cosines[:, k, None, None]) * (K @ K)
                turned = turned @ turn
            R.append(turned)
        return np.stack(p, axis=1), np.stack(R, axis=1)


class Peer:
    """Robots on MuJoCo."""

    def __init__(self, robot: fuyu.Model, count: int, substeps: int, seed: int = 1) -> None:
        xml = mjcf(robot.urdf, PERIOD / substeps)
        self.model, self.substeps = mujoco.MjModel.from_xml_string(xml), substeps
        self.data = mujoco.MjData(self.model)
        self.law = Law(self.model, GOAL, matrices(GOAL_XYZW[[3, 0, 1, 2]]), robot.effort_limits)
        self.poses = Poses(self.model, self.law.bodies)
        random = np.random.default_rng(seed)
        self.q = POSTURE + random.normal(size=(count, 6)) * 0.035
        spin = random.normal(size=(count, 3))
        self.spin = 0.0005 * spin / np.linalg.norm(spin, axis=1, keepdims=True)
        self.roll = mujoco.rollout.Rollout(nthread=0)

    def start(self) -> np.ndarray:
        """States at the start: time, positions, velocities."""
        count = len(self.q)
        base = np.tile([0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (count, 1))
        return np.hstack([base, self.q, np.zeros((count, 3)), self.spin, np.zeros((count, 6))])

    def efforts(self, state: np.ndarray) -> np.ndarray:
        """The law at states."""
        p, R = self.poses.of(state[:, 1:14])
        return self.law.efforts(p, R, state[:, 20:])

    def run(self, periods: int) -> np.ndarray:
        """The closed loops for some periods; returns the last states."""
        state = self.start()
        for _ in range(periods):
            held = np.repeat(self.efforts(state)[:, None, :], self.substeps, axis=1)
            states, _ = self.roll.rollout(self.model, [self.data], state, held)
            state = states[:, -1]
        return state

    def plant(self, periods: int) -> None:
        """The same robots without a law, in one call."""
        self.roll.rollout(self.model, [self.data], self.start(), np.zeros((len(self.q), periods * self.substeps, 6)))


class Own:
    """The same robots on fuyu's batch, under the same law in numpy: to compare integrators."""

    def __init__(self, robot: fuyu.Model, peer: Peer, method: str, substeps: int) -> None:
        self.batch, self.peer, self.substeps = fuyu.Batch(robot, len(peer.q), method=method), peer, substeps
        for k, (q, w) in enumerate(zip(peer.q, peer.spin)):
            self.batch.set_state(k, fuyu.State(robot, q, angular_velocity=w))

    def run(self, periods: int) -> np.ndarray:
        """The closed loops for some periods; returns the attitudes of the bases, w, x, y, z."""
        batch, identity = self.batch, np.zeros((len(self.peer.q), 3))
        for _ in range(periods):
            wxyz = batch.attitude[:, [3, 0, 1, 2]]
            # The law does not depend on where the world is: poses from the base, the goal in the world.
            p, R = self.peer.poses.of(np.hstack([identity, wxyz, batch.q]))
            p = p + self.base_positions()[:, None]
            batch.step(PERIOD / self.substeps, self.peer.law.efforts(p, R, batch.qd), steps=self.substeps)
        return batch.attitude[:, [3, 0, 1, 2]].copy()

    def base_positions(self) -> np.ndarray:
        """Positions of the bases in the world."""
        wxyz = self.batch.attitude[:, [3, 0, 1, 2]]
        own = self.batch.model.center_of_mass(self.batch.q)
        return self.batch.com - np.einsum("mij,mj->mi", matrices(wxyz), own)


def angle(a: np.ndarray, b: np.ndarray) -> float:
    """Largest angle between attitudes [rad]."""
    w = np.abs(np.einsum("mi,mi->m", a, b)) / (np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1))
    imaginary = a[:, :1] * b[:, 1:] - b[:, :1] * a[:, 1:] - cross(a[:, 1:], b[:, 1:])
    return float(2 * np.arctan2(np.linalg.norm(imaginary, axis=1), w).max())


def check_law(robot: fuyu.Model, peer: Peer) -> float:
    """Largest difference from the efforts of fuyu's controller at random states, relative to the largest effort."""
    random, worst = np.random.default_rng(3), 0.0
    for _ in range(10):
        q, qd = POSTURE + random.normal(size=6) * 0.3, random.normal(size=6) * 0.02
        controller = fuyu.Controller(
            robot, "transpose_jacobian", k_p=K_P, k_o=K_O, k_v=K_V, e_p_max=E_P_MAX, e_o_max=E_O_MAX
        )
        expected = controller.update(0.0, q, qd, goal=(GOAL, GOAL_XYZW))
        state = np.hstack([[0.0, 0, 0, 0, 1, 0, 0, 0], q, np.zeros(6), qd])[None]
        found = peer.efforts(state)[0]
        worst = max(worst, abs(found - np.clip(expected, -robot.effort_limits, robot.effort_limits)).max() / abs(expected).max())
    return worst


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--runs", type=int, default=256, help="runs of a round: MuJoCo's robots in a call")
    options.add_argument("--rounds", type=int, default=7)
    options.add_argument("--seconds", type=float, default=60.0, help="simulated time of a run")
    options.add_argument("--campaign", default=str(ROOT / "config/campaigns/positioning.yaml"))
    options.add_argument("--fuyu", default=str(ROOT / "target/release/fuyu"), help="the executable")
    given = options.parse_args()
    periods, runs = round(given.seconds / PERIOD), given.runs
    robot = fuyu.Model.from_urdf("package://fuyu/urdf/servicer.urdf")
    peer = Peer(robot, runs, 1)
    print(f"plants agree to {check(robot.urdf, mjcf(robot.urdf, PERIOD)):.1e}, laws to {check_law(robot, peer):.1e}", flush=True)

    few = 8
    reference = Own(robot, Peer(robot, few, 1), "dop8", 8).run(periods)
    own_error = angle(Own(robot, Peer(robot, few, 1), "rk4", 1).run(periods), reference)
    print(f"error of the base's attitude after {given.seconds:.0f} s: fuyu, 1 step per period: {own_error:.1e} rad")
    equal, errors = None, {}
    for substeps in (1, 2, 3, 4, 6, 8, 16, 32):
        errors[substeps] = angle(Peer(robot, few, substeps).run(periods)[:, 4:8], reference)
        print(f"  MuJoCo, {substeps} steps per period: {errors[substeps]:.1e} rad", flush=True)
        if errors[substeps] <= 2 * own_error:
            equal = substeps
            break
    text = Path(given.campaign).read_text()
    programs = {
        "fuyu campaign": lambda: campaign(given.fuyu, text, runs, given.seconds),
        "fuyu campaign, tip alone": lambda: campaign(given.fuyu, with_tip_alone(text), runs, given.seconds),
        "rollout and law, 1 step per period": lambda: peer.run(periods),
        "rollout, plant alone, 1 step per period": lambda: peer.plant(periods),
    }
    if equal not in (1, None):
        accurate = Peer(robot, runs, equal)
        programs[f"rollout and law, {equal} steps per period"] = lambda: accurate.run(periods)
    found: dict[str, list[float]] = {name: [] for name in programs}
    for _ in range(given.rounds):
        for name, run in programs.items():
            start = processor_time()
            run()
            found[name].append((processor_time() - start) / runs)
    for name, times in found.items():
        line = f"{name:42} {1e3 * statistics.median(times):8.2f} ms a run"
        for own in ["fuyu campaign", "fuyu campaign, tip alone"]:
            ratios = [a / b for a, b in zip(times, found[own])]
            line += f"   {statistics.median(ratios):6.2f} ({min(ratios):.2f}-{max(ratios):.2f}) x {own}"
        print(line)


def processor_time() -> float:
    """Of this process and of those that it has started and that have ended [s]."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def with_tip_alone(text: str) -> str:
    """The campaign that keeps the errors of the tip at the end, and nothing else."""
    text, count = re.subn(r"(?ms)^keep:\n.*?(?=^\S|\Z)", "keep: {results: [tip_position_error, tip_attitude_error]}\n", text)
    if count != 1:
        raise SystemExit("the campaign has no section keep")
    return text


def campaign(fuyu_command: str, text: str, runs: int, seconds: float) -> None:
    """The campaign on one processor, into a folder that is removed, with all that belongs to it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "campaign.yaml"
        path.write_text(text + f"\nduration: {seconds}\n")
        run = [fuyu_command, "campaign", "run", str(path), "--output", f"{folder}/out", "--runs", str(runs)]
        subprocess.run([*run, "--jobs", "1", "--json"], check=True, stdout=subprocess.DEVNULL)


if __name__ == "__main__":
    main()
