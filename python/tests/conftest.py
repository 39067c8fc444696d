"""What the tests share."""

import os
from pathlib import Path

import numpy as np
import pytest

import fuyu

ROOT = Path(__file__).resolve().parents[2]
#: 65, 99, -95, -22, 3, -42 degrees: the initial posture of the scenario `positioning`.
POSTURE = np.radians([65.0, 99.0, -95.0, -22.0, 3.0, -42.0])


@pytest.fixture(scope="session")
def servicer():
    return fuyu.Model.from_urdf(ROOT / "urdf/servicer.urdf")


@pytest.fixture
def random():
    return np.random.default_rng(7)


@pytest.fixture(scope="session")
def command():
    """The executable, to compare with; FUYU names it."""
    path = os.environ.get("FUYU")
    if path is None:
        found = [ROOT / "target" / profile / "fuyu" for profile in ("release", "quick")]
        path = next((str(p) for p in found if p.exists()), None)
    if path is None:
        pytest.fail("no executable fuyu to compare with: build it, or name it in FUYU")
    return path
