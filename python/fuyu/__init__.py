"""Free-floating space robots: dynamics, control, estimation and simulation on numpy arrays.

Everything is computed by the Rust library `fuyu`, to the bit. Units are SI; frames and axes are those of REP-103 and REP-105;
quaternions are x, y, z, w. Errors are `InputError`, a `ValueError`, and `RunError`, a `RuntimeError`, with the text of the
command line. `fuyu.gym` has Gymnasium environments, `Bag` reads recordings as Arrow tables,
`Campaign` runs a scenario many times.

>>> import fuyu
>>> servicer = fuyu.Model.from_urdf("package://fuyu/urdf/servicer.urdf")
>>> servicer.generalized_jacobian([1.1, 1.7, -1.7, -0.4, 0.1, -0.7]).shape
(6, 6)
"""

from ._fuyu import (
    Batch,
    Controller,
    InputError,
    Integrator,
    Latches,
    Model,
    MotionEstimate,
    RunError,
    Scenario,
    State,
    __version__,
    estimate,
    estimate_rates,
)
from .bags import Bag
from .campaign import Campaign

__all__ = [
    "Bag",
    "Batch",
    "Campaign",
    "Controller",
    "InputError",
    "Integrator",
    "Latches",
    "Model",
    "MotionEstimate",
    "RunError",
    "Scenario",
    "State",
    "__version__",
    "estimate",
    "estimate_rates",
]


def _restore_model(urdf: str, name: str) -> Model:
    """A model that comes from another process."""
    import warnings

    with warnings.catch_warnings():
        # Repairs were reported where the model was made.
        warnings.simplefilter("ignore")
        return Model.from_urdf(urdf, name=name)
