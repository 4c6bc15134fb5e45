"""Fixed points of fields, by elimination over the rationals with python-flint."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from itertools import count, product
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.base import Body
from ..bodies.classes import BodyOrField
from ..bodies.fields.field import QuadraticField
from ..bodies.fields.general import Field
from ..checks import FloatArray, OneOrEach, extra, instance, warn, wrong
from ..keywords import public
from .equilibria import Equilibria, equilibria

try:
    import flint
except ImportError:  # not needed for one variable
    flint = None

Points = set[tuple[float, ...]]

_BEYOND = "fixed_points(system, near=x0) finds one near x0"
_SHOWN = 10  # members with infinitely many fixed points that a warning names
# Bits of the first computation of coordinates, and bits that must be right before rounding.
_BITS, _LEAST_BITS = 192, 100


@overload
def fixed_points(system: BodyOrField, /, near: None = None) -> OneOrEach: ...


@overload
def fixed_points(system: BodyOrField, /, near: ArrayLike) -> Equilibria: ...


@public
def fixed_points(system: BodyOrField, /, near: ArrayLike | None = None) -> OneOrEach | Equilibria:
    """Equilibria near given states, or all real ones of a quadratic field of few variables.

    With `near` they are found by Newton's method for f(x) = 0 with the exact f', from all states at
    once; members of a family may go to different equilibria: to follow one, pass the last one found
    as `near` of the next. A body without a rotor has a line of them, of which it is the nearest
    one. Without `near` they are found by exact elimination (Groebner bases), so none is missed.
    The fixed points of Kahan's map are the same for every step size, because
    (1 - (eps / 2) f'(x)) (x_next - x) = eps f(x).

    Parameters
    ----------
    system : QuadraticField, Field or a body
        A single one, or a batch. Without `near` a quadratic field of at most 3 variables; more than
        one variable needs the extra `algebra`.
    near : array_like(float, shape=(..., D)), optional
        States near equilibria, which broadcast with the batch. NaN gives NaN.

    Returns
    -------
    Equilibria, ndarray(float, shape=(k, D)), or a list or an array of these
        With `near`, a named tuple of `states` (..., D), `eigenvalues` of f' (..., k) by decreasing
        real part, and `status` (...), a :class:`Status`: the equilibrium of each state. Variables
        with a constant rate, such as time, keep the value that they have in `near`, and count
        neither in the condition nor in the eigenvalues. On a curve of equilibria a point near the
        given one is found, and of a body without a rotor the nearest one. If Newton's method does
        not converge at once, shorter steps begin, and then ``scipy.optimize.root``, by its methods
        "hybr" and "lm"; what they find may be far. NaN, with a negative status, for a state from
        which none is found, and where one is degenerate, as at a fold. If f' is singular in
        doubles, as for networks with rates of 16 decades, f of + - * / ** exp, log, sqrt, abs,
        maximum and minimum is solved with 150 digits (.3 ms for 3 variables); of other functions
        a point on what doubles take for a curve of equilibria is returned.

        Without `near`, each point once, sorted by components. A batch with one axis gives a
        list, with several an array of objects of its shape: ``points[i, j]`` is the array of a
        member. If a member has as many points as the one before it (to the left, or above at the
        beginning of a row), its points are in the order of those, by the least sum of distances.
        A member with infinitely many is None, with one warning that names these members.

    Raises
    ------
    TypeError
        If a `Field` is passed without `near`.
    ValueError
        Without `near`, if there are more than 3 variables, or infinitely many fixed points of a
        single field, as for all Suslov bodies: the message describes their steady states. For
        D = 3, curves of complex fixed points count, even without real points, such as the
        intersection of two ellipsoids.

    Warns
    -----
    UserWarning
        Once for all states without an equilibrium.

    Examples
    --------
    >>> from suslov_fast import QuadraticField, fixed_points
    >>> lorenz = QuadraticField.from_function(
    ...     lambda x, r: (10 * (x[1] - x[0]), x[0] * (r - x[2]) - x[1], x[0] * x[1] - 3 * x[2]),
    ...     "x y z", r=28,
    ... )
    >>> fixed_points(lorenz)
    array([[-9., -9., 27.],
           [ 0.,  0.,  0.],
           [ 9.,  9., 27.]])

    A pendulum with friction and a torque, for three torques:

    >>> import numpy as np
    >>> from suslov_fast import Field
    >>> pendulum = Field.from_function(
    ...     lambda x, m: (x[1], m - np.sin(x[0]) - 0.1 * x[1]), "q p", m=[0.0, 0.3, 0.6]
    ... )
    >>> found = fixed_points(pendulum, near=[0.1, 0.0])
    >>> found.states[:, 0].round(6)
    array([0.      , 0.304693, 0.643501])
    >>> found.eigenvalues.real.max(axis=-1).round(6)
    array([-0.05, -0.05, -0.05])
    """
    instance("system", system, Body)
    if near is not None:
        return equilibria(system, near)
    if isinstance(system, Field):
        raise TypeError("fixed_points of a Field takes near=x0, a state or many of them")
    exact = QuadraticField.of(system)
    if exact.dimension > 3:
        raise wrong("system", "have at most 3 variables", f"{exact.dimension}: {_BEYOND}")
    points: OneOrEach = _in_order(exact, system) if exact.shape else _points_of(exact, system)
    return points


def _in_order(family: Any, passed: Any) -> Any:
    """Return the points of each member, in the order of those of its neighbour if possible."""
    ordered = np.empty(family.shape, object)
    for index in np.ndindex(family.shape):
        points = _points_of(family[index], passed, index)
        axis = max((k for k, i in enumerate(index) if i), default=None)
        if axis is not None and points is not None:
            before = ordered[tuple(i - (k == axis) for k, i in enumerate(index))]
            if before is not None and len(points) == len(before):
                points = _continuing(before, points)
        ordered[index] = points
    infinite = [i for i in np.ndindex(family.shape) if ordered[i] is None]
    if infinite:
        names = [passed.of_member(i if len(i) > 1 else i[0]) for i in infinite[:_SHOWN]]
        names += [f" and {len(infinite) - _SHOWN} more"] * (len(infinite) > _SHOWN)
        text = f"infinitely many fixed points{','.join(names)}"
        warn(f"{text}; None stands in their place: {_what_to_do(passed)}")
    return [*ordered] if ordered.ndim == 1 else ordered


def _points_of(field: Any, passed: Any, index: tuple[int, ...] = ()) -> Any:
    """Return the sorted fixed points of a single field: member `index` of what the user passed."""
    i: Any = index[0] if len(index) == 1 else index
    if field.dimension > 1:
        extra("flint", "algebra")
    points = _roots(field) if field.dimension == 1 else _real_zeros(field.components)
    if points is None:
        if passed.shape:
            return None
        raise ValueError(f"fixed_points: infinitely many fixed points: {_what_to_do(passed)}")
    array = np.array(sorted(points), np.float64).reshape(-1, field.dimension)
    if np.isinf(array).any():
        where = f"fixed points{passed.of_member(i)} are beyond the range of float64"
        raise ValueError(f"fixed_points: {where}: use other units")
    return array


def _what_to_do(passed: Any) -> str:
    """Return the steady states of a body, or how to find some of a field."""
    return f"its steady states are {passed.steady}" if passed.steady else _BEYOND


def _continuing(before: FloatArray, points: FloatArray) -> FloatArray:
    """Return points in the order that has the least sum of distances to those of `before`."""
    from scipy.optimize import linear_sum_assignment  # here, because the import takes time

    scale = max(abs(before).max(initial=0.0), abs(points).max(initial=0.0)) or 1.0
    distances = np.linalg.norm((before[:, np.newaxis] - points) / scale, axis=-1)
    return np.asarray(points[linear_sum_assignment(distances)[1]])


def _roots(field: Any) -> Points | None:
    """Return the roots of the equation in one variable; None if it is 0."""
    terms = dict(field._exact.members())
    a, b, c = (terms.get((0, *place), Fraction(0)) for place in ((0, 0), (0, 1), (1, 1)))
    half_b = b / 2
    if not a:
        return ({(float(-c / (2 * half_b)),)} if half_b else set()) if half_b or c else None
    middle, square = -half_b / a, (half_b * half_b - a * c) / (a * a)
    if square < 0:
        return set()
    p, q = square.as_integer_ratio()  # 2,000 bits are more than terms from 1e-60 to 1e60 can cancel
    root = Fraction(math.isqrt(p * q << 4000), q << 2000)
    return {(float(middle + each) + 0.0,) for each in (root, -root)}  # no -0.0


def _real_zeros(equations: Sequence[Any], weight: int = 0) -> Points | None:
    """Return the real common zeros of ``flint.fmpq_mpoly``, None if there are infinitely many.

    If there are finitely many complex zeros, the minimal polynomial of the linear form
    x1 + weight x2 + weight**2 x3 is factored. If the form has different values at all zeros of an
    irreducible factor, their coordinates are polynomials in it; else another weight is tried.
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
    # The real zeros of a semidefinite quadric are its critical points.
    squares = [p.derivative(i) for p in equations if _is_semidefinite(p) for i in range(len(x))]
    return _real_zeros([*equations, *squares]) if squares else None


def _groebner_basis(equations: Sequence[Any]) -> Any:
    """Return a reduced Groebner basis with integer coefficients, in one more variable, the unit.

    No equation contains the unit: see `_multiplications`.
    """
    names = *equations[0].context().names(), "1"  # no variable can have this name
    context = flint.fmpz_mpoly_ctx.get(names, ordering="degrevlex")
    integral = []
    for each in equations:
        scale = math.lcm(*(int(c.q) for c in each.coeffs()))
        terms = {(*m, 0): int((c * scale).p) for m, c in each.to_dict().items()}
        integral.append(context.from_dict(terms))
    basis = flint.fmpz_mpoly_vec(integral, context).buchberger_naive()
    return basis.autoreduction(groebner=True)


def _multiplications(basis: Any, D: int) -> list[Any] | None:
    """Return the matrices of multiplication by each variable modulo an ideal, or None.

    They act on rows of coefficients of the standard monomials, those that no leading monomial
    divides; the first one is 1. None if there are infinitely many. Flint returns remainders times
    a factor: the coefficient of `unit`, which is added to a polynomial before the division.
    """
    leading = [each.monoms()[0] for each in basis]
    powers = [[int(m[i]) for m in leading if m[i] == sum(m)] for i in range(D)]
    if not all(powers):
        return None
    box = product(*(range(min(each)) for each in powers), [0])
    heads = [[*map(int, m)] for m in leading]
    standard = [m for m in box if not any(all(map(int.__le__, head, m)) for head in heads)]
    context = basis[0].context()
    *x, unit = context.gens()

    def row(polynomial: Any) -> list[Any]:
        remainder = (polynomial + unit).reduction_primitive_part(basis)
        return [flint.fmpq(remainder[m], remainder[(*[0] * D, 1)]) for m in standard]

    return [flint.fmpq_mat([row(a * context.from_dict({m: 1})) for m in standard]) for a in x]


def _points_at(form: Any, matrices: Sequence[Any], minimal: Any) -> Points:
    """Return the points at the real zeros of the minimal polynomial of a generating form.

    The matrix of a coordinate is a polynomial in the matrix of the form; the same polynomial gives
    the coordinate at a zero.
    """
    size = form.nrows()
    rows = [flint.fmpq_mat(1, size, [1] + [0] * (size - 1))]
    for _ in range(size - 1):
        rows.append(rows[-1] * form)
    powers = flint.fmpq_mat([row.entries() for row in rows]).transpose()
    solutions = (powers.solve((rows[0] * matrix).transpose()) for matrix in matrices)
    coordinates = [flint.fmpq_poly(solution.entries()) for solution in solutions]
    for bits in (_BITS << k for k in count()):
        with flint.ctx.workprec(bits):
            zeros = [zero.real for zero, _ in minimal.complex_roots() if zero.imag.is_zero()]
            points = [[flint.arb_poly(p)(zero) for p in coordinates] for zero in zeros]
        if all(v.is_zero() or v.rel_accuracy_bits() > _LEAST_BITS for p in points for v in p):
            break
    return {tuple(map(float, point)) for point in points}


def _is_semidefinite(polynomial: Any) -> bool:
    """Return whether a polynomial has degree 2 and does not change sign."""
    if polynomial.total_degree() != 2:
        return False
    D = len(polynomial.context().gens())
    matrix = flint.fmpq_mat(D + 1, D + 1)  # twice the matrix of the quadratic form in (x, 1)
    for powers, c in polynomial.terms():
        places = [i for i, power in enumerate(powers) for _ in range(int(power))]
        i, j = (*places, D, D)[:2]
        matrix[i, j] += c
        matrix[j, i] += c
    # All eigenvalues are real, so none is positive if and only if no coefficient is negative.
    return any(min((sign * matrix).charpoly().coeffs()) >= 0 for sign in (1, -1))
