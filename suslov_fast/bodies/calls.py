"""Calls of functions of users with symbolic numbers, and errors in their words."""

from __future__ import annotations

import re
import traceback
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..core.lists.records import FUNCTIONS, OTHER_NAMES
from .advice import (
    check_arguments,
    check_callable,
    explained,
    name_of,
    of_numpy,
    raise_explained,
)
from .symbolic import HOW, Symbol, Tracer, Untraceable
from .tracing import _components

# Functions of `math` with another name in NumPy.
_OF_MATH = {
    "asin": "arcsin", "acos": "arccos", "atan": "arctan", "atan2": "arctan2", "asinh": "arcsinh",
    "acosh": "arccosh", "atanh": "arctanh", "pow": "power", "fabs": "abs", "ceil": "ceil",
}  # fmt: skip


def traced(
    argument: str, f: Any, names: Sequence[str], parameters: Mapping[str, Any], maker: str
) -> tuple[Tracer, list[Any]]:
    """Return the tracer with which f was called, and the operands that are f, or [H]."""
    check_callable(argument, f)
    f = getattr(f, "py_func", f)  # the Python function, if Numba compiled f
    check_arguments(argument, f, names, parameters, maker)
    tracer = Tracer(names, [*parameters])
    first, second = (_called(argument, f, tracer) for _ in range(2))
    if [*map(repr, first)] != [*map(repr, second)]:  # equal operations have one value
        how = "f must compute from x and its parameters alone, without random numbers or memory"
        raise ValueError(f"{argument}: two calls of f differ: {how}")
    return tracer, first


def _called(argument: str, f: Any, tracer: Tracer) -> list[Any]:
    f_name, D = name_of(f, argument), len(tracer.state)
    names = tracer.names[:D]
    try:
        result = f(tracer.state.copy(), **tracer.parameters)
    except Untraceable as error:
        raise TypeError(f"{argument}: {error}") from None
    except Exception as error:  # raised by f
        why = _of_package(error) or _of_math(error)
        raise_explained(argument, error, why or explained(error, f_name, names, False))
    try:
        parts = [result] if argument == "H" else _components(result, D)
    except (TypeError, ValueError) as error:
        raise type(error)(f"{argument}: {error}") from None
    labels = [f_name] if argument == "H" else [f"{name}'" for name in names]
    return [
        _operand(tracer, part, label, argument) for part, label in zip(parts, labels, strict=True)
    ]


def _operand(tracer: Tracer, value: Any, name: str, argument: str) -> Any:
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.item()
    try:
        return tracer.number(value)
    except Untraceable as error:
        text = f"{name} must be an expression of x: {error}"
        raise TypeError(f"{argument}: {text}") from None


def _of_package(error: Exception) -> str:
    """Return what to write in place of a function of NumPy or of a package."""
    text = str(error)
    function = of_numpy(error)
    if found := re.search(r"ufunc '(\w+)' not supported", text):
        function = found[1]
        if function in FUNCTIONS:  # which has no loop for objects
            how = f"x is an array, write {function}(x) in place of {function}(np.array(x))"
            return f"{function} of an array made by np.array takes no symbols: {how}"
    if not function:
        return ""
    how = f"write {HOW[function]}" if function in HOW else "write formulas of the entries"
    return f"calls {function} of NumPy, which takes no symbols: {how}"


def _of_math(error: Exception) -> str:
    """Return what to write where a number was wanted, and a symbol came; "" for other errors."""
    text = str(error)
    wants_integer = "cannot be interpreted as an integer" in text or "list indices" in text
    if wants_integer and "Symbol" in text:
        how = "fix it in f, as in lambda x, a: f(x, a, n=3)"
        return f"a parameter or a component counts or is an index, and has no value yet: {how}"
    if "must be real number, not" not in text and "() argument must be" not in text:
        return ""
    frames = traceback.extract_tb(error.__traceback__)
    last = frames[-1]
    if "site-packages" in last.filename or last.filename.endswith(".pyx"):
        how = "write formulas of NumPy, and np.interp(x, knots, values) for a table or a spline"
        return f"a function of a package takes no symbols: {how}"
    segment = _segment(last)
    line = (segment or last.line or "").strip()
    if re.fullmatch(r"\w+\[.*\]", segment):  # the target of an assignment
        how = "return a tuple, or fill np.zeros(n, dtype=object) or np.zeros_like(x)"
        return f"{line}: an array of floats takes no symbols: {how}"
    found = re.search(r"\bmath\.(\w+)\(", segment or line) or re.search(r"\b(\w+)\(", segment)
    if found is None or found[1] in ("float", "int", "array", "asarray", "complex"):
        how = "leave the conversion out; np.floor in place of int, np.array(x, object) for arrays"
        return f"{line}: a symbol has no value yet, so it is not converted to a number: {how}"
    name = _OF_MATH.get(found[1], found[1])
    if name not in FUNCTIONS and name not in OTHER_NAMES:
        how = f"write {HOW[name]}" if name in HOW else "write a formula of NumPy's functions"
        return f"{line}: {found[1]} takes no symbols: {how}"
    call = re.sub(rf"(math\.)?\b{found[1]}\(", f"np.{name}(", segment or found[0])
    return f"{found[0]}…) of math takes no symbols: write np.{name}, as in {call}"


def _segment(frame: Any) -> str:
    """Return the part of the line of a frame that raised."""
    line, begin, end = frame.line or "", getattr(frame, "colno", None), frame.end_colno
    if begin is None or end is None or frame.lineno != frame.end_lineno:
        return line
    original = frame._original_line if hasattr(frame, "_original_line") else line
    return str(original)[begin:end]


def called_by_name(name: str, arguments: Sequence[Any]) -> Any:
    """Return the value of a function in the text of an equation."""
    from .symbolic import applied, interpolated

    if name == "interp":
        return interpolated(*arguments)
    own = OTHER_NAMES.get(name, name)
    record = FUNCTIONS.get(own)
    if record is None or record.sign or len(arguments) != record.operands:
        raise ValueError(f"equations: there is no function {name} of {len(arguments)}")
    if any(isinstance(a, tuple) for a in arguments):
        raise ValueError(f"equations: {name} takes numbers")
    if not any(isinstance(a, Symbol) for a in arguments):
        with np.errstate(all="ignore"):
            return float(applied(own, *arguments))
    return applied(own, *arguments)
