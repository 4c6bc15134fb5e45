"""Calls of functions of users with symbolic numbers, and errors in their words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...core.lists.records import FUNCTIONS, OTHER_NAMES
from .advice import explained, name_of, raise_explained
from .symbolic import Symbol, Tracer, Untraceable, applied, interpolated
from .tracing import check_same, checked_function, components


def traced(
    argument: str, f: Any, names: Sequence[str], parameters: Mapping[str, Any], maker: str
) -> tuple[Tracer, list[Any]]:
    """Return the tracer with which f was called, and the operands that are f, or [H]."""
    f = checked_function(argument, f, names, parameters, maker)
    tracer = Tracer(names, [*parameters])
    first, second = (_called(argument, f, tracer) for _ in range(2))
    check_same(argument, [*map(repr, first)], [*map(repr, second)])  # equal operations are one
    return tracer, first


def _called(argument: str, f: Any, tracer: Tracer) -> list[Any]:
    f_name, D = name_of(f, argument), len(tracer.state)
    names = tracer.names[:D]
    try:
        result = f(tracer.state.copy(), **tracer.parameters)
    except Exception as error:  # raised by f
        raise_explained(argument, error, explained(error, f_name, names, False))
    try:
        parts = [result] if argument == "H" else components(result, D)
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


def called_by_name(name: str, arguments: Sequence[Any]) -> Any:
    """Return the value of a function in the text of an equation."""
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
