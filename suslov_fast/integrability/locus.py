"""Values of a parameter for which a map has more relations along its orbits than for others.

Relations are counted modulo a large prime for all fractions up to a height.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import cache
from itertools import product
from typing import Any, NamedTuple

from ..bodies.fields.field import QuadraticField
from ..checks import integer, kind_of, wrong
from ..keywords import public
from . import arithmetic
from .arguments import exponents_of, progress_function
from .kahan import KahanMap, kahan
from .maps import RationalMap
from .polynomials import Exponents
from .relations import relations_along

_GENERAL = 3  # general values that tell how many relations there are in general


class Special(NamedTuple):
    """A value of a parameter with more relations than a general one.

    `relations` is their number.
    """

    value: Fraction
    relations: int


class Locus(list[Special]):
    """The values that `locus` found, in ascending order.

    `generic` is the number of relations of a general value and `height` the largest numerator or
    denominator that was tried. `left_out` has the values for which there is no field or map.
    """

    def __init__(
        self,
        special: Sequence[Special],
        generic: int,
        height: int,
        left_out: Sequence[Fraction],
    ) -> None:
        super().__init__(special)
        self.generic, self.height, self.left_out = generic, height, tuple(left_out)

    def __repr__(self) -> str:
        special = ", ".join(f"{value} ({relations})" for value, relations in self)
        text = f"general values: {self.generic} relations; more at {special or 'none'}"
        text += f", of all fractions of height up to {self.height}"
        if self.left_out:
            text += f" but {', '.join(map(str, self.left_out))}, without a map"
        return f"Locus({text})"


@public
def locus(
    f: Callable[[Any], Any],
    degree: int,
    *,
    height: int = 10,
    monomials: Sequence[Sequence[int]] | None = None,
    progress: Any = None,
) -> Locus:
    """Find the values of a parameter for which a map has more relations along its orbits.

    For each fraction up to a height, the linear relations between monomials along an orbit are
    counted modulo a prime, at a general eps. Values with more relations than generic values
    are confirmed modulo another prime, from another point, and at another eps. The additional
    relations may come from integrals, or only from invariant curves: `report` says which.

    Parameters
    ----------
    f : callable
        A function of the parameter that returns a QuadraticField or a map; it is called with
        fractions.
    degree : int
        Largest degree of the monomials.
    height : int, optional
        Largest numerator and denominator of the values, by default 10.
    monomials : sequence of exponents, optional
        The exponents (e1, ..., eD) of the monomials, by default all up to `degree`.
    progress : callable, optional
        Called as ``progress(done, parts)`` after each group of values.

    Returns
    -------
    Locus
        A list of named tuples `value, relations`.

    Raises
    ------
    TypeError, ValueError
        If f returns something else, or fields of different dimensions.
    ArithmeticError
        If there is no map for general values.

    Examples
    --------
    >>> from suslov_fast import QuadraticField
    >>> from suslov_fast.integrability import locus
    >>> def henon_heiles(c):
    ...     H = lambda x: (x[2]**2 + x[3]**2) / 2 + x[0]**2*x[1] + c*x[1]**3 / 3
    ...     return QuadraticField.from_hamiltonian(H, 4)
    >>> locus(henon_heiles, degree=3, height=3)
    Locus(general values: 0 relations; more at 1 (2), of all fractions of height up to 3)
    """
    degree, height = integer("degree", degree, 1), integer("height", height, 1)
    rng = random.Random(0)
    report_progress = progress_function(progress)
    maps = _Maps(f)
    general = [
        Fraction(rng.randrange(10**3, 10**6), rng.randrange(10**3, 10**6) | 1)
        for _ in range(_GENERAL)
    ]
    examples = [*filter(None, map(maps.at, general))]
    if not examples:
        raise ArithmeticError("f makes no map for general values of the parameter") from maps.error
    example, rng = examples[0], examples[0].generator()
    exponents = exponents_of(degree if monomials is None else monomials, example.dimension)

    def counts(values: Sequence[Fraction]) -> dict[Fraction, int]:
        """Return the numbers of relations along orbits from a random point modulo a prime."""
        p = arithmetic.random_prime(rng)
        eps, x = rng.randrange(2, p), arithmetic.random_point(example.dimension, p, rng)
        return {value: _count(maps.at(value), exponents, eps, x) for value in values}

    of_general = [n for n in counts(general).values() if n >= 0]
    if not of_general:
        raise ArithmeticError("f makes no map for general values of the parameter")
    generic = min(of_general)
    pairs = product(range(-height, height + 1), range(1, height + 1))
    first = counts(sorted({Fraction(a, b) for a, b in pairs}))
    report_progress(1, 2)
    second = counts([value for value, n in first.items() if n > generic])
    report_progress(2, 2)
    special = [Special(value, min(n, first[value])) for value, n in second.items() if n > generic]

    left_out = [value for value, n in first.items() if n < 0]
    return Locus(special, generic, height, left_out)


class _Maps:
    """The maps of a function at exact numbers; fields have a symbolic eps."""

    def __init__(self, f: Any) -> None:
        if not callable(f) or isinstance(f, QuadraticField | RationalMap):
            received = f"{kind_of(f)}: pass one that returns fields or maps"
            raise wrong("f", "a function of the parameter", received, TypeError)
        self._f, self._dimension = f, 0
        self.at = cache(self._at)  # the map at a value; None if there is none
        self.error: Exception | None = None  # of a value without a map

    def _at(self, value: Fraction) -> RationalMap | None:
        try:
            returned = self._f(value)
        except (ArithmeticError, ValueError) as error:
            # A tracer of f reports the errors of f.
            if not isinstance(error.__cause__ or error, ArithmeticError):
                raise
            self.error = error
            return None
        if isinstance(returned, QuadraticField) and not returned.shape:
            returned = kahan(returned)
        if not isinstance(returned, RationalMap):
            got = f"{kind_of(returned)} at {value}"
            raise wrong("f", "a single QuadraticField or map for each number", got, TypeError)
        self._dimension = self._dimension or returned.dimension
        if returned.dimension != self._dimension:
            expected = f"have {self._dimension} variables for each number"
            raise wrong("f", expected, f"{returned.dimension} at {value}")
        return returned


def _count(map: RationalMap | None, exponents: Exponents, eps: int, x: list[Any]) -> int:
    """Return the number of relations along an orbit modulo a prime; -1 without a map or orbit."""
    p = int(x[0].modulus())
    coefficients = map.field._exact.values if isinstance(map, KahanMap) else ()
    if map is None or not all(c.denominator % p for c in coefficients):
        return -1
    try:
        return len(relations_along(map, exponents, eps, x))
    except ZeroDivisionError:
        return -1
