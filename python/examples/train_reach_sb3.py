"""PPO of stable-baselines3 learns fuyu/Reach-v0 on 256 robots that are stepped together.

    pip install "./python[gym]" stable-baselines3
    python python/examples/train_reach_sb3.py --steps 2000000 --draw curve.svg

Prints a row per evaluation: agent steps, seconds, mean distance at the end of an episode [m], share of successful episodes.
Learning on the processor suffices; torch from the Python Package Index brings the libraries of a graphics card too (5 GB), its builds for processors are smaller.
"""

from __future__ import annotations

import argparse
import json
import time
from typing import Any

import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from fuyu.gym import ReachVectorEnv


class Robots(VecEnv):
    """The vectorised environment as stable-baselines3 wants it."""

    def __init__(self, count: int, **settings: Any) -> None:
        self.envs = ReachVectorEnv(count, autoreset_mode=AutoresetMode.SAME_STEP, **settings)
        super().__init__(count, self.envs.single_observation_space, self.envs.single_action_space)
        self.seed_of_next_reset: int | None = None

    def reset(self):
        observations, _ = self.envs.reset(seed=self.seed_of_next_reset)
        self.seed_of_next_reset = None
        return observations

    def seed(self, seed: int | None = None):
        self.seed_of_next_reset = seed
        return [seed] * self.num_envs

    def step_async(self, actions: np.ndarray) -> None:
        self.actions = actions

    def step_wait(self):
        observations, rewards, _, truncated, infos = self.envs.step(self.actions)
        each: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if truncated.any():
            last = infos["final_info"]
            for k in np.flatnonzero(truncated):
                each[k] = {
                    "terminal_observation": infos["final_obs"][k],
                    "TimeLimit.truncated": True,
                    "distance": last["distance"][k],
                    "is_success": last["is_success"][k],
                }
        return observations, rewards.astype(np.float32), truncated, each

    def close(self) -> None:
        self.envs.close()

    def get_attr(self, attr_name, indices=None):
        return [getattr(self.envs, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name, value, indices=None) -> None:
        raise NotImplementedError

    def env_method(self, method_name, *args, indices=None, **kwargs):
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class, indices=None):
        return [False] * self.num_envs


def evaluate(agent: PPO, count: int = 200) -> tuple[float, float]:
    """Mean distance at the end [m] and share of successes of `count` episodes, without exploration."""
    envs = ReachVectorEnv(count, autoreset_mode=AutoresetMode.DISABLED)
    observations, _ = envs.reset(seed=12345)
    for _ in range(envs.task.episode_steps):
        actions, _ = agent.predict(observations, deterministic=True)
        observations, *_, infos = envs.step(actions)
    return float(infos["distance"].mean()), float(infos["is_success"].mean())


class Curve(BaseCallback):
    """Evaluates after every few rollouts."""

    def __init__(self, every: int) -> None:
        super().__init__()
        self.every, self.rollouts, self.rows = every, 0, []
        self.start = time.perf_counter()

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        if self.rollouts % self.every == 0:
            self.add()
        self.rollouts += 1

    def add(self) -> None:
        distance, success = evaluate(self.model)
        row = (self.num_timesteps, round(time.perf_counter() - self.start, 1), round(distance, 4), round(success, 3))
        self.rows.append(row)
        print("%9d steps %7.1f s   distance %.3f m   success %.2f" % row, flush=True)


def draw(rows: list[tuple[int, float, float, float]], path: str) -> None:
    """Distance and successes of the evaluations over the time of learning."""
    from matplotlib.figure import Figure

    minutes = [row[1] / 60 for row in rows]
    figure = Figure(figsize=(6.4, 2.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.semilogy(minutes, [row[2] for row in rows])
    left.set(xlabel="time [min]", ylabel="distance at the end [m]")
    right.plot(minutes, [row[3] for row in rows])
    right.set(xlabel="time [min]", ylabel="successful episodes", ylim=(0, 1.02))
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.set_xlim(left=0)
    figure.savefig(path, metadata={"Date": None})


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--steps", type=int, default=2_000_000, help="agent steps of all robots together")
    options.add_argument("--robots", type=int, default=256)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--output", help="write the learning curve as JSON to this file")
    options.add_argument("--draw", help="draw the learning curve into this file (.svg, .png; needs matplotlib)")
    given = options.parse_args()
    torch.set_num_threads(2)
    agent = PPO(
        "MlpPolicy",
        Robots(given.robots),
        n_steps=100,
        batch_size=3200,
        n_epochs=5,
        gamma=0.97,
        gae_lambda=0.95,
        learning_rate=1e-3,
        policy_kwargs={"net_arch": [64, 64], "log_std_init": -0.5},
        seed=given.seed,
        device="cpu",
    )
    curve = Curve(every=4)
    agent.learn(given.steps, callback=curve)
    curve.add()
    if given.output:
        with open(given.output, "w") as file:
            json.dump({"columns": ["steps", "seconds", "distance", "success"], "rows": curve.rows}, file)
    if given.draw:
        draw(curve.rows, given.draw)


if __name__ == "__main__":
    main()
