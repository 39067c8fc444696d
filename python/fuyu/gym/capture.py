"""The task of capturing a tumbling body."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .._fuyu import Batch, Latches, Model
from .dispersions import Dispersion, disperse
from .tasks import TIME_STEP, Randomization, Task, is_dispersed, require_positive, scaled


@dataclass(frozen=True)
class CaptureRandomization(Randomization):
    """`Randomization`, and dispersions of the body; the grasp frame begins where the goal is.

    - `target_velocity` [m/s]: of its centre of mass, each component in world axes.
    - `target_angular_velocity` [rad/s]: each component in its own axes.
    - `target_mass_scale`: factor of its mass and inertia, one per link. As `mass_scale`, drawn once for each of `robots` pairs.
    """

    target_velocity: Dispersion = field(default_factory=lambda: {"uniform": {"min": -0.01, "max": 0.01}})
    target_angular_velocity: Dispersion = field(default_factory=lambda: {"uniform": {"min": -0.04, "max": 0.04}})
    target_mass_scale: Dispersion = 1.0


class Capture(Task):
    """The goal is a grasp frame on a free body, to which the tip latches."""

    FURTHER = 4
    randomization_type = CaptureRandomization
    #: Reward of a capture, less 1 per N s of its impulse; share of the angle [1/rad].
    BONUS, TURN_WEIGHT = 10.0, 0.2
    #: Of the drives [1/s]: their time constant is 0.1 s.
    BANDWIDTH = 10.0

    def __init__(
        self,
        count: int,
        *,
        target: str = "package://fuyu/urdf/client.urdf",
        grasp_position: Any = (-0.75, 0.0, 0.0),
        grasp_orientation: Any = (0.0, 0.0, 0.0, 1.0),
        success_distance: float = 0.03,
        success_angle: float = 0.1,
        success_speed: float = 0.03,
        success_rate: float = 0.06,
        episode_steps: int = 200,
        **settings: Any,
    ) -> None:
        super().__init__(count, success_distance=success_distance, episode_steps=episode_steps, **settings)
        self.target = Model.from_urdf(target)
        self.grasp = {"position": grasp_position, "orientation": grasp_orientation}
        #: Largest value of each measure at which the latch closes, in this order.
        self.limits = {"distance": success_distance, "angle": success_angle, "speed": success_speed, "rate": success_rate}
        for name, value in self.limits.items():
            require_positive(f"success_{name}", value)
        self.latches: list[tuple[slice, Latches]] = []
        self.targets = np.zeros((count, 2 * self.target.dof + 19))
        self.targets[:] = Batch(self.target, 1).data
        self.separations, self.grasps = np.zeros((count, 12)), np.zeros((count, 13))
        self.impulses = np.zeros((count, 7))
        self.just_captured = np.zeros(count, dtype=bool)

    def has_many_robots(self) -> bool:
        return super().has_many_robots() or is_dispersed(self.randomization.target_mass_scale)

    def make_robots(self, random: np.random.Generator) -> None:
        super().make_robots(random)
        self.latches = []
        for rows, robots in self.batches:
            model = scaled(self.target, "target_mass_scale", self.randomization.target_mass_scale, random)
            targets = Batch(model, data=self.targets[rows], method="rk4")
            self.latches.append((rows, Latches(robots, targets, tip=self.tip, **self.grasp)))

    def place_goal(self, which: np.ndarray, poses: np.ndarray, random: np.random.Generator) -> None:
        shape = (len(which), 3)
        velocity = disperse("target_velocity", self.randomization.target_velocity, random, shape)
        spin = disperse("target_angular_velocity", self.randomization.target_angular_velocity, random, shape)
        for rows, latches in self.latches:
            own = (rows.start <= which) & (which < rows.stop)
            latches.place_targets(which[own] - rows.start, poses[own], velocity[own], spin[own])
        self.impulses[which] = 0.0
        self.just_captured[which] = False

    def move_bodies(self, rates: np.ndarray) -> None:
        # The inertia of the free-floating robot decouples the joints: each follows its rate in any posture.
        inertia = self.model.reduced_inertia(self.data[:, self.columns["q"]])
        gains = self.BANDWIDTH * self.scale[:, :, None] * inertia
        for rows, latches in self.latches:
            latches.servo(TIME_STEP, rates[rows], gains[rows], steps=self.substeps)

    def advance(self, actions: np.ndarray) -> None:
        super().advance(actions)
        ready = ~self.terminated & (self.obstacles() == "")
        self.just_captured = ready
        if not ready.any():
            return
        # The limits are checked above; the angle here may differ in rounding.
        distance, angle = (self.limits[name] * (1.0 + 1e-9) for name in ("distance", "angle"))
        for rows, latches in self.latches:
            pairs = np.flatnonzero(ready[rows])
            if len(pairs) > 0:
                found = latches.close(pairs, distance=distance, angle=angle)
                self.impulses[rows.start + pairs] = found
        self.terminated |= ready
        self.measure()

    def measure(self) -> None:
        for rows, latches in self.latches:
            latches.separations(out=self.separations[rows])
            latches.grasp_states(out=self.grasps[rows])
        self.error, self.velocity = self.separations[:, :3], -self.separations[:, 6:9]
        self.goal, self.goal_velocity = self.grasps[:, :3], self.grasps[:, 7:10]
        parts = self.separations.reshape(self.count, 4, 3)
        self.distance, self.angle, self.speed, self.rate = np.sqrt(np.einsum("ijk,ijk->ji", parts, parts))

    def further_vectors(self) -> list[np.ndarray]:
        return [self.goal_velocity, self.separations[:, 3:6], -self.separations[:, 9:], self.grasps[:, 10:]]

    def obstacles(self) -> np.ndarray:
        """The first limit that keeps each latch open, or ""; shape (count,)."""
        found = np.full(self.count, "", dtype="<U8")
        for name, limit in reversed(self.limits.items()):
            found[getattr(self, name) > limit] = name
        return found

    def infos(self) -> dict[str, np.ndarray]:
        measures = {name: getattr(self, name).copy() for name in self.limits}
        latch = np.where(self.terminated, "closed", self.obstacles())
        impulses = {"impulse": self.impulses[:, :6].copy(), "energy_lost": self.impulses[:, 6].copy()}
        return measures | {"is_success": self.terminated.copy(), "latch": latch} | impulses

    def rewards(self, actions: np.ndarray) -> np.ndarray:
        """See `CaptureEnv`; shape (count,)."""
        effort = np.einsum("ij,ij->i", actions, actions) / self.model.dof
        impulse = np.linalg.norm(self.impulses[:, :3], axis=1)
        bonus = self.just_captured * (self.BONUS - impulse)
        return bonus - self.distance - self.TURN_WEIGHT * self.angle - 0.05 * effort
