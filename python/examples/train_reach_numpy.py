"""A linear policy learns fuyu/Reach-v0 with numpy alone, by augmented random search.

H. Mania, A. Guy, B. Recht, Simple random search of static linear policies is competitive for reinforcement learning, NeurIPS 2018
(version V2-t). All perturbed policies are tried at the same time, each by some robots of one vectorised environment.

    pip install "./python[gym]"
    python python/examples/train_reach_numpy.py
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from gymnasium.vector import AutoresetMode

from fuyu.gym import ReachVectorEnv


class Search:
    """The policy is `action = clip(W (observation - mean) / deviation)`."""

    def __init__(self, directions: int = 24, robots_each: int = 8, seed: int = 1, **settings) -> None:
        self.directions, self.each = directions, robots_each
        self.random = np.random.default_rng(seed)
        self.envs = ReachVectorEnv(2 * directions * robots_each, autoreset_mode=AutoresetMode.DISABLED, **settings)
        self.envs.reset(seed=seed)
        size, dof = self.envs.single_observation_space.shape[0], self.envs.single_action_space.shape[0]
        self.weights = np.zeros((dof, size))
        self.mean, self.square, self.seen = np.zeros(size), np.ones(size), 1.0

    @property
    def deviation(self) -> np.ndarray:
        return np.sqrt(np.maximum(self.square - self.mean**2, 1e-4))

    def rollouts(self, weights: np.ndarray, envs: ReachVectorEnv, learn: bool) -> tuple[np.ndarray, dict]:
        """Sums of rewards of one episode per robot; robot `i` has policy `weights[i]`."""
        observations, infos = envs.reset()
        total = np.zeros(envs.num_envs)
        for _ in range(envs.task.episode_steps):
            if learn:
                count = len(observations)
                share = count / (self.seen + count)
                self.mean += share * (observations.mean(0) - self.mean)
                self.square += share * ((observations**2).mean(0) - self.square)
                self.seen = min(self.seen + count, 1e5)
            normal = (observations - self.mean) / self.deviation
            actions = np.clip(np.einsum("nij,nj->ni", weights, normal), -1.0, 1.0)
            observations, rewards, _, _, infos = envs.step(actions)
            total += rewards
        return total, infos

    def improve(self, step: float = 0.03, noise: float = 0.05, best: int = 12) -> float:
        """One update; returns the mean sum of rewards of the tried policies."""
        deltas = self.random.normal(size=(self.directions, *self.weights.shape))
        policies = np.concatenate([self.weights + noise * deltas, self.weights - noise * deltas])
        total, _ = self.rollouts(np.repeat(policies, self.each, axis=0), self.envs, learn=True)
        plus, minus = total.reshape(2, self.directions, self.each).mean(axis=2)
        chosen = np.argsort(-np.maximum(plus, minus))[:best]
        spread = np.concatenate([plus[chosen], minus[chosen]]).std() + 1e-9
        self.weights += step / (best * spread) * np.einsum("n,nij->ij", plus[chosen] - minus[chosen], deltas[chosen])
        return float(total.mean())

    def evaluate(self, count: int = 200) -> tuple[float, float]:
        """Mean distance at the end [m] and share of successes of `count` episodes, always the same."""
        envs = ReachVectorEnv(count, autoreset_mode=AutoresetMode.DISABLED)
        envs.reset(seed=12345)
        _, infos = self.rollouts(np.broadcast_to(self.weights, (count, *self.weights.shape)), envs, learn=False)
        return float(infos["distance"].mean()), float(infos["is_success"].mean())


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--updates", type=int, default=200)
    options.add_argument("--seed", type=int, default=1)
    given = options.parse_args()
    search, start = Search(seed=given.seed), time.perf_counter()
    for update in range(given.updates + 1):
        if update % 20 == 0:
            distance, success = search.evaluate()
            seconds = time.perf_counter() - start
            print(f"{update:4} updates {seconds:6.1f} s   distance {distance:.3f} m   success {success:.2f}", flush=True)
        search.improve()


if __name__ == "__main__":
    main()
