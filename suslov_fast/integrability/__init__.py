"""Exact experiments on the integrability of Kahan maps and other birational maps.

`report` calls the other functions. It finds degrees of iterates and their growth, Hirota-Kimura
bases, which give first integrals, and Darboux polynomials, which give invariant measures and first
integrals. All are evidence for or against integrability.

Arithmetic is exact, over the rationals or modulo random primes of 62 bits, two of which must agree
on each result. The primes are the same in each run. Extra `algebra`: python-flint.

The files, each of which uses only those before it:

- `arithmetic`, `interpolation`, `polynomials`, `rational_functions`: exact numbers; rational
  functions of letters from their values; polynomials; rational functions in factors.
- `birational_maps`, `composed_maps`, `kahan_maps`, `exact_maps`: birational maps; compositions of
  several; Kahan maps of fields; the exact map of any system, also with letters. `zoo`: examples.
- `degrees_of_iterates`: degrees and their growth. `pencils`: reducible polynomials of a pencil.
  `contracted_curves`, `entropy`: the entropy of maps of the plane, from the curves that they
  contract. `repairs`: letters for which it is lower. `levels`: maps on levels of integrals, which
  may be maps of the plane.
- `linear_relations`: linear relations along orbits, and integrals from them.
  `integrals_of_polynomials`: integrals and measures from Darboux polynomials. `darboux`: these
  polynomials and their cofactors. `symmetries`: reversing symmetries.
- `search`: all of this, task by task. `hirota_kimura`: Hirota-Kimura bases. `report`: the results
  in one object.
"""

from ..checks import extra
from ..fields.field import Field
from ..keywords import missing_in

try:
    import flint  # noqa: F401
except ImportError:
    extra("flint", "algebra")  # raises the error of any missing extra
    raise

from .birational_maps import RationalMap
from .darboux import cofactors, darboux_polynomials
from .degrees_of_iterates import Growth, degrees, growth
from .entropy import Contraction, PlanarEntropy, planar_entropy
from .exact_maps import kahan, rational_map
from .hirota_kimura import HKBasis, hk_bases
from .kahan_maps import KahanMap
from .levels import Level, on_level
from .levels_of_integrals import BasePoint, Lines, Member, Pencil, pencil
from .linear_relations import ImplicitIntegral
from .rational_functions import RationalFunction
from .repairs import Condition, Repair, locus, repairs
from .report import Report, report
from .zoo import zoo

__all__ = [
    "BasePoint",
    "Condition",
    "Contraction",
    "Field",
    "Growth",
    "HKBasis",
    "ImplicitIntegral",
    "KahanMap",
    "Level",
    "Lines",
    "Member",
    "Pencil",
    "PlanarEntropy",
    "RationalFunction",
    "RationalMap",
    "Repair",
    "Report",
    "cofactors",
    "darboux_polynomials",
    "degrees",
    "growth",
    "hk_bases",
    "kahan",
    "locus",
    "on_level",
    "pencil",
    "planar_entropy",
    "rational_map",
    "repairs",
    "report",
    "zoo",
]


def __getattr__(name: str) -> object:
    raise missing_in(__name__, name)


def __dir__() -> list[str]:
    return __all__
