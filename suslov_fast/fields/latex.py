"""Equations in LaTeX, for notebooks, from their texts."""

from __future__ import annotations

import ast
import re
from collections.abc import Sequence
from typing import Any

from .names import latex
from .tolerances import LONGEST_LATEX

_SIGNS: dict[type, str] = {
    ast.Add: " + ", ast.Sub: " - ", ast.Mult: r" \, ", ast.BitAnd: r" \land ", ast.BitOr: r" \lor ",
    ast.BitXor: r" \oplus ", ast.Mod: r" \bmod ", ast.Lt: " < ", ast.Gt: " > ", ast.LtE: r" \le ",
    ast.GtE: r" \ge ", ast.Eq: " = ", ast.NotEq: r" \ne ", ast.USub: "-", ast.UAdd: "",
    ast.Invert: r"\lnot ",
}  # fmt: skip
# Signs with larger numbers bind tighter. A quotient is a fraction, whose parts need no brackets.
_LEVELS: dict[type, int] = {
    ast.BitOr: -2, ast.BitXor: -1, ast.BitAnd: 0, ast.Add: 2, ast.Sub: 2, ast.USub: 3, ast.UAdd: 3,
    ast.Mod: 3, ast.Mult: 3, ast.Invert: 3, ast.Div: 4, ast.FloorDiv: 4, ast.Pow: 4,
}  # fmt: skip
_ATOM = 5
_FUNCTIONS = frozenset("sin cos tan sinh cosh tanh exp log arcsin arccos arctan".split())


def symbol(name: str) -> str:
    """Return the LaTeX of a name."""
    if text := latex(name):
        return text
    if part := {"real": "Re", "imag": "Im"}.get(name.partition(".")[2]):
        return rf"\mathrm{{{part}}}\,{symbol(name.partition('.')[0])}"
    stem = name.rstrip("0123456789")
    word, index = stem.rstrip("_").replace("_", r"\_"), name[len(stem) :]
    return rf"\mathrm{{{word}}}" + (f"_{{{index}}}" if index else "")


def equations(rows: Sequence[tuple[str, str]]) -> str | None:
    """Return equations of left sides, in LaTeX, and texts; None if a text is no formula."""
    if sum(len(text) for _, text in rows) > LONGEST_LATEX:
        return None
    try:
        lines = [rf"{left} &= {formula(text)}" for left, text in rows]
    except (SyntaxError, KeyError, RecursionError):
        return None
    return "$\\displaystyle \\begin{aligned}" + r" \\ ".join(lines) + "\\end{aligned}$"


def formula(text: str) -> str:
    """Return the LaTeX of a formula that is a text, with powers as ^ or as **."""
    return _of(ast.parse(re.sub(r"\^(?=\d)", "**", text), mode="eval").body)[0]


def _of(node: Any) -> tuple[str, int]:
    """Return the LaTeX of a formula, and how tightly its sign binds."""
    if isinstance(node, ast.Constant) and node.value is not Ellipsis:
        text = repr(node.value)
        if "e" in text:
            digits, exponent = text.split("e")
            return rf"{digits} \cdot 10^{{{int(exponent)}}}", 3
        return text, _ATOM
    if isinstance(node, (ast.Name, ast.Attribute)):
        return symbol(ast.unparse(node)), _ATOM
    if isinstance(node, ast.UnaryOp):
        level = _LEVELS[type(node.op)]
        return f"{_SIGNS[type(node.op)]}{_within(node.operand, 3)}", level
    if isinstance(node, ast.BinOp):
        kind = type(node.op)
        first = node.left
        if kind is ast.Div and isinstance(first, ast.UnaryOp) and isinstance(first.op, ast.USub):
            quotient = ast.BinOp(first.operand, node.op, node.right)
            return f"-{_of(quotient)[0]}", 3
        if kind in (ast.Div, ast.FloorDiv):
            top, bottom = (_of(each)[0] for each in (node.left, node.right))
            text = rf"\frac{{{top}}}{{{bottom}}}"
            return (text, 4) if kind is ast.Div else (rf"\left\lfloor {text} \right\rfloor", _ATOM)
        if kind is ast.Pow:
            return f"{_within(node.left, _ATOM)}^{{{_of(node.right)[0]}}}", 4
        level = _LEVELS[kind]
        left, right = _within(node.left, level), _within(node.right, level + 1)
        if kind is ast.Mult and re.match(r"\d", right):
            return rf"{left} \cdot {right}", level
        return f"{left}{_SIGNS[kind]}{right}", level
    if isinstance(node, ast.Compare):
        left, right = (_within(each, 2) for each in (node.left, node.comparators[0]))
        return f"{left}{_SIGNS[type(node.ops[0])]}{right}", 1
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        return _call(node.func.id, [_of(each)[0] for each in node.args]), _ATOM
    raise SyntaxError


def _call(name: str, arguments: Sequence[str]) -> str:
    """Return the LaTeX of a function of arguments in LaTeX."""
    if name == "sqrt":
        return rf"\sqrt{{{arguments[0]}}}"
    if name == "abs":
        return rf"\left|{arguments[0]}\right|"
    if name == "quotient":
        top, bottom = (rf"{a} + i \, \left({b}\right)" for a, b in (arguments[:2], arguments[2:]))
        return rf"\mathrm{{Re}}\,\frac{{{top}}}{{{bottom}}}"
    escaped = name.replace("_", r"\_")
    word = f"\\{name}" if name in _FUNCTIONS else rf"\operatorname{{{escaped}}}"
    return rf"{word}\left({', '.join(arguments)}\right)"


def _within(node: Any, least: int) -> str:
    """Return the LaTeX of an operand, in brackets if its sign binds less tightly than `least`."""
    text, level = _of(node)
    return text if level >= least else rf"\left({text}\right)"
