"""Coefficients that a user passes, as arrays or as lists of terms: checked, without zeros."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from ... import checks
from ...checks import OTHERS, within, wrong
from .names import check_order
from .polynomials import as_given, coefficients, exact, numbers
from .terms import Terms, collected, fractions, joined

# Indices (axes, n) and values (..., n) of entries of an array.
Entries = tuple[Any, Any]
_COMMON_BITS = 2**12  # of the denominator that the numbers of a Hamiltonian share


def entries(name: str, array: Any) -> Entries:
    """Return the entries of a single array that are not 0, exactly: as floats or fractions."""
    if array.dtype.kind not in "iufO":  # such as booleans and texts, which `exact` refuses
        numbers(name, array, False)
    where = np.nonzero(np.asarray(array != 0, bool))
    values = array[where]
    if array.dtype.kind == "O" and {*map(type, values)} == {float}:
        values = values.astype(np.float64)
    if values.dtype.kind != "f" or values.dtype.itemsize > 8:
        values = np.array([exact(name, each) for each in values.tolist()], object)
    elif np.isfinite(values).all():
        values = values.astype(np.float64)
    else:
        exact(name, values[~np.isfinite(values)].tolist()[0])
    return np.array(where, np.int64).reshape(array.ndim, -1), within(name, values, OTHERS)


def of_array(name: str, value: Any, axes: int, D: int) -> Entries:
    """Return the entries of an array with `axes` axes of length D, or of a family of them."""
    array = as_given(name, value)
    if D == 0 or array.shape[-axes:] != (D,) * axes:
        size = D if name != "quadratic" else "D"
        raise wrong(name, f"have the shape (..., {', '.join([str(size)] * axes)})", array.shape)
    if array.ndim == axes:
        return entries(name, array)
    array = within(name, checks.real_array(name, array), OTHERS)
    where = np.nonzero((array != 0).any(axis=tuple(range(array.ndim - axes))))
    return np.array(where, np.int64).reshape(axes, -1), array[(..., *where)]


def with_arrays(parts: dict[str, Entries], linear: Any, constant: Any, D: int) -> Terms:
    """Return the terms of a field with these entries, and with linear terms and constants."""
    for name, value, axes in (("linear", linear, 2), ("constant", constant, 1)):
        if value is not None:
            parts[name] = of_array(name, value, axes, D)
    # Indices of the factor 1 for those that linear terms and constants lack.
    indices = [np.vstack([i, np.full((3 - len(i), i.shape[1]), D)]) for i, _ in parts.values()]
    batch = checks.common_shape({name: v.shape[:-1] for name, (_, v) in parts.items()})
    values = [np.broadcast_to(v, (*batch, v.shape[-1])) for _, v in parts.values()]
    values = [v.astype(np.float64) for v in values] if batch else values
    return collected(np.hstack(indices), joined(values), D, 2)


def checked_indices(name: str, given: Any, D: int, symbols: str) -> Any:
    """Return integers (rows, T) from 0 to D, one row for each of these symbols.

    The first of "ijk" is below D, as are both of "ij".
    """
    indices, rows = np.asarray(given), len(symbols)
    if indices.size == 0:
        indices = np.zeros((rows, 0), np.int64)
    if indices.dtype.kind not in "iu":
        received = f"{checks.short(given)} of dtype {indices.dtype}"
        raise wrong(name, "hold integers", received, TypeError)
    if indices.ndim != 2 or len(indices) != rows:
        how = ": pass the transpose" if indices.ndim == 2 and indices.shape[1] == rows else ""
        shape = f"have the shape ({rows}, T): {', '.join(symbols)} of each term"
        raise wrong(name, shape, f"{indices.shape}{how}")
    most = {"ijk": [D - 1, D, D], "ij": [D - 1, D - 1]}.get(symbols, [D] * rows)
    is_wrong = (indices < 0) | (indices > np.reshape(most, (rows, 1)))
    if is_wrong.any():
        t = int(np.argmax(is_wrong.any(axis=0)))
        ranges = ", ".join(f"{s} from 0 to {high}" for s, high in zip(symbols, most, strict=True))
        one = f", where {D} stands for a factor 1" if symbols == "ijk" else ""
        raise wrong(name, f"hold {ranges}{one}", f"{indices[:, t].tolist()} in term {t}")
    return indices.astype(np.int64)


def _checked_values(name: str, given: Any, count: int) -> Any:
    """Return values (..., count) as they are."""
    array = as_given(name, given)
    if array.ndim == 0 or array.shape[-1] != count:
        raise wrong(name, f"have the shape (..., {count}), one for each term", array.shape)
    return array


def of_terms(indices: Any, values: Any, D: int) -> Entries:
    """Return checked indices (3, T) and values (..., T) of terms of a field."""
    indices = checked_indices("indices", indices, D, "ijk")
    array = _checked_values("values", values, indices.shape[1])
    if array.ndim > 1:
        return indices, within("values", checks.real_array("values", array), OTHERS)
    (which,), found = entries("values", array)
    return indices[:, which], found


def of_file(indices: Any, values: Any, D: int) -> Entries:
    """Return the entries of terms in a dictionary, where none is repeated.

    Sums of repeated ones could take minutes, and :meth:`to_dict` writes none.
    """
    places, found = of_terms(indices, values, D)
    i, (j, k) = places[0], np.sort(places[1:], axis=0)
    if len(np.unique((i * (D + 1) + j) * (D + 1) + k)) < len(i):
        raise wrong("indices", "hold each term once", "one of them again")
    return places, found


def check_denominators(name: str, values: Iterable[Any]) -> None:
    """Raise ValueError for numbers whose common denominator is so long that sums take minutes."""
    common = 1
    for value in values:
        if isinstance(value, Fraction):
            common = math.lcm(common, value.denominator)
            if common.bit_length() > _COMMON_BITS:
                raise wrong(name, f"fractions with a denominator below 2**{_COMMON_BITS}", "others")


def of_hamiltonian(H: Any, D: int) -> Terms:
    """Return the exact terms of H from its entry in a dictionary."""
    _check_entry("H", H)
    indices = checked_indices("H", H["indices"], D, "mnp")
    values = coefficients("H", _checked_values("H", H["values"], indices.shape[1]), False)
    check_denominators("H", values.flat)
    return collected(indices, values, D, 3)


def _check_entry(name: str, given: Any) -> None:
    checks.instance(name, given, Mapping)
    if {*given} != {"indices", "values"}:
        raise wrong(name, "have the entries indices and values", ", ".join(map(str, given)))


def structure_matrix(K: Any, D: int, names: Sequence[str] = ()) -> Any:
    """Return the antisymmetric matrix of a Hamiltonian field as (3, n): i, j and exact values.

    K is an array or the entry of a dictionary; by default it is canonical.
    """
    if K is None:
        if D % 2:
            raise wrong("dimension", "even where K is left out, the matrix of x' = K grad H", D)
        check_order(names)
        q, p, one = np.arange(D // 2), np.arange(D // 2, D), np.full(D // 2, Fraction(1))
        places, values = np.array([[*q, *p], [*p, *q]]), np.concatenate([one, -one])
    elif isinstance(K, Mapping):
        _check_entry("K", K)
        places = checked_indices("K", K["indices"], D, "ij")
        (which,), values = entries("K", _checked_values("K", K["values"], places.shape[1]))
        places = places[:, which]
        check_denominators("K", values.tolist())
    else:
        if callable(K):
            how = "a function: for K(x) pass from_function(lambda x: K(x) @ dH(x), names)"
            raise wrong("K", "a constant matrix", how, TypeError)
        array = as_given("K", K)
        if array.shape != (D, D):
            raise wrong("K", f"an antisymmetric matrix of shape ({D}, {D})", array.shape)
        places, values = of_array("K", array, 2, D)
    values = fractions(values)
    found = dict(zip(zip(*places.tolist(), strict=True), values, strict=True))
    for (i, j), v in found.items():
        if (w := found.get((j, i), Fraction(0))) != -v:
            received = f"one with {float(v)} at {i, j} and {float(w)} at {j, i}"
            raise wrong("K", f"an antisymmetric matrix of shape ({D}, {D})", received)
    matrix: Any = np.empty((3, len(values)), object)
    matrix[:2], matrix[2] = places, values
    return matrix
