"""The Hamiltonian of a field as a polynomial in the ring of its map."""

from __future__ import annotations

import math
from typing import Any

from ..bodies.field import QuadraticField
from ..bodies.polynomials import terms_of
from .maps import BirationalMap, KahanMap


def hamiltonian_of(map: BirationalMap) -> Any:
    """Return an integer multiple of H for a Kahan map of K grad H; None for other maps."""
    if not isinstance(map, KahanMap) or map.field.H is None:
        return None
    field, D = map.field, map.dimension
    terms = terms_of(field.H.tensor)

    def H(x: Any) -> Any:
        return sum(math.prod((x[i] for i in powers), start=c) for powers, c in terms.items())

    # H and K of a field in a file of a batch are rounded.
    if QuadraticField.from_hamiltonian(H, D, field.K) != field:
        return None
    scale = math.lcm(*(c.denominator for c in terms.values()))
    letter = (0,) * map.has_letter
    return map.ring.from_dict(
        {(*letter, *(e.count(i) for i in range(D))): int(c * scale) for e, c in terms.items()}
    )
