"""Everything that the page shows, found by the public functions, as plain numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..._bodies.matter import ellipsoid_of_inertia
from ..._bodies.three import Suslov3D
from ..._checks import FloatArray
from ..._engine.status import Status
from ..._runs.iterate import iterate
from ..._runs.solution import flow, limits
from ..._space.scattering import scattering_angle
from ..._space.vectors import to_vector
from ..._states.conserved import criticality, energy, first_integral
from ..._states.continuous import vector_field
from ..plane import energy_level, level_curves, repelling_direction
from .parameters import Parameters

# Branches that do not end are drawn as far as anyone zooms out.
_REACH = 12.0
_DOUBLINGS = 60

REGIMES = {
    "steady": "This state is a steady rotation: it does not move.",
    "below": (
        "The orbit follows the continuous motion: on a level of F, from the repelling half of the "
        "line to the attracting one."
    ),
    "at": "The orbit falls onto a steady state in one step or two.",
    "above": (
        "The step is too long to follow the continuous motion: the orbit jumps across the line "
        "and, unless it meets a pole, still ends on it."
    ),
}


def scene(parameters: Parameters) -> dict[str, Any]:
    """All numbers of a page; ValueError, with what was expected, where there are none."""
    with np.errstate(all="ignore"):  # numbers beyond float64 are shown as none
        return _scene(parameters)


def _scene(parameters: Parameters) -> dict[str, Any]:
    body, eps, start = parameters.body, parameters.eps, np.array(parameters.omega0)
    run = iterate(
        body, start, eps, parameters.steps, attitude=True, on_singular="ignore", threads=1
    )
    assert run.attitude is not None
    t = float(criticality(body, start, eps))
    status = Status(int(run.status))
    F = run.first_integral()
    regime = _regime(body, start, t)
    minus, plus = limits(body, start, eps)
    of_matter = body.admissible_I3()
    drift = np.abs(F / F[0] - 1.0)
    curves = {
        "F": [_rows(branch) for branch in _levels(body, eps, t)],
        "energy": _rows(energy_level(body, start)),
    }
    return {
        "parameters": parameters._asdict(),
        "omega": _rows(run.omega),
        "flow": _flow(body, start, run.time),
        "attitude": _rows(run.attitude.reshape(-1, 9)),
        "spatial": _rows(to_vector(body, run.omega, attitude=run.attitude)),
        "line": _line(body, eps),
        "levels": curves,
        "ellipsoid": _ellipsoid(body, *of_matter),
        "regime": {"name": regime, "text": REGIMES[regime]},
        "status": {
            "name": status.name,
            "message": status.message,
            "failed_at": int(run.failed_at) if status < 0 else None,
        },
        "numbers": {
            "criticality": _number(t),
            "F": _number(first_integral(body, start, eps)),
            "drift": _number(np.nanmax(drift)) if np.isfinite(drift).any() else None,
            "energy": _number(energy(body, start)),
            "omega_minus": _rows(minus[np.newaxis])[0],
            "omega_plus": _rows(plus[np.newaxis])[0],
            "scattering_angle": _number(scattering_angle(body)),
            "I3": _rows(np.array([of_matter]))[0],
        },
        "python": code(parameters),
    }


def code(parameters: Parameters) -> str:
    """The lines of Python that give the same states."""
    return (
        "from suslov_fast import Suslov3D, iterate\n\n"
        f"body = {parameters.body!r}\n"
        f"run = iterate(body, {parameters.omega0}, eps={parameters.eps}, "
        f"steps={parameters.steps}, attitude=True)\n"
    )


def _regime(body: Suslov3D, start: FloatArray, t: float) -> str:
    if not vector_field(body, start).any():
        return "steady"
    return "below" if abs(t) < 1 else "above" if abs(t) > 1 else "at"


def _flow(body: Suslov3D, start: FloatArray, times: FloatArray) -> list[list[float] | None]:
    """The continuous motion at the times of the states, where these are in the range of float64."""
    within = np.isfinite(times)
    missing = [None] * int((~within).sum())
    return [*_rows(flow(body, start, times[within])), *missing]


def _line(body: Suslov3D, eps: float) -> dict[str, list[float]] | None:
    """The directions of the two halves of the line of steady states."""
    if body.I13 == 0 and body.I23 == 0:
        return None
    repelling = math.copysign(1.0, eps) * repelling_direction(body)
    return {"repelling": repelling.tolist(), "attracting": (-repelling).tolist()}


def _levels(body: Suslov3D, eps: float, t: float) -> list[FloatArray]:
    """The curves on which F is that of the start; a point is none."""
    if t == 0 or not math.isfinite(t):
        return []
    return level_curves(body, eps, abs(t), _REACH)


def _ellipsoid(body: Suslov3D, low: FloatArray, high: FloatArray) -> dict[str, Any] | None:
    """The ellipsoid of inertia of a body with these parameters.

    I3 decides its shape alone: it is in the middle of those that matter can have, from low to high,
    or, where it can have none, large enough for an ellipsoid.
    """
    of_matter = bool(np.isfinite(low))
    I3 = float(0.5 * (low + high)) if of_matter else float(np.maximum(body.I1, body.I2))
    for _ in range(_DOUBLINGS):
        try:
            radii, axes = ellipsoid_of_inertia(body.parameters, I3)
        except ValueError:
            I3 *= 2.0
        else:
            return {"I3": I3, "matter": of_matter, "radii": radii.tolist(), "axes": axes.tolist()}
    return None


def _number(value: Any) -> float | None:
    """A number that JSON can hold."""
    return float(value) if np.isfinite(value) else None


def _rows(array: FloatArray) -> list[list[float] | None]:
    """Rows of numbers, and None for those that do not exist."""
    finite = np.isfinite(array).tolist()
    return [row if all(each) else None for row, each in zip(array.tolist(), finite, strict=True)]
