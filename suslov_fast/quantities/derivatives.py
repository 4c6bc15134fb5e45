"""The vector field, the reaction, and derivatives of the map: multipliers, Lyapunov exponents."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.classes import AnyBody, BodyOrField
from ..checks import (
    FloatArray,
    OneOrEach,
    common_shape,
    first_index,
    integer,
    real_number,
    spell,
    wrong,
)
from ..engine.problem import Problem, warn_of_times
from ..engine.status import report_poles
from ..engine.stretches import Progress, reporter, states_after
from ..keywords import public
from ..maps import Method, map_of, problem
from .evaluation import evaluate, mask_and_warn

# Tolerance of fixed points: the modulus of a component of f over the sum of those of its terms.
_FIXED = 1e-8


@public
def vector_field(body: BodyOrField, omega: ArrayLike, /) -> FloatArray:
    """Time derivative of the state by the equations of motion.

    For a field x' = f(x) this is f(x); for a body, the derivative of its angular velocity.

    Parameters
    ----------
    body, omega
        As in :func:`jacobian`.

    Returns
    -------
    ndarray(float, shape=(..., D))
        Unit: that of x divided by that of time; for a body, omega**2.

    Notes
    -----
    For bodies these are equations (2) and (14) of Dragovic and Gajic, arXiv:0807.2966.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, vector_field
    >>> vector_field(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), [1.0, 0.5]).round(6)
    array([ 0.08125, -0.65   ])
    """
    return evaluate("vector_field", body, omega)


@public
def reaction(body: AnyBody, omega: ArrayLike, /, eps: ArrayLike | None = None) -> FloatArray:
    """Torque of the constraint, which keeps Omega3 at 0: its Lagrange multiplier lambda.

    With x = I13 Omega1 + I23 Omega2, the equation of the third component is
    x' = lambda + (I1 - I2) Omega1 Omega2, and its discretization is
    (x_next - x) / eps = lambda + (I1 - I2) (Omega1 Omega2_next + Omega1_next Omega2) / 2.

    Parameters
    ----------
    body, omega
        As in :func:`jacobian`, without fields.
    eps : array_like(float, shape=(...)), optional
        With a step size, lambda between each state and the next one; without, that of the
        continuous motion.

    Returns
    -------
    ndarray(float, shape=(...) or (..., n - 1, n - 1))
        Unit: inertia * omega**2. In n dimensions, the antisymmetric matrix lambda_ij. With eps, NaN
        and one :class:`SingularStepWarning` where a state has no next state.

    Raises
    ------
    TypeError
        For a field, which has no constraint.

    Notes
    -----
    Equations (2) and (13) of Dragovic and Gajic, arXiv:0807.2966.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, reaction
    >>> float(reaction(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), [1.0, 0.5], eps=0.01).round(6))
    -1.336328
    """
    return evaluate("reaction", body, omega, 0.0 if eps is None else eps)


@public
def matrix(body: BodyOrField, omega: ArrayLike, /, eps: ArrayLike) -> FloatArray:
    """Matrix A of the linear system that a step of Kahan's map solves.

    A = 1 - (eps / 2) f'(omega), and A (omega_next - omega) = eps f(omega), where f is the
    :func:`vector_field`. The map has a pole where det A = 0. For a body without a rotor
    A omega_next = omega.

    Parameters
    ----------
    body, omega, eps
        As in :func:`jacobian`.

    Returns
    -------
    ndarray(float, shape=(..., D, D))
        A, dimensionless.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, matrix, step
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> (matrix(body, [1.0, 0.5], eps=0.2) @ step(body, [1.0, 0.5], eps=0.2)).round(6)
    array([1. , 0.5])
    """
    return evaluate("matrix", body, omega, eps)


@public
def jacobian(
    body: BodyOrField, omega: ArrayLike, /, eps: ArrayLike, *, method: Method = "auto"
) -> FloatArray:
    """Derivative of the map: row i, column j holds d(omega_next)_i / d(omega)_j.

    It is A(omega; eps)**-1 A(omega_next; -eps), with the A of :func:`matrix`, for Kahan's map, the
    product over all stages for the methods of order 4, 6 and 8, and the sum of w_n times the
    products over columns of n stages for "extrapolated".

    Parameters
    ----------
    body : Suslov3D, SuslovND, SuslovGyrostat or QuadraticField
        A single body or field, or a batch.
    omega : array_like(float, shape=(..., D))
        States: angular velocities, or states x of a field. NaN gives NaN.
    eps : array_like(float, shape=(...))
        Step size: in seconds, if omega is in rad/s. A negative one steps back.
    method : str
        As in :func:`iterate`.

    Returns
    -------
    ndarray(float, shape=(..., D, D))
        Dimensionless. NaN, with one :class:`SingularStepWarning`, where a state has no next state.

    Raises
    ------
    TypeError, ValueError
        If an argument is out of range, shapes do not broadcast, or the body lacks the method.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, jacobian
    >>> jacobian(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), [1.0, 0.5], eps=0.2).round(6)
    array([[ 1.006511,  0.037232],
           [-0.221645,  0.937189]])
    """
    return evaluate("jacobian", body, omega, eps, map=map_of(body, method))


@public
def multipliers(
    body: BodyOrField,
    x: ArrayLike | list[FloatArray],
    /,
    eps: ArrayLike,
    *,
    method: Method = "auto",
) -> OneOrEach:
    """Multipliers of fixed points: the eigenvalues of the derivative of the map, for stability.

    A fixed point attracts if all moduli are below 1. Multipliers of Kahan's map are
    (1 + eps mu / 2) / (1 - eps mu / 2) for the eigenvalues mu of f', those of order 4, 6 and 8 the
    products of these over all stages, and those of "extrapolated" the sum of w_n
    ((1 + eps mu / (2 n)) / (1 - eps mu / (2 n)))**n over the columns n. In n dimensions mu = c s at
    omega = c I, for s in the spectrum of ``J**-1 (|I|**2 Id - I I^T)``.

    Parameters
    ----------
    body, eps, method
        As in :func:`jacobian`.
    x : array_like(float, shape=(..., D))
        Fixed points of the map: steady states of a body, zeros of a field. For a family also the
        result of :func:`fixed_points`, with an array (k, D) for each member.

    Returns
    -------
    ndarray(float or complex, shape=(..., D)), or a list of them
        Dimensionless, sorted by decreasing modulus; in conjugate pairs Im > 0 comes first. Floats
        for a Suslov body, where 1 belongs to the line of steady states; complex for a gyrostat or
        a field. Infinite at a pole. For a result of :func:`fixed_points`, arranged as that.

    Raises
    ------
    ValueError
        If f(x) is not 0: a component exceeds 1e-8 of the sum of the moduli of its terms, and no
        fixed point lies within 1e-8 of ``max abs(x)`` by a step of Newton's method. At other
        states use :func:`jacobian`.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, multipliers
    >>> multipliers(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), [-0.6, 1.0], eps=0.2).round(6)
    array([1.062919, 1.      ])
    """
    points: Any = x
    map_of(body, method).require("multipliers", body)
    # The result of `fixed_points` for a family: a list, or an array of objects.
    is_list = isinstance(points, list) and len(body.shape) == 1 and len(points) > 0
    if is_list and all(a is None or (isinstance(a, np.ndarray) and a.ndim == 2) for a in points):
        if len(points) != len(body):
            raise wrong("x", f"a list of {len(body)} arrays, one for each member", len(points))
        in_list: OneOrEach = _of_each_member(body, points, eps, method)
        return in_list
    if isinstance(points, np.ndarray) and points.dtype == object and points.shape == body.shape:
        values: Any = np.empty(body.shape, object)
        for i, of_member in enumerate(_of_each_member(body, [*points.flat], eps, method)):
            values.flat[i] = of_member
        in_array: OneOrEach = values
        return in_array
    checked = problem("multipliers", body, points, eps, method=method, name="x")
    of_all: OneOrEach = _multipliers(checked)
    return of_all


def _of_each_member(family: Any, points: list[Any], eps: ArrayLike, method: str) -> Any:
    """Return a list with the multipliers (k, D) at the points of each member of a family."""
    step = np.asarray(real_number("eps", eps))
    if common_shape({"body": family.shape, "eps": step.shape}) != family.shape:
        raise wrong("eps", f"a number, or one for each of {len(points)} members", step.shape)
    steps = np.broadcast_to(step, family.shape)
    values: list[Any] = []
    for x, index in zip(points, np.ndindex(family.shape), strict=True):
        if x is None:  # infinitely many fixed points
            values.append(None)
            continue
        member, name = family[index], index if len(index) > 1 else index[0]
        of_member = problem("multipliers", member, x, steps[index], method=method, name="x")
        values.append(_multipliers(of_member, family._of_member(name)))
    return values


def _multipliers(checked: Problem, member: str = "") -> Any:
    """Return the multipliers (..., D); `member` is text for messages."""
    with np.errstate(all="ignore"):
        eigenvalues = checked.map.known_eigenvalues
        slopes_at = _slopes_at_fixed_points if eigenvalues else _jacobian_at_fixed_points
        slopes = slopes_at(checked, member)
        known = np.asarray(np.isfinite(slopes).all(axis=(-2, -1)))[..., np.newaxis]
        slopes = np.where(known[..., np.newaxis], slopes, 0.0)
        if eigenvalues:
            Y = 0.5 * np.asarray(checked.eps)[..., np.newaxis] * eigenvalues(checked, slopes)
            values = checked.map.stages.multiply(Y)
        else:
            values = np.linalg.eigvals(slopes).astype(complex)
        values = np.where(np.broadcast_to(known, (*checked.batch, 1)), values, np.nan)
        order = np.lexsort((-values.imag, -abs(values)), axis=-1)
    return np.take_along_axis(values, order, axis=-1)


def _slopes_at_fixed_points(checked: Problem, member: str) -> FloatArray:
    """Return f' (..., D, D); raise ValueError where f is not 0 to rounding."""
    x, D = checked.omega, checked.body.dimension
    (i, j, k), values = checked.body._terms
    y = np.concatenate([x, np.ones((*x.shape[:-1], 1))], axis=-1)
    left, right = values * y[..., j], values * y[..., k]
    products = left * y[..., k]
    # f, the sum of the moduli of its terms, and f' with a last column for the factor 1.
    f, sizes = np.zeros((2, D, *products.shape[:-1]))
    slopes = np.zeros((D, D + 1, *products.shape[:-1]))
    np.add.at(f, i, np.moveaxis(products, -1, 0))
    np.add.at(sizes, i, np.moveaxis(abs(products), -1, 0))
    np.add.at(slopes, (i, j), np.moveaxis(right, -1, 0))
    np.add.at(slopes, (i, k), np.moveaxis(left, -1, 0))
    f, sizes = np.moveaxis(f, 0, -1), np.moveaxis(sizes, 0, -1)
    derivative = np.moveaxis(slopes[:, :D], (0, 1), (-2, -1))
    moves = ~((abs(f) <= _FIXED * sizes) & (sizes < np.inf)) & ~np.isnan(x)
    if moves.any():
        moves &= ~_is_near_fixed_point(f, sizes, derivative, x)[..., np.newaxis]
    _refuse_moving(checked, moves, member)
    return derivative


def _is_near_fixed_point(f: Any, sizes: Any, slopes: Any, x: Any) -> Any:
    """Return (...) whether f' d = f has a small solution d: what a solver of f = 0 returns."""
    known = np.isfinite(slopes).all(axis=(-2, -1)) & np.isfinite(f).all(axis=-1)
    slopes, f = np.where(known[..., np.newaxis, np.newaxis], slopes, 0.0), f[..., np.newaxis]
    f = np.where(known[..., np.newaxis, np.newaxis], f, 0.0)
    d = np.linalg.pinv(slopes, rcond=1e-13) @ f
    residual, x = abs(slopes @ d - f)[..., 0], np.broadcast_to(x, sizes.shape)
    is_small = abs(d[..., 0]).max(axis=-1) <= _FIXED * abs(x).max(axis=-1)
    return known & is_small & (residual <= _FIXED * sizes).all(axis=-1)


def _jacobian_at_fixed_points(checked: Problem, member: str) -> FloatArray:
    """Return the derivative (..., D, D) of any map; raise ValueError where a step moves a state."""
    x = np.broadcast_to(checked.omega, (*checked.batch, checked.body.dimension))
    size = abs(x).max(axis=-1, keepdims=True)
    moves = ~(abs(states_after(checked) - x) <= _FIXED * size) & ~np.isnan(x)
    _refuse_moving(checked, moves, member)
    values: FloatArray = checked.map.formulas["jacobian"].compute(checked)
    return values


def _refuse_moving(checked: Problem, moves: Any, member: str) -> None:
    """Raise ValueError if `moves` (..., D) is True for a component of a state."""
    if moves.any():
        moves = np.broadcast_to(moves.any(axis=-1), checked.batch)
        text = f"{checked.name} is not a fixed point"
        if checked.batch:
            where = spell(first_index(moves))
            text = f"{checked.name}: states{member} that are not fixed points, first: {where}"
        raise ValueError(
            f"{text}: use jacobian for the derivative there; "
            "for a periodic orbit see periodic_orbit"
        )


@public
def lyapunov_exponents(
    body: BodyOrField,
    omega0: ArrayLike,
    /,
    eps: ArrayLike,
    steps: int,
    transient: int = 0,
    *,
    method: Method = "auto",
    threads: int | None = None,
    progress: Progress = None,
) -> FloatArray:
    """Lyapunov exponents of orbits over a finite number of steps; chaos shows as positive ones.

    The derivatives of the map along an orbit are multiplied and decomposed as Q R, again and again
    before columns lose digits (Benettin's method); exponents are mean logarithms of the diagonals
    of R. The sum equals the mean of ``log |det DPhi|`` (relative error 1e-10). The exponents of an
    orbit are bit-identical whatever else is in the batch.

    Parameters
    ----------
    body, omega0, eps, method, threads
        As in :func:`iterate`.
    steps : int
        Number of steps averaged over, after the transient; 1 or more.
    transient : int
        Number of steps before the mean begins. They align the tangent vectors, too, so that the
        mean has no error of order 1 / steps.
    progress : bool or callable, optional
        True shows a bar (needs tqdm); a callable is called as ``progress(done, transient +
        steps)``, and ends the run if it returns False: exponents are then means over the steps
        done, or NaN if the transient was not over.

    Returns
    -------
    ndarray(float, shape=(..., D))
        Exponents per step, dimensionless, the largest first; divide by eps for rates. -inf if a
        step is not invertible; NaN, with one :class:`SingularStepWarning`, if an orbit fails. After
        a step over a pole (one :class:`PoleWarning`) they are exponents of the map alone.

    Raises
    ------
    TypeError, ValueError
        As :func:`iterate`.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, lyapunov_exponents
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> lyapunov_exponents(body, [1.0, 0.5], eps=0.2, steps=100_000).round(4)
    array([ 0.    , -0.0805])
    """
    checked = problem("lyapunov_exponents", body, omega0, eps, threads, method, name="omega0")
    steps, transient = integer("steps", steps, 1), integer("transient", transient, 0)
    warn_of_times(checked)
    with reporter(progress, transient + steps) as report, np.errstate(all="ignore"):
        growth = checked.map.find_growth(checked, steps, transient, report)
        sums, of_det = growth.sums, growth.of_det
        others = sums[:, :-1].sum(axis=1)
        # The last one follows from the determinant and the others, if all steps are invertible.
        sums[:, -1] = np.where(others == -np.inf, sums[:, -1], of_det - others)
    sums[np.isnan(sums).any(axis=1)] = np.nan
    exponents = -np.sort(-sums / max(growth.steps, 1), axis=1).reshape(
        (*checked.batch, body.dimension)
    )
    told = (each.reshape(checked.batch) for each in (growth.status, growth.failed_at))
    methods = checked.map.methods
    report_poles(checked, methods.get(checked.method, next(iter(methods.values()))), *told)
    if growth.steps == 0:  # `progress` ended the run in its transient
        return exponents
    return mask_and_warn(checked, exponents, poles=True)
