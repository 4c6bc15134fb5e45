"""Real common zeros of polynomials over the rationals, by elimination with python-flint."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import count, product
from typing import Any

import flint

Points = set[tuple[float, ...]]

# Bits of the numbers from which coordinates are rounded first, and that they have at least.
_BITS, _LEAST_BITS = 192, 100


def real_zeros(equations: Sequence[Any], weight: int = 0) -> Points | None:
    """Return the real common zeros of ``flint.fmpq_mpoly``, None if there are infinitely many.

    If there are finitely many complex zeros, those for each irreducible factor of the minimal
    polynomial of the linear form x1 + weight x2 + weight**2 x3 are found from its roots, with
    another weight if the form has equal values at different points.
    """
    context = equations[0].context()
    x = context.gens()
    basis = _groebner_basis(equations)
    equations = [context.from_dict({m[:-1]: c for m, c in p.to_dict().items()}) for p in basis]
    matrices = _multiplications(basis, len(x))
    products = equations
    if matrices is not None:
        if not matrices[0].nrows():
            return set()
        form = sum((a * weight**i for i, a in enumerate(matrices)), matrices[0] * 0)
        minimal, linear = form.minpoly(), sum(a * weight**i for i, a in enumerate(x))
        products = [sum(c * linear**k for k, c in enumerate(minimal.coeffs()))]
    for each in products:
        _, factors = each.factor()
        if len(factors) > 1 or any(power > 1 for _, power in factors):
            parts = [real_zeros([*equations, factor], weight) for factor, _ in factors]
            return None if None in parts else set().union(*parts)  # type: ignore[arg-type]
    if matrices is not None:
        if minimal.degree() < form.nrows():
            return real_zeros(equations, weight + 1)
        return _points_at(_in_powers(form, matrices), minimal)
    # Where a quadric has no two values of opposite sign, its real zeros are critical points.
    squares = [p.derivative(i) for p in equations if _is_semidefinite(p) for i in range(len(x))]
    return real_zeros([*equations, *squares]) if squares else None


def _groebner_basis(equations: Sequence[Any]) -> Any:
    """Return a reduced Groebner basis over the integers in one variable more, `unit`."""
    names = *equations[0].context().names(), "unit"
    context = flint.fmpz_mpoly_ctx.get(names, ordering="degrevlex")
    integral = []
    for each in equations:
        scale = math.lcm(*(int(c.q) for c in each.coeffs()))
        terms = {(*m, 0): int((c * scale).p) for m, c in each.to_dict().items()}
        integral.append(context.from_dict(terms))
    basis = flint.fmpz_mpoly_vec(integral, context).buchberger_naive()
    return basis.autoreduction(groebner=True)


def _multiplications(basis: Any, D: int) -> list[Any] | None:
    """Return the matrices of multiplication by each variable modulo an ideal.

    They act on rows of coefficients of the monomials that no leading one divides, the first of
    which is 1. None if these are infinitely many. Remainders are known up to a factor, which is
    that of `unit`.
    """
    leading = [each.monoms()[0] for each in basis]
    powers = [[int(m[i]) for m in leading if m[i] == sum(m)] for i in range(D)]
    if not all(powers):
        return None
    box = product(*(range(min(each)) for each in powers), [0])
    below = [m for m in box if not any(all(map(int.__le__, map(int, head), m)) for head in leading)]
    context = basis[0].context()
    *x, unit = context.gens()

    def row(polynomial: Any) -> list[Any]:
        remainder = (polynomial + unit).reduction_primitive_part(basis)
        return [flint.fmpq(remainder[m], remainder[(*[0] * D, 1)]) for m in below]

    return [flint.fmpq_mat([row(a * context.from_dict({m: 1})) for m in below]) for a in x]


def _in_powers(form: Any, matrices: Sequence[Any]) -> list[Any]:
    """Return matrices of multiplication as polynomials in that of a form that generates all."""
    size = form.nrows()
    rows = [flint.fmpq_mat(1, size, [1] + [0] * (size - 1))]
    for _ in range(size - 1):
        rows.append(rows[-1] * form)
    powers = flint.fmpq_mat([row.entries() for row in rows]).transpose()
    found = (powers.solve((rows[0] * each).transpose()) for each in matrices)
    return [flint.fmpq_poly(each.entries()) for each in found]


def _points_at(coordinates: Sequence[Any], minimal: Any) -> Points:
    """Return the values of polynomials of lower degree at the real zeros of an irreducible one."""
    for bits in (_BITS << k for k in count()):
        with flint.ctx.workprec(bits):
            zeros = [zero.real for zero, _ in minimal.complex_roots() if zero.imag.is_zero()]
            points = [[flint.arb_poly(each)(zero) for each in coordinates] for zero in zeros]
        if all(v.is_zero() or v.rel_accuracy_bits() > _LEAST_BITS for p in points for v in p):
            break
    return {tuple(map(_rounded, point)) for point in points}


def _rounded(value: Any) -> float:
    """Return a float; OverflowError if it is out of range."""
    middle = value.mid().fmpq()
    return int(middle.p) / int(middle.q)


def _is_semidefinite(polynomial: Any) -> bool:
    """Return whether a polynomial is of degree 2 and has no two values of opposite sign."""
    if polynomial.total_degree() != 2:
        return False
    D = len(polynomial.context().gens())
    matrix = flint.fmpq_mat(D + 1, D + 1)  # twice that of the quadratic form in x and 1
    for powers, c in polynomial.terms():
        places = [i for i, power in enumerate(powers) for _ in range(int(power))]
        i, j = (*places, D, D)[:2]
        matrix[i, j] += c
        matrix[j, i] += c
    # All eigenvalues are real, so the coefficients have one sign if none is positive.
    return any(min((sign * matrix).charpoly().coeffs()) >= 0 for sign in (1, -1))
