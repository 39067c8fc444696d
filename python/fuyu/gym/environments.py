"""The environments: one robot, or many that are stepped together."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from .._fuyu import InputError
from .capture import Capture
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


def _reset(options: dict[str, Any] | None, count: int) -> np.ndarray:
    """Indices of the environments that `options` resets: those of `reset_mask`, or all."""
    given = (options or {}).get("reset_mask")
    if given is None:
        return np.arange(count)
    mask = np.asarray(given)
    if mask.shape != (count,) or mask.dtype != bool:
        raise InputError(f"`reset_mask` has the shape {mask.shape} and the type {mask.dtype}; it must be ({count},), bool")
    return np.flatnonzero(mask)


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
        terminated = bool(self.task.terminated[0])
        truncated = not terminated and bool(self.task.steps[0] >= self.task.episode_steps)
        return self.task.observe(self.np_random)[0], reward, terminated, truncated, self._info()

    def _info(self) -> dict[str, Any]:
        rows = {name: values[0] for name, values in self.task.infos().items()}
        return {name: row.item() if np.ndim(row) == 0 else row for name, row in rows.items()}


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
        which = _reset(options, self.num_envs)
        super().reset(seed=seed)
        # The same seed gives the same robots as well. Those that are not reset stay as they are.
        if seed is not None and len(which) == self.num_envs:
            self.task.batches = []
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
        terminated = self.task.terminated.copy()
        truncated = ~terminated & (self.task.steps >= self.task.episode_steps)
        over = terminated | truncated
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
        return observations, rewards, terminated, truncated, infos

    def _infos(self) -> dict[str, Any]:
        infos = self.task.infos()
        return infos | {f"_{name}": np.ones(self.num_envs, dtype=bool) for name in infos}


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


class CaptureEnv(_OneEnv):
    """The tip of a free-floating servicer latches on to a grasp frame of a free body that tumbles and drifts.

    Actions are those of `ReachEnv`, but the drives know the robot's inertia: each joint follows its rate with a time constant of 0.1 s. After
    each action the latch closes if the grasp frame is within `success_distance` [m] and `success_angle` [rad] of the tip, and moves
    against it with no more than `success_speed` [m/s] and `success_rate` [rad/s]: an impulse joins both bodies by a weld, in which the
    joints turn freely, and the episode terminates. `target` is the body's description, `grasp_position` [m] and
    `grasp_orientation` (x, y, z, w) are those of the grasp frame in its root link, by default a post of the client satellite.

    Observation, shape (2 n + 18,): joint positions from the middle posture [rad], joint rates / max_rate, then vectors in base axes: from
    tip to grasp frame [m], velocity of the tip against the grasp frame [m/s], velocity of the grasp frame [m/s], rotation vector that
    turns the tip's axes to those of the grasp frame [rad], angular velocity of the tip against the body [rad/s], angular velocity of
    the body [rad/s].

    Reward: minus the distance [m], minus 0.2 times the angle [rad], less a little for large actions; for the capture 10, less the size of
    its linear impulse [N s]. `randomization` is a `CaptureRandomization` or a dict of its fields. `info` has `distance` [m], `angle`
    [rad], `speed` [m/s], `rate` [rad/s], `is_success`, `latch` ("closed", or the first limit that keeps it open: "distance", "angle",
    "speed", "rate"), `impulse`, shape (6,): force and torque impulse on the tip in world axes [N s, N m s], and `energy_lost` [J],
    both zero before the capture.
    """

    task_type = Capture


class ReachVectorEnv(_ManyEnvs):
    """Many of `ReachEnv`, stepped together on all processors.

    `autoreset_mode` is that of Gymnasium: NextStep, SameStep or Disabled.
    """

    task_type = Reach


class TrackVectorEnv(_ManyEnvs):
    """Many of `TrackEnv`, stepped together on all processors."""

    task_type = Track


class CaptureVectorEnv(_ManyEnvs):
    """Many of `CaptureEnv`, stepped together on all processors. Without automatic resets robot and body go on as one."""

    task_type = Capture
