"""Formulas of bodies in n dimensions, by formulas of the reduced coordinates."""

from collections.abc import Callable
from functools import partial
from itertools import accumulate
from typing import Any

import numpy as np

from ..checks import FloatArray, first_index, spell
from ..errors import SuslovError
from ..maps.batch import states_after
from ..maps.evaluation import Formula
from ..maps.formulas import KAHAN
from ..maps.problem import Problem
from .formulas_3d import IN_3D, density, in_range
from .reduction import taken
from .rigid import Suslov3D


class NotIntegrableError(SuslovError, ValueError):
    """No formula is known for this body: no closed form, first integral or invariant measure.

    Functions that need one raise it; the message says for which bodies a formula is known, and what
    to use for this one.

    Examples
    --------
    >>> from suslov_fast import NotIntegrableError, SuslovND
    >>> body = SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5])
    >>> try:
    ...     body.first_integral([1.0, 0.5, 0.2], eps=0.1)
    ... except NotIntegrableError as error:
    ...     print(str(error).rpartition(": ")[2])
    use suslov_fast.integrability.report, which looks for integrals
    """


_INSTEAD = {
    **dict.fromkeys(("exact", "limits"), "iterate"),
    "first_integral": "suslov_fast.integrability.report, which looks for integrals",
    "criticality": "iterate, and compare with half the step size",
    "invariant_density": "the determinant of kahan.jacobian",
}


def check_known(body: Any, function: str) -> None:
    """Raise NotIntegrableError if a member of `body` has no known formula for `function`."""
    parts, known = body._reduction, body._is_solved
    expected = "two coordinates"
    if function == "invariant_density":
        known = known | (parts.count == 3) & parts.one_coupled
        expected += ", or three of which one has a coupling"
    if not known.all():
        which = f"body {spell(first_index(~known))}" if known.ndim else "this body"
        known_for = f"only for those that equal J, or I = 0, reduce to {expected} (see reduced)"
        text = f"{function} has no known formula for {which}, {known_for}"
        raise NotIntegrableError(f"{text}: use {_INSTEAD[function]}")


def wedge(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a b^T - b a^T."""
    product = a[..., :, np.newaxis] * b[..., np.newaxis, :]
    return np.asarray(product - product.swapaxes(-2, -1)) + 0.0  # + 0.0 turns -0.0 into 0.0


def _momentum(problem: Problem) -> FloatArray:
    body, omega = problem.body, problem.x
    whole = np.zeros((*problem.batch, 3, body.n))
    for row, part in zip(range(3), (omega, body.I, body.J * omega), strict=True):
        whole[..., row, :-1] = part
    return wedge(whole[..., 0, :], whole[..., 1, :]) + wedge(whole[..., 2, :], np.eye(body.n)[-1])


def _energy(problem: Problem) -> FloatArray:
    return 0.5 * _sum(problem.body.J * problem.x**2)


def _sum(terms: FloatArray) -> FloatArray:
    """Return the sum over the last axis; for a few components `np.sum` takes longer."""
    return np.asarray(sum(np.moveaxis(terms, -1, 0)))


def _rates(body: Any, omega: FloatArray, after: FloatArray) -> FloatArray:
    """Return the rates (after - w) / eps of a step from w to `after`; f(w) if `after` is w.

    They are (p w_i - I_i |w|**2) / J_i, p = I . w, equation (14), with products of w and `after`.
    I_i w_i**2, which p w_i and I_i |w|**2 contain, cancels and is left out.
    """
    of_p = _sums_of_others(body.I * omega) * after + _sums_of_others(body.I * after) * omega
    return np.asarray((0.5 * of_p - body.I * _sums_of_others(omega * after)) / body.J)


def _sums_of_others(terms: FloatArray) -> FloatArray:
    """Return for each i the sum of the terms j != i (..., m)."""
    parts = [*np.moveaxis(terms, -1, 0)]
    before = [0.0, *accumulate(parts[:-1])]
    after = [0.0, *accumulate(parts[:0:-1])]
    return np.stack([a + b for a, b in zip(before, reversed(after), strict=True)], axis=-1)


def _modified_energy(problem: Problem) -> FloatArray:
    """Return E**2 / (E + eps**2 f.Jf / 8)."""
    E = _energy(problem)
    f = _rates(problem.body, problem.x, problem.x)
    ratio = 0.125 * problem.eps * problem.eps * in_range(_sum(problem.body.J * f * f)) / E
    return np.where(E == 0.0, 0.0, E / in_range(1.0 + ratio))


def _reaction(problem: Problem) -> FloatArray:
    """Return the reaction of equation (13), for a step from w to the next state `after`.

    lambda_ij = I_j s_i - I_i s_j - (J_j - J_i) (w_i after_j + after_i w_j) / 2, with the rates
    s = (after - w) / eps.
    """
    body, omega = problem.body, problem.x
    after = states_after(problem) if np.any(problem.eps) else omega
    products = omega[..., :, np.newaxis] * after[..., np.newaxis, :]
    mean = 0.5 * (products + products.swapaxes(-2, -1))
    differences = body.J[..., np.newaxis, :] - body.J[..., :, np.newaxis]
    return wedge(_rates(body, omega, after), body.I) - differences * mean


def eigenvalues_nd(problem: Problem, slopes: FloatArray) -> FloatArray:
    """Return the eigenvalues of f', `slopes`, at steady states x of bodies in n dimensions.

    There f' = (I.x) J**-1 P, where P projects onto the complement of I. The eigenvalues are I.x
    times the squares of singular values of P J**-1/2: squares of small singular values keep more
    digits than small eigenvalues have.
    """
    body, x = problem.body, problem.x
    length = np.linalg.norm(body.I, axis=-1, keepdims=True)
    unit = body.I / np.where(length > 0.0, length, 1.0)
    P = np.eye(body.dimension) - unit[..., :, np.newaxis] * unit[..., np.newaxis, :]
    roots = np.linalg.svd(P / np.sqrt(body.J)[..., np.newaxis, :], compute_uv=False)
    roots[..., -1] = 0.0
    return np.asarray((body.I * x).sum(axis=-1, keepdims=True) * roots * roots)


def in_plane(problem: Problem) -> tuple[Problem, Callable[[FloatArray], FloatArray]]:
    """Return an equivalent problem in three dimensions, and the function that maps states back.

    It is for bodies that `reduction` describes by two coordinates, with J = (a, b) and I = (c, d),
    or whose states are all steady. The body has I1 = a, I2 = b, I13 = -d and I23 = c.
    """
    parts, omega = problem.body._reduction, problem.x
    J, I = parts.parameters(2)
    plane = {"I1": J[..., 0], "I2": J[..., 1], "I13": -I[..., 1], "I23": I[..., 0]}
    steady = parts.steady[..., np.newaxis]

    def map_back(states: FloatArray) -> FloatArray:
        return np.where(steady, omega, parts.back(states, omega))

    states = parts.states(omega, 2)
    return problem._replace(body=Suslov3D._of(plane), x=states), map_back


def _criticality(problem: Problem) -> FloatArray:
    """Return t of the reduced body."""
    return IN_3D["criticality"].compute(in_plane(problem)[0])


def _first_integral(problem: Problem) -> FloatArray:
    """Return the modified energy over 2 a b, with the J of the two coordinates."""
    J, _ = problem.body._reduction.parameters(2)
    return np.asarray(_modified_energy(problem) / (2.0 * J.prod(axis=-1)))


def _density(problem: Problem) -> FloatArray:
    """Return the invariant density: that of the reduced body, divided by the areas of spheres.

    States with the same coordinate r (see `reduction`) form a sphere. Its area is proportional to
    a power of r. The density is 1 for bodies of which every state is steady.
    """
    parts = problem.body._reduction
    values = np.ones(problem.batch)
    for size, of_size in ((2, _density_of_two), (3, _density_of_three)):
        has_size = ~parts.steady & (parts.count == size)
        if has_size.any():
            x = parts.states(problem.x, size)
            area = (x ** parts.further(size)).prod(axis=-1)
            J, I = parts.parameters(size)
            values = np.where(has_size, of_size(J, I, problem.eps, x) / area, values)
    return np.asarray(values + 0.0 * problem.x.sum(axis=-1))


def _density_of_two(J: FloatArray, I: FloatArray, eps: Any, w: FloatArray) -> FloatArray:
    return density(J[..., 0] * J[..., 1], I[..., 0] * w[..., 1] - I[..., 1] * w[..., 0], eps)


def _density_of_three(J: FloatArray, I: FloatArray, eps: Any, w: FloatArray) -> FloatArray:
    """Return the density for I along axis a, with the other axes b and c.

    With rate = eps I_a / 2 the density is the inverse of
    w_b w_c (1 - rate**2 (J_a w_a**2 - (J_c - J_b) (w_b**2 - w_c**2)) / (J_a J_b J_c)).
    """
    order = (abs(I).argmax(axis=-1)[..., np.newaxis] + np.arange(3)) % 3
    J_a, J_b, J_c = np.moveaxis(taken(J, order), -1, 0)
    w_a, w_b, w_c = np.moveaxis(taken(w, order), -1, 0)
    rate = 0.5 * eps * taken(I, order)[..., 0]
    along = (rate * w_a / J_b) * (rate * w_a / J_c)
    across = (w_b - w_c) * (w_b + w_c) * (rate / J_a) * (rate / J_b) * ((J_c - J_b) / J_c)
    below = in_range(w_b * w_c * (1.0 - along + across))
    return np.where(below == 0.0, np.inf, 1.0 / below)


def _known(name: str, compute: Any, **options: Any) -> dict[str, Formula]:
    """Return {name: formula} for a function that is known for some bodies only."""
    return {name: Formula(compute, partial(check_known, function=name), **options)}


IN_ND = {
    **KAHAN,
    "energy": Formula(_energy),
    "modified_energy": Formula(_modified_energy),
    **_known("first_integral", _first_integral),
    **_known("criticality", _criticality),
    **_known("invariant_density", _density, poles=True),
    "reaction": Formula(_reaction),
    "momentum": Formula(_momentum),
}
