"""Fixed points of fields, by elimination over the rationals with python-flint."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from itertools import count, product
from typing import Any

import numpy as np

from ..bodies.base import Body
from ..bodies.field import QuadraticField
from ..checks import FloatArray, OneOrEach, extra, wrong

try:
    import flint
except ImportError:  # in one variable it is not needed
    flint = None

Points = set[tuple[float, ...]]

_BEYOND = "scipy.optimize.root(lambda x: vector_field(field, x), x0) finds one near x0"
# Bits of the numbers from which coordinates are rounded first, and that they have at least.
_BITS, _LEAST_BITS = 192, 100


def fixed_points(field: Body, /) -> OneOrEach:
    """All real fixed points of a field, which are those of its Kahan map for every step size.

    Parameters
    ----------
    field : QuadraticField or a body
        A single field, or a batch, of at most 3 variables; more than one variable needs the extra
        `algebra`.

    Returns
    -------
    ndarray(float, shape=(k, D)), or a list or an array of them
        Each point once, rounded once, in ascending order of the components; for a batch with one
        axis a list, with several an array of objects of the shape of the batch: ``found[i, j]`` is
        the array of a member. Where a member has as many points as the one before, its points are
        in the order with the least sum of distances to the points of that one. Before is the member
        to the left, and at the beginning of a row the one above.

    Raises
    ------
    ValueError
        If there are more than 3 variables, or infinitely many fixed points, as of all Suslov
        bodies, whose steady states the message has. For D = 3 complex fixed points that form an
        irreducible curve, such as the intersection of two ellipsoids, count, even if none is real.

    Examples
    --------
    >>> from suslov_fast import QuadraticField, fixed_points
    >>> fixed_points(QuadraticField.from_function(lambda x: (x[0] - x[1], x[0] * x[1] - 4), 2))
    array([[-2., -2.],
           [ 2.,  2.]])
    """
    whole = QuadraticField.of(field)
    if whole.dimension > 3:
        raise wrong("field", "have at most 3 variables", f"{whole.dimension}: {_BEYOND}")
    found: OneOrEach = _in_order(whole, field) if whole.shape else _points_of(whole, field)
    return found


def _in_order(family: Any, named: Any) -> Any:
    """Return the points of each member, in the order of those that they continue."""
    found = np.empty(family.shape, object)
    for index in np.ndindex(family.shape):
        points = _points_of(family[index], named, index)
        axis = max((k for k, i in enumerate(index) if i), default=None)
        if axis is not None:
            before = found[tuple(i - (k == axis) for k, i in enumerate(index))]
            if len(points) == len(before):
                points = _continuing(before, points)
        found[index] = points
    return [*found] if found.ndim == 1 else found


def _points_of(field: Any, named: Any, index: tuple[int, ...] = ()) -> Any:
    """Return the fixed points of a single field, in ascending order.

    It is a member of what the caller passed, `named`, which messages name.
    """
    i: Any = index[0] if len(index) == 1 else index
    if field.dimension > 1:
        extra("flint", "algebra")
    points = _roots(field) if field.dimension == 1 else _real_zeros(field.components)
    if points is None:
        how = f"its steady states are {named._steady}" if named._steady else _BEYOND
        raise ValueError(f"field: infinitely many fixed points{named._of_member(i)}: {how}")
    found = np.array(sorted(points), np.float64).reshape(-1, field.dimension)
    if np.isinf(found).any():
        where = f"fixed points{named._of_member(i)} are beyond the range of float64"
        raise ValueError(f"field: {where}: use other units")
    return found


def _continuing(before: FloatArray, points: FloatArray) -> FloatArray:
    """Return points in the order of those `before`, with the least sum of distances to them."""
    from scipy.optimize import linear_sum_assignment  # imported here, since importing takes time

    scale = max(abs(before).max(initial=0.0), abs(points).max(initial=0.0)) or 1.0
    distances = np.linalg.norm((before[:, np.newaxis] - points) / scale, axis=-1)
    return np.asarray(points[linear_sum_assignment(distances)[1]])


def _roots(field: Any) -> Points | None:
    """Return the roots of the equation in one variable; None if it is 0."""
    a, half_b, c = (Fraction(field.table[(0, *place)]) for place in ((0, 0), (0, 1), (1, 1)))
    if not a:
        return ({(float(-c / (2 * half_b)),)} if half_b else set()) if half_b or c else None
    middle, square = -half_b / a, (half_b * half_b - a * c) / (a * a)
    if square < 0:
        return set()
    p, q = square.as_integer_ratio()  # 2,000 bits are more than sums from 1e-60 to 1e60 can lose
    root = Fraction(math.isqrt(p * q << 4000), q << 2000)
    return {(float(middle + each) + 0.0,) for each in (root, -root)}  # no -0.0


def _real_zeros(equations: Sequence[Any], weight: int = 0) -> Points | None:
    """Return the real common zeros of ``flint.fmpq_mpoly``, None if there are infinitely many.

    If the complex zeros are finitely many, the minimal polynomial of the linear form x1 + weight x2
    + weight**2 x3 is factored. The zeros of an irreducible factor have coordinates that are
    polynomials in the form, if its values at them differ; else another weight is tried.
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
            parts = [_real_zeros([*equations, factor], weight) for factor, _ in factors]
            return None if None in parts else set().union(*parts)  # type: ignore[arg-type]
    if matrices is not None:
        if minimal.degree() < form.nrows():
            return _real_zeros(equations, weight + 1)
        return _points_at(form, matrices, minimal)
    # Where a quadric has no two values of opposite sign, its real zeros are critical points.
    squares = [p.derivative(i) for p in equations if _is_semidefinite(p) for i in range(len(x))]
    return _real_zeros([*equations, *squares]) if squares else None


def _groebner_basis(equations: Sequence[Any]) -> Any:
    """Return a reduced Groebner basis over the integers in one variable more, the unit."""
    names = *equations[0].context().names(), "1"  # which is no name of a variable
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


def _points_at(form: Any, matrices: Sequence[Any], minimal: Any) -> Points:
    """Return the points at the real zeros of the minimal polynomial of a generating form.

    A coordinate is that polynomial in the form which its matrix is in the matrix of the form.
    """
    size = form.nrows()
    rows = [flint.fmpq_mat(1, size, [1] + [0] * (size - 1))]
    for _ in range(size - 1):
        rows.append(rows[-1] * form)
    powers = flint.fmpq_mat([row.entries() for row in rows]).transpose()
    found = (powers.solve((rows[0] * each).transpose()) for each in matrices)
    coordinates = [flint.fmpq_poly(each.entries()) for each in found]
    for bits in (_BITS << k for k in count()):
        with flint.ctx.workprec(bits):
            zeros = [zero.real for zero, _ in minimal.complex_roots() if zero.imag.is_zero()]
            points = [[flint.arb_poly(each)(zero) for each in coordinates] for zero in zeros]
        if all(v.is_zero() or v.rel_accuracy_bits() > _LEAST_BITS for p in points for v in p):
            break
    return {tuple(map(float, point)) for point in points}


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
