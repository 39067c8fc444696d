"""Gymnasium environments with free-floating robots.

`fuyu/Reach-v0`: the tip reaches a point that rests in inertial space. `fuyu/Track-v0`: the tip follows a point on a body that tumbles
and drifts. `fuyu/Capture-v0`: the tip latches on to such a body. Each arm motion moves the base. All exist as one environment and as
natively vectorised ones, which step all robots together on all processors:

>>> import gymnasium
>>> env = gymnasium.make("fuyu/Reach-v0")
>>> envs = gymnasium.make_vec("fuyu/Reach-v0", num_envs=4096, vectorization_mode="vector_entry_point")

Needs gymnasium (`pip install fuyu[gym]`).
"""

from .capture import CaptureRandomization
from .dispersions import Dispersion, disperse
from .environments import CaptureEnv, CaptureVectorEnv, ReachEnv, ReachVectorEnv, TrackEnv, TrackVectorEnv
from .tasks import Randomization
from .registration import register

__all__ = [
    "CaptureEnv",
    "CaptureRandomization",
    "CaptureVectorEnv",
    "Dispersion",
    "Randomization",
    "ReachEnv",
    "ReachVectorEnv",
    "TrackEnv",
    "TrackVectorEnv",
    "disperse",
    "register",
]

register()
