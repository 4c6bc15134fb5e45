"""Maps with letters: named parameters of a field or a body that stay symbols, beside eps.

Weights of letters and variables under which a map is homogeneous set as many of them to 1 as
weights are independent; `interpolation` finds formulas in the others.
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from fractions import Fraction
from functools import cached_property
from typing import Any

import flint
import numpy as np

from ..bodies.fields import coefficients
from ..bodies.fields.base import Body
from ..bodies.fields.field import Field
from ..bodies.fields.terms import collected
from ..checks import wrong
from .arithmetic import as_written
from .functions import RationalFunction, factored, over_common_denominator
from .interpolation import MOST, Box, Unknown, over_rationals
from .kahan import KahanMap, energy_of, exact_body, rows_of
from .maps import MapWithLetters
from .polynomials import coprime, cramer, ring_with_letters


class Scalings:
    """The scalings of letters and variables of a map, and the formulas that they simplify."""

    def __init__(self, map: MapWithLetters) -> None:
        self.map = map

    @cached_property
    def weights(self) -> list[list[int]]:
        """A basis of the weights of letters and x for which all F_i / F_0 have those of x_i."""
        count, size = len(self.map.letters), len(self.map.ring.gens())
        first, rows = [*map(int, self.map.forms[-1].monoms()[0])], []
        for i, F in enumerate(self.map.forms, count):
            for e in F.monoms():
                rows.append([int(a) - b for a, b in zip(e, first, strict=True)])
                if i < size:
                    rows[-1][i] -= 1
        columns, rank = flint.fmpz_mat(rows).nullspace()
        basis = [[int(columns[i, j]) for i in range(size)] for j in range(rank)]
        return [[a // math.gcd(*row) for a in row] for row in basis]

    def weight(self, e: Sequence[int]) -> list[int]:
        """Return the weights of a monomial in x."""
        count = len(self.map.letters)
        return [sum(a * int(k) for a, k in zip(w[count:], e, strict=True)) for w in self.weights]

    def lifted(self, box: Box, weights: Sequence[Sequence[int]], count: int) -> list[Any]:
        """Return numerators and denominators of the entries of a box, which have these weights.

        They are polynomials in the first letters and variables, as many as `count`. Those that
        weights set to 1 get their exponents back at the end.
        """
        scales = flint.fmpq_mat([row[:count] for row in self.weights]) if self.weights else None
        fixed = _pivots(scales) if scales else []
        free = [k for k in range(count) if k not in fixed]
        if len(free) > MOST:
            raise Unknown(f"at most {MOST} letters and variables are interpolated")

        def reduced(p: int, values: list[int]) -> list[int]:
            point = [1] * count
            for k, a in zip(free, values, strict=True):
                point[k] = a
            return box(p, point)

        found = over_rationals(reduced, len(free), random.Random(count))
        return [
            self._restored(N, D, weight, fixed, free) if N else (self.map.ring.constant(0), 1)
            for (N, D), weight in zip(found, weights, strict=True)
        ]

    def _restored(self, N: Any, D: Any, weight: Any, fixed: Any, free: Any) -> tuple[Any, Any]:
        """Return N and D with powers of the letters that were set to 1."""
        size, origin, terms = len(self.map.ring.gens()), next(iter(D)), list[Any]()
        columns = [[w[k] for k in fixed] for w in self.weights]
        for part, total in ((N, weight), (D, [0] * len(weight))):
            for e, c in part.items():
                exponents = [0] * size
                rest = [*total]
                for k, a, b in zip(free, e, origin, strict=True):
                    exponents[k] = a
                    rest = [r - w[k] * (a - b) for r, w in zip(rest, self.weights, strict=True)]
                for k, a in zip(fixed, _solution(columns, rest), strict=True):
                    exponents[k] = a
                terms.append((part is N, exponents, c))
        low = [min(column) for column in zip(*(e for _, e, _ in terms), strict=True)]
        scale = math.lcm(*(c.denominator for *_, c in terms))
        parts: tuple[Any, Any] = {}, {}
        for is_numerator, e, c in terms:
            key = tuple(a - b for a, b in zip(e, low, strict=True))
            parts[not is_numerator][key] = int(c * scale)
        return self.map.ring.from_dict(parts[0]), self.map.ring.from_dict(parts[1])


def _pivots(matrix: Any) -> list[int]:
    reduced, rank = matrix.rref()
    return [next(k for k in range(matrix.ncols()) if reduced[i, k] != 0) for i in range(rank)]


def _solution(columns: Sequence[Sequence[int]], right: Sequence[int]) -> list[int]:
    """Return the only solution of linear equations, in integers."""
    count = len(columns[0]) if columns else 0
    if not count:
        if any(right):
            raise Unknown("a formula is not homogeneous")
        return []
    rows = [[*row, b] for row, b in zip(columns, right, strict=True)]
    reduced, rank = flint.fmpq_mat(rows).rref()
    found = [reduced[i, count] for i in range(count)]
    if rank > count or any(a.q != 1 for a in found):
        raise Unknown("a formula is not homogeneous")
    return [int(a.p) for a in found]


def _coefficients(system: Body, symbols: Mapping[str, Any], decimals: bool) -> tuple[Any, Any]:
    """Return the coefficients of f, and of H or None, with symbols for some parameters."""
    exactly = as_written if decimals else Fraction
    if not isinstance(system, Field):
        parts = {**exact_body(system, decimals).parts, **symbols}
        terms = system._of(parts).field()._own_terms
        return {place: _function(c) for place, c in terms.members()}, None
    equations = system._equations

    def number(a: Any) -> RationalFunction:
        if isinstance(a, RationalFunction):
            return a
        return _function(equations.ratios[a] if a in equations.ratios else exactly(a))

    values = [symbols.get(name, a) for name, a in system.parameters.items()]

    def read(results: Sequence[Any], degree: int) -> Any:
        found = coefficients.coefficients_by(number, equations, results, degree, values)
        return {place: c for place, c in found.items() if c}

    try:
        energy = None if equations.H is None else read([equations.H], 3)
        return read(equations.results, 2), energy
    except coefficients.NotQuadratic as error:
        raise TypeError(f"system: {error}, so it has no Kahan map") from None
    except TypeError as error:
        text = "must enter by + - * / and powers with integers"
        raise TypeError(f"letters: {', '.join(symbols)} {text}: {error}") from None


def kahan_with_letters(system: Body, letters: Sequence[str], decimals: bool) -> MapWithLetters:
    """Return the Kahan map of a field or a body with letters, the first of which is eps."""
    names, D = system.field().names, system.dimension
    ring = ring_with_letters(D, ["eps", *letters])
    eps, *others = ring.gens()
    rates, energy = _coefficients(
        system, {name: factored(a) for name, a in zip(letters, others, strict=False)}, decimals
    )
    x = [*others[len(letters) :], ring.constant(1)]
    *values, common = over_common_denominator(rates.values(), ring)
    halves = [((i, j, k), (1 + (j == k)) * v) for (i, j, k), v in zip(rates, values, strict=True)]
    zero = ring.constant(0)
    system_of_rows = [
        [sum(((c + d * eps) * x[j] for j, c, d in form), zero) for form in row]
        for row in rows_of(halves, 2 * common, D)
    ]
    forms = coprime(cramer(system_of_rows))
    back = [F.compose(-eps, *others, ctx=ring) for F in forms]
    modified = None
    if energy is not None:
        *of_H, _ = over_common_denominator(energy.values(), ring)
        products = (v * math.prod(x[i] for i in e) for e, v in zip(energy, of_H, strict=True))
        modified = energy_of(sum(products, zero), forms, x, len(letters) + 1)
    rows = []
    for i, name in enumerate(names):
        terms = (v * x[j] * x[k] for (row, j, k), v in zip(rates, values, strict=True) if row == i)
        rows.append(f"{name}' = {(factored(sum(terms, zero)) / factored(common)).renamed(names)}")
    text = f"Kahan map of {', '.join(rows)}"
    inverse = MapWithLetters(back, ["eps", *letters], names)
    map = MapWithLetters(forms, ["eps", *letters], names, inverse, text, modified)
    constants: Any = np.empty(len(rates), object)
    constants[:] = [c._with(map.numbers).constant for c in rates.values()]
    terms_at = collected(np.array([*rates]).T, constants, D, 2)
    map.at_numbers = KahanMap(Field.of_terms(terms_at, names), map.numbers["eps"])
    return map


def _function(a: Any) -> RationalFunction:
    return a if isinstance(a, RationalFunction) else RationalFunction((), Fraction(a))


def checked_letters(system: Any, letters: Any) -> tuple[str, ...]:
    """Return names of parameters of a field or a body that are letters."""
    if not isinstance(system, Body):
        raise wrong("letters", "left out for a map, which has its own", letters, TypeError)
    if system.shape:
        raise wrong("system", "a single one", f"a batch of shape {system.shape}: pass system[i]")
    has = [name for name, a in system.parameters.items() if not np.ndim(a)]
    if letters is True:
        return tuple(has)
    names = letters.replace(",", " ").split() if isinstance(letters, str) else letters
    names = [*names] if isinstance(names, Sequence) else []
    if not names or {*names} - {*has} or len({*names}) < len(names):
        known = f"names of its parameters {', '.join(has)}" if has else "left out: it has none"
        raise wrong("letters", known, repr(letters))
    if "eps" in names:
        raise wrong("letters", "names of parameters: eps is a letter in any case", repr(letters))
    if len(names) > MOST:
        raise wrong("letters", f"at most {MOST} names", len(names))
    return tuple(names)
