"""All numbers of the page, computed by public functions, as JSON values."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np

from ..._bodies.three import Suslov3D
from ..._checks import FloatArray
from ..._engine.status import Status
from ..._runs.iterate import iterate
from ..._runs.solution import flow, limits
from ..._space.scattering import scattering_angle
from ..._space.vectors import to_vector
from ..._states.conserved import criticality, energy, first_integral
from ..._states.continuous import vector_field
from ..._states.coordinates import from_xy, to_xy
from ..ellipsoid import ellipsoid
from ..plane import energy_level, level_curves, repelling_direction
from .parameters import Parameters

# Unbounded branches are drawn beyond the largest view.
_REACH = 12.0
# Orbits of a portrait: levels, steps, angle from the line of steady states, significant digits.
_LEVELS, _STEPS, _NEAR, _DIGITS = 10, 300, 0.05, 6

REGIMES = {
    "steady": "This state is a steady rotation: a fixed point of the map.",
    "below": (
        "The orbit follows the continuous motion on a level curve of F, from the repelling half of "
        "the line of steady states to the attracting one."
    ),
    "at": "The orbit reaches a steady state in one or two steps.",
    "above": (
        "The step is too long to follow the continuous motion: the orbit jumps across the line of "
        "steady states and, unless it meets a pole, still tends to it."
    ),
}


def scene(parameters: Parameters) -> dict[str, Any]:
    """Return all numbers of the page; ValueError for an invalid body."""
    # Numbers out of the range of float64 become null.
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return _scene(parameters)


def _scene(parameters: Parameters) -> dict[str, Any]:
    body, eps, start = parameters.body, parameters.eps, np.array(parameters.omega0)
    run = iterate(
        body, start, eps, parameters.steps, attitude=True, on_singular="ignore", threads=1
    )
    assert run.attitude is not None
    t = float(criticality(body, start, eps))
    status = Status(int(run.status))
    drift = np.abs(run.first_integral() / run.first_integral()[0] - 1.0)
    regime = "below" if abs(t) < 1 else "above" if abs(t) > 1 else "at"
    if not vector_field(body, start).any():
        regime = "steady"
    repelling = _repelling(body, eps)
    minus, plus = limits(body, start, eps)
    within = np.isfinite(run.time)
    of_flow = np.full_like(run.omega, np.nan)
    of_flow[within] = flow(body, start, run.time[within])
    return {
        "parameters": parameters._asdict(),
        "time": [_finite(each) for each in run.time],
        "omega": _finite(run.omega),
        "flow": _finite(of_flow),
        "attitude": _finite(run.attitude.reshape(-1, 9)),
        "spatial": _finite(to_vector(body, run.omega, attitude=run.attitude)),
        "line": repelling and {"repelling": repelling, "attracting": [-each for each in repelling]},
        "levels": {
            "F": [_finite(branch) for branch in _levels(body, eps, t)],
            "energy": _finite(energy_level(body, start)),
        },
        "portrait": _portrait(parameters) if parameters.portrait else None,
        "ellipsoid": _ellipsoid(body),
        "regime": {"name": regime, "text": REGIMES[regime]},
        "status": {
            "name": status.name,
            "message": status.message,
            "failed_at": int(run.failed_at) if status < 0 else None,
        },
        "numbers": {
            "criticality": _finite(t),
            "F": _finite(first_integral(body, start, eps)),
            "drift": _finite(np.nanmax(drift)) if np.isfinite(drift).any() else None,
            "energy": _finite(energy(body, start)),
            "omega_minus": _finite(minus),
            "omega_plus": _finite(plus),
            "scattering_angle": _finite(scattering_angle(body)),
            "I3": _finite(body.admissible_I3()),
        },
        "python": (
            "from suslov_fast import Suslov3D, iterate\n\n"
            f"body = {body!r}\n"
            f"run = iterate(body, {parameters.omega0}, eps={eps}, steps={parameters.steps}, "
            "attitude=True)\n"
        ),
    }


def _repelling(body: Suslov3D, eps: float) -> list[float] | None:
    """Direction of the repelling half of the line of steady states, if they are a line."""
    if body.I13 == 0 and body.I23 == 0:
        return None
    return list((math.copysign(1.0, eps) * repelling_direction(body)).tolist())


def _levels(body: Suslov3D, eps: float, t: float) -> list[FloatArray]:
    """Level curves of F through the initial state; none if the level is a point."""
    if t == 0 or not math.isfinite(t):
        return []
    return level_curves(body, eps, abs(t), _REACH)


def _portrait(parameters: Parameters) -> dict[str, Any] | None:
    """Orbits from both sides of the repelling half of the line, on levels that fill the view."""
    body, eps, extent = parameters.body, parameters.eps, parameters.extent
    direction = _repelling(body, eps)
    if eps == 0 or direction is None:
        return None
    corner = np.sqrt(energy(body, [extent, extent]) / energy(body, direction))
    y = to_xy(body, corner * np.outer(np.arange(1, _LEVELS + 1) / _LEVELS, direction))[:, 1]
    x = np.tan(_NEAR) * y / np.sqrt(body.I1 * body.I2)
    starts = from_xy(body, np.stack([[x, -x], [y, y]], axis=-1))
    t = criticality(body, starts[0], eps)
    steps = min(parameters.steps, _STEPS)
    orbits = iterate(body, starts.reshape(-1, 2), eps, steps, on_singular="ignore", threads=1)
    levels = [each for level in t for each in _levels(body, eps, float(level))]
    return {
        "levels": [_short(branch) for branch in levels],
        "orbits": [_short(orbit) for orbit in np.moveaxis(orbits.omega, 1, 0)],
    }


def _ellipsoid(body: Suslov3D) -> dict[str, Any] | None:
    """Ellipsoid of inertia, if there is one in the range of float64."""
    try:
        radii, axes, I3, admissible = ellipsoid(body)
    except (ValueError, OverflowError, np.linalg.LinAlgError):
        return None
    return {"I3": I3, "matter": admissible, "radii": radii.tolist(), "axes": axes.tolist()}


def _finite(value: Any) -> Any:
    """Return a number, a row or a list of rows; None for numbers and rows that are not finite."""
    array = np.asarray(value)
    if array.ndim < 2:
        return array.tolist() if np.isfinite(array).all() else None
    finite = np.isfinite(array).all(axis=-1).tolist()
    return [row if each else None for row, each in zip(array.tolist(), finite, strict=True)]


def _short(array: FloatArray) -> list[list[float] | None]:
    """Rows rounded to a few digits, for drawing only."""
    return [row and [float(f"{x:.{_DIGITS}g}") for x in row] for row in _finite(array)]
