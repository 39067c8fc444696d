"""Random numbers for domain randomisation, described as in the files of campaigns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .._fuyu import InputError

#: A number, or a mapping such as `{"uniform": {"min": 0.8, "max": 1.2}}`.
Dispersion = float | Mapping[str, Any]

# What each kind needs; None means that it has to be given.
_KINDS: dict[str, dict[str, float | None]] = {
    "uniform": {"min": None, "max": None},
    "normal": {"mean": 0.0, "sigma": None},
    "truncated_normal": {"mean": 0.0, "sigma": None, "min": -np.inf, "max": np.inf},
    "log_normal": {"median": 1.0, "sigma": None},
}


def disperse(name: str, dispersion: Dispersion, random: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Samples of `dispersion`, of this shape; `name` is what errors call it.

    A number is that number. Mappings: `{"uniform": {"min": a, "max": b}}`, `{"normal": {"mean": m, "sigma": s}}`,
    `{"truncated_normal": {"mean": m, "sigma": s, "min": a, "max": b}}`, `{"log_normal": {"median": m, "sigma": s}}` (sigma is that
    of the logarithm), `{"choice": [value, ...]}`. The mean is 0 and the median 1 by default; `truncated_normal` may lack one end.
    """
    if not isinstance(dispersion, Mapping):
        return np.full(shape, _number(name, dispersion))
    known = ", ".join([*_KINDS, "choice"])
    if len(dispersion) != 1:
        raise InputError(f"{name}: give one of {known}")
    kind, given = next(iter(dispersion.items()))
    if kind == "choice":
        if not isinstance(given, (list, tuple, np.ndarray)) or len(given) == 0:
            raise InputError(f"{name}: choice is {given!r}; give a list of numbers")
        return random.choice([_number(f"{name}: choice", value) for value in given], shape)
    if kind not in _KINDS:
        raise InputError(f"{name}: '{kind}' is not one of {known}")
    wanted = _KINDS[kind]
    if not isinstance(given, Mapping) or not set(given) <= set(wanted):
        raise InputError(f"{name}: {kind} is {given!r}; it has {', '.join(wanted)}")
    if kind == "truncated_normal" and not {"min", "max"} & set(given):
        raise InputError(f"{name}: truncated_normal has neither min nor max; give one of them, or use normal")
    values = {}
    for key, default in wanted.items():
        if key in given:
            values[key] = _number(f"{name}: {kind}: {key}", given[key])
        elif default is not None:
            values[key] = default
        else:
            raise InputError(f"{name}: {kind} has no {key}; it has {', '.join(wanted)}")
    low, high = values.get("min", 0.0), values.get("max", 1.0)
    if not low < high:
        raise InputError(f"{name}: min is {low} and max is {high}; min must be below max")
    if kind == "uniform":
        return random.uniform(low, high, shape)
    sigma = values["sigma"]
    if sigma < 0:
        raise InputError(f"{name}: sigma is {sigma}; a standard deviation is not negative")
    if kind == "normal":
        return random.normal(values["mean"], sigma, shape)
    if kind == "log_normal":
        if values["median"] <= 0:
            raise InputError(f"{name}: median is {values['median']}; it must be positive")
        return values["median"] * np.exp(random.normal(0.0, sigma, shape))
    return _truncated(name, values["mean"], sigma, low, high, random, shape)


def _truncated(
    name: str, mean: float, sigma: float, low: float, high: float, random: np.random.Generator, shape: tuple[int, ...]
) -> np.ndarray:
    """A normal distribution between two ends, by rejection."""
    samples = random.normal(mean, sigma, shape)
    for _ in range(1000):
        outside = (samples < low) | (samples > high)
        if not outside.any():
            return samples
        samples[outside] = random.normal(mean, sigma, int(outside.sum()))
    raise InputError(f"{name}: hardly any sample of the normal distribution is between {low} and {high}")


def _number(name: str, value: Any) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise InputError(f"{name} is {value!r}; it must be a number") from None
    if not np.isfinite(number):
        raise InputError(f"{name} is {number}; it must be finite")
    return number
