"""Parameters of the page: body, step size, initial state, number of steps, extent of the plane."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple
from urllib.parse import parse_qsl, urlencode, urlsplit

from ..._bodies.body_3d import Suslov3D
from ..._bodies.body_gyrostat import SuslovGyrostat
from ..._bodies.paper import PICTURES
from ..._checks import vectors, wrong

STEPS = 5000
_LINK = 2000


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
    def without_rotor(self) -> Suslov3D:
        """The body at k = 0; ValueError if the parameters are invalid."""
        return Suslov3D(*self[:4])

    @property
    def body(self) -> Suslov3D | SuslovGyrostat:
        """The body; ValueError if the parameters are invalid."""
        return SuslovGyrostat(*self[:4], self.k) if self.k else self.without_rotor

    @property
    def omega0(self) -> list[float]:
        """The initial state."""
        return [self.Omega1, self.Omega2]


def read(texts: Mapping[str, str]) -> Parameters:
    """Read parameters from the text of the fields."""
    values: dict[str, Any] = {}
    for name, text in texts.items():
        try:
            values[name] = float(text)
        except ValueError:
            values[name] = math.nan
        if not math.isfinite(values[name]):
            raise ValueError(f"{name}: expected a number, got {text!r}")
    for name in ("I1", "I2", "extent"):
        if not values.get(name, 1.0) > 0:
            raise ValueError(f"{name}: expected a positive number, got {texts[name]}")
    steps = values["steps"]
    if not (steps == int(steps) and 1 <= steps <= STEPS):
        raise ValueError(f"steps: expected an integer from 1 to {STEPS}, got {texts['steps']}")
    whole = {"steps": int(steps), "portrait": int(bool(values.get("portrait", 0)))}
    return Parameters(**values | whole)


def split(query: str) -> dict[str, str]:
    """Return the fields of a query; ValueError unless each is there once, or has a default."""
    pairs = parse_qsl(query, keep_blank_values=True, max_num_fields=len(Parameters._fields))
    texts = dict(pairs)
    needed = set(Parameters._fields) - set(Parameters._field_defaults)
    if len(texts) < len(pairs) or not needed <= set(texts) <= set(Parameters._fields):
        names = ", ".join(name for name in Parameters._fields if name in needed)
        got = ", ".join(name for name, _ in pairs) or "none"
        raise ValueError(f"expected each of {names} once, got {got}")
    return texts


def query_of_link(link: str) -> str:
    """Return the checked query of an address copied from the page."""
    pairs = dict(parse_qsl(urlsplit(link).query))
    view = {"show": pairs.pop("show")} if "show" in pairs else {}
    if len(link) > _LINK:
        raise ValueError(f"expected at most {_LINK} characters, got {len(link)}")
    parameters = read(split(urlencode(pairs)))
    values = {name: f"{value}".removesuffix(".0") for name, value in parameters._asdict().items()}
    return urlencode(values | view)


def query_of(body: Suslov3D | SuslovGyrostat, eps: float, omega0: Any, steps: int) -> str:
    """Return the query of a page that shows an orbit of a single body."""
    state = vectors("omega0", omega0, 2)
    if body.shape or state.ndim != 1:
        raise wrong("body, omega0", "a single body and a single state", (body.shape, state.shape))
    I1, I2, I13, I23 = map(float, body.parameters[:4])
    extent = 1.5 * float(abs(state).max()) or 1.0
    k = float(getattr(body, "k", 0.0))
    Omega1, Omega2 = state.tolist()
    numbers = Parameters(I1, I2, I13, I23, eps, Omega1, Omega2, steps, extent, k=k)
    texts = {name: f"{value!r}" for name, value in numbers._asdict().items()}
    return urlencode(read(texts)._asdict())


def _of_picture(number: int, Omega1: float, Omega2: float, steps: int) -> Parameters:
    body, eps, extent = PICTURES[number]
    I1, I2, I13, I23 = map(float, body.parameters)
    return Parameters(I1, I2, I13, I23, eps, Omega1, Omega2, steps, extent)


# With I1 = I2 = 1, I13 = 0.25 and I23 = 0 the values of t are exact; all bodies are
# realizable, except those of pictures labelled otherwise.
PRESETS = {
    "A rigid body": Parameters(4.0, 2.0, -0.5, -0.3, 0.2, -0.9, 1.3, 300, 4.0),
    "Long steps: t = 0.5": Parameters(3.0, 3.0, -0.2, -0.2, 1.0, -8.0, 7.0, 40, 14.0),
    "t = 1": Parameters(1.0, 1.0, 0.25, 0.0, 1.0, 2.0, -8.0, 5, 14.0),
    "t > 1: jumps": Parameters(1.0, 1.0, 0.25, 0.0, 1.0, 2.0, -16.0, 60, 30.0),
    "A pole: no next state": Parameters(1.0, 1.0, 0.25, 0.0, 1.0, 2.0, -9.0, 20, 14.0),
    "Paper, picture 1 (no rigid body)": _of_picture(1, -0.8, 1.3, 300),
    "Paper, picture 2": _of_picture(2, -2.5, 5.5, 300),
    "Paper, picture 3": _of_picture(3, -60.0, 3.0, 300),
    "Paper, picture 4": _of_picture(4, -1.5, 1.4, 100),
}
