"""Functions of complex numbers as formulas of their real and imaginary parts.

A part is a number, or a symbol with Python's operators and NumPy's functions. Parts that are the
numbers 0, 1 and -1 cause no operations.
"""

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


def _quotient(a: Any, b: Any, c: Any, d: Any) -> tuple[Any, Any]:
    if _is(d, 0):
        return (0.0 if _is(a, 0) else a / c), (0.0 if _is(b, 0) else b / c)
    size = _add(_mul(c, c), _mul(d, d))
    x, y = _product(a, b, c, _neg(d))
    return (0.0 if _is(x, 0) else x / size), (0.0 if _is(y, 0) else y / size)


def _polar(size: Any, angle: Any) -> tuple[Any, Any]:
    return size * np.cos(angle), size * np.sin(angle)


def _log(x: Any, y: Any) -> tuple[Any, Any]:
    return np.log(np.hypot(x, y)), np.arctan2(y, x)


def _exp(x: Any, y: Any) -> tuple[Any, Any]:
    return _polar(1.0, y) if _is(x, 0) else _polar(np.exp(x), y)


def _tanh(x: Any, y: Any) -> tuple[Any, Any]:
    below = np.cosh(2.0 * x) + np.cos(2.0 * y)
    return np.sinh(2.0 * x) / below, np.sin(2.0 * y) / below


def _power(a: Any, b: Any, c: Any, d: Any) -> tuple[Any, Any]:
    """Return (a + i b)**(c + i d): by products for an integer c, else by the principal branch."""
    if not _is(d, 0) or not isinstance(c, (int, float)):
        return _exp(*_product(*_log(a, b), c, d))
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
    "sqrt": lambda x, y: _polar(np.sqrt(np.hypot(x, y)), 0.5 * np.arctan2(y, x)),
    "sin": lambda x, y: (np.sin(x) * np.cosh(y), np.cos(x) * np.sinh(y)),
    "cos": lambda x, y: (np.cos(x) * np.cosh(y), -(np.sin(x) * np.sinh(y))),
    "sinh": lambda x, y: (np.sinh(x) * np.cos(y), np.cosh(x) * np.sin(y)),
    "cosh": lambda x, y: (np.cosh(x) * np.cos(y), np.sinh(x) * np.sin(y)),
    "tanh": _tanh,
    "tan": lambda x, y: (lambda t: (t[1], -t[0]))(_tanh(-y, x)),
}
TO_REAL: dict[str, Any] = {
    "absolute": lambda x, y: abs(x) if _is(y, 0) else np.hypot(x, y),
    "square of absolute": lambda x, y: _add(_mul(x, x), _mul(y, y)),
    "angle": lambda x, y: np.arctan2(y, x),
    "equal": lambda a, b, c, d: (a == c) & (b == d),
    "not_equal": lambda a, b, c, d: (a != c) | (b != d),
}
