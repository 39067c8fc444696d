"""Many robots with one task each: what one environment and the vectorised ones share."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass, field, fields

import numpy as np

from .._fuyu import Batch, Controller, InputError, Model, State
from .dispersions import Dispersion, disperse

#: Step of the integration [s], and steps per action by default.
TIME_STEP, SUBSTEPS = 0.01, 10
#: Posture around which episodes begin [rad]: that of the scenario `positioning`.
POSTURE = np.radians([65.0, 99.0, -95.0, -22.0, 3.0, -42.0])


@dataclass(frozen=True)
class Randomization:
    """Dispersions of an episode: numbers, or mappings as `disperse` takes them.

    - `posture` [rad]: added to each joint of the initial posture.
    - `goal_offset` [rad]: the goal is where a fixed base would hold the tip with so much added to each joint.
    - `base_angular_velocity` [rad/s]: of the base at the start, each component.
    - `effort_scale`: factor of every joint effort, one per joint.
    - `observation_noise`: added to every observation, each step.
    - `mass_scale`: factor of mass and inertia, one per link. Drawn once for each of `robots` robots, which the environments share.
    """

    posture: Dispersion = field(default_factory=lambda: {"uniform": {"min": -0.3, "max": 0.3}})
    goal_offset: Dispersion = field(default_factory=lambda: {"uniform": {"min": -0.35, "max": 0.35}})
    base_angular_velocity: Dispersion = 0.0
    effort_scale: Dispersion = 1.0
    observation_noise: Dispersion = 0.0
    mass_scale: Dispersion = 1.0
    robots: int = 8

    @classmethod
    def of(cls, given: Randomization | dict | None) -> Randomization:
        """From the keywords of an environment."""
        if isinstance(given, cls):
            return given
        known = [f.name for f in fields(cls)]
        for name in given or {}:
            if name not in known:
                raise InputError(f"randomization: there is no '{name}'; there are {', '.join(known)}")
        return cls(**(given or {}))


def require_positive(name: str, value: float) -> None:
    """Refuses a setting that is not positive and finite."""
    if not (np.isfinite(value) and value > 0):
        raise InputError(f"{name} is {value}; it must be positive and finite")


def is_dispersed(scale: Dispersion) -> bool:
    """Whether a factor is anything but 1."""
    return isinstance(scale, Mapping) or scale != 1.0


def scaled(model: Model, name: str, scale: Dispersion, random: np.random.Generator) -> Model:
    """The model with mass and inertia of each link times a factor, drawn from `scale`; `name` is what errors call it."""
    if not is_dispersed(scale):
        return model
    factors = disperse(name, scale, random, (len(model.frame_names),))
    if (factors <= 0).any():
        raise InputError(f"{name} is {factors.min()}; it must be positive")
    robot = ElementTree.fromstring(model.urdf)
    links = [link.find("inertial") for link in robot.iter("link")]
    for inertial, factor in zip((i for i in links if i is not None), factors):
        for element, attributes in [
            (inertial.find("mass"), ["value"]),
            (inertial.find("inertia"), ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"]),
        ]:
            for name in attributes:
                if element is not None and name in element.attrib:
                    element.set(name, repr(float(element.get(name, "0")) * float(factor)))
    return Model.from_urdf(ElementTree.tostring(robot, encoding="unicode"), name="randomized robot")


class Task:
    """`count` robots. An action is a rate for each joint, as a share of `max_rate`, to which the drives damp the joints every 10 ms."""

    #: Number of further vectors that are observed.
    FURTHER = 0
    #: What `randomization` may have.
    randomization_type: type[Randomization] = Randomization
    #: Observations are within this; no episode comes near.
    LARGEST = 100.0

    def __init__(
        self,
        count: int,
        *,
        urdf: str = "package://fuyu/urdf/servicer.urdf",
        tip: str = "tool0",
        max_rate: float = 0.15,
        success_distance: float = 0.05,
        episode_steps: int = 100,
        substeps: int = SUBSTEPS,
        randomization: Randomization | dict | None = None,
    ) -> None:
        require_positive("max_rate", max_rate)
        require_positive("success_distance", success_distance)
        for name, value in [("num_envs", count), ("episode_steps", episode_steps), ("substeps", substeps)]:
            if value < 1:
                raise InputError(f"{name} is {value}; it must be at least 1")
        self.count, self.tip, self.substeps = count, tip, substeps
        self.period = TIME_STEP * substeps
        self.max_rate, self.success_distance, self.episode_steps = max_rate, success_distance, episode_steps
        self.randomization = self.randomization_type.of(randomization)
        self.model = Model.from_urdf(urdf)
        n = self.model.dof
        self.posture = POSTURE if n == len(POSTURE) else np.zeros(n)
        # The gains that damp the sampled joints without overshoot.
        self.k_v = Controller(self.model, tip=tip, sample_period=TIME_STEP).gains["k_v"]
        self.batches: list[tuple[slice, Batch]] = []
        self.data = np.zeros((count, 2 * n + 19))
        self.data[:] = State(self.model, self.posture).to_row()
        self.columns = Batch(self.model, 1).columns
        self.steps = np.zeros(count, dtype=np.int64)
        self.goal = np.zeros((count, 3))
        self.goal_velocity = np.zeros((count, 3))
        self.scale = np.ones((count, n))
        self.tips = np.zeros((count, 13))
        self.distance = np.zeros(count)
        #: Episodes that have come to their end before their time.
        self.terminated = np.zeros(count, dtype=bool)
        #: Length of an observation.
        self.size = 2 * n + 6 + 3 * self.FURTHER

    def has_many_robots(self) -> bool:
        """Whether robots differ in mass."""
        return is_dispersed(self.randomization.mass_scale)

    def make_robots(self, random: np.random.Generator) -> None:
        """Draws the robots, which divide the environments among themselves."""
        scale = self.randomization.mass_scale
        robots = min(self.randomization.robots, self.count) if self.has_many_robots() else 1
        if robots < 1:
            raise InputError(f"randomization: robots is {robots}; it must be at least 1")
        ends = np.linspace(0, self.count, robots + 1).astype(int)
        self.batches = []
        for start, end in zip(ends[:-1], ends[1:]):
            model = scaled(self.model, "mass_scale", scale, random)
            rows = slice(int(start), int(end))
            self.data[rows] = State(model, self.posture).to_row()
            self.batches.append((rows, Batch(model, data=self.data[rows], method="rk4")))

    def reset(self, which: np.ndarray, random: np.random.Generator) -> None:
        """Starts new episodes of the environments with these indices."""
        if not self.batches:
            self.make_robots(random)
        n, count, r = self.model.dof, len(which), self.randomization
        q = self.posture + disperse("posture", r.posture, random, (count, n))
        offset = disperse("goal_offset", r.goal_offset, random, (count, n))
        spin = disperse("base_angular_velocity", r.base_angular_velocity, random, (count, 3))
        self.scale[which] = disperse("effort_scale", r.effort_scale, random, (count, n))
        poses = self.model.frame_pose(q + offset, self.tip)
        self.steps[which] = 0
        self.terminated[which] = False
        rows = np.zeros((count, self.data.shape[1]))
        columns = self.columns
        rows[:, columns["q"]] = q
        rows[:, columns["attitude"].stop - 1] = 1.0
        for batch_rows, batch in self.batches:
            own = (batch_rows.start <= which) & (which < batch_rows.stop)
            # With this centre of mass the base is at the origin.
            rows[own, columns["com"]] = batch.model.center_of_mass(q[own])
        self.data[which] = rows
        if spin.any():
            for index, joints, w in zip(which, q, spin):
                batch_rows, batch = next(b for b in self.batches if b[0].start <= index < b[0].stop)
                batch.set_state(index - batch_rows.start, State(batch.model, joints, angular_velocity=w))
        self.place_goal(which, poses, random)
        self.measure()

    def place_goal(self, which: np.ndarray, poses: np.ndarray, random: np.random.Generator) -> None:
        """Places the goals of these environments at `poses`, shape (k, 7), and draws how they move."""
        self.goal[which] = poses[:, :3]

    def move_goal(self) -> None:
        """Moves all goals to the present time."""

    def advance(self, actions: np.ndarray) -> None:
        """One action of all environments."""
        self.move_bodies(np.clip(actions, -1.0, 1.0) * self.max_rate)
        self.steps += 1
        self.move_goal()
        self.measure()

    def move_bodies(self, rates: np.ndarray) -> None:
        """Moves all bodies while the drives follow these rates, shape (count, n)."""
        gains = self.k_v * self.scale
        for rows, batch in self.batches:
            batch.servo(TIME_STEP, rates[rows], gains[rows], steps=self.substeps)

    def measure(self) -> None:
        """Tips, and their distances and velocities against the goals."""
        for rows, batch in self.batches:
            batch.frame_states(self.tip, out=self.tips[rows])
        self.error = self.goal - self.tips[:, :3]
        self.velocity = self.tips[:, 7:10] - self.goal_velocity
        self.distance = np.sqrt(np.einsum("ij,ij->i", self.error, self.error))

    def observe(self, random: np.random.Generator) -> np.ndarray:
        """Joint positions [rad] from the posture, joint rates / max_rate; in base axes tip to goal [m], velocity of the tip against
        that of the goal [m/s], and the further vectors; shape (count, size), float32."""
        n, columns = self.model.dof, self.columns
        out = np.empty((self.count, self.size), dtype=np.float32)
        out[:, :n] = self.data[:, columns["q"]] - self.posture
        out[:, n : 2 * n] = self.data[:, columns["qd"]] / self.max_rate
        attitude = self.data[:, columns["attitude"]]
        out[:, 2 * n : 2 * n + 3] = _into_base(attitude, self.error)
        out[:, 2 * n + 3 : 2 * n + 6] = _into_base(attitude, self.velocity)
        for k, vectors in enumerate(self.further_vectors()):
            out[:, 2 * n + 6 + 3 * k : 2 * n + 9 + 3 * k] = _into_base(attitude, vectors)
        noise = self.randomization.observation_noise
        if isinstance(noise, dict) or noise != 0.0:
            out += disperse("observation_noise", noise, random, out.shape)
        return np.clip(out, -self.LARGEST, self.LARGEST, out=out)

    def further_vectors(self) -> list[np.ndarray]:
        """What else is observed in base axes, given in world axes, each of shape (count, 3)."""
        return []

    def infos(self) -> dict[str, np.ndarray]:
        """What `info` has, one row per environment."""
        return {"distance": self.distance.copy(), "is_success": self.distance < self.success_distance}

    def rewards(self, actions: np.ndarray) -> np.ndarray:
        """-distance [m], +1 within the success distance, less a little for large actions; shape (count,)."""
        effort = np.einsum("ij,ij->i", actions, actions) / self.model.dof
        return (self.distance < self.success_distance) - self.distance - 0.05 * effort


def _into_base(attitude: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Components in base axes of vectors in world axes, for attitudes x, y, z, w."""
    # v - 2 w (u x v) + 2 u x (u x v), written out: numpy.cross is slow.
    x, y, z, w = attitude.T
    a, b, c = vectors.T
    p, q, r = y * c - z * b, z * a - x * c, x * b - y * a
    out = np.empty_like(vectors)
    out[:, 0] = a + 2.0 * (y * r - z * q - w * p)
    out[:, 1] = b + 2.0 * (z * p - x * r - w * q)
    out[:, 2] = c + 2.0 * (x * q - y * p - w * r)
    return out


class Reach(Task):
    """The goal rests in inertial space."""


class Track(Task):
    """The goal is a point on a body that spins about a principal axis (a torque-free motion) while its centre drifts."""

    FURTHER = 1
    #: Largest rate of the body [rad/s], distance of the point from its axis [m], and speed of its centre [m/s].
    SPIN, RADIUS, DRIFT = 0.1, 0.4, 0.02

    def place_goal(self, which: np.ndarray, poses: np.ndarray, random: np.random.Generator) -> None:
        super().place_goal(which, poses, random)
        if not hasattr(self, "axis"):
            self.axis, self.arm, self.drift = (np.zeros((self.count, 3)) for _ in range(3))
            self.start, self.spin = np.zeros((self.count, 3)), np.zeros(self.count)
        count = len(which)
        axis = random.normal(size=(count, 3))
        axis /= np.linalg.norm(axis, axis=1, keepdims=True)
        arm = np.cross(axis, random.normal(size=(count, 3)))
        arm *= self.RADIUS / np.linalg.norm(arm, axis=1, keepdims=True)
        self.axis[which], self.arm[which] = axis, arm
        self.spin[which] = random.uniform(0.3 * self.SPIN, self.SPIN, count)
        self.drift[which] = random.uniform(-self.DRIFT, self.DRIFT, (count, 3)) / np.sqrt(3.0)
        self.start[which] = self.goal[which] - arm
        self.move_goal()

    def move_goal(self) -> None:
        time = self.steps * self.period
        angle = (self.spin * time)[:, None]
        across = np.cross(self.axis, self.arm)
        arm = np.cos(angle) * self.arm + np.sin(angle) * across
        self.goal = self.start + self.drift * time[:, None] + arm
        turning = np.cos(angle) * across - np.sin(angle) * self.arm
        self.goal_velocity = self.drift + self.spin[:, None] * turning

    def further_vectors(self) -> list[np.ndarray]:
        return [self.goal_velocity]
