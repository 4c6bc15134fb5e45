"""All numbers of the page, computed by public functions, as JSON values."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np

from ..._bodies.body_3d import Suslov3D
from ..._engine.arguments import BodyIn3D
from ..._engine.status import Status
from ..._runs.iterate import iterate
from ..._runs.solution import flow, limits
from ..._space.scattering import scattering_angle
from ..._space.vectors import to_vector
from ..._states.conserved import criticality, energy, first_integral
from ..._states.derivatives import vector_field
from ..geometry import ellipsoid, half_angle, level, meeting_phase, on_level, steady_line
from .parameters import Parameters

# Unbounded branches are drawn beyond the largest view.
_REACH = 12.0
# Orbits of a portrait: levels, steps, phase from the line of steady states.
_LEVELS, _LONGEST_ORBIT, _OFFSET = 10, 300, 0.07

REGIMES = {
    "unknown": "The criticality of these numbers is beyond the range of float64.",
    "still": "With a step size of 0 nothing moves: every state is its own next state.",
    "steady": "This state is a steady rotation: a fixed point of the map.",
    "below": (
        "The orbit follows the continuous motion on a level curve of F, from the repelling half of "
        "the line of steady states to the attracting one."
    ),
    # Of the quotient of the rates with which map and flow tend to the last steady state.
    "ahead": (
        "The orbit leads from the repelling half of the line of steady states to the attracting "
        "one, as the continuous motion does, but faster: near the end a step takes it as far as "
        "{:.3g} steps of the continuous motion, and it is on a level curve of F, not of the energy."
    ),
    "at": "The orbit reaches a steady state in one or two steps.",
    "above": (
        "The step is too long to follow the continuous motion: the orbit jumps across the line of "
        "steady states, and tends to it."
    ),
    "pole": (
        "The step is too long to follow the continuous motion: the orbit jumps across the line of "
        "steady states, and meets a pole of the map."
    ),
    "rotor": (
        "The momentum of the rotor exceeds that of the products of inertia: the orbit never comes "
        "to rest, and turns on a level curve of F."
    ),
}
# Below this criticality the rates of map and flow differ by less than a third of a percent.
_FOLLOWS = 0.1


def scene(parameters: Parameters) -> dict[str, Any]:
    """Return all numbers of the page; ValueError for an invalid body."""
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        values: dict[str, Any] = _json_values(_scene(parameters))
        return values


def _scene(parameters: Parameters) -> dict[str, Any]:
    body, eps, start = parameters.body, parameters.eps, np.array(parameters.omega0)
    run = iterate(
        body, start, eps, parameters.steps, attitude=True, on_singular="ignore", threads=1
    )
    t = float(criticality(body, start, eps))
    status = Status(int(run.status))
    drift = np.abs(run.first_integral() / run.first_integral()[0] - 1.0)
    R = 2.0 * float(np.sqrt(body.I1 * body.I2 * first_integral(body, start, eps)))
    regime = _regime(parameters, t, status)
    ahead = math.atanh(abs(t)) / abs(t) if 0 < abs(t) < 1 else 1.0
    line = None
    if body.I13 or body.I23:
        middle, direction = steady_line(body)
        repelling = math.copysign(1.0, eps) * direction
        line = {"middle": middle, "repelling": repelling, "attracting": -repelling}
    minus, plus = limits(body, start, eps)
    within = np.isfinite(run.time)
    of_flow = np.full_like(run.omega, np.nan)
    of_flow[within] = flow(body, start, run.time[within])
    return {
        "parameters": parameters._asdict(),
        "time": [*run.time],
        "omega": run.omega,
        "flow": of_flow,
        "attitude": run.attitude.reshape(-1, 9),
        "spatial": to_vector(body, run.omega, attitude=run.attitude),
        "line": line,
        "levels": {
            "F": level(body, eps, R, _REACH) if R > 0 else [],
            "energy": level(body, 0.0, math.sqrt(2.0 * energy(body, start)))[0],
        },
        "portrait": _portrait(parameters) if parameters.portrait else None,
        "ellipsoid": _ellipsoid(body),
        "regime": {"name": regime, "text": REGIMES[regime].format(ahead)},
        "status": {
            "name": status.name,
            "message": status.message,
            "failed_at": int(run.failed_at) if status < 0 else None,
        },
        "numbers": {
            "criticality": t,
            "F": first_integral(body, start, eps),
            "drift": np.fmax.reduce(drift),
            "energy": energy(body, start),
            "omega_minus": minus,
            "omega_plus": plus,
            "scattering_angle": scattering_angle(body) if isinstance(body, Suslov3D) else None,
            "I3": Suslov3D(*parameters[:4]).admissible_I3(),
        },
        "python": (
            f"from suslov_fast import {type(body).__name__}, iterate\n\n"
            f"body = {body!r}\n"
            f"run = iterate(body, {parameters.omega0}, eps={eps}, steps={parameters.steps}, "
            "attitude=True)\n"
        ),
    }


def _regime(parameters: Parameters, t: float, status: Status) -> str:
    """Return the name of the regime of an orbit, which agrees with its status."""
    body, eps, start = parameters.body, parameters.eps, parameters.omega0
    if eps == 0:
        return "still"
    if not math.isfinite(t) or status == Status.NONFINITE:
        return "unknown"
    if not vector_field(body, start).any():
        return "steady"
    if status == Status.SINGULAR:
        return "pole"
    # In units of 2 sqrt(I1 I2): t is e A, that of the rotor is e k.
    if abs(eps * parameters.k) > 2.0 * math.sqrt(parameters.I1 * parameters.I2) * abs(t):
        return "rotor"
    if abs(t) == 1:
        return "at" if parameters.k == 0 else "above"
    return "above" if abs(t) > 1 else "ahead" if abs(t) > _FOLLOWS else "below"


def _portrait(parameters: Parameters) -> dict[str, Any] | None:
    """Orbits on levels that fill the view, from both sides of a repelling steady state."""
    body, eps, extent = parameters.body, parameters.eps, parameters.extent
    if eps == 0 or not (body.I13 or body.I23 or parameters.k):
        return None
    g, k = half_angle(body)
    steps = min(parameters.steps, _LONGEST_ORBIT)
    largest = float(np.sqrt(2.0 * energy(body, [extent, extent])))
    starts, levels = [], []
    for R in largest * np.arange(1, _LEVELS + 1) / _LEVELS:
        start = -math.copysign(meeting_phase(R * abs(g), k), eps)
        starts.append(on_level(body, eps, R, np.array([start + _OFFSET, start - _OFFSET])))
        levels += level(body, eps, R, _REACH)
    orbits = iterate(body, np.concatenate(starts), eps, steps, on_singular="ignore", threads=1)
    return {"levels": levels, "orbits": [*np.moveaxis(orbits.omega, 1, 0)]}


def _ellipsoid(body: BodyIn3D) -> dict[str, Any] | None:
    """Ellipsoid of inertia, if there is one in the range of float64."""
    try:
        radii, axes, I3, admissible = ellipsoid(body)
    except (ValueError, OverflowError, np.linalg.LinAlgError):
        return None
    return {"I3": I3, "matter": admissible, "radii": radii, "axes": axes}


def _json_values(value: Any) -> Any:
    """Return arrays as lists; None for numbers and rows out of the range of float64."""
    if isinstance(value, dict):
        return {name: _json_values(each) for name, each in value.items()}
    if isinstance(value, list):
        return [_json_values(each) for each in value]
    if value is None or isinstance(value, (str, int)):
        return value
    array = np.asarray(value)
    if array.ndim < 2:
        return array.tolist() if np.isfinite(array).all() else None
    finite = np.isfinite(array).all(axis=-1).tolist()
    return [row if each else None for row, each in zip(array.tolist(), finite, strict=True)]
