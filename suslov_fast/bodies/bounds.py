"""Bounds on what a file may ask of its reader, so that a small file cannot take hours or memory.

Lists and equations are measured before anything is computed with them.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Iterable
from fractions import Fraction
from keyword import iskeyword
from typing import Any, NamedTuple

from ..checks import short, wrong

LONGEST_NAME = 200  # characters
MOST_VARIABLES = 2**20
LONGEST_NUMBER = 10_000  # characters of a text "p/q"
LARGEST_EXPONENT = 400  # of a number that is raised to a number, and of 10 in a decimal
_MOST_AXES = 64  # of lists in lists, as in arrays of NumPy
_LONGEST = 1_000_000  # characters of an equation
_DEEPEST = 100  # operations and functions inside each other; a + b - c and a * b / c are one
_MOST_BITS = 2**16  # of a numerator or a denominator
_MOST_TERMS = 2**14  # of a polynomial
_COMMON_BITS = 2**12  # of the denominator that the numbers of a Hamiltonian share


def check_axes(name: str, value: Any) -> None:
    """Raise ValueError for lists and dictionaries that are nested more deeply than arrays."""
    level, axes = [value], 0
    while level := [each for item in level for each in _inside(item)]:
        axes += 1
        if axes > _MOST_AXES:
            raise wrong(name, f"lists of at most {_MOST_AXES} axes", "lists of more")


def _inside(value: Any) -> Iterable[Any]:
    """Return the lists and dictionaries in a list or a dictionary."""
    items = value.values() if isinstance(value, dict) else value
    return (each for each in items if isinstance(each, (list, dict)))


def check_denominators(name: str, values: Iterable[Any]) -> None:
    """Raise ValueError for numbers whose common denominator is so long that sums take minutes."""
    common = 1
    for value in values:
        if isinstance(value, Fraction):
            common = math.lcm(common, value.denominator)
            if common.bit_length() > _COMMON_BITS:
                raise wrong(name, f"fractions with a denominator below 2**{_COMMON_BITS}", "others")


def parsed(text: Any) -> ast.expr:
    """Return the syntax tree of an equation; ValueError if it is too long, too deep or no formula.

    Numbers in it that are computed from others, such as 9**400, have at most 2**16 bits.
    """
    if not isinstance(text, str) or len(text) > _LONGEST:
        raise ValueError(f"equations: {short(text)} is not an equation")
    words = {*re.findall(r"[^\W\d]\w*", text)}
    is_formula = not re.search(r"[^\w\s.,()+*/-]|\b0[xXoObB]", text)
    if not is_formula or any(map(iskeyword, words)):  # Python would warn of "1if"
        raise ValueError(f"equations: {short(text)} is not made of numbers, names, ( ) + - * / **")
    try:
        tree = ast.parse(text, mode="eval").body
    except (SyntaxError, RecursionError, MemoryError, ValueError):
        raise ValueError(f"equations: {short(text)} cannot be read") from None
    _check_depth(tree, text)
    for node, size in _sizes(tree):
        if size.is_number and max(size.numerator, size.denominator) > _MOST_BITS:
            raise _too_large(node, text, f"a number of more than {_MOST_BITS} bits")
    return tree


def check_expanded(tree: ast.expr, text: str) -> None:
    """Raise ValueError for an equation whose powers and products have too many terms."""
    for node, size in _sizes(tree):
        if size.terms > _MOST_TERMS or max(size.numerator, size.denominator) > _MOST_BITS:
            raise _too_large(node, text, f"more than {_MOST_TERMS} terms, or too long numbers")


def _too_large(node: ast.expr, text: str, what: str) -> ValueError:
    part = ast.get_source_segment(text, node) or text
    return ValueError(f"equations: {short(part)} has {what}")


def _check_depth(tree: ast.expr, text: str) -> None:
    level: list[ast.AST] = [tree]
    for _ in range(_DEEPEST):
        inside: list[ast.AST] = []
        for node in level:
            while is_chain(node):
                inside.append(node.right)  # type: ignore[attr-defined]
                node = node.left  # type: ignore[attr-defined]
            inside.extend(ast.iter_child_nodes(node))
        if not (level := inside):
            return
    raise ValueError(f"equations: {short(text)} has more than {_DEEPEST} operations in each other")


def is_chain(node: ast.AST) -> bool:
    """Return whether a node is + - * or /, whose left operand may begin a long chain of them."""
    return isinstance(node, ast.BinOp) and not isinstance(node.op, ast.Pow)


class _Size(NamedTuple):
    """An upper bound on the size of the value of an expression, as a polynomial."""

    numerator: int  # bits of the longest
    denominator: int  # bits without powers of 2, which floats have
    terms: int = 1
    is_number: bool = False


def _sizes(tree: ast.expr) -> Iterable[tuple[ast.expr, _Size]]:
    """Yield each part of an expression and its size, parts of a part first."""
    sizes: dict[ast.AST, _Size] = {}
    for node in reversed([*ast.walk(tree)]):
        if not isinstance(node, ast.expr):
            continue
        size = _Size(1, 0)  # of a name, and of a function
        if isinstance(node, ast.Constant):
            size = _of_number(node.value)
        elif isinstance(node, ast.UnaryOp):
            size = sizes[node.operand]
        elif isinstance(node, ast.BinOp):
            size = _of_operation(node, sizes[node.left], sizes[node.right])
        sizes[node] = size
        yield node, size


def _of_number(value: Any) -> _Size:
    if isinstance(value, float) and math.isfinite(value):
        return _Size(sum(map(int.bit_length, value.as_integer_ratio())), 0, 1, True)
    return _Size(value.bit_length() if isinstance(value, int) else 1, 0, 1, True)


def _of_operation(node: ast.BinOp, a: _Size, b: _Size) -> _Size:
    is_number = a.is_number and b.is_number
    terms, numerator, denominator = 1, a.numerator + b.numerator, a.denominator + b.denominator
    if isinstance(node.op, (ast.Add, ast.Sub)):
        terms = a.terms + b.terms
        numerator = 1 + max(a.numerator + b.denominator, b.numerator + a.denominator)
    elif isinstance(node.op, ast.Mult):
        terms = a.terms * b.terms
        numerator += min(a.terms, b.terms).bit_length() - 1
    elif isinstance(node.op, ast.Div):
        terms = a.terms
        numerator, denominator = a.numerator + b.denominator, a.denominator + b.numerator
    elif isinstance(node.op, ast.Pow):
        n = _exponent(node.right, b.is_number)
        terms = math.comb(a.terms + n - 1, n) if a.terms > 1 else 1
        numerator, denominator = (a.numerator + a.terms.bit_length() - 1) * n, a.denominator * n
        if isinstance(node.right, ast.UnaryOp):  # a negative one
            numerator, denominator = max(numerator, denominator), max(numerator, denominator)
    return _Size(min(numerator, _HUGE), min(denominator, _HUGE), min(terms, _HUGE), is_number)


_HUGE = 2**40  # sizes beyond are not told apart


def _exponent(node: ast.expr, is_number: bool) -> int:
    """Return the modulus of an exponent, rounded up, or LARGEST_EXPONENT if it is computed."""
    while isinstance(node, ast.UnaryOp):
        node = node.operand
    if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)):
        return math.ceil(min(node.value, _MOST_BITS))
    return LARGEST_EXPONENT if is_number else 1
