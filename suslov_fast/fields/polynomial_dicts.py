"""Polynomials as dictionaries: coefficients by sorted letters, where (0, 0, 1) is x1 x1 x2.

Coefficients are fractions, or floats, or arrays (...) of floats for the members of a family.
"""

from __future__ import annotations

from typing import Any

import numpy as np

Polynomial = dict[tuple[int, ...], Any]


def _is_nonzero(c: Any) -> bool:
    """Return True for a number other than 0, an array that contains one, or an empty array."""
    return bool(c.any() or not c.size) if isinstance(c, np.ndarray) else bool(c)


def constant(c: Any) -> Polynomial:
    """Return a constant."""
    return {(): c} if _is_nonzero(c) else {}


def without_zeros(a: Polynomial) -> Polynomial:
    """Return the terms that are not 0."""
    return {m: c for m, c in a.items() if _is_nonzero(c)}


def total(*parts: Polynomial) -> Polynomial:
    """Return a sum; shorter parts are added to longer ones, because copies take time."""
    found = dict(parts[0])
    for part in parts[1:]:
        fewer, found = (part, found) if len(part) <= len(found) else (found, dict(part))
        for m, c in fewer.items():
            found[m] = found[m] + c if m in found else c
            if not _is_nonzero(found[m]):
                del found[m]
    return found


def difference(a: Polynomial, b: Polynomial) -> Polynomial:
    """Return a - b."""
    return total(a, {m: -c for m, c in b.items()})


def product(a: Polynomial, b: Polynomial) -> Polynomial:
    """Return a b."""
    a, b = sorted((a, b), key=len)
    products = ({tuple(sorted(m + n)): c * d for n, d in b.items()} for m, c in a.items())
    return total({}, *products)
