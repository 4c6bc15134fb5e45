"""Kahan maps of quadratic fields, exact: solutions x~ of A(x; eps) x~ = b(x; eps).

The inverse is the map for -eps. det DPhi = det A(x~; -eps) / det A(x; eps). For x' = K grad H, the
modified energy H + grad H (x~ - x) / 3 is an integral (Celledoni, McLachlan, Owren, Quispel 2013).
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from fractions import Fraction
from itertools import combinations
from typing import Any, NamedTuple

import flint
import numpy as np

from ..core.cached import cached_property
from ..fields.field import Field
from ..fields.terms import Terms, collected
from . import rational_functions
from .arithmetic import Values, as_written, moduli
from .birational_maps import RationalMap, checked_names
from .polynomials import coprime, cramer, degree_of, exponents_in_x, letters_in, primitive
from .rational_functions import MODULAR, RationalFunction, factored, over_common_denominator
from .tolerances import FEW_MONOMIALS, LONGEST_PULLBACK, MOST_VARIABLES_OF_HAMILTONIAN


class InLetters(NamedTuple):
    """Coefficients with letters, as {(i, j, k): c}, for terms c x_j x_k of x_i', and of H."""

    given: dict[str, Any]  # the values that the letters had in the system
    rates: dict[tuple[int, ...], RationalFunction]
    energy: dict[tuple[int, ...], RationalFunction] | None


class KahanMap(RationalMap):
    """The Kahan map of a quadratic field, exact; made by `kahan`.

    A `RationalMap`. If `eps` is None, the step size is symbolic; `subs` replaces it by a number.
    """

    def __init__(
        self,
        field: Field,
        eps: Fraction | None,
        sign: int = 1,
        is_exact: bool = False,
        in_letters: InLetters | None = None,
    ) -> None:
        if not isinstance(field, Field) or not isinstance(eps, Fraction | None):
            raise TypeError("field: a KahanMap is made by kahan(field, eps)")
        self._is_exact = is_exact  # True if the field has no floats
        self.field, self.eps, self._sign = field, eps, sign
        self.dimension, self.in_letters = field._layout.D, in_letters
        self.given = in_letters.given if in_letters else {}
        self.letters = ("eps",) * (eps is None) + (*self.given,)
        self.names = checked_names(field._layout.components)

    @cached_property
    def terms(self) -> Terms:
        """The terms v x_j x_k of the field, with fractions v."""
        return self.field._terms_of(exactly=Fraction if self._is_exact else as_written)

    @cached_property
    def inverse(self) -> KahanMap:
        """The inverse map, which is the Kahan map of the same field with -eps."""
        return self._at(None if self.eps is None else -self.eps, -self._sign)

    def _at(self, eps: Fraction | None, sign: int = 1) -> KahanMap:
        """Return the map for another eps, or for the symbol `sign` * eps if `eps` is None."""
        sign = sign if eps is None else 1
        map = KahanMap(self.field, eps, sign, self._is_exact, self.in_letters)
        map._rates = self._rates  # `_rates` take long to compute
        if self.in_letters is None:
            map.terms = self.terms
        return map

    def _with(self, numbers: Mapping[str, Fraction]) -> KahanMap:
        eps = self._sign * self._all_numbers(numbers)[0]
        if self.in_letters is None:
            return self._at(eps)
        indices, rates = zip(*self.in_letters.rates.items(), strict=True)
        constants = np.array([c._with(numbers).constant for c in rates], object)
        terms = collected(np.array(indices).T, constants, self.dimension, 2)
        return KahanMap(Field._of_terms(terms, self.field._layout.components), eps, is_exact=True)

    def _at_numbers(self, values: Values) -> KahanMap:
        point = [*values[: len(self.letters)], *[0] * self.dimension]
        forward, backward = KahanMap(self.field, Fraction(1)), KahanMap(self.field, Fraction(-1))
        for map, at in ((self, forward), (self.inverse, backward)):
            at._forms = [
                [[(j, int(a(*point))) for j, a in form] for form in row] for row in map._forms
            ]
        forward.inverse = backward
        backward.inverse = forward
        return forward

    @cached_property
    def _rates(self) -> tuple[list[tuple[tuple[int, ...], Any]], Any]:
        """Pairs ((i, j, k), v) for terms v x_j x_k / q of x_i', and the common denominator q."""
        if self.in_letters is None:
            return _integers(self.terms)
        *values, common = over_common_denominator(self.in_letters.rates.values(), self.ring)
        return [*zip(self.in_letters.rates, values, strict=True)], common

    @cached_property
    def coefficients(self) -> list[int]:
        """The integers in the terms of the field, and in eps, from which `prime` follows."""
        if self.in_letters:
            terms, common = self._rates
            return [int(c) for P in (common, *(v for _, v in terms)) for c in P.coeffs()]
        numbers = [*self.terms.values, *([] if self.eps is None else [self.eps])]
        return [part for c in numbers for part in (c.numerator, c.denominator)]

    def __repr__(self) -> str:
        if self.in_letters is None:
            eps = "" if self._sign > 0 else ", eps=-eps"
            return f"kahan({self.field}{eps if self.eps is None else f', eps={self.eps}'})"
        x, (terms, common), equations = self.variables, self._rates, []
        for i, name in enumerate(self.field._layout.components):
            products = (v * x[j] * x[k] for (row, j, k), v in terms if row == i)
            rate = factored(sum(products, self.ring.constant(0))) / factored(common)
            equations.append(f"{name}' = {rate.renamed(self.field._layout.components)}")
        return f"Kahan map of {', '.join(equations)}"

    def __reduce__(self) -> Any:
        return KahanMap, (self.field, self.eps, self._sign, self._is_exact, self.in_letters)

    @cached_property
    def _forms(self) -> list[Any]:
        """The rows of (A | b) for the equations A(x) x~ = b(x), times a common denominator.

        An entry is a linear form, a list of pairs (j, a). The number a is the coefficient of
        x_(j+1), or the constant term if j = D.
        """
        if self.eps is None:
            eps, unit = self._sign * self.ring.gens()[0], self.ring.constant(1)
        else:
            eps, unit = self.eps.numerator, self.eps.denominator
        D, (terms, common) = self.dimension, self._rates
        rows: list[list[dict[int, Any]]] = [[{} for _ in range(D + 1)] for _ in range(D)]
        for i in range(D):  # at eps = 0, A is the unit matrix and b is x
            rows[i][i][D] = 2 * common * unit
            rows[i][D][i] = 2 * common * unit
        for (i, *pair), v in terms:  # x_j x_k becomes (x_j x~_k + x_k x~_j) / 2
            half = (2 if pair[0] == pair[1] else 1) * v * eps
            for j, k in {(*pair,), (*pair[::-1],)}:
                rows[i][k][j] = rows[i][k].get(j, 0) + (half if k == D else -half)
        return [[sorted(form.items()) for form in row] for row in rows]

    def _system(self, x: Sequence[Any]) -> list[list[Any]]:
        """Return the rows of (A | b) at a point x, for the equations A x~ = b of the image x~."""
        zero = 0 * x[-1]
        return [[sum((a * x[j] for j, a in form), zero) for form in row] for row in self._forms]

    def _matrices(self, x: Sequence[Any]) -> tuple[Any, Any]:
        """Return the matrices A (D, D) and b (D, 1) of A x~ = b, at a point x of numbers."""
        D, modulus = self.dimension, moduli(x[0])
        new = flint.nmod_mat if modulus else flint.fmpq_mat
        if self._latest[0] != modulus:
            forms = [dict(form) for row in self._forms for form in row[:-1]]
            forms += [dict(row[-1]) for row in self._forms]
            coefficients = [form.get(j, 0) for form in forms for j in range(D + 1)]
            self._latest = modulus, new(len(forms), D + 1, coefficients, *modulus)
        values = (self._latest[1] * new(D + 1, 1, [*x], *modulus)).entries()
        return new(D, D, values[: D * D], *modulus), new(D, 1, values[D * D :], *modulus)

    def homogeneous_image(self, x: Sequence[Any]) -> list[Any]:
        if not isinstance(x[-1], flint.nmod | flint.fmpq):  # x consists of polynomials
            return cramer(self._system(x))
        A, b = self._matrices(x)
        return [*A.solve(b).entries(), x[-1]]

    def derivative(self, x: Sequence[Any]) -> Any:
        # A(x; eps) DPhi(x) = A(Phi(x); -eps)
        return self._matrices(x)[0].solve(self.inverse._matrices(self.image(x))[0])

    @cached_property
    def _solution(self) -> list[Any]:
        return self.homogeneous_image(self.variables)

    @cached_property
    def forms(self) -> list[Any]:
        return coprime(self._solution)

    @property
    def denominator(self) -> Any:
        """The determinant of A in A x~ = b: the common denominator of the image x~."""
        return self._solution[-1]

    def _determinant(self) -> RationalFunction | None:
        # det DPhi = det A(F; -eps) / (F_0^D det A(x; eps)), with det A homogeneous of degree D.
        backward = factored(cramer(self.inverse._system(self.variables))[-1])
        determinant = RationalFunction((), backward.constant) / factored(self.denominator)
        determinant /= factored(self.forms[-1]) ** backward.degree
        for f, e in backward.factors:
            if self.cost_of_pullback(f, degree_of(f)) > LONGEST_PULLBACK:
                return None
            if (pullback := self._in_factors(self.pullback(f, degree_of(f)))) is None:
                return None
            determinant *= pullback**e
        return determinant

    @cached_property
    def length(self) -> float:
        """The relative cost of the image of a line: elimination takes 2 D^3 / 3 products."""
        return max(1.0, 2 * self.dimension**3 / 3 * self.degree / FEW_MONOMIALS)

    @property
    def cost_of_factors(self) -> float:
        """The estimated seconds for `factors`, a pullback of det A; at most `LONGEST_PULLBACK`."""
        return min(
            LONGEST_PULLBACK, self.cost_of_pullback(self.denominator, degree_of(self.denominator))
        )

    @cached_property
    def hamiltonian(self) -> Any:
        """An integer multiple of H in `ring` for a field K grad H; None for other fields."""
        if self.in_letters and (energy := self.in_letters.energy):
            *values, _ = over_common_denominator(energy.values(), self.ring)
            terms = [*zip(energy, values, strict=True)]
        elif self.in_letters or not self.field._is_hamiltonian:
            return self._integrated_hamiltonian()
        else:
            exactly = Fraction if self._is_exact else as_written
            terms, _ = _integers(self.field._terms_of(True, exactly))
        products = (v * math.prod(self.variables[i] for i in indices) for indices, v in terms)
        return sum(products, 0 * self.variables[-1])

    def _integrated_hamiltonian(self) -> Any:
        """Return H with grad H = L f for a constant antisymmetric regular matrix L, or None."""
        D, x, zero = self.dimension, self.variables, 0 * self.variables[-1]
        if D % 2 or D > MOST_VARIABLES_OF_HAMILTONIAN:
            return None
        f, pairs = [zero] * D, [*combinations(range(D), 2)]
        for (i, j, k), v in self._rates[0]:
            f[i] += v * x[j] * x[k]
        conditions = []  # curl L f (0 for a gradient), for each L with one pair of entries 1, -1
        for k, l in pairs:
            g = [zero] * D
            g[k], g[l] = f[l], -f[k]
            curl = {(i, j): _slope(g[j], i) - _slope(g[i], j) for i, j in pairs}
            conditions.append({(ij, e): int(c) for ij, P in curl.items() for e, c in P.terms()})
        places = {place for each in conditions for place in each}
        rows = [[each.get(place, 0) for each in conditions] for place in places]
        columns, count = flint.fmpz_mat(rows or [[0] * len(pairs)]).nullspace()
        rng, L = random.Random(0), flint.fmpz_mat(D, D)
        weights = [rng.randrange(1, 99) for _ in range(count)]
        for (k, l), row in zip(pairs, columns.tolist(), strict=True):
            L[k, l] = sum(w * c for w, c in zip(weights, row, strict=False))
            L[l, k] = -L[k, l]
        if L.det() == 0:
            return None
        products = (int(L[i, k]) * x[i] * f[k] for i in range(D) for k in range(D))
        of_H = sum(products, zero)  # x . grad H: a term of degree d is d times the term of H
        degrees = map(sum, exponents_in_x(of_H))
        terms = {e: 6 // d * c for d, (e, c) in zip(degrees, of_H.terms(), strict=True)}
        return primitive(zero.context().from_dict(terms))

    @cached_property
    def modified_energy(self) -> RationalFunction | None:
        """The integral H + grad H (x~ - x) / 3 of a field K grad H; None if it is constant."""
        if (H := self.hamiltonian) is None:
            return None
        *numerators, F_0 = self.forms
        energy = 3 * H * F_0
        for i, (F, a) in enumerate(zip(numerators, self.variables, strict=False)):
            energy += _slope(H, i) * (F - a * F_0)
        modified = rational_functions.quotient_of(energy, F_0, MODULAR)
        return modified if modified.degree else None


def _slope(P: Any, i: int) -> Any:
    """Return the derivative of a polynomial with respect to variable number i of x, from 0."""
    return P.derivative(i + letters_in(P))


def _integers(terms: Terms) -> tuple[list[tuple[tuple[int, ...], int]], int]:
    """Return exact terms with integers in place of fractions, and their common denominator."""
    denominator = math.lcm(*(c.denominator for c in terms.values))
    return [(place, int(denominator * c)) for place, c in terms.members()], denominator


def exact_body(body: Any) -> Any:
    """Return a single body with fractions as parameters; floats become decimals, as written."""

    def read(a: Any) -> Fraction:
        return a if isinstance(a, Fraction) else as_written(a)

    exact = (
        np.vectorize(read, "O")(body._exact_parts.get(n, a))[()] for n, a in body._parts.items()
    )
    return body._of(dict(zip(body._parts, exact, strict=True)))
