"""Vectorised environments of the servicer: fuyu against Gymnasium's MuJoCo environments, mujoco.rollout and MuJoCo Warp on the CPU, in one run.

All simulate the same robot, a free base with six joints, with RK4 and steps of 10 ms, without contacts. The programs alternate, and the ratios
are those of neighbours in time: medians of `--rounds` of them. MuJoCo computes more in a step than accelerations
(sensors, constraints); the plant has none. MuJoCo Warp computes in single precision, and on a CPU on one processor; its kernels are
compiled first, which takes minutes. Without the package it is left out.

    pip install "./python[gym]" mujoco mujoco-warp
    python python/benches/vector_env.py
"""

from __future__ import annotations

import argparse
import os
import statistics
import time

import gymnasium
import mujoco
import mujoco.rollout
import numpy as np

import fuyu
import fuyu.gym

from mujoco_model import check, mjcf

try:
    import warp

    warp.config.log_level = warp.LOG_WARNING
    import mujoco_warp
except ImportError:
    mujoco_warp = None

DT = 0.01


class MujocoServicer(gymnasium.Env):
    """One servicer as a Gymnasium environment on MuJoCo: one step of 10 ms per action, joints and tip observed."""

    def __init__(self, xml: str) -> None:
        self.model = mujoco.MjModel.from_xml_string(xml)
        self.data = mujoco.MjData(self.model)
        self.tip = self.model.body("tool0").id
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (18,), np.float32)
        self.action_space = gymnasium.spaces.Box(-1, 1, (6,), np.float32)

    def _observe(self) -> np.ndarray:
        data = self.data
        tip = data.xpos[self.tip]
        return np.concatenate([data.qpos[7:], data.qvel[6:], tip, data.cvel[self.tip][3:]]).astype(np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        mujoco.mj_resetData(self.model, self.data)
        return self._observe(), {}

    def step(self, action):
        self.data.ctrl[:] = action
        mujoco.mj_step(self.model, self.data)
        return self._observe(), -float(np.linalg.norm(self.data.xpos[self.tip])), False, False, {}


class WarpServicers:
    """Many servicers on MuJoCo Warp on the CPU, under efforts that are held."""

    def __init__(self, model: mujoco.MjModel, efforts: np.ndarray) -> None:
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        with warp.ScopedDevice("cpu"):
            self.model = mujoco_warp.put_model(model)
            self.data = mujoco_warp.put_data(model, data, nworld=len(efforts))
            warp.copy(self.data.ctrl, warp.array(efforts.astype(np.float32), dtype=warp.float32))

    def step(self) -> np.ndarray:
        """One step of all; returns their positions."""
        with warp.ScopedDevice("cpu"):
            mujoco_warp.step(self.model, self.data)
            warp.synchronize()
            return self.data.qpos.numpy()


def timed(run, states: int, clock) -> float:
    """Steps per second of `clock`, of all states together."""
    start = clock()
    run()
    return states / (clock() - start)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--envs", type=int, default=4096)
    options.add_argument("--rounds", type=int, default=5)
    options.add_argument("--processor-time", action="store_true", help="of all threads, instead of wall time: where others use the machine")
    given = options.parse_args()
    clock = time.process_time if given.processor_time else time.perf_counter
    robot = fuyu.Model.from_urdf("package://fuyu/urdf/servicer.urdf")
    xml = mjcf(robot.urdf, DT)
    print(f"plants agree to {check(robot.urdf, xml):.1e}; {os.cpu_count()} processors, {given.envs} servicers")
    n, m = robot.dof, given.envs
    actions = np.random.default_rng(2).uniform(-1, 1, (m, n))

    # Raw steps: states and efforts in, states out.
    batch = fuyu.Batch(robot, m, method="rk4")
    model = mujoco.MjModel.from_xml_string(xml)
    threads = [mujoco.MjData(model) for _ in range(os.cpu_count() or 1)]
    data = mujoco.MjData(model)
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    start = np.zeros(size)
    mujoco.mj_getState(model, data, start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    starts, steps = np.tile(start, (m, 1)), 10
    controls = np.repeat(actions[:, None, :], steps, axis=1)
    roll = mujoco.rollout.Rollout(nthread=len(threads))

    # Environments, with observations and rewards.
    envs = fuyu.gym.ReachVectorEnv(m, episode_steps=10**9)
    envs.reset(seed=1)
    few = 16
    peers = gymnasium.vector.SyncVectorEnv([lambda: MujocoServicer(xml)] * few)
    peers.reset(seed=1)

    def many(run, count):
        return lambda: [run() for _ in range(count)]

    programs = {
        "fuyu.Batch, 1 step a call": (many(lambda: batch.step(DT, actions), 10), 10 * m),
        "fuyu.Batch, 10 steps a call": (lambda: batch.step(DT, actions, steps=10), 10 * m),
        "fuyu.gym, 1 step an action": (many(lambda: single.step(actions), 10), 10 * m),
        "fuyu.gym, 10 steps an action": (many(lambda: envs.step(actions), 2), 20 * m),
        "fuyu.gym, Capture, 10 steps an action": (many(lambda: captures.step(actions), 2), 20 * m),
        "mujoco.rollout, all processors": (lambda: roll.rollout(model, threads, starts, controls), steps * m),
        f"Gymnasium, {few} MuJoCo environments": (many(lambda: peers.step(actions[:few]), 100), 100 * few),
    }
    single = fuyu.gym.ReachVectorEnv(m, episode_steps=10**9, substeps=1)
    single.reset(seed=1)
    captures = fuyu.gym.CaptureVectorEnv(m, episode_steps=10**9)
    captures.reset(seed=1)
    if mujoco_warp is None:
        print("MuJoCo Warp is not installed: left out")
    else:
        print("MuJoCo Warp compiles its kernels", flush=True)
        warps = WarpServicers(model, actions)
        moved, one = warps.step()[m - 1], mujoco.MjData(model)
        one.ctrl[:] = actions[m - 1]
        mujoco.mj_step(model, one)
        if abs(moved - one.qpos).max() > 1e-5:
            raise SystemExit("MuJoCo Warp moves otherwise than MuJoCo")
        programs["MuJoCo Warp, one processor"] = (warps.step, m)
    found: dict[str, list[float]] = {name: [] for name in programs}
    for _ in range(given.rounds + 1):
        for name, (run, states) in programs.items():
            found[name].append(timed(run, states, clock))
    # The first round warms up.
    found = {name: rates[1:] for name, rates in found.items()}
    peers_names = [name for name in found if not name.startswith("fuyu")]
    print(f"medians of {given.rounds} rounds, load {os.getloadavg()[0]:.1f}")
    for name, rates in found.items():
        line = f"{name:38} {statistics.median(rates):12,.0f} steps/s"
        if name.startswith("fuyu"):
            for peer in peers_names:
                ratios = [a / b for a, b in zip(rates, found[peer])]
                line += f"   {statistics.median(ratios):6.1f} x {peer.split(',')[0]}"
        print(line)


if __name__ == "__main__":
    main()
