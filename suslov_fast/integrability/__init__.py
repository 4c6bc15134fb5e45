"""Exact experiments on the integrability of Kahan maps and other birational maps.

`report` calls the other functions one by one. It finds degrees and their growth,
Hirota-Kimura bases, which give first integrals, and Darboux polynomials, which give invariant
measures and first integrals. All are evidence for or against integrability.

Arithmetic is exact, over the rationals or modulo random primes of 62 bits, two of which must agree
on each result; they are the same ones each time. Extra `algebra`: python-flint.

The files, in an order in which each uses only those before it:

- `arithmetic`, `polynomials`, `rational_functions`: exact numbers, polynomials and rational
  functions in factors.
- `interpolation`: rational functions of letters from their values modulo primes.
- `birational_maps`: birational maps. `composed_maps`: those of several stages. `rational_maps`:
  those of a `Map`. `kahan_maps`: the Kahan maps of fields. `letters`: these with parameters as
  letters. `zoo`: examples.
- `degrees_of_iterates`: degrees of iterates. `pencils`: reducible polynomials of a pencil.
  `contracted_curves`, `singular_orbits`, `entropy`: the entropy of maps of the plane, from the
  curves that they contract. `levels`: maps on levels of integrals, which may be maps of the plane.
- `linear_relations`: linear relations along orbits, and integrals by them.
- `darboux`: Darboux polynomials of a cofactor, and cofactors. `invariants`: integrals and measures
  that follow from them, in normal form. `symmetries`: reversing ones.
- `search`: all of this, task by task. `hirota_kimura`: Hirota-Kimura bases. `report`: the results
  in one object.
"""

from ..checks import extra
from ..fields.field import Field
from ..keywords import missing_in

try:
    import flint  # noqa: F401
except ImportError:
    extra("flint", "algebra")  # raises in the words of all extras
    raise

from .birational_maps import RationalMap
from .darboux import cofactors
from .darboux_polynomials import darboux_polynomials
from .degrees_of_iterates import Growth, degrees, growth
from .entropy import Contraction, PlanarEntropy, planar_entropy
from .hirota_kimura import HKBasis, hk_bases
from .kahan_maps import KahanMap, kahan
from .levels import Level, on_level
from .linear_relations import ImplicitIntegral
from .rational_functions import RationalFunction
from .rational_maps import rational_map
from .report import Report, report
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
