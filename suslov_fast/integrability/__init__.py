"""Exact experiments on the integrability of Kahan maps and other birational maps.

`report` finds what the other functions find one by one: degrees and their growth,
Hirota-Kimura bases, which give first integrals, and Darboux polynomials, which give invariant
measures and first integrals. All are evidence for or against integrability.

Arithmetic is exact, over the rationals or modulo random primes of 62 bits, two of which must agree
on each result. A seed determines primes, points and lines. Extra `algebra`: python-flint.

The files, in an order in which each uses only those before it:

- `arithmetic`, `polynomials`: exact numbers and polynomials. `reconstruction`: rational results
  from residues modulo primes. `functions`: rational functions in factors. `arguments`, `decimals`:
  checks, and floats as decimals.
- `maps`, `kahan`: birational maps, and the Kahan maps of fields. `zoo`: examples.
- `tasks`: the queue of a search. `growth`: degrees of iterates.
- `reducible`: reducible polynomials of a space. `contracted`, `confinement`, `never_confined`,
  `monomials`, `planar`: the entropy of maps of the plane, from the curves that they contract, and
  of monomial maps. `surfaces`: maps on levels of integrals, which may be maps of the plane.
- `relations`: linear relations along orbits. `implicit`: integrals by them, without a formula.
  `locus`: parameters with more of them.
- `darboux`: Darboux polynomials of a cofactor, and cofactors. `invariants`: integrals and measures
  that follow from them. `normal_form`: which of many formulas. `symmetries`: reversing ones.
- `search`: all of this, task by task. `bases`: Hirota-Kimura bases. `process`: a search that can be
  interrupted. `report`: the results in one object. `levels`: the function for them.
"""

import sys
from typing import NoReturn

import suslov_fast

from ..bodies.fields.field import QuadraticField
from ..checks import extra
from ..keywords import refuse

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
from .levels import on_level
from .locus import Locus, Special, locus
from .maps import RationalMap, rational_map
from .planar import Contraction, PlanarEntropy, planar_entropy
from .report import Report, report
from .surfaces import Level
from .zoo import zoo

__all__ = [
    "Contraction",
    "Growth",
    "HKBasis",
    "ImplicitIntegral",
    "KahanMap",
    "Level",
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
    "on_level",
    "planar_entropy",
    "rational_map",
    "report",
    "zoo",
]


def __getattr__(name: str) -> NoReturn:
    """Say where a public name is that is not in this module."""
    refuse(sys.modules[__name__], name, f"suslov_fast.{name}" * (name in dir(suslov_fast)))


def __dir__() -> list[str]:
    return __all__
