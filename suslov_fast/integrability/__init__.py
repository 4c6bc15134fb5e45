"""Exact experiments on the integrability of Kahan maps.

A quadratic vector field and a step size define a birational map. Its degrees and their growth,
Hirota-Kimura bases, which give first integrals, and Darboux polynomials, which give invariant
measures and first integrals, are evidence for or against integrability. `report` finds all::

    from suslov_fast import Suslov3D
    from suslov_fast.integrability import *

    map = kahan(QuadraticField.of(Suslov3D(4, 1, -0.5, -0.25)), eps=0.25)
    report(map.field, map.eps)
    growth(degrees(map, 20))
    hk_bases(map, 2).integrals
    darboux_polynomials(map, 3)

All arithmetic is exact, over the rationals or modulo random primes of 62 bits, two of which must
agree on each result. A seed determines primes, points and lines. The module needs python-flint
(extra `algebra`).
"""

try:
    import flint  # noqa: F401
except ImportError as error:
    raise ImportError(
        "suslov_fast.integrability needs python-flint: "
        "pip install '.[algebra]' in a copy of the repository"
    ) from error

from .._bodies.field import QuadraticField
from ._functions import RationalFunction
from ._growth import Growth, degrees, growth
from ._invariants import cofactors
from ._maps import KahanMap, kahan
from ._planar import Pencil
from ._relations import HKBasis, darboux_polynomials, hk_bases
from ._report import Report, report
from ._zoo import zoo

__all__ = [
    "Growth",
    "HKBasis",
    "KahanMap",
    "Pencil",
    "QuadraticField",
    "RationalFunction",
    "Report",
    "cofactors",
    "darboux_polynomials",
    "degrees",
    "growth",
    "hk_bases",
    "kahan",
    "report",
    "zoo",
]
