"""Equations as text: writes lists of operations as formulas, and reads formulas without `eval`.

The size and the depth of texts are limited, so that no file can keep its reader busy.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from itertools import count
from typing import Any

import numpy as np

from ..checks import short
from ..core.expressions.function_records import FUNCTIONS, RECORDS, same
from .tolerances import (
    DEEPEST_READ,
    DEEPEST_WRITTEN,
    LARGEST_DENOMINATOR,
    LONGEST_DECIMAL,
    LONGEST_EQUATION,
    LONGEST_EQUATIONS,
)

_INSTRUCTIONS = {
    "fadd": "add", "fsub": "subtract", "fmul": "multiply", "fdiv": "divide", "fabs": "absolute",
    "select": "where", "olt": "less", "ogt": "greater", "oge": "greater_equal", "oeq": "equal",
    "and": "logical_and", "or": "logical_or", "xor": "logical_xor", "max": "maximum",
    "min": "minimum", **{record.instruction: record.name for record in RECORDS.values()},
}  # fmt: skip
_NONE: dict[float, Fraction] = {}
# The precedence of operators in Python: signs with larger numbers bind tighter.
_CALL, _UNARY = 10, 8
_LEVELS = {
    "power": 9, "multiply": 7, "divide": 7, "floor_divide": 7, "remainder": 7, "add": 6,
    "subtract": 6, "logical_and": 4, "logical_xor": 3, "logical_or": 2,
    **dict.fromkeys("less greater less_equal greater_equal equal not_equal".split(), 1),
}  # fmt: skip


# --------------------------------------------------------------------------------- writing
def _node(values: Any, number: int) -> tuple[str, Sequence[Any], Sequence[Any]]:
    """Return the name of the function that computes a value, its operands, and its tables."""
    if number in values.written:
        name, operands, *tables = values.written[number]
        return name, operands, tables
    instruction, operands = values.of[number]
    if instruction == "fmul" and same(operands[0], -1.0):
        return "negative", operands[1:], ()
    return _INSTRUCTIONS[instruction], operands, ()


def _number(c: float, ratios: Mapping[float, Fraction] = _NONE) -> tuple[str, int]:
    """Return the text of a constant, such as 0.1 or 8/3, and how tightly its sign binds."""
    is_whole = c == np.floor(c) and abs(c) < 1e15 and not same(c, -0.0)
    text = str(int(c)) if is_whole else repr(c)
    if len(text) > LONGEST_DECIMAL and math.isfinite(c):
        ratio = ratios.get(c) or Fraction(c).limit_denominator(LARGEST_DENOMINATOR)
        if float(ratio) == c and max(abs(ratio.numerator), ratio.denominator) < 2**53:
            return str(ratio), _LEVELS["divide"]
    return text, _UNARY if text.startswith("-") else _CALL


def _joined(name: str, parts: Sequence[tuple[str, int]], tables: Sequence[Any]) -> tuple[str, int]:
    """Return the text of a function of texts, and how tightly its sign binds."""
    sign = FUNCTIONS[name].sign if name in FUNCTIONS else ""
    if name in ("negative", "logical_not"):
        ((text, level),) = parts
        return f"{sign or '-'}{text if level >= _UNARY else f'({text})'}", _UNARY
    if not sign:
        written = [text for text, _ in parts]
        for table in tables:
            is_list = isinstance(table, tuple)
            texts = [_number(c)[0] for c in (table if is_list else [table])]
            comma = "," * (len(texts) == 1)
            written.append(f"({', '.join(texts)}{comma})" if is_list else texts[0])
        return f"{'abs' if name == 'absolute' else name}({', '.join(written)})", _CALL
    own = _LEVELS[name]
    least = own + (own in (1, 9)), own + 1  # brackets also in (a < b) < c and (a**b)**c
    left, right = (
        text if level >= bound else f"({text})"
        for (text, level), bound in zip(parts, least, strict=True)
    )
    space = "" if own in (7, 9) else " "
    return f"{left}{space}{sign}{space}{right}", own


def brief(
    values: Any,
    operand: Any,
    names: Sequence[str],
    length: int = 60,
    ratios: Mapping[float, Fraction] = _NONE,
) -> str:
    """Return the text of a value for readers, "..." if it names more than `length` values."""
    size, stack = 0, [operand]
    while stack:
        a = stack.pop()
        size += 1
        if size > length:
            return "..."
        if not isinstance(a, float) and a in values.of:
            stack.extend(_node(values, a)[1])
    [text] = written(values, [operand], names, ratios, defines=False)[1]
    return text


def written(
    values: Any,
    results: Sequence[Any],
    names: Sequence[str],
    ratios: Mapping[float, Fraction] = _NONE,
    defines: bool = True,
) -> tuple[dict[str, str], list[str]]:
    """Return definitions of values that occur twice or are nested deeply, and texts of results."""
    of, order = {}, []
    stack = [(a, False) for a in reversed(results)]
    while stack:
        a, is_ready = stack.pop()
        if isinstance(a, float) or a < len(names) or (a in of and not is_ready):
            continue
        if is_ready:
            order.append(a)
        else:
            of[a] = _node(values, a)
            stack.append((a, True))
            stack.extend((b, False) for b in reversed(of[a][1]))
    uses = Counter(b for _, operands, _ in of.values() for b in _numbers(operands))
    uses.update(_numbers(results))
    free = (f"u{k}" for k in count(1))
    texts: dict[int, tuple[str, int]] = {i: (name, _CALL) for i, name in enumerate(names)}
    depths: dict[Any, int] = {}
    definitions: dict[str, str] = {}
    for a in order:
        name, operands, tables = of[a]
        parts = [_number(b, ratios) if isinstance(b, float) else texts[b] for b in operands]
        texts[a] = _joined(name, parts, tables)
        depths[a] = 1 + max((depths.get(b, 0) for b in _numbers(operands)), default=0)
        if defines and ((uses[a] > 1 and operands) or depths[a] >= DEEPEST_WRITTEN):
            new = next(each for each in free if each not in names)
            definitions[new], texts[a], depths[a] = texts[a][0], (new, _CALL), 0
    rows = [_number(a, ratios) if isinstance(a, float) else texts[a] for a in results]
    return definitions, [text for text, _ in rows]


def _numbers(operands: Sequence[Any]) -> set[int]:
    """Return the operands that are values, not constants."""
    return {a for a in operands if not isinstance(a, float)}


# --------------------------------------------------------------------------------- reading
def _divided(a: Any, b: Any) -> Any:
    """Return a quotient; of integers as a fraction, because it was typed as a fraction."""
    if isinstance(a, float) and isinstance(b, float) and a.is_integer() and b.is_integer() and b:
        return Fraction(int(a), int(b))
    return a / b


_OPERATORS: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul,
    ast.Div: _divided, ast.Pow: operator.pow, ast.Mod: operator.mod,
    ast.FloorDiv: operator.floordiv, ast.BitAnd: operator.and_, ast.BitOr: operator.or_,
    ast.BitXor: operator.xor, ast.Lt: operator.lt, ast.Gt: operator.gt, ast.LtE: operator.le,
    ast.GtE: operator.ge, ast.Eq: operator.eq, ast.NotEq: operator.ne, ast.USub: operator.neg,
    ast.UAdd: operator.pos, ast.Invert: operator.invert,
}  # fmt: skip
_CHARACTERS = re.compile(r"[\w\s.,()+*/%<>=!&|^~-]*")


def values_of(
    texts: Iterable[tuple[Any, Any]],
    names: Mapping[str, Any],
    calls: Callable[[str, Sequence[Any]], Any],
) -> dict[Any, Any]:
    """Return the values of named formulas, and of the variables and parameters in `names`.

    A formula may use the names of formulas before it. ``calls(name, arguments)`` returns the value
    of a function.
    """
    known: dict[Any, Any] = dict(names)
    length = 0
    for name, text in texts:
        length += len(text) if isinstance(text, str) else 0
        if length > LONGEST_EQUATIONS:
            raise ValueError(f"equations: all have more than {LONGEST_EQUATIONS} characters")
        tree = _parsed(text)
        try:
            known[name] = _value(tree, known, calls, 0)
        except (ArithmeticError, TypeError, RecursionError) as error:
            raise ValueError(f"equations: {short(text)}: {error.args[-1]}") from None
        if isinstance(known[name], tuple):
            raise ValueError(f"equations: {short(text)} is no number")
    return known


def _parsed(text: Any) -> Any:
    """Return the syntax tree of a formula."""
    if not isinstance(text, str) or len(text) > LONGEST_EQUATION or not _CHARACTERS.fullmatch(text):
        how = f"a text of at most {LONGEST_EQUATION} characters, names, numbers and signs of Python"
        if ":" in str(text):
            how = "a formula, without units and : signs"
        if "[" in str(text):
            how = "a text whose tables are in parentheses, interp(x, (0, 1, 2), (0, 1, 0))"
        raise ValueError(f"equations: each must be {how}, not {short(text)}")
    try:
        return ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, RecursionError, MemoryError, ValueError):
        how = "write formulas as in Python, 2*x, x**2, and x - 1 for x = 1"
        raise ValueError(f"equations: {short(text)} cannot be read: {how}") from None


def _value(node: Any, known: Mapping[str, Any], calls: Any, depth: int) -> Any:
    """Return the value of a syntax tree; `depth` counts the operations around it."""
    if depth > DEEPEST_READ:
        raise ValueError(f"equations: more than {DEEPEST_READ} operations in each other")
    chain = []
    while isinstance(node, ast.BinOp):  # long sums (a + b) + c + ... do not count as deep
        chain.append(node)
        node = node.left
    value = _of_part(node, known, calls, depth + 1)
    for each in reversed(chain):
        right = _value(each.right, known, calls, depth + 1)
        operate = _OPERATORS.get(type(each.op)) or _no(each)
        value = operate(value, right)
    return value


def _of_part(node: Any, known: Mapping[str, Any], calls: Any, depth: int) -> Any:
    """Return the value of a syntax tree that does not begin with an operation of two numbers."""
    if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)):
        return float(node.value)
    if isinstance(node, ast.Name):
        if node.id in known:
            return known[node.id]
        if node.id in ("inf", "nan"):
            return float(node.id)
        names = ", ".join(name for name in known if isinstance(name, str))
        if node.id in ("t", "time"):
            how = f"time is a variable: add the equation {node.id}' = 1"
            raise ValueError(f"equations: there is no {node.id}: {how}")
        raise ValueError(
            f"equations: a name must be one of {names}, not {short(node.id)}: write its value"
        )
    if isinstance(node, ast.Attribute) and ast.unparse(node) in known:
        return known[ast.unparse(node)]  # a part of a complex variable
    if isinstance(node, ast.UnaryOp) and type(node.op) in _OPERATORS:
        return _OPERATORS[type(node.op)](_value(node.operand, known, calls, depth))
    if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in _OPERATORS:
        sides = (_value(side, known, calls, depth) for side in (node.left, node.comparators[0]))
        return _OPERATORS[type(node.ops[0])](*sides)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        arguments = [_value(each, known, calls, depth) for each in node.args]
        return calls(node.func.id, [float(a) if isinstance(a, Fraction) else a for a in arguments])
    if isinstance(node, ast.Tuple):
        return tuple(_value(each, known, calls, depth) for each in node.elts)
    return _no(node)


def _no(node: Any) -> Any:
    """Raise the error of a syntax tree that no formula has."""
    raise ValueError(f"equations: {short(ast.unparse(node))} has no meaning in an equation")
