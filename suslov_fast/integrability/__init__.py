"""Exact experiments on the integrability of Kahan maps and other birational maps.

`report` finds what the other functions find one by one: degrees and their growth,
Hirota-Kimura bases, which give first integrals, and Darboux polynomials, which give invariant
measures and first integrals. All are evidence for or against integrability.

Arithmetic is exact, over the rationals or modulo random primes of 62 bits, two of which must agree
on each result. A seed determines primes, points and lines. Extra `algebra`: python-flint.
"""

from ..bodies.field import QuadraticField
from ..checks import extra

try:
    import flint  # noqa: F401
except ImportError:
    extra("flint", "algebra")  # raises in the words of all extras
    raise

from .bases import HKBasis, hk_bases
from .darboux import cofactors, darboux_polynomials
from .functions import RationalFunction
from .growth import Growth, degrees, growth
from .implicit import ImplicitIntegral
from .kahan import KahanMap, kahan
from .locus import Locus, Special, locus
from .maps import RationalMap
from .planar import Contraction, PlanarEntropy, planar_entropy
from .rational import rational_map
from .report import Report, report
from .zoo import zoo

__all__ = [
    "Contraction",
    "Growth",
    "HKBasis",
    "ImplicitIntegral",
    "KahanMap",
    "Locus",
    "PlanarEntropy",
    "QuadraticField",
    "RationalFunction",
    "RationalMap",
    "Report",
    "Special",
    "cofactors",
    "darboux_polynomials",
    "degrees",
    "growth",
    "hk_bases",
    "kahan",
    "locus",
    "planar_entropy",
    "rational_map",
    "report",
    "zoo",
]


def __dir__() -> list[str]:
    return __all__
