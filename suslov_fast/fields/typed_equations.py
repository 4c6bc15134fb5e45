"""Equations as a user types them in one text: x' = v; v' = -k*x; k = 2."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from ..checks import wrong
from .exact_numbers import from_text

_LIKE = "x' = a*x - x*y; y' = x*y - y; a = 2"


def equations_of_text(text: str, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return entries of `to_dict`: names, equations, and parameters with those in the text."""
    equations: dict[str, str] = {}
    values = dict(parameters)
    for part in filter(str.strip, re.split("[;\n]", text)):
        left, sign, value = (each.strip() for each in part.partition("="))
        left = re.sub(r"^d(\w+)/dt$", r"\1'", left)
        name = left.removesuffix("'").rstrip()
        if not (sign and name and value) or "'" in name or re.search("(^|[^<>=!])=[^=]", value):
            how = f"write equations of order 1, with a ; between two: {_LIKE}"
            raise ValueError(f"equations: {part.strip()!r} cannot be read: {how}")
        if name in equations or name in values:
            raise ValueError(f"equations: {name} has two lines or values: write one")
        if left.endswith("'"):
            equations[name] = value
            continue
        try:
            values[name] = from_text(value) if "/" in value else float(value)
        except ValueError:
            how = f"a parameter is a number; if it is an equation write {name}' = {value}"
            raise ValueError(f"equations: {part.strip()}: {how}") from None
    if not equations:
        raise wrong("equations", f"like {_LIKE}", repr(text))
    return {"names": [*equations], "equations": [*equations.values()], "parameters": values}
