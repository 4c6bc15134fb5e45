"""Monomial maps, x_i~ = c_i x1^a_i1 ... xD^a_iD: iterates have the powers of A as exponents.

The entropy is the log of the spectral radius of A (Hasselblatt and Propp 2007).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from .maps import RationalMap
from .polynomials import exponents_in_x


def exponents_of_monomials(map: RationalMap) -> list[list[int]] | None:
    """Return the matrix A of a monomial map; None for other maps."""
    if any(len(F) != 1 for F in map.forms):
        return None
    *rows, denominator = (
        [*map_exponents] for F in map.forms for map_exponents in exponents_in_x(F)
    )
    return [[int(a - b) for a, b in zip(row, denominator, strict=True)] for row in rows]


def degrees_of_monomials(A: Sequence[Sequence[int]]) -> Iterator[int]:
    """Yield the degrees of the iterates of a monomial map, as maps of projective space."""
    power = [[*row] for row in A]
    while True:
        # The common denominator has the largest negative exponents of each variable.
        negative = sum(max(0, *(-a for a in column)) for column in zip(*power, strict=True))
        yield max(0, *map(sum, power)) + negative
        power = (np.array(power, object) @ np.array(A, object)).tolist()
