"""Fields of degree 2 as lists of terms, from which steps of Kahan's map are made.

With x_D = 1, component i of a field is the sum of v x_j x_k over its terms (i, j, k), where j <= k,
and a Hamiltonian is the sum of v x_i x_j x_k over its terms, where i <= j <= k.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray
from .exact_numbers import text_of


class Terms(NamedTuple):
    """Terms of a field or a Hamiltonian in the order in which kernels add them: by indices.

    Terms of lower degree, in which x_k is the constant 1 (k = D), come last. No two terms have the
    same indices, and no term is 0 for all members of a family.
    """

    indices: NDArray[np.int64]  # rows i, j and k (3, T)
    values: Any  # (..., T), floats or fractions

    @property
    def floats(self) -> Terms:
        """The terms with floats, each rounded once; a copy, for kernels."""
        return Terms(self.indices.copy(), np.ascontiguousarray(self.values.astype(np.float64)))

    def read(self, exactly: Callable[[Any], Fraction]) -> Terms:
        """Return the terms of a single polynomial with ``exactly(v)`` in place of each value v."""
        return Terms(self.indices, np.vectorize(exactly, "O")(self.values))

    def members(self) -> zip[tuple[tuple[int, ...], Any]]:
        """Yield the indices and the value of each term of a single polynomial."""
        return zip(map(tuple, self.indices.T.tolist()), self.values.tolist(), strict=True)


def collected(indices: Any, values: Any, D: int, degree: int) -> Terms:
    """Return sorted terms of a field (degree 2) or Hamiltonian (3); equal ones are added up."""
    indices = np.array(indices, np.int64).reshape(3, -1)
    indices[3 - degree :].sort(axis=0)
    order = np.lexsort((*indices[::-1], indices[2] == D))
    indices, values = indices[:, order], values[..., order]
    is_first = np.ones(len(order), bool)
    is_first[1:] = (indices[:, 1:] != indices[:, :-1]).any(axis=0)
    if not is_first.all():
        values = np.add.reduceat(values, np.flatnonzero(is_first), axis=-1)
    return without_zeros(indices[:, is_first], values)


def without_zeros(indices: Any, values: Any) -> Terms:
    """Return sorted terms, without terms that are 0 for all members."""
    is_there = np.asarray(values != 0, bool).any(axis=tuple(range(values.ndim - 1)))
    return Terms(np.ascontiguousarray(indices[:, is_there]), values[..., is_there])


def by_zeros(exists: NDArray[np.bool_]) -> Iterator[tuple[NDArray[np.bool_], NDArray[np.int64]]]:
    """Yield which terms exist, and the members with these terms; `exists` (members, T) tells all.

    Rows are compared as strings of bits: `np.unique` compares them number by number.
    """
    bits = np.packbits(exists, axis=1)
    whole = bits.view(f"V{bits.shape[1]}")[:, 0]
    _, first, which = np.unique(whole, return_index=True, return_inverse=True)
    for k, pattern in enumerate(exists[first]):
        yield pattern, np.flatnonzero(which == k)


def with_one(x: FloatArray) -> FloatArray:
    """Return states (..., D + 1) with x_D = 1."""
    return np.concatenate([x, np.ones((*x.shape[:-1], 1))], axis=-1)


def sums_at(places: Any, numbers: FloatArray, count: int) -> FloatArray:
    """Return sums (..., count): number t of (..., T) is added to the sum number places[t]."""
    order = np.argsort(places, kind="stable")
    there, first = np.unique(places[order], return_index=True)
    sums = np.zeros((*numbers.shape[:-1], count))
    if len(there):
        sums[..., there] = np.add.reduceat(numbers[..., order], first, axis=-1)
    return sums


def slopes_at(terms: Terms, x: FloatArray) -> FloatArray:
    """Return f' (..., D, D) at states (..., D), for the terms of f."""
    D, y = x.shape[-1], with_one(x)  # callers ignore warnings of NumPy
    (i, j, k), values = terms.floats
    # v x_j x_k has the derivatives v x_k with respect to x_j, and v x_j with respect to x_k.
    places, others = np.hstack([i * (D + 1) + j, i * (D + 1) + k]), np.hstack([k, j])
    products = np.concatenate([values, values], axis=-1) * y[..., others]
    sums = sums_at(places, products, D * (D + 1))
    slopes: FloatArray = sums.reshape(*sums.shape[:-1], D, D + 1)[..., :D]
    return slopes + 0.0 * x[..., np.newaxis, :]


def texts_of(terms: Terms, names: Sequence[str]) -> Iterator[str]:
    """Yield the components of a single field as texts."""
    rows: list[dict[tuple[int, ...], Any]] = [{} for _ in names]
    for (i, *factors), v in sorted(terms.read(Fraction).members()):
        rows[i][*(k for k in factors if k < len(names)),] = v
    return (text_of(row, names).replace("^", "**") for row in rows)
