"""Parameters of the page: body, step size, initial state, number of steps, extent of the plane."""

from __future__ import annotations

import math
from typing import Any, NamedTuple
from urllib.parse import parse_qsl, urlencode, urlsplit

from ... import __version__
from ...bodies.paper import PICTURES
from ...bodies.rigid import Suslov3D, SuslovGyrostat
from ...checks import states, wrong
from ..geometry import BodyIn3D

STEPS = 5000


class Parameters(NamedTuple):
    """Numbers, by their names in the address of the page."""

    I1: float
    I2: float
    I13: float
    I23: float
    eps: float
    Omega1: float
    Omega2: float
    steps: int
    extent: float = 4.0
    portrait: int = 0
    k: float = 0.0

    @property
    def body(self) -> BodyIn3D:
        """The body; ValueError if the parameters are invalid."""
        return SuslovGyrostat(*self[:4], self.k) if self.k else Suslov3D(*self[:4])

    @property
    def omega0(self) -> list[float]:
        return [self.Omega1, self.Omega2]


def parse_query(query: str) -> Parameters:
    """Return the parameters in a query, beside what it shows; each once, or by default."""
    pairs = [each for each in parse_qsl(query, keep_blank_values=True) if each[0] != "show"]
    needed = [name for name in Parameters._fields if name not in Parameters._field_defaults]
    values: dict[str, Any] = {name: _number(name, text) for name, text in pairs}
    if len(values) < len(pairs) or not {*needed} <= values.keys() <= {*Parameters._fields}:
        got = ", ".join(name for name, _ in pairs) or "none"
        raise wrong("parameters", f"each of {', '.join(needed)} once", got)
    if values["steps"] not in range(1, STEPS + 1):
        raise wrong("steps", f"an integer from 1 to {STEPS}", f"{values['steps']:g}")
    whole = {name: int(values.get(name, 0)) for name in ("steps", "portrait")}
    return Parameters(**values | whole)


def _number(name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise wrong(name, "a number", repr(text))
    return value


def query_of_link(link: str) -> str:
    """Return the query of an address copied from the page; ValueError if it is not one."""
    query = urlsplit(link).query
    parse_query(query)
    return query


def query_of(body: BodyIn3D, eps: float, omega0: Any, steps: int) -> str:
    """Return the query of a page that shows an orbit of a single body."""
    state = states("omega0", omega0, body._labels)
    if body.shape or state.ndim != 1:
        raise wrong("body, omega0", "a single body and a single state", (body.shape, state.shape))
    *moments, k = map(float, body.parameters)
    extent = 1.5 * float(abs(state).max()) or 1.0
    values = *moments, eps, *state.tolist(), steps, extent, 0, k
    query = urlencode(dict(zip(Parameters._fields, values, strict=True)))
    parse_query(query)
    return query


def _of_picture(number: int, Omega1: float, Omega2: float, steps: int) -> Parameters:
    body, eps, extent = PICTURES[number]
    I1, I2, I13, I23, _ = map(float, body.parameters)
    return Parameters(I1, I2, I13, I23, eps, Omega1, Omega2, steps, extent)


# With I1 = I2 = 1, I13 = 0.25 and I23 = 0 the values of t are exact; all bodies are
# realizable, except those of pictures labelled otherwise.
PRESETS = {
    "A rigid body": Parameters(4.0, 2.0, -0.5, -0.3, 0.2, -0.9, 1.3, 300, 4.0),
    "Long steps: t = 0.5": Parameters(3.0, 3.0, -0.2, -0.2, 1.0, -8.0, 7.0, 40, 14.0),
    "t = 1": Parameters(1.0, 1.0, 0.25, 0.0, 1.0, 2.0, -8.0, 5, 14.0),
    "t > 1: jumps": Parameters(1.0, 1.0, 0.25, 0.0, 1.0, 2.0, -16.0, 60, 30.0),
    "A pole: no next state": Parameters(1.0, 1.0, 0.25, 0.0, 1.0, 2.0, -9.0, 20, 14.0),
    "A rotor: periodic": Parameters(4.0, 2.0, -0.5, -0.3, 0.2, 1.2, 0.6, 300, 4.0, 0, 1.0),
    "Paper, picture 1 (no rigid body)": _of_picture(1, -0.8, 1.3, 300),
    "Paper, picture 2": _of_picture(2, -2.5, 5.5, 300),
    "Paper, picture 3": _of_picture(3, -60.0, 3.0, 300),
    "Paper, picture 4": _of_picture(4, -1.5, 1.4, 100),
}
# What the page is told at its beginning.
SETTINGS = {
    "version": __version__,
    "longest": STEPS,
    "presets": [{"name": name, "parameters": each._asdict()} for name, each in PRESETS.items()],
}
