"""Polynomials as lists of terms: what fields and Hamiltonians are.

With x_D = 1, component i of a field is the sum of v x_j x_k over its terms (i, j, k), j <= k, and a
Hamiltonian that of v x_i x_j x_k over terms with i <= j <= k. Tables of all coefficients are made
only where someone asks for them, because they have D**3 entries.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from functools import cached_property
from numbers import Rational
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import checks
from ...checks import FloatArray
from .polynomials import Polynomial, numbers

# Bytes of the largest table. A field of 1024 variables would have one of 8 GiB, of zeros almost.
LARGEST = 2**32


class Terms(NamedTuple):
    """Terms at different places, none of which is 0 for all members of a family.

    They are sorted by their indices, except that those with a factor 1 are last: kernels add up in
    this order.
    """

    indices: NDArray[np.int64]  # (3, T)
    values: Any  # (..., T), floats or fractions

    @property
    def exact(self) -> Terms:
        """The terms of a single polynomial with fractions as values."""
        return Terms(self.indices, fractions(self.values))

    @property
    def floats(self) -> Terms:
        """The terms with floats, each rounded once; a copy, for kernels."""
        return Terms(self.indices.copy(), np.ascontiguousarray(self.values.astype(np.float64)))

    def members(self) -> zip[tuple[tuple[int, ...], Any]]:
        """Yield the indices and the value of each term of a single polynomial."""
        return zip(map(tuple, self.indices.T.tolist()), self.values.tolist(), strict=True)


def fractions(values: Any) -> Any:
    """Return an array of floats or fractions as fractions."""
    if values.dtype == object:
        return values
    found: Any = np.empty(values.shape, object)
    found.flat = [*map(Fraction, values.ravel().tolist())]
    return found


def collected(indices: Any, values: Any, D: int, degree: int) -> Terms:
    """Return the sum of terms at any places: of a field with the degree 2, of a Hamiltonian with 3.

    Repeated terms are added exactly; sums of floats of a family are rounded once.
    """
    indices = np.array(indices, np.int64).reshape(3, -1)
    indices[3 - degree :].sort(axis=0)
    order = np.lexsort((*indices[::-1], indices[2] == D))
    indices, values = indices[:, order], values[..., order]
    is_first = np.ones(len(order), bool)
    is_first[1:] = (indices[:, 1:] != indices[:, :-1]).any(axis=0)
    if not is_first.all():
        first = np.flatnonzero(is_first)
        sums = np.add.reduceat(values, first, axis=-1)
        if values.dtype == np.float64 and values.ndim == 1:
            sums = _exact_sums(values, first, sums)
        elif values.dtype == np.float64:
            counts = np.diff(first, append=len(order))
            for k in np.flatnonzero(counts > 2):  # a sum of two is rounded once
                own = values[..., first[k] : first[k] + counts[k]]
                sums[..., k] = np.apply_along_axis(math.fsum, -1, own)
        values, indices = sums, indices[:, is_first]
    return without_zeros(indices, values)


def _exact_sums(values: Any, first: Any, sums: Any) -> Any:
    """Return the sums of floats from each index on: floats if these are exact, else fractions."""
    ends = np.append(first[1:], len(values))
    before, last = values[first], np.where(ends - first == 2, values[ends - 1], 0.0)
    # A sum of two is exact if differences give back both (Knuth).
    part = sums - before
    if ((ends - first <= 2) & (part == last) & (sums - part == before)).all():
        return sums
    found: Any = np.empty(len(first), object)
    ratios = [each.as_integer_ratio() for each in values.tolist()]
    for n, (begin, end) in enumerate(zip(first.tolist(), ends.tolist(), strict=True)):
        scale = max(d for _, d in ratios[begin:end])  # a power of 2, as the others
        found[n] = Fraction(sum(a * (scale // d) for a, d in ratios[begin:end]), scale)
    return found


def without_zeros(indices: Any, values: Any) -> Terms:
    """Return sorted terms without those that are 0 for all members."""
    is_there = np.asarray(values != 0, bool).any(axis=tuple(range(values.ndim - 1)))
    return Terms(np.ascontiguousarray(indices[:, is_there]), values[..., is_there])


def joined(parts: Sequence[Any]) -> Any:
    """Return values (..., T) of several lists of terms as one: fractions if one list has them."""
    is_exact = any(values.dtype == object for values in parts)
    return np.concatenate([fractions(v) if is_exact else v for v in parts], axis=-1)


def rates(H: Terms, K: Any, D: int) -> Terms:
    """Return the terms of K grad H; K is (3, n): i, j and the value of each entry."""
    count = H.indices.shape[1]
    # One factor x_m of each term of H after the other, the two others, and the term it is from.
    m = H.indices.ravel()
    others = np.hstack([H.indices[[1, 2]], H.indices[[0, 2]], H.indices[[0, 1]]])
    source = np.tile(np.arange(count), 3)
    rows, columns = K[:2].astype(np.int64)
    by_column = np.argsort(columns, kind="stable")
    first = np.searchsorted(columns[by_column], np.arange(D + 2))
    times = np.diff(first)[m]  # the entries of K in column m; 0 for m = D, the factor 1
    which = np.repeat(np.arange(3 * count), times)
    place = np.arange(len(which)) - np.repeat(np.cumsum(times) - times, times)
    entry = by_column[first[m[which]] + place]
    values = H.values[..., source[which]] * K[2, entry]
    return collected([rows[entry], *others[:, which]], values, D, 2)


def table_of(name: str, shape: tuple[int, ...], places: Any, values: Any) -> Any:
    """Return a table with values at places and 0 elsewhere; MemoryError if it is too large."""
    size = 8 * int(np.prod(shape, dtype=object))
    if size > LARGEST:
        how = "the attribute terms has the coefficients that are not 0"
        raise MemoryError(f"{name} would need {size:,} bytes for the shape {shape}: {how}")
    is_exact = values.dtype == object
    table = np.full(shape, Fraction(0), object) if is_exact else np.zeros(shape)
    table[(..., *places)] = values
    table.flags.writeable = False
    return table


def values_at(terms: Terms, x: Any, names: Sequence[str], degree: int) -> Any:
    """Return the values at states of a field, or of a Hamiltonian: of degree 2 or 3.

    They are fractions, a list for a field, if all numbers are exact, else floats. Numbers of an
    array of NumPy's integers count as floats.
    """
    D = len(names)
    is_array = isinstance(x, np.ndarray) and x.ndim == 1 and x.dtype == object
    is_list = isinstance(x, (tuple, list)) or is_array
    is_single = terms.values.ndim == 1
    if is_single and is_list and len(x) == D and all(isinstance(a, Rational) for a in x):
        point = [*numbers("x", x, False), Fraction(1)]
        sums = [Fraction(0)] * (D if degree == 2 else 1)
        for (i, j, k), v in terms.exact.members():
            sums[i if degree == 2 else 0] += v * point[j] * point[k] * (degree == 2 or point[i])
        return sums if degree == 2 else sums[0]
    x = checks.states("x", x, names)
    y = np.concatenate([x, np.ones((*x.shape[:-1], 1))], axis=-1)
    (i, j, k), values = terms.floats
    with np.errstate(all="ignore"):
        products = values * y[..., j] * y[..., k]
        if degree == 3:
            return (products * y[..., i]).sum(axis=-1) + 0.0 * x[..., 0]
        return sums_at(i, products, D) + 0.0 * x


def sums_at(places: Any, numbers: FloatArray, count: int) -> FloatArray:
    """Return the sums (..., count) of those numbers (..., T) that have the same place."""
    order = np.argsort(places, kind="stable")
    there, first = np.unique(places[order], return_index=True)
    sums = np.zeros((*numbers.shape[:-1], count))
    if len(there):
        sums[..., there] = np.add.reduceat(numbers[..., order], first, axis=-1)
    return sums


def slopes_at(terms: Terms, x: FloatArray) -> FloatArray:
    """Return the derivatives (..., D, D) of the terms of a field at states (..., D)."""
    D = x.shape[-1]
    y = np.concatenate([x, np.ones((*x.shape[:-1], 1))], axis=-1)
    (i, j, k), values = terms.floats
    # v x_j x_k has the derivative v x_k by x_j, and v x_j by x_k.
    places, others = np.hstack([i * (D + 1) + j, i * (D + 1) + k]), np.hstack([k, j])
    with np.errstate(all="ignore"):
        products = np.concatenate([values, values], axis=-1) * y[..., others]
        sums = sums_at(places, products, D * (D + 1))
        slopes: FloatArray = sums.reshape(*sums.shape[:-1], D, D + 1)[..., :D]
        return slopes + 0.0 * x[..., np.newaxis, :]


def components_of(terms: Terms, D: int) -> list[dict[tuple[int, ...], Any]]:
    """Return the exact terms of each component of a single field: {(j, k): value}, in order."""
    rows: list[dict[tuple[int, ...], Any]] = [{} for _ in range(D)]
    for (i, j, k), v in sorted(terms.exact.members()):
        rows[i][j, k] = v
    return rows


def polynomial_in(places: dict[tuple[int, ...], Any], D: int) -> Polynomial:
    """Return the polynomial with these values at indices, of which D stands for the factor 1."""
    return Polynomial({tuple(i for i in place if i < D): v for place, v in places.items() if v})


class Hamiltonian:
    """A polynomial H of degree 3, or a family of them; H(x) is its value at a state x.

    Values are fractions if all numbers are exact, else floats (...).
    """

    def __init__(self, exact: Terms, names: Sequence[str]) -> None:
        self.exact = exact  # with fractions
        self._names = tuple(names)

    @cached_property
    def terms(self) -> Terms:
        """The terms v x_i x_j x_k as kernels take them."""
        return self.exact.floats

    def __call__(self, x: Any) -> Any:
        return values_at(self.exact, x, self._names, 3)

    def __repr__(self) -> str:
        if shape := self.exact.values.shape[:-1]:
            return f"<polynomials of shape {shape}>"
        return polynomial_in(dict(self.exact.members()), len(self._names)).text(self._names)
