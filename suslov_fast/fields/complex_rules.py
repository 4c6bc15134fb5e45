"""Functions of complex numbers as formulas of their real and imaginary parts.

A part is a number, or a symbol with Python's operators and NumPy's functions. Parts that are the
numbers 0, 1 and -1 cause no operations.
"""

import math
from typing import Any

import numpy as np


def _is(a: Any, number: float) -> bool:
    return isinstance(a, (int, float)) and a == number


def _add(a: Any, b: Any) -> Any:
    return b if _is(a, 0) else a if _is(b, 0) else a + b


def _sub(a: Any, b: Any) -> Any:
    return _neg(b) if _is(a, 0) else a if _is(b, 0) else a - b


def _neg(a: Any) -> Any:
    return 0.0 if _is(a, 0) else -a


def _mul(a: Any, b: Any) -> Any:
    if _is(a, 0) or _is(b, 0):
        return 0.0
    if _is(a, -1) or _is(b, -1):
        return -b if _is(a, -1) else -a
    return b if _is(a, 1) else a if _is(b, 1) else a * b


def _product(a: Any, b: Any, c: Any, d: Any) -> tuple[Any, Any]:
    if a is c and b is d:  # a square
        return _sub(_mul(a, a), _mul(b, b)), _mul(2.0, _mul(a, b))
    return _sub(_mul(a, c), _mul(b, d)), _add(_mul(a, d), _mul(b, c))


def _over(a: Any, b: Any) -> Any:
    return 0.0 if _is(a, 0) else a if _is(b, 1) else a / b


def _quotient(a: Any, b: Any, c: Any, d: Any) -> tuple[Any, Any]:
    """Return (a + i b) / (c + i d) for any size of c and d."""
    if _is(d, 0):
        return _over(a, c), _over(b, c)
    if _is(c, 0):
        return _over(b, d), _neg(_over(a, d))
    if isinstance(c, (int, float)) and isinstance(d, (int, float)):
        return _product(a, b, (1 / complex(c, d)).real, (1 / complex(c, d)).imag)
    tracer = (d if isinstance(c, (int, float)) else c).tracer

    def real(*operands: Any) -> Any:
        return tracer.applied("quotient", [*map(tracer.number, operands)])

    return real(a, b, c, d), real(b, _neg(a), c, d)


def _polar(size: Any, angle: Any) -> tuple[Any, Any]:
    return _mul(size, np.cos(angle)), _mul(size, np.sin(angle))


def _scaled_by(factor: float, z: tuple[Any, Any]) -> tuple[Any, Any]:
    return factor * z[0], factor * z[1]


def _log(x: Any, y: Any) -> tuple[Any, Any]:
    return np.log(np.hypot(x, y)), np.arctan2(y, x)


def _log1p(x: Any, y: Any) -> tuple[Any, Any]:
    """Return log(1 + z); its real part is log1p(h - 1), h = abs(1 + z)."""
    size = np.hypot(1.0 + x, y) + 1.0
    return np.log1p(x * ((2.0 + x) / size) + y * (y / size)), np.arctan2(y, 1.0 + x)


def _exp(x: Any, y: Any) -> tuple[Any, Any]:
    return _polar(1.0, y) if _is(x, 0) else _polar(np.exp(x), y)


def _expm1(x: Any, y: Any) -> tuple[Any, Any]:
    half = np.sin(0.5 * y)
    return np.expm1(x) * np.cos(y) - 2.0 * (half * half), np.exp(x) * np.sin(y)


def _tanh(x: Any, y: Any) -> tuple[Any, Any]:
    """Return tanh(x + i y) = (tanh(2 x) + i sin(2 y) s) / (1 + cos(2 y) s), s = 1 / cosh(2 x)."""
    s = 1.0 / np.cosh(2.0 * x)
    below = 1.0 + np.cos(2.0 * y) * s
    return np.tanh(2.0 * x) / below, np.sin(2.0 * y) * s / below


def _sqrt(x: Any, y: Any) -> tuple[Any, Any]:
    return _polar(np.sqrt(np.hypot(x, y)), 0.5 * np.arctan2(y, x))


# Inverse functions: W. Kahan, Branch cuts for complex elementary functions, 1987.
def _arcsin(x: Any, y: Any) -> tuple[Any, Any]:
    (a, b), (c, d) = _sqrt(1.0 - x, _neg(y)), _sqrt(1.0 + x, y)
    return np.arctan2(x, a * c - b * d), np.arcsinh(a * d - b * c)


def _arccos(x: Any, y: Any) -> tuple[Any, Any]:
    (a, b), (c, d) = _sqrt(1.0 - x, _neg(y)), _sqrt(1.0 + x, y)
    return 2.0 * np.arctan2(a, c), np.arcsinh(c * b - d * a)


def _arccosh(x: Any, y: Any) -> tuple[Any, Any]:
    (a, b), (c, d) = _sqrt(x - 1.0, y), _sqrt(x + 1.0, y)
    return np.arcsinh(a * c + b * d), 2.0 * np.arctan2(b, c)


def _arctanh(x: Any, y: Any) -> tuple[Any, Any]:
    distance = (1.0 - x) * (1.0 - x) + y * y
    return 0.25 * np.log1p(4.0 * x / distance), 0.5 * np.arctan2(
        2.0 * y, (1.0 - x) * (1.0 + x) - y * y
    )


def _turned(rule: Any) -> Any:
    """Return the rule of -i rule(i z), for sin and sinh, tan and tanh, and their inverses."""

    def turned(x: Any, y: Any) -> tuple[Any, Any]:
        a, b = rule(_neg(y), x)
        return b, _neg(a)

    return turned


def _power(a: Any, b: Any, c: Any, d: Any) -> tuple[Any, Any]:
    """Return (a + i b)**(c + i d): by products for an integer c, else by the principal branch."""
    if not _is(d, 0) or not isinstance(c, (int, float)):
        real, imag = _exp(*_product(*_log(a, b), c, d))
        if not isinstance(c, (int, float)) or c <= 0:
            return real, imag
        is_0 = np.hypot(a, b) == 0.0
        return np.where(is_0, 0.0, real), np.where(is_0, 0.0, imag)
    if abs(c) > 128 or c != int(c):
        return _polar(np.hypot(a, b) ** c, c * np.arctan2(b, a))
    result, square, n = None, (a, b), int(abs(c))
    while n:
        if n & 1:
            result = square if result is None else _product(*result, *square)
        n >>= 1
        square = _product(*square, *square) if n else square
    result = result or (1.0, 0.0)
    return _quotient(1.0, 0.0, *result) if c < 0 else result


def _sign(x: Any, y: Any) -> tuple[Any, Any]:
    size = np.hypot(x, y)
    size = np.where(size == 0.0, 1.0, size)
    return x / size, y / size


RULES: dict[str, Any] = {
    "add": lambda a, b, c, d: (_add(a, c), _add(b, d)),
    "subtract": lambda a, b, c, d: (_sub(a, c), _sub(b, d)),
    "multiply": _product,
    "divide": _quotient,
    "power": _power,
    "negative": lambda x, y: (_neg(x), _neg(y)),
    "positive": lambda x, y: (x, y),
    "conjugate": lambda x, y: (x, _neg(y)),
    "exp": _exp,
    "log": _log,
    "log1p": _log1p,
    "log2": lambda x, y: _scaled_by(1.0 / math.log(2.0), _log(x, y)),
    "log10": lambda x, y: _scaled_by(1.0 / math.log(10.0), _log(x, y)),
    "expm1": _expm1,
    "exp2": lambda x, y: _exp(*_scaled_by(math.log(2.0), (x, y))),
    "sqrt": _sqrt,
    "sin": lambda x, y: (np.sin(x) * np.cosh(y), np.cos(x) * np.sinh(y)),
    "cos": lambda x, y: (np.cos(x) * np.cosh(y), -(np.sin(x) * np.sinh(y))),
    "sinh": lambda x, y: (np.sinh(x) * np.cos(y), np.cosh(x) * np.sin(y)),
    "cosh": lambda x, y: (np.cosh(x) * np.cos(y), np.sinh(x) * np.sin(y)),
    "tanh": _tanh,
    "tan": _turned(_tanh),
    "arcsin": _arcsin,
    "arccos": _arccos,
    "arctan": _turned(_arctanh),
    "arcsinh": _turned(_arcsin),
    "arccosh": _arccosh,
    "arctanh": _arctanh,
    "sign": _sign,
}
TO_REAL: dict[str, Any] = {
    "absolute": lambda x, y: abs(x) if _is(y, 0) else np.hypot(x, y),
    "square of absolute": lambda x, y: _add(_mul(x, x), _mul(y, y)),
    "angle": lambda x, y: np.arctan2(y, x),
    "equal": lambda a, b, c, d: (a == c) & (b == d),
    "not_equal": lambda a, b, c, d: (a != c) | (b != d),
}
