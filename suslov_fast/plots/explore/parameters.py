"""Parameters of the page: body, step size, initial state, number of steps, extent of the plane."""

from __future__ import annotations

import math
from typing import Any, NamedTuple
from urllib.parse import parse_qsl, urlencode

from ...bodies.rigid import Suslov3D, SuslovGyrostat
from ...checks import states, wrong
from ..geometry import BodyIn3D

_STEPS = 5000


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
    values: dict[str, Any] = {}
    for name, text in pairs:
        try:
            values[name] = float(text)
        except ValueError:
            values[name] = math.nan
        if not math.isfinite(values[name]):
            raise wrong(name, "a number", repr(text))
    if len(values) < len(pairs) or not {*needed} <= values.keys() <= {*Parameters._fields}:
        got = ", ".join(name for name, _ in pairs) or "none"
        raise wrong("parameters", f"each of {', '.join(needed)} once", got)
    if values["steps"] not in range(1, _STEPS + 1):
        raise wrong("steps", f"an integer from 1 to {_STEPS}", f"{values['steps']:g}")
    whole = {name: int(values.get(name, 0)) for name in ("steps", "portrait")}
    return Parameters(**values | whole)


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
