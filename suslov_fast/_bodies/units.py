"""Scaling of bodies by powers of two: parameters of the order of 1 that define the same map.

The map depends only on ratios such as eps I13 / I1, so powers of two may be moved between moments
of inertia, couplings and eps. There is no rounding, and no product of parameters overflows.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray
from .base import Body

Exponents = NDArray[np.intc]


class Units(NamedTuple):
    """Exponents of the units of a body, and its scaled `parameters`.

    `single` is couplings - moments of a single body.
    """

    moments: Exponents
    couplings: Exponents
    parameters: tuple[FloatArray, ...]
    single: int


def units_of(body: Body) -> Units:
    """Return the units of a body, cached because they take as long as a short run."""
    units: Units | None = vars(body).get("_units")
    if units is None:
        units = vars(body)["_units"] = _units_of(body)
    return units


def _units_of(body: Body) -> Units:
    ends = (_extreme(each, body, body._moments) for each in (np.maximum, np.minimum))
    moments = np.asarray(sum(map(_exponent, ends)) // 2)
    couplings = _exponent(_extreme(np.maximum, body, body._couplings))
    own = (np.newaxis,) * body._own_axes
    parameters = tuple(
        np.ldexp(getattr(body, name), -exponent[(..., *own)])
        for names, exponent in ((body._moments, moments), (body._couplings, couplings))
        for name in names
    )
    return Units(moments, couplings, parameters, 0 if body.shape else int(couplings - moments))


def _extreme(function: np.ufunc, body: Body, names: tuple[str, ...]) -> FloatArray:
    """Return the largest or the smallest absolute value of some parameters of each body."""
    arrays = [abs(np.asarray(getattr(body, name))) for name in names]
    extreme: FloatArray = functools.reduce(function, arrays)  # type: ignore[arg-type]
    return function.reduce(extreme, axis=-1) if body._own_axes else extreme


def _exponent(values: FloatArray) -> Exponents:
    return np.asarray(np.frexp(values)[1])


def scaled_eps(body: Body, eps: float | FloatArray) -> float | FloatArray:
    """Return the step size, or the unit of time, scaled like the parameters of `units_of`."""
    units = units_of(body)
    if isinstance(eps, float) and not body.shape:
        try:  # some ten times faster than NumPy
            return math.ldexp(eps, units.single)
        except OverflowError:
            return math.copysign(math.inf, eps)
    with np.errstate(all="ignore"):
        scaled: FloatArray = np.ldexp(eps, units.couplings - units.moments)
    return scaled
