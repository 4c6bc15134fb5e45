"""What a person moves on the page: a body, a step size, a start and a number of steps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple
from urllib.parse import parse_qsl, urlencode, urlsplit

from ..._bodies.paper import PICTURES
from ..._bodies.three import Suslov3D

STEPS = 5000
# A page remembers in its address what it shows beside the parameters.
_VIEW = ("extent", "show")
_QUERY = 2000


class Parameters(NamedTuple):
    """Numbers, by the names that the address of the page has for them."""

    I1: float
    I2: float
    I13: float
    I23: float
    eps: float
    Omega1: float
    Omega2: float
    steps: int

    @property
    def body(self) -> Suslov3D:
        """The body; ValueError where there is none."""
        return Suslov3D(self.I1, self.I2, self.I13, self.I23)

    @property
    def omega0(self) -> list[float]:
        """The start."""
        return [self.Omega1, self.Omega2]


class WrongValue(ValueError):
    """A value that a person can correct, and the field that holds it."""

    def __init__(self, field: str, message: str) -> None:
        super().__init__(f"{field}: {message}")
        self.field = field


def read(texts: Mapping[str, str]) -> Parameters:
    """Parameters from what the fields of the page hold."""
    values: dict[str, Any] = {}
    for name, text in texts.items():
        try:
            values[name] = float(text)
        except ValueError:
            values[name] = math.nan
        if not math.isfinite(values[name]):
            raise WrongValue(name, f"expected a number, got {text!r}")
    for name in ("I1", "I2"):
        if not values[name] > 0:
            raise WrongValue(name, f"expected a positive number, got {texts[name]}")
    steps = values["steps"]
    if not (steps == int(steps) and 1 <= steps <= STEPS):
        raise WrongValue("steps", f"expected an integer from 1 to {STEPS}, got {texts['steps']}")
    return Parameters(**values | {"steps": int(steps)})


def split(query: str) -> dict[str, str]:
    """The fields of a query, all of them once; ValueError if it is another page's."""
    pairs = parse_qsl(query, keep_blank_values=True, max_num_fields=len(Parameters._fields))
    texts = dict(pairs)
    if len(texts) < len(pairs) or set(texts) != set(Parameters._fields):
        got = ", ".join(name for name, _ in pairs) or "none"
        raise ValueError(f"expected each of {', '.join(Parameters._fields)} once, got {got}")
    return texts


def query_of_link(link: str) -> str:
    """The query of an address that was copied from the page, so that it can be shown again."""
    address = urlsplit(link)
    pairs = dict(parse_qsl(address.query))
    view = {name: pairs.pop(name) for name in _VIEW if name in pairs}
    if len(link) > _QUERY:
        raise ValueError(f"expected at most {_QUERY} characters, got {len(link)}")
    parameters = read(split(urlencode(pairs)))
    values = {name: f"{value}".removesuffix(".0") for name, value in parameters._asdict().items()}
    return urlencode(values | view)


def _of_picture(number: int, Omega1: float, Omega2: float, steps: int) -> Parameters:
    body, eps, _ = PICTURES[number]
    I1, I2, I13, I23 = (float(each) for each in body.parameters)
    return Parameters(I1, I2, I13, I23, eps, Omega1, Omega2, steps)


# States near the repelling half of the line, and how far from 0 the plane reaches.
PRESETS: dict[str, tuple[Parameters, float]] = {
    "Picture 1": (_of_picture(1, -0.8, 1.3, 300), PICTURES[1].extent),
    "Picture 2": (_of_picture(2, -2.5, 5.5, 300), PICTURES[2].extent),
    "Picture 3": (_of_picture(3, -60.0, 3.0, 300), PICTURES[3].extent),
    "Picture 4": (_of_picture(4, -1.5, 1.4, 100), PICTURES[4].extent),
    "Long steps: t = 0.5": (_of_picture(4, -8.0, 7.0, 40), 14.0),
    "t = 1": (Parameters(1.0, 1.0, 1.0, 0.0, 1.0, 0.5, -2.0, 5), 4.0),
    "t > 1: jumps": (Parameters(1.0, 1.0, 1.0, 0.0, 1.0, 0.5, -4.0, 60), 8.0),
    "A pole: no next state": (Parameters(1.0, 1.0, 1.0, 0.0, 1.0, 1.0, -3.0, 20), 5.0),
}
