"""All numbers of the page, computed by public functions, as JSON values."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from ... import __version__
from ...bodies.rigid import Suslov3D
from ...engine.status import Status
from ...quantities.conserved import criticality, energy, first_integral
from ...quantities.derivatives import vector_field
from ...runs.iterate import iterate
from ...runs.solution import flow, limits
from ...space.scattering import scattering_angle
from ...space.vectors import to_vector
from .. import geometry
from ..geometry import BodyIn3D
from .parameters import Parameters, parse_query

# The files of the page, which draws these numbers.
PAGE = Path(__file__).with_name("page")
# Unbounded branches are drawn beyond the largest view.
_REACH = 12.0
# Orbits of a portrait: levels, steps, phase from the line of steady states.
_LEVELS, _LONGEST_ORBIT, _OFFSET = 10, 300, 0.07
# Below this criticality the rates of map and flow differ by less than a third of a percent.
_FOLLOWS = 0.1


def answer(query: str) -> dict[str, Any]:
    """Return the numbers for a query, or a message that the page shows."""
    try:
        return scene(parse_query(query))
    except ValueError as error:
        # A message begins with the names of the fields that it is about.
        named = str(error).partition(":")[0].split(", ")
        fields = [name for name in named if name in Parameters._fields]
        return {"error": str(error), "fields": fields}
    except ArithmeticError as error:
        expected = "parameters: expected numbers of which a picture can be drawn"
        return {"error": f"{expected}, got an {error}", "fields": []}


def scene(parameters: Parameters) -> dict[str, Any]:
    """Return all numbers of the page; ValueError for an invalid body."""
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        body, eps, start = parameters.body, parameters.eps, np.array(parameters.omega0)
        steps = parameters.steps
        run = iterate(body, start, eps, steps, attitude=True, on_singular="ignore", threads=1)
        status = Status(int(run.status))
        F = first_integral(body, run.omega, eps)
        t = float(criticality(body, start, eps))
        numbers = {
            "criticality": t,
            # How many times faster than the flow the map tends to the last steady state.
            "ahead": math.atanh(abs(t)) / abs(t) if 0 < abs(t) < 1 else None,
            "F": F[0],
            "drift": np.fmax.reduce(abs(F / F[0] - 1.0)),
            "energy": energy(body, start),
            "scattering_angle": scattering_angle(body) if isinstance(body, Suslov3D) else None,
            "I3": Suslov3D(*parameters[:4]).admissible_I3(),
        }
        numbers["omega_minus"], numbers["omega_plus"] = limits(body, start, eps)
        found = {
            "version": __version__,
            "parameters": parameters._asdict(),
            "time": list(run.time),
            "omega": run.omega,
            "flow": flow(body, start, run.time),
            "attitude": run.attitude.reshape(-1, 9),
            "spatial": to_vector(body, run.omega, attitude=run.attitude),
            "line": _line(body, eps),
            "levels": _levels(body, eps, numbers),
            "portrait": _portrait(parameters) if parameters.portrait else None,
            "ellipsoid": _ellipsoid(body),
            "regime": _regime(parameters, t, status),
            "status": {
                "name": status.name,
                "message": status.message,
                "failed_at": int(run.failed_at) if status < 0 else None,
            },
            "numbers": numbers,
            "python": (
                f"from suslov_fast import {type(body).__name__}, iterate\n\n"
                f"body = {body!r}\n"
                f"run = iterate(body, {parameters.omega0}, eps={eps}, steps={steps}, "
                "attitude=True)\n"
            ),
        }
        return {name: _json_values(each) for name, each in found.items()}


def _line(body: BodyIn3D, eps: float) -> dict[str, Any] | None:
    """The line of steady states, if there is one: its middle and the directions of its halves."""
    if not (body.I13 or body.I23):
        return None
    middle, direction = geometry.steady_line(body)
    repelling = math.copysign(1.0, eps) * direction
    return {"middle": middle, "repelling": repelling, "attracting": -repelling}


def _levels(body: BodyIn3D, eps: float, numbers: dict[str, Any]) -> dict[str, Any]:
    """The levels of F and of the energy through the first state."""
    R = 2.0 * float(np.sqrt(body.I1 * body.I2 * numbers["F"]))
    return {
        "F": geometry.level(body, eps, R, _REACH) if R > 0 else [],
        "energy": geometry.level(body, 0.0, math.sqrt(2.0 * numbers["energy"]))[0],
    }


def _regime(parameters: Parameters, t: float, status: Status) -> str:
    """The name of the regime, which agrees with the status."""
    body, eps = parameters.body, parameters.eps
    if eps == 0:
        return "still"
    if not math.isfinite(t) or status == Status.NONFINITE:
        return "unknown"
    if not vector_field(body, parameters.omega0).any():
        return "steady"
    if status == Status.SINGULAR:
        return "pole"
    if abs(geometry.half_step(body, eps) * parameters.k) > abs(t):
        return "rotor"
    if abs(t) == 1:
        return "at" if parameters.k == 0 else "above"
    return "above" if abs(t) > 1 else "ahead" if abs(t) > _FOLLOWS else "below"


def _portrait(parameters: Parameters) -> dict[str, Any] | None:
    """Orbits on levels that fill the view, from both sides of a repelling steady state."""
    body, eps, extent = parameters.body, parameters.eps, parameters.extent
    if eps == 0 or not (body.I13 or body.I23 or parameters.k):
        return None
    g, k = geometry.half_angle(body)
    largest = float(np.sqrt(2.0 * energy(body, [extent, extent])))
    starts, levels = [], []
    for R in largest * np.arange(1, _LEVELS + 1) / _LEVELS:
        start = -math.copysign(geometry.meeting_phase(R * abs(g), k), eps)
        starts.append(geometry.on_level(body, eps, R, np.array([start + _OFFSET, start - _OFFSET])))
        levels += geometry.level(body, eps, R, _REACH)
    steps = min(parameters.steps, _LONGEST_ORBIT)
    orbits = iterate(body, np.concatenate(starts), eps, steps, on_singular="ignore", threads=1)
    return {"levels": levels, "orbits": list(np.moveaxis(orbits.omega, 1, 0))}


def _ellipsoid(body: BodyIn3D) -> dict[str, Any] | None:
    """The ellipsoid of inertia, if there is one in the range of float64."""
    try:
        radii, axes, I3, admissible = geometry.ellipsoid(body)
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
