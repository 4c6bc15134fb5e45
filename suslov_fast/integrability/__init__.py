"""Exact experiments on the integrability of Kahan maps and other birational maps.

A quadratic vector field and a step size define a birational map; `rational_map` takes any other.
Degrees and their growth, Hirota-Kimura bases, which give first integrals, and Darboux polynomials,
which give invariant measures and first integrals, are evidence for or against integrability.
`report` finds all::

    from suslov_fast import Suslov3D
    from suslov_fast.integrability import *

    map = kahan(QuadraticField.of(Suslov3D(4, 1, -0.5, -0.25)), eps=0.25)
    report(map.field, map.eps)
    report(map.field)  # formulas in eps
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

from ..bodies.field import QuadraticField
from .darboux import darboux_polynomials
from .functions import RationalFunction
from .growth import Growth, degrees, growth
from .invariants import cofactors
from .kahan import KahanMap, kahan
from .maps import RationalMap
from .rational import rational_map
from .relations import HKBasis, hk_bases
from .report import Report, report
from .zoo import zoo

__all__ = [
    "Growth",
    "HKBasis",
    "KahanMap",
    "QuadraticField",
    "RationalFunction",
    "RationalMap",
    "Report",
    "cofactors",
    "darboux_polynomials",
    "degrees",
    "growth",
    "hk_bases",
    "kahan",
    "rational_map",
    "report",
    "zoo",
]
