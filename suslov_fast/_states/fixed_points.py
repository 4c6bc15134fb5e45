"""Fixed points of fields, by elimination over the rationals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np

from .._bodies.algebra import Polynomial
from .._bodies.base import Body
from .._bodies.field import QuadraticField
from .._checks import FloatArray, wrong
from .._docs import filled

_BEYOND = "scipy.optimize.root(lambda x: vector_field(field, x), x0) finds one near x0"
# Bits of the numbers from which coordinates are rounded, and the most that are tried.
_BITS, _MOST_BITS = 192, 2**16

PowersOfTerm = tuple[int, ...]


@filled
def fixed_points(field: Body) -> FloatArray:
    """All real fixed points of a field, which are those of its Kahan map for every step size.

    Parameters
    ----------
    field : QuadraticField or a body
        A single one, with at most 3 variables.

    Returns
    -------
    ndarray(float, shape=(k, D))
        Each point once, rounded once, in ascending order of the components.

    Raises
    ------
    TypeError, ValueError
        If the argument has a wrong type, is a batch, or has more than 3 variables; and if there are
        infinitely many fixed points, as those of all bodies.
    ImportError
        For D = 2 and 3, if python-flint is not installed (extra `algebra`).

    Notes
    -----
    With a Groebner basis of the components, the points are rational functions of the roots of one
    polynomial (Rouillier, Applicable Algebra in Engineering, Communication and Computing 9 (1999)
    433-461). For more variables ``scipy.optimize.root`` finds single points.

    Examples
    --------
    >>> from suslov_fast import QuadraticField, fixed_points
    >>> field = QuadraticField.from_function(
    ...     lambda x: (10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 3 * x[2]), 3
    ... )
    >>> fixed_points(field)
    array([[-9., -9., 27.],
           [ 0.,  0.,  0.],
           [ 9.,  9., 27.]])
    """
    whole = QuadraticField.of(field)
    D = whole.dimension
    if whole.shape:
        raise wrong("field", "a single one", f"a batch of shape {whole.shape}")
    if D > 3:
        raise wrong("field", "at most 3 variables", f"{D}: {_BEYOND}")
    equations = [each for each in whole.polynomials if each.terms]
    points = _roots(equations) if D == 1 else _solutions(_without_squares(equations, D), D)
    if points is None:
        raise wrong("field", "finitely many fixed points", f"infinitely many: {_BEYOND}")
    return np.array(sorted(points), np.float64).reshape(-1, D)


def _roots(equations: Sequence[Polynomial]) -> list[tuple[float, ...]] | None:
    """Return the roots of an equation in one variable; None if there is none."""
    if not equations:
        return None
    c, b, a = (equations[0].terms.get((0,) * k, Fraction(0)) for k in range(3))
    if not a:
        return [(_rounded(-c / b),)] if b else []
    middle, square = -b / (2 * a), (b * b - 4 * a * c) / (4 * a * a)
    if square <= 0:
        return [(_rounded(middle),)] * (square == 0)
    scale = 1 << (_BITS + square.denominator.bit_length())
    root = Fraction(math.isqrt(square.numerator * scale * scale // square.denominator), scale)
    larger = middle + root if middle >= 0 else middle - root  # where nothing cancels
    return [(_rounded(larger),), (_rounded(c / a / larger),)]


def _rounded(number: Fraction) -> float:
    try:
        return float(number)
    except OverflowError:
        raise wrong("field", "fixed points in the range of float64", "others") from None


def _without_squares(equations: Sequence[Polynomial], D: int) -> list[Polynomial]:
    """Replace equations q = 0 with q >= 0 everywhere by linear ones with the same real points."""
    found = []
    for each in equations:
        rows = _symmetric(each, D)
        found += _linear(rows, D) if any(map(_is_semidefinite, (rows, -rows))) else [each]
    return found


def _symmetric(q: Polynomial, D: int) -> Any:
    """Return the matrix of q as a quadratic form in (x, 1)."""
    matrix = np.full((D + 1, D + 1), Fraction(0))
    for powers, c in q.terms.items():
        j, k = (*powers, D, D)[:2]
        matrix[j, k] += c / 2
        matrix[k, j] += c / 2
    return matrix


def _is_semidefinite(matrix: Any) -> bool:
    """Return whether a symmetric matrix of fractions has no negative eigenvalue."""
    rest = matrix.copy()
    while len(rest):
        if rest[0, 0] < 0 or (rest[0, 0] == 0 and rest[0].any()):
            return False
        column = rest[1:, 0]
        rest = rest[1:, 1:] - (np.outer(column, column) / rest[0, 0] if rest[0, 0] else 0)
    return True


def _linear(rows: Any, D: int) -> list[Polynomial]:
    """Return the polynomials whose coefficients of x and 1 are these rows."""
    monomials = [*((i,) for i in range(D)), ()]
    return [Polynomial(dict(zip(monomials, row, strict=True))) for row in rows if row.any()]


def _solutions(equations: Sequence[Polynomial], D: int) -> list[tuple[float, ...]] | None:
    """Return the common real zeros of polynomials in 2 or 3 variables; None if infinitely many."""
    try:
        import flint
    except ImportError as error:
        install = "pip install '.[algebra]' in a copy of the repository"
        raise ImportError(f"expected python-flint, got none: {install}") from error

    context = flint.fmpz_mpoly_ctx.get([f"x{i}" for i in range(1, D + 1)], ordering="degrevlex")
    ideal = flint.fmpz_mpoly_vec([_integral(each, context, D) for each in equations], context)
    basis = [each for each in ideal.buchberger_naive().autoreduction(groebner=True) if each]
    leading = {tuple(map(int, each.monoms()[0])): each for each in basis}
    units = [tuple(int(i == k) for k in range(D)) for i in range(D)]
    bounds = [[sum(m) for m in leading if sum(m) == m[i]] for i in range(D)]
    if not all(bounds):
        known = [_quadratic(each) for each in basis if each.total_degree() <= 2]
        fewer = _without_squares(known, D)
        return None if fewer == known else _solutions([*equations, *fewer], D)
    ranges = np.ndindex(*(min(each) for each in bounds))
    below = [m for m in ranges if not any(_divides(head, m) for head in leading)]
    if not below:
        return []
    places = {m: k for k, m in enumerate(below)}

    @cache
    def reduced(monomial: PowersOfTerm) -> Any:
        """Return the remainder of a monomial as a row of coefficients of those in `below`."""
        row = flint.fmpq_mat(1, len(below))
        if monomial in places:
            row[0, places[monomial]] = 1
        elif monomial in leading:
            head, *tail = leading[monomial].terms()
            for powers, c in tail:
                row -= reduced(tuple(map(int, powers))) * flint.fmpq(c, head[1])
        else:
            head = next(each for each in leading if _divides(each, monomial))
            unit = next(u for u in units if _divides(u, np.subtract(monomial, head)))
            row = times(reduced(tuple(np.subtract(monomial, unit).tolist())), unit)
        return row

    def times(row: Any, unit: PowersOfTerm) -> Any:
        parts = ((m, row[0, k]) for m, k in places.items() if row[0, k])
        rows = (reduced(tuple(np.add(m, unit).tolist())) * c for m, c in parts)
        return sum(rows, flint.fmpq_mat(1, len(below)))

    def trace(a: Any) -> Any:
        return sum((a[k, k] for k in range(len(below))), flint.fmpq(0))

    def matrix(row_of: Any) -> Any:
        rows = [[row_of(m)[0, k] for k in range(len(below))] for m in below]
        return flint.fmpq_mat(rows)

    by = [matrix(lambda m, unit=unit: reduced(tuple(np.add(m, unit).tolist()))) for unit in units]
    one = flint.fmpq_mat(np.eye(len(below), dtype=int).tolist())
    of = {m: math.prod((b for b, power in zip(by, m, strict=True) for _ in range(power)), start=one)
          for m in below}  # fmt: skip
    count = flint.fmpq_mat([[trace(of[m] * of[k]) for m in below] for k in below]).rank()
    for weight in range(1, 10**6):  # until the values of one linear form differ at all zeros
        form = sum((b * weight**i for i, b in enumerate(by)), by[0] * 0)
        minimal = form.charpoly()
        minimal /= minimal.gcd(minimal.derivative())
        if minimal.degree() == count:
            break
    powers = [one]
    for _ in range(count - 1):
        powers.append(powers[-1] * form)
    horner = [minimal.right_shift(count - j) for j in range(count)]
    horner.reverse()
    traces = [
        sum((h * trace(b * p) for p, h in zip(powers, horner, strict=True)), minimal * 0)
        for b in (one, *by)
    ]
    return _real_points(minimal, traces)


def _divides(head: Any, monomial: Any) -> bool:
    return all(a <= b for a, b in zip(head, monomial, strict=True))


def _integral(equation: Polynomial, context: Any, D: int) -> Any:
    scale = math.lcm(*(c.denominator for c in equation.terms.values()))
    return context.from_dict(
        {tuple(map(powers.count, range(D))): int(c * scale) for powers, c in equation.terms.items()}
    )


def _quadratic(each: Any) -> Polynomial:
    """Return a polynomial of degree 2 or less of the other library."""
    terms = {}
    for powers, c in each.terms():
        terms[tuple(i for i, power in enumerate(powers) for _ in range(int(power)))] = Fraction(
            int(c)
        )
    return Polynomial(terms)


def _real_points(minimal: Any, traces: Sequence[Any]) -> list[tuple[float, ...]]:
    """Return the points g_i(t) / g(t) at the real roots t of a polynomial, for g, g_1, ...."""
    import flint

    before, points, bits = flint.ctx.prec, None, _BITS
    shared = [minimal.gcd(each) for each in traces[1:]]
    try:
        while points is None and bits <= _MOST_BITS:
            flint.ctx.prec = bits
            points = _points_to(minimal, traces, shared)
            bits *= 2
    finally:
        flint.ctx.prec = before
    if points is None:
        raise wrong("field", "fixed points that can be told apart", "nearly equal ones")
    return points


def _points_to(
    minimal: Any, traces: Sequence[Any], shared: Sequence[Any]
) -> list[tuple[float, ...]] | None:
    """Return these points, or None if the precision does not suffice."""
    import flint

    def value(polynomial: Any, t: Any) -> Any:
        total = flint.arb(0)
        for c in reversed(polynomial.coeffs()):
            total = total * t + flint.arb(c)
        return total

    points = []
    for root, _ in minimal.numer().complex_roots():
        if not root.imag.is_zero():
            continue
        point = []
        for g, common in zip(traces[1:], shared, strict=True):
            ratio = value(g, root.real) / value(traces[0], root.real)
            if ratio.contains(0) and value(minimal / common, root.real).contains(0) is False:
                ratio = flint.arb(0)  # t is a root of g
            if not (ratio.is_zero() or ratio.rel_accuracy_bits() > 100):
                return None
            man, exp = map(int, ratio.mid().man_exp())
            point.append(_rounded(Fraction(man) * Fraction(2) ** exp))
        points.append(tuple(point))
    return points
