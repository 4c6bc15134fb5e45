"""What bodies are as values: parameters that nobody can change, equality, text and plain data."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any

import numpy as np

from .._checks import FloatArray

# Characters of a line that a body is shown in.
_LINE = 100


def frozen(array: FloatArray) -> float | FloatArray:
    """A number as a float, an array as a copy that can never be made writeable."""
    if array.ndim == 0:
        return float(array)
    return np.frombuffer(array.tobytes(), np.float64).reshape(array.shape)


def times_power(value: float, exponent: int) -> float:
    """value 2**exponent, some ten times faster than NumPy has it; infinite beyond float64."""
    try:
        return math.ldexp(value, exponent)
    except OverflowError:
        return math.copysign(math.inf, value)


def parameters_of(body: Any) -> dict[str, float | FloatArray]:
    """The parameters that are set, by name."""
    values = {field: getattr(body, field.name) for field in fields(body)}
    return {
        field.name: value
        for field, value in values.items()
        if value is not None or field.default is MISSING
    }


def equal(body: Any, other: Any) -> Any:
    """Whether both are bodies of one kind with the same parameters."""
    if type(other) is not type(body):
        return NotImplemented
    own, others = parameters_of(body), parameters_of(other)
    return own.keys() == others.keys() and all(map(np.array_equal, own.values(), others.values()))


def hash_of(body: Any) -> int:
    # Adding 0 makes one of the two zeros, which are equal.
    arrays = [np.asarray(parameter) + 0.0 for parameter in parameters_of(body).values()]
    return hash(tuple((array.shape, array.tobytes()) for array in arrays))


def line_of(body: Any) -> str:
    """The call that makes the body, or where that is too long the shapes of its parameters."""
    pairs = parameters_of(body).items()
    small = sum(np.size(parameter) for _, parameter in pairs) <= _LINE // 4
    if small:
        shown = ", ".join(f"{name}={_whole(parameter)}" for name, parameter in pairs)
        if len(shown) < _LINE:
            return f"{type(body).__name__}({shown})"
    shown = ", ".join(f"{name}={_short(parameter)}" for name, parameter in pairs)
    return f"<{type(body).__name__} of shape {body.shape}: {shown}>"


def table_of(body: Any) -> str:
    """The parameters as a short table in HTML, for notebooks: of many numbers, the range."""
    rows = "".join(
        f"<tr><th>{name}</th><td>{_brief(parameter)}</td></tr>"
        for name, parameter in parameters_of(body).items()
    )
    of_shape = f", shape {body.shape}" if body.shape else ""
    return f"<table><caption>{type(body).__name__}{of_shape}</caption>{rows}</table>"


def _brief(parameter: float | FloatArray) -> str:
    size = np.size(parameter)
    if size <= _LINE // 10:
        return _whole(parameter)
    return f"{np.min(parameter):g} ... {np.max(parameter):g}, shape {np.shape(parameter)}"


def _whole(parameter: float | FloatArray) -> str:
    return repr(np.asarray(parameter).tolist())


def _short(parameter: float | FloatArray) -> str:
    return repr(parameter) if np.ndim(parameter) == 0 else f"{np.shape(parameter)}"


def plain(body: Any) -> dict[str, Any]:
    """The parameters as numbers and nested lists by name."""
    return {name: np.asarray(parameter).tolist() for name, parameter in parameters_of(body).items()}


def named(cls: Any, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """The reverse of `plain`, or an error that says what names were expected."""
    names = [field.name for field in fields(cls)]
    optional = {field.name for field in fields(cls) if field.default is not MISSING}
    if not isinstance(parameters, Mapping):
        raise TypeError(f"expected a mapping of {names}, got {type(parameters).__name__}")
    if not set(names) - optional <= set(parameters) <= set(names):
        raise ValueError(f"expected the names {names}, got {sorted(map(str, parameters))}")
    return dict(parameters)
