"""Polynomials of degree 2 and 3 as symmetric tensors in (x1, ..., xD, 1)."""

from __future__ import annotations

from fractions import Fraction
from functools import cached_property
from numbers import Rational
from typing import Any

import numpy as np

from ..checks import FloatArray, refuse, states
from .numbers import exact
from .polynomials import terms_of, text_of


class Hamiltonian:
    """A polynomial of degree 3, or a batch: ``H(x) = sum_ijk H_ijk x_i x_j x_k``, x_(D+1) = 1.

    Called with a state it returns a fraction if all numbers are exact, else floats (...).
    """

    def __init__(self, tensor: Any) -> None:
        self.tensor = tensor

    @cached_property
    def terms(self) -> tuple[Any, FloatArray]:
        """The nonzero terms v x_i x_j x_k: i <= j <= k (3, T), where D is the 1, and v (..., T)."""
        return sparse(self.tensor, ordered=3)

    def __call__(self, x: Any) -> Any:
        return at_points(self.tensor, x, 3)

    def __repr__(self) -> str:
        if self.tensor.ndim > 3:
            return f"<polynomials of shape {self.tensor.shape[:-3]}>"
        return text_of(terms_of(self.tensor))


def rates(H: Any, K: Any) -> Any:
    """Return the table of K grad H; most entries of K are 0."""
    table = np.full_like(H[..., :-1, :, :], Fraction(0))
    for i, j in np.argwhere(K != 0):
        table[..., i, :, :] += 3 * K[i, j] * H[..., j, :, :]
    return table


def sparse(table: Any, ordered: int) -> tuple[Any, FloatArray]:
    """Return indices and values of the nonzero terms of a table symmetric in its last axes."""
    places = np.argwhere(np.any(table != 0, axis=tuple(range(table.ndim - 3)))).T
    places = places[:, (np.diff(places[3 - ordered :], axis=0) >= 0).all(axis=0)]
    places = places[:, np.argsort(places[-1] == table.shape[-1] - 1, kind="stable")]
    kinds = 1 + (np.diff(places[3 - ordered :], axis=0) > 0).sum(axis=0)  # of variables in a term
    count = kinds if ordered == 2 else np.array([0, 1, 3, 6])[kinds]
    values = (table[(..., *places)] * count).astype(np.float64)
    return np.ascontiguousarray(places), np.ascontiguousarray(values)


def at_points(tensor: Any, x: Any, degree: int) -> Any:
    """Return the values at x of polynomials, whose variables are the last `degree` axes.

    They are fractions if all numbers are exact, else floats.
    """
    D = tensor.shape[-1] - 1
    is_list = isinstance(x, (tuple, list)) or (isinstance(x, np.ndarray) and x.ndim == 1)
    are_exact = tensor.dtype == object and is_list and all(isinstance(a, Rational) for a in x)
    if are_exact and len(x) == D:
        refuse("x", x)
        point = np.array([*(exact("x", a) for a in x), Fraction(1)], dtype=object)
    else:
        x = states("x", x, [f"x{i}" for i in range(1, D + 1)])
        point = np.concatenate([x, np.ones((*x.shape[:-1], 1))], axis=-1)
        tensor = np.asarray(tensor, np.float64)
    with np.errstate(all="ignore"):
        for axes in ("ijk", "ij", "i")[:degree]:
            tensor = np.einsum(f"...{axes},...{axes[-1]}->...{axes[:-1]}", tensor, point)
    return tensor
