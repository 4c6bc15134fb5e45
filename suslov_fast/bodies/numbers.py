"""Numbers that users give: exact ones, arrays of coefficients, and named parameters."""

from __future__ import annotations

import re
from collections.abc import Mapping
from fractions import Fraction
from numbers import Rational
from typing import Any

import numpy as np

from ..checks import OTHERS, common_shape, real_array, refuse, short, within, wrong

# Names that a parameter may not have: those of runs, of their files and datasets, of variables,
# and of arguments of functions that take parameters by name.
RESERVED = frozenset(
    "f H K x omega n time eps dimension body space component component_j component_k trajectory "
    "quadratic linear constant parameters states status failed_at final method steps save_every "
    "attitude orientation carry ok first_integral energy modified_energy criticality to_xy "
    "reaction extend to_xarray plot save load about format version map title omega0 store "
    "functions dims coords chunk client progress self cls".split()
)
_NUMBERED = re.compile(r"x\d+|batch_\d+|_.*")


def is_number(value: Any) -> bool:
    """Return True for integers, fractions, decimals and floats, of NumPy and SymPy too."""
    known = isinstance(value, Rational) or hasattr(value, "as_integer_ratio")
    return known and not isinstance(value, bool)


def exact(name: str, value: Any) -> Fraction:
    """Return a number as a fraction: a float as its binary value."""
    if not is_number(value):
        received = f"{short(value)} of type {type(value).__name__}"
        raise wrong(name, "integers, fractions or floats", received, TypeError)
    if isinstance(value, Rational):
        return Fraction(int(value.numerator), int(value.denominator))
    try:
        return Fraction(*map(int, value.as_integer_ratio()))
    except (OverflowError, ValueError):
        raise wrong(name, "finite numbers", value) from None


def exact_array(name: str, array: Any) -> Any:
    """Return an array of fractions."""
    found, some = np.full(array.shape, Fraction(0)), array != 0
    found[some] = [exact(name, each) for each in array[some].tolist()]
    return found


def as_given(name: str, value: Any) -> Any:
    """Return an array of the numbers as they are: one of integers and floats is one of objects."""
    refuse(name, value)
    return value if isinstance(value, np.ndarray) else np.array(value, dtype=object)


def coefficients(name: str, array: Any, is_batch: bool) -> Any:
    """Return floats of a batch, or fractions of a single field, that are in range."""
    return within(name, real_array(name, array) if is_batch else exact_array(name, array), OTHERS)


def antisymmetric(K: Any, D: int) -> Any:
    """Return the exact antisymmetric matrix (D, D), the canonical one for None."""
    if K is None:
        if D % 2:
            raise wrong("dimension", "an even number without K", D)
        K = np.eye(D, k=D // 2, dtype=np.int64) - np.eye(D, k=-D // 2, dtype=np.int64)
    matrix = coefficients("K", as_given("K", K), False)
    if matrix.shape != (D, D):
        raise wrong("K", f"shape ({D}, {D})", matrix.shape)
    if (matrix != -matrix.T).any():
        raise wrong("K", "an antisymmetric matrix", short(matrix.astype(float).tolist()))
    return matrix


def check_parameters(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters by name: numbers as they are, and read-only arrays of floats."""
    found: dict[str, Any] = {}
    for name, value in parameters.items():
        if name in RESERVED or _NUMBERED.fullmatch(name) or not name.isidentifier():
            raise wrong("parameters", "names that are not in use, as a or rho", repr(name))
        refuse(name, value)
        if isinstance(value, (list, tuple)) or np.ndim(value):
            found[name] = real_array(name, value).copy()
            found[name].flags.writeable = False
        else:
            found[name] = value.item() if hasattr(value, "item") else value
            exact(name, found[name])
    common_shape({name: np.shape(value) for name, value in found.items()})
    return found


def plain(value: Any) -> float | str:
    """Return a number as a float if it is one, else as the string "p/q"."""
    number = exact("value", value)
    return float(number) if float(number) == number else str(number)


def to_lists(value: Any) -> Any:
    """Return numbers as nested lists of floats and strings "p/q"."""
    array = np.asarray(value)
    return array.tolist() if array.dtype.kind == "f" else np.vectorize(plain, "O")(array).tolist()


def from_lists(name: str, value: Any) -> Any:
    """Return nested lists of numbers whose strings "p/q" are fractions."""
    if isinstance(value, Mapping):
        return {key: from_lists(key, each) for key, each in value.items()}
    if isinstance(value, list):
        return [from_lists(name, each) for each in value]
    try:
        return Fraction(value) if isinstance(value, str) else value
    except (ValueError, ZeroDivisionError):
        raise wrong(name, 'numbers or strings "p/q"', repr(value)) from None
