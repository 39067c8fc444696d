"""The environments: one robot, or many that are stepped together."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from .._fuyu import InputError
from .tasks import SUBSTEPS, TIME_STEP, Reach, Task, Track


def _spaces(task: Task) -> tuple[gymnasium.spaces.Box, gymnasium.spaces.Box]:
    observation = gymnasium.spaces.Box(-task.LARGEST, task.LARGEST, (task.size,), np.float32)
    action = gymnasium.spaces.Box(-1.0, 1.0, (task.model.dof,), np.float32)
    return observation, action


def _actions(given: Any, shape: tuple[int, int]) -> np.ndarray:
    actions = np.asarray(given, dtype=float).reshape((1, -1) if shape[0] == 1 else np.shape(given))
    if actions.shape != shape:
        raise InputError(f"`action` has the shape {np.shape(given)}; it must be {shape if shape[0] > 1 else shape[1:]}")
    if not np.isfinite(actions).all():
        raise InputError("`action` has a number that is not finite")
    return actions


class _OneEnv(gymnasium.Env):
    metadata: dict[str, Any] = {"render_modes": [], "render_fps": 1 / (TIME_STEP * SUBSTEPS)}
    task_type: type[Task]

    def __init__(self, render_mode: str | None = None, **settings: Any) -> None:
        self.render_mode = render_mode
        self.task = self.task_type(1, **settings)
        self.observation_space, self.action_space = _spaces(self.task)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        super().reset(seed=seed)
        if seed is not None:
            # The same seed gives the same robot as well.
            self.task.batches = []
        self.task.reset(np.arange(1), self.np_random)
        return self.task.observe(self.np_random)[0], self._info()

    def step(self, action: np.ndarray):
        actions = _actions(action, (1, self.task.model.dof))
        self.task.advance(actions)
        reward = float(self.task.rewards(actions)[0])
        is_over = bool(self.task.steps[0] >= self.task.episode_steps)
        return self.task.observe(self.np_random)[0], reward, False, is_over, self._info()

    def _info(self) -> dict[str, Any]:
        distance = float(self.task.distance[0])
        return {"distance": distance, "is_success": distance < self.task.success_distance}


class _ManyEnvs(VectorEnv):
    task_type: type[Task]

    def __init__(
        self,
        num_envs: int = 1,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **settings: Any,
    ) -> None:
        self.num_envs, self.render_mode = num_envs, render_mode
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {**_OneEnv.metadata, "autoreset_mode": self.autoreset_mode}
        self.task = self.task_type(num_envs, **settings)
        self.single_observation_space, self.single_action_space = _spaces(self.task)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._over = np.zeros(num_envs, dtype=bool)

    def reset(self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None):
        if isinstance(seed, (list, tuple)):
            given = [s for s in seed if s is not None]
            seed = int(np.random.SeedSequence(given).generate_state(1)[0]) if given else None
        super().reset(seed=seed)
        if seed is not None:
            self.task.batches = []
        mask = (options or {}).get("reset_mask")
        which = np.arange(self.num_envs) if mask is None else np.flatnonzero(mask)
        self.task.reset(which, self.np_random)
        self._over[which] = False
        return self.task.observe(self.np_random), self._infos()

    def step(self, actions: np.ndarray):
        actions = _actions(actions, (self.num_envs, self.task.model.dof))
        before = self._over
        self.task.advance(actions)
        rewards = self.task.rewards(actions)
        if self.autoreset_mode == AutoresetMode.NEXT_STEP and before.any():
            self.task.reset(np.flatnonzero(before), self.np_random)
            rewards[before] = 0.0
        over = self.task.steps >= self.task.episode_steps
        self._over = over
        observations, infos = self.task.observe(self.np_random), self._infos()
        if self.autoreset_mode == AutoresetMode.SAME_STEP and over.any():
            which = np.flatnonzero(over)
            final = np.full(self.num_envs, None, dtype=object)
            for k in which:
                final[k] = observations[k].copy()
            infos = {"final_obs": final, "_final_obs": over, "final_info": infos, "_final_info": over}
            self.task.reset(which, self.np_random)
            observations = self.task.observe(self.np_random)
            infos |= self._infos()
        return observations, rewards, np.zeros(self.num_envs, dtype=bool), over, infos

    def _infos(self) -> dict[str, Any]:
        distance = self.task.distance.copy()
        every = np.ones(self.num_envs, dtype=bool)
        success = distance < self.task.success_distance
        return {"distance": distance, "_distance": every, "is_success": success, "_is_success": every}


class ReachEnv(_OneEnv):
    """The tip of a free-floating servicer reaches a point that rests in inertial space.

    Action, shape (n,), in [-1, 1]: rates of the joints, as a share of `max_rate` [rad/s], for `substeps` steps of 0.01 s, 10 by default. Observation, shape (2 n + 6,):
    joint positions from the middle posture [rad], joint rates / max_rate, vector from tip to goal [m] and velocity of the tip
    [m/s] in base axes. Reward: minus the distance [m], plus 1 within `success_distance` [m], less a little for large actions.
    An episode is truncated after `episode_steps`. `randomization` is a `Randomization` or a dict of its fields. `info` has
    `distance` [m] and `is_success`.
    """

    task_type = Reach


class TrackEnv(_OneEnv):
    """The tip of a free-floating servicer follows a point on a body that spins about a principal axis and drifts.

    As `ReachEnv`; the observed velocity of the tip is that against the point, and three more elements are the velocity of the
    point in base axes [m/s].
    """

    task_type = Track


class ReachVectorEnv(_ManyEnvs):
    """Many of `ReachEnv`, stepped together on all processors.

    `autoreset_mode` is that of Gymnasium: NextStep, SameStep or Disabled.
    """

    task_type = Reach


class TrackVectorEnv(_ManyEnvs):
    """Many of `TrackEnv`, stepped together on all processors."""

    task_type = Track
