"""Orbits of many maps at once modulo a small prime, in NumPy, and ranks of matrices."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from ..bodies.field import QuadraticField
from .arithmetic import Exponents

Array = Any  # of int64: products of residues fit if the prime has at most 31 bits


def residue(a: Fraction, p: int) -> int | None:
    """Return a fraction modulo a prime; None if there is none."""
    return None if a.denominator % p == 0 else a.numerator * pow(a.denominator, -1, p) % p


def inverse(a: Array, p: int) -> Array:
    """Return 1 / a modulo a prime; 0 for 0."""
    result, power = np.ones_like(a), p - 2
    while power:
        if power & 1:
            result = result * a % p
        a, power = a * a % p, power >> 1
    return result


def ranks(matrices: Array, p: int) -> Array:
    """Return the rank modulo a prime of each matrix (B, n, m)."""
    A = matrices.copy()
    B, n, m = A.shape
    rank, each, row = np.zeros(B, np.int64), np.arange(B), np.arange(n)[None]
    for column in range(m):
        candidates = (row >= rank[:, None]) & (A[:, :, column] != 0)
        has, pivot = candidates.any(axis=1), candidates.argmax(axis=1)
        top = np.minimum(rank, n - 1)
        chosen, others = A[each, pivot].copy(), A[each, top].copy()
        A[each[has], pivot[has]] = others[has]
        chosen = chosen * inverse(chosen[each, column], p)[:, None] % p
        A[each[has], top[has]] = chosen[has]
        factors = A[:, :, column].copy()
        factors[(row <= rank[:, None]) | ~has[:, None]] = 0
        A[:, :, column:] = (A[:, :, column:] - factors[:, :, None] * chosen[:, None, column:]) % p
        rank += has
    return rank


def solved(A: Array, b: Array, p: int) -> tuple[Array, Array]:
    """Return the solutions modulo a prime of systems (B, n, n), and which of them have one."""
    B, n, _ = A.shape
    M, good, each = np.concatenate([A, b[:, :, None]], axis=2), np.ones(B, bool), np.arange(B)
    for column in range(n):
        candidates = (np.arange(n)[None] >= column) & (M[:, :, column] != 0)
        good &= candidates.any(axis=1)
        pivot = candidates.argmax(axis=1)
        chosen = M[each, pivot].copy()
        M[each, pivot] = M[:, column]
        chosen = chosen * inverse(chosen[:, column], p)[:, None] % p
        M[:, column] = chosen
        factors = M[:, :, column].copy()
        factors[:, column] = 0
        M = (M - factors[:, :, None] * chosen[:, None, :]) % p
    return M[:, :, n], good


def monomials_at(exponents: Exponents, x: Array, p: int) -> Array:
    """Return the monomials (B, m) at points (B, D)."""
    highest = max(max(e, default=0) for e in exponents)
    powers = [np.ones_like(x)]
    for _ in range(highest):
        powers.append(powers[-1] * x % p)
    values = np.ones((len(x), len(exponents)), np.int64)
    for k, e in enumerate(exponents):
        for i, power in enumerate(e):
            if power:
                values[:, k] = values[:, k] * powers[power][:, i] % p
    return values


class Maps:
    """Maps of one kind modulo a prime: Kahan maps at a number eps, or rational maps."""

    def __init__(self, given: Sequence[Any], p: int, eps: int) -> None:
        first = given[0]
        self.p, self.eps, self.is_field = p, eps, isinstance(first, QuadraticField)
        tables = [self._of_field(each) if self.is_field else each for each in given]
        if self.is_field:
            self.good = np.array([table is not None for table in tables])
            shape = next((table.shape for table in tables if table is not None), (1, 2, 2))
            empty = np.zeros(shape, np.int64)
            self.table = np.stack([empty if table is None else table for table in tables])
            return
        self.good = np.ones(len(given), bool)
        monomials = {e for map in given for F in map.forms for e in map_exponents(F)}
        self.exponents = tuple(sorted(monomials))
        place = {e: k for k, e in enumerate(self.exponents)}
        self.table = np.zeros((len(given), len(first.forms), len(place)), np.int64)
        for map, rows in zip(given, self.table, strict=True):
            for F, row in zip(map.forms, rows, strict=True):
                for e, c in zip(map_exponents(F), F.coeffs(), strict=True):
                    row[place[e]] = int(c) % p

    def _of_field(self, field: QuadraticField) -> Array | None:
        table = np.zeros(field.table.shape, np.int64)
        for place in zip(*np.nonzero(field.table), strict=True):
            if (value := residue(field.table[place], self.p)) is None:
                return None
            table[place] = value
        return table

    def step(self, x: Array) -> tuple[Array, Array]:
        """Return the next points, and which of them exist."""
        p = self.p
        if not self.is_field:
            values = monomials_at(self.exponents, x, p)
            forms = (self.table * values[:, None, :] % p).sum(axis=2) % p
            return forms[:, :-1] * inverse(forms[:, -1], p)[:, None] % p, forms[:, -1] != 0
        # (x~ - x) / eps = sum of T_ijk X_j X~_k with X = (x, 1)
        B, D = x.shape
        whole = np.concatenate([x, np.ones((B, 1), np.int64)], axis=1)
        form = np.zeros((B, D, D + 1), np.int64)
        for j in range(D + 1):
            form = (form + self.table[:, :, j, :] * whole[:, j, None, None]) % p
        form = form * self.eps % p
        A = (np.eye(D, dtype=np.int64) - form[:, :, :D]) % p
        return solved(A, (x + form[:, :, D]) % p, p)


def map_exponents(P: Any) -> list[tuple[int, ...]]:
    return [tuple(map(int, e)) for e in P.monoms()]


def relations(maps: Maps, exponents: Exponents, rng: Any, extra: int) -> Array:
    """Return the number of relations between monomials along an orbit of each map; -1 if it ends.

    The orbits begin at one random point.
    """
    B, D = len(maps.table), len(exponents[0])
    x = np.broadcast_to(rng.integers(1, maps.p, D), (B, D)).astype(np.int64)
    good, rows = maps.good.copy(), []
    for _ in range(len(exponents) + extra):
        rows.append(monomials_at(exponents, x, maps.p))
        x, exists = maps.step(x)
        good &= exists
    return np.where(good, len(exponents) - ranks(np.stack(rows, axis=1), maps.p), -1)
