"""Equations as text: a grammar of their own, read by Python's `ast` without `eval`."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any

import numpy as np

from ..checks import short
from .bounds import LARGEST_EXPONENT, check_expanded, is_chain, parsed
from .expressions import FUNCTIONS, Expression
from .parameters import Parameter


def value_of(text: Any, names: Mapping[str, Any]) -> Any:
    """Return the value of a text of numbers, names, + - * / ** and functions of NumPy.

    `names` has the values of names, which are expressions, columns or numbers. ValueError quotes
    what is anything else.
    """
    tree = parsed(text)
    check_expanded(tree, text)
    try:
        with np.errstate(all="ignore"):  # of numbers that are not finite, which are refused later
            return _value(tree, names, text)
    except ZeroDivisionError:
        raise ValueError(f"equations: {short(text)}: division by zero") from None
    except (TypeError, OverflowError) as error:
        raise ValueError(f"equations: {short(text)}: {error}") from None


def _value(node: Any, names: Mapping[str, Any], text: str) -> Any:
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return Fraction(node.value) if type(node.value) is int else node.value
    if isinstance(node, ast.Name) and node.id in names:
        return names[node.id]
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
        value = _value(node.operand, names, text)
        return -value if isinstance(node.op, ast.USub) else value
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATIONS:
        chain = [node]  # with its left operands, which may be too many for recursion
        while is_chain(node) and isinstance(node.left, ast.BinOp):
            node = node.left
            chain.append(node)
        a = _value(node.left, names, text)
        for node in reversed(chain):
            if type(node.op) not in _OPERATIONS:
                raise _refused(node, text)
            b = _value(node.right, names, text)
            is_power = isinstance(node.op, ast.Pow) and not _is_symbolic(a, b)
            if is_power and abs(b) > LARGEST_EXPONENT:
                raise _refused(node, text)
            a = _OPERATIONS[type(node.op)](a, b)
        return a
    if _is_call(node) and node.func.id in FUNCTIONS:
        values = [_value(each, names, text) for each in node.args]
        if not _is_symbolic(*values):
            values = [float(each) for each in values]
        return getattr(np, node.func.id)(*values)
    raise _refused(node, text)


def _is_call(node: Any) -> bool:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords


def _is_symbolic(*values: Any) -> bool:
    return any(isinstance(each, (Expression, Parameter)) for each in values)


def _refused(node: ast.expr, text: str) -> ValueError:
    part = ast.get_source_segment(text, node) or text
    return ValueError(
        f"equations: {short(part)} is not allowed: use numbers, names of variables and parameters, "
        f"+ - * / ** and {', '.join(FUNCTIONS)}"
    )


_OPERATIONS: dict[Any, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
