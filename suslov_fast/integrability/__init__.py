"""Exact experiments on the integrability of Kahan maps and other birational maps.

`report` finds what the other functions find one by one: degrees and their growth,
Hirota-Kimura bases, which give first integrals, and Darboux polynomials, which give invariant
measures and first integrals. All are evidence for or against integrability.

Arithmetic is exact, over the rationals or modulo random primes of 62 bits, two of which must agree
on each result; they are the same ones each time. Extra `algebra`: python-flint.

The files, in an order in which each uses only those before it:

- `arithmetic`, `polynomials`, `functions`: exact numbers, polynomials and rational functions in
  factors.
- `interpolation`: rational functions of letters from their values modulo primes.
- `maps`, `kahan`: birational maps, and the Kahan maps of fields. `letters`: Kahan maps with
  parameters as letters. `zoo`: examples.
- `growth`: degrees of iterates. `reducible`: reducible polynomials of a pencil. `contracted`,
  `orbits`, `planar`: the entropy of maps of the plane, from the curves that they contract, and of
  monomial maps. `surfaces`: maps on levels of integrals, which may be maps of the plane.
- `relations`: linear relations along orbits, and integrals by them.
- `darboux`: Darboux polynomials of a cofactor, and cofactors. `invariants`: integrals and measures
  that follow from them, in normal form. `symmetries`: reversing ones.
- `search`: all of this, task by task. `bases`: Hirota-Kimura bases. `report`: the results in one
  object. `levels`: the function of levels.
"""

from ..bodies.fields.field import Field
from ..checks import extra
from ..keywords import missing_in

try:
    import flint  # noqa: F401
except ImportError:
    extra("flint", "algebra")  # raises in the words of all extras
    raise

from .bases import HKBasis, hk_bases
from .darboux import cofactors
from .functions import RationalFunction
from .generators import darboux_polynomials
from .growth import Growth, degrees, growth
from .kahan import KahanMap, kahan
from .levels import on_level
from .maps import RationalMap, rational_map
from .planar import Contraction, PlanarEntropy, planar_entropy
from .relations import ImplicitIntegral
from .report import Report, report
from .surfaces import Level
from .zoo import zoo

__all__ = [
    "Contraction",
    "Field",
    "Growth",
    "HKBasis",
    "ImplicitIntegral",
    "KahanMap",
    "Level",
    "PlanarEntropy",
    "RationalFunction",
    "RationalMap",
    "Report",
    "cofactors",
    "darboux_polynomials",
    "degrees",
    "growth",
    "hk_bases",
    "kahan",
    "on_level",
    "planar_entropy",
    "rational_map",
    "report",
    "zoo",
]


def __getattr__(name: str) -> object:
    raise missing_in(__name__, name)


def __dir__() -> list[str]:
    return __all__
