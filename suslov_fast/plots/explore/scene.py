"""The numbers that the page draws, for the parameters in its address."""

import math
import re
import warnings
from collections.abc import Callable, Sequence
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any, NamedTuple
from urllib.parse import parse_qsl

import numpy as np

from ... import __version__
from ...bodies.classes import BodyIn3D
from ...bodies.rigid import Suslov3D, SuslovGyrostat
from ...checks import real_number, wrong
from ...engine.status import Status
from ...quantities.conserved import rotation_number
from ...quantities.derivatives import vector_field
from ...runs.flow import flow
from ...runs.iterate import iterate
from ...runs.solution import limits
from ...space import scattering_angle
from ..phase import Plane

# Folder of the files of the page, which may be in an archive.
PAGE: Traversable = files(__package__) / "page"
MOST_STEPS = 5000
# Length of unbounded branches, see `Plane.level`: beyond the largest view.
_REACH = 12.0
# Levels of a portrait, and steps of its orbits on each side of their middle.
_LEVELS, _STEPS = 10, 150
# Below this criticality the rates of map and flow differ by less than a third of a percent.
_FOLLOWS = 0.1


class Parameters(NamedTuple):
    """Parameters in the address of the page; `show` lists the curves that it draws."""

    I1: float
    I2: float
    I13: float
    I23: float
    k: float
    eps: float
    Omega1: float
    Omega2: float
    steps: int
    extent: float = 4.0
    show: str = "F energy"

    @property
    def body(self) -> BodyIn3D:
        """The body; ValueError if the parameters are invalid."""
        return SuslovGyrostat(*self[:5]) if self.k else Suslov3D(*self[:4])


def parse_query(query: str) -> Parameters:
    """Return the parameters in a query, checked."""
    values = values_in(query, Parameters._fields, Parameters._fields[:-2])
    for name in [name for name in values if name != "show"]:
        values[name] = number_in(name, values[name])
    return Parameters(**values | {"steps": checked_steps(values["steps"])})


def values_in(query: str, known: Sequence[str], needed: Sequence[str] = ()) -> dict[str, Any]:
    """Return the texts in a query by their names, all of which are known, and no one twice."""
    pairs = parse_qsl(query, keep_blank_values=True)
    values: dict[str, Any] = dict(pairs)
    if len(values) < len(pairs) or not {*needed} <= values.keys() <= {*known}:
        names = ", ".join(name for name, _ in pairs) or "none"
        raise wrong("parameters", f"each of {', '.join(needed or known)} once", names)
    return values


def checked_steps(steps: float) -> int:
    """Return a number of steps that the page can draw."""
    if steps not in range(1, MOST_STEPS + 1):
        raise wrong("steps", f"an integer from 1 to {MOST_STEPS}", f"{steps:g}")
    return int(steps)


def number_in(name: str, text: str) -> float:
    """Return the number in a text of an address."""
    try:
        return float(real_number(name, float(text)))
    except ValueError as error:
        raise wrong(name, "a number", repr(text)) from error


def answer(query: str) -> Any:
    """Return the numbers for a query; for a wrong one, a message and the names of its fields."""
    return as_answer(lambda: _scene(parse_query(query)), Parameters._fields)


def as_answer(scene: Callable[[], dict[str, Any]], names: Sequence[str]) -> dict[str, Any]:
    """Return a scene for JSON; for a wrong one, a message and the `names` it begins with."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return dict(_json_values(scene()))
    except Exception as error:  # the user's function may raise anything
        is_told = isinstance(error, (ValueError, ArithmeticError))
        text = str(error) if is_told else f"{type(error).__name__}: {error}"
        # Messages begin with the names of the wrong arguments.
        found = re.split(": | must ", text, maxsplit=1)[0].split(", ")
        return {"error": text, "fields": [name for name in found if name in names]}


def _scene(parameters: Parameters) -> dict[str, Any]:
    """Return the orbit, levels, limits, ellipsoid and numbers for one set of parameters."""
    body, eps, steps = parameters.body, parameters.eps, parameters.steps
    plane, start = Plane(body, eps), [parameters.Omega1, parameters.Omega2]
    run = iterate(body, start, eps, steps, attitude=True, on_singular="ignore", threads=1)
    status = Status(int(run.status))
    failed_at = int(run.failed_at) if status < 0 else None
    F, t = run.first_integral(), float(run.criticality()[0])
    before, after = limits(body, start, eps)
    without_rotor = Suslov3D(*parameters[:4])
    R = 2.0 * float(np.sqrt(body.I1 * body.I2 * F[0]))
    return {
        "version": __version__,
        "parameters": parameters._asdict(),
        "omega": run.omega,
        "flow": flow(body, start, time=run.time).omega,
        "attitude": run.attitude.reshape(-1, 9),
        "line": plane.steady_line(),
        "levels": {
            "F": plane.level(R, _REACH) if R > 0 else [],
            "energy": Plane(body, 0.0).level(plane.radius(start))[0],
        },
        "portrait": _portrait(plane, parameters),
        "ellipsoid": _ellipsoid(body),
        "regime": _regime(body, start, eps, t, status),
        "status": {"name": status.name, "message": status.message, "failed_at": failed_at},
        "numbers": {
            "criticality": t,
            # Rate of approach to the last steady state, relative to the flow.
            "ahead": math.atanh(abs(t)) / abs(t) if 0 < abs(t) < 1 else None,
            "F": F[0],
            "drift": np.fmax.reduce(abs(F / F[0] - 1.0)),
            "energy": run.energy()[0],
            "scattering_angle": None if parameters.k else scattering_angle(without_rotor),
            "I3": without_rotor.admissible_I3(),
            "omega_minus": before,
            "omega_plus": after,
        },
        "python": (
            f"from suslov_fast import {type(body).__name__}, iterate\n\n"
            f"body = {body!r}\n"
            f"run = iterate(body, {start}, eps={eps}, steps={steps}, attitude=True)\n"
        ),
    }


def _ellipsoid(body: BodyIn3D) -> dict[str, Any] | None:
    """Return the ellipsoid of inertia; None if the inertia tensor is not positive definite.

    `radii` are the semi-axes, the largest is 1; columns of `axes` are their directions; `matter` is
    whether a rigid body can have this I3. If `body.I3` is not set, `I3` is the middle of the
    admissible interval; if that is empty, one of a positive definite tensor.
    """
    I1, I2, I13, I23, _ = body.constants
    low, high = Suslov3D(I1, I2, I13, I23).admissible_I3()
    definite = max(I1, I2, 2.0 * (I13**2 / I1 + I23**2 / I2))
    middle = float(np.nan_to_num(0.5 * (low + high), nan=definite))
    I3 = middle if body.I3 is None else body.I3
    moments, axes = np.linalg.eigh(body._inertia(I3))
    if not moments[0] > 0:
        return None
    radii, is_realizable = np.sqrt(moments[0] / moments), bool(low < I3 < high)
    return {"radii": radii, "axes": axes, "I3": I3, "matter": is_realizable}


def _regime(body: BodyIn3D, start: list[float], eps: float, t: float, status: Status) -> str:
    """Return the name by which the page describes the motion."""
    if eps == 0:
        return "still"
    if not math.isfinite(t) or status == Status.NONFINITE:
        return "unknown"
    if not vector_field(body, start).any():
        return "steady"
    if status == Status.SINGULAR:
        return "pole"
    if rotation_number(body, start, eps):
        return "rotor"
    if abs(t) >= 1:
        return "at" if abs(t) == 1 and body.constants[-1] == 0.0 else "above"
    return "ahead" if abs(t) > _FOLLOWS else "below"


def _portrait(plane: Plane, parameters: Parameters) -> dict[str, Any] | None:
    """Return levels that fill the view, and orbits on them; None if not shown, or all is steady."""
    if "portrait" not in parameters.show or not (parameters.eps and (plane.g or parameters.k)):
        return None
    radii = plane.radius([parameters.extent] * 2) * np.arange(1, _LEVELS + 1) / _LEVELS
    return {
        "levels": [branch for R in radii for branch in plane.level(R, _REACH)],
        "orbits": [orbit for R in radii for orbit in plane.orbits(R, _STEPS)],
    }


def _json_values(value: Any) -> Any:
    """Return values for JSON: arrays as lists; rows and numbers that are not finite as None."""
    if isinstance(value, dict):
        return {name: _json_values(item) for name, item in value.items()}
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        if not (value and isinstance(value[0], float)):
            return [_json_values(item) for item in value]
        return value if all(map(math.isfinite, value)) else None
    return None if isinstance(value, float) and not math.isfinite(value) else value
