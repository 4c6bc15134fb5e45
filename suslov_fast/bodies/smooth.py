"""Calls of functions of users with expressions, for `LiftedField`, and errors in their words."""

from __future__ import annotations

import re
import traceback
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..checks import short
from .advice import (
    check_arguments,
    check_callable,
    explained,
    name_of,
    of_numpy,
    prefixed,
    raise_explained,
)
from .columns import Refused
from .definitions import Definitions
from .expressions import FUNCTIONS, NotSmooth, as_polynomial, state_of
from .polynomials import Polynomial
from .tracing import _components

# Functions of `math` with another name in NumPy.
_OF_MATH = {"atan": "arctan", "pow": "power"}


def traced(
    argument: str, f: Any, definitions: Definitions, parameters: Mapping[str, Any], maker: str
) -> list[Polynomial]:
    """Return the components of f, or [H], as polynomials in the state and added variables."""
    names = definitions.names
    check_callable(argument, f)
    f = getattr(f, "py_func", f)
    f_name = name_of(f, argument)
    check_arguments(argument, f, names, parameters, maker)
    is_family = any(hasattr(each, "values") for each in parameters.values())
    state: Any = state_of(definitions)
    try:
        result = f(tuple(state), **parameters)
    except NotSmooth as error:
        raise TypeError(prefixed(argument, f"{f_name} {error.in_words(names)}")) from None
    except Refused as error:
        how = "make one field for each value"
        text = f"{f_name} {error or 'needs single values'}: {how}"
        raise TypeError(prefixed(argument, text)) from None
    except Exception as error:  # raised by f
        of_math = "" if of_numpy(error) else _of_math(error)
        cause = of_math or explained(error, f_name, names, is_family)
        raise_explained(argument, error, cause)
    try:
        parts = [result] if argument == "H" else _components(result, len(names))
    except (TypeError, ValueError) as error:
        raise type(error)(f"{argument}: {error}") from None
    labels = [f_name] if argument == "H" else [f"{name}'" for name in names]
    return [_polynomial(*pair, argument) for pair in zip(parts, labels, strict=True)]


def _polynomial(value: Any, name: str, argument: str) -> Polynomial:
    if isinstance(value, np.ndarray) and not value.ndim:
        value = value.item()  # of np.where, with a condition of parameters
    try:
        return as_polynomial(value)
    except (TypeError, Refused):
        how = ""
        if isinstance(value, complex):
            how = ": split complex variables into real and imaginary parts"
        raise TypeError(
            f"{argument}: {name} must be an expression of x, not {short(value)}{how}"
        ) from None


def _of_math(error: Exception) -> str:
    """Return what to write in place of a function of `math`; "" for other errors."""
    text = str(error)
    if "must be real number, not" not in text and "() argument must be" not in text:
        return ""
    last = traceback.extract_tb(error.__traceback__)[-1]
    line = (last.line or "").strip()
    if re.fullmatch(r"\w+\[.*\]", _segment(last)):  # the target of an assignment
        how = "return a tuple, or fill np.zeros(D, dtype=object)"
        return f"{line}: an array of floats takes no symbols: {how}"
    found = re.search(r"\bmath\.(\w+)\(", _segment(last) or line) or re.search(
        r"\b(\w+)\(", _segment(last)
    )
    if found is None:
        return "functions of math take no symbols: write those of NumPy, such as np.exp(x)"
    name = _OF_MATH.get(found[1], found[1])
    if name not in FUNCTIONS:
        return f"{found[1]} has no rule; those with one are {', '.join(FUNCTIONS)}"
    call = re.sub(rf"(math\.)?\b{found[1]}\(", f"np.{name}(", _segment(last) or found[0])
    return f"{found[0]}…) of math takes no symbols: write np.{name}, as in {call}"


def _segment(frame: Any) -> str:
    """Return the part of the line of a frame that raised."""
    line, begin, end = frame.line or "", getattr(frame, "colno", None), frame.end_colno
    if begin is None or end is None or frame.lineno != frame.end_lineno:
        return line
    original = frame._original_line if hasattr(frame, "_original_line") else line
    return str(original)[begin:end]
