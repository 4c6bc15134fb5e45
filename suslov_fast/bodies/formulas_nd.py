"""Formulas of bodies in n dimensions, by formulas of the reduced coordinates."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ..checks import FloatArray, first_index, spell
from ..core.suslov import quantities
from ..errors import SuslovError
from ..maps.batch import states_after
from ..maps.evaluation import Formula
from ..maps.formulas import KAHAN, values_by_constants
from ..maps.problem import Problem
from .body import whole_states
from .rigid import IN_3D, Suslov3D


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
    """Raise NotIntegrableError unless the formula of a function is known for all bodies."""
    parts, how = body._reduction, _INSTEAD[function]
    known, expected = body._is_solved, "two coordinates"
    if function == "invariant_density":
        known = known | (parts.count == 3) & parts.one_coupled
        expected += ", or three of which one has a coupling"
    if not known.all():
        which = f"body {spell(first_index(~known))}" if known.ndim else "this body"
        known_for = f"only for those that equal J, or I = 0, reduce to {expected} (see reduced)"
        text = f"{function} has no known formula for {which}, {known_for}: use {how}"
        raise NotIntegrableError(text)


def wedge(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a b^T - b a^T."""
    product = a[..., :, np.newaxis] * b[..., np.newaxis, :]
    return np.asarray(product - product.swapaxes(-2, -1)) + 0.0  # no -0.0


def _momentum(problem: Problem) -> FloatArray:
    body, vector = problem.body, whole_states(problem)
    last = np.eye(body.dimension + 1)[-1]
    J, I = (np.concatenate([part, 0.0 * part[..., :1]], axis=-1) for part in (body.J, body.I))
    return wedge(vector, I) + wedge(J * vector, last)


def _reaction(problem: Problem) -> FloatArray:
    body, omega = problem.body, problem.omega
    after = states_after(problem) if np.any(problem.eps) else omega
    return quantities.reaction_between(body.J, body.I, omega, after)


def eigenvalues_nd(problem: Problem, slopes: FloatArray) -> FloatArray:
    """Return the eigenvalues of f' = (I.x) J**-1 P.

    P projects onto the vectors orthogonal to I. The eigenvalues are I.x times the squares of the
    singular values of P J**-1/2, computed in this way because small singular values keep their
    digits beside large ones.
    """
    body, x = problem.body, problem.omega
    length = np.linalg.norm(body.I, axis=-1, keepdims=True)
    unit = body.I / np.where(length > 0.0, length, 1.0)
    P = np.eye(body.dimension) - unit[..., :, np.newaxis] * unit[..., np.newaxis, :]
    roots = np.linalg.svd(P / np.sqrt(body.J)[..., np.newaxis, :], compute_uv=False)
    roots[..., -1] = 0.0
    return np.asarray((body.I * x).sum(axis=-1, keepdims=True) * roots * roots)


def in_plane(
    problem: Problem,
) -> tuple[Problem, Callable[[FloatArray], FloatArray]]:
    """Return an equivalent problem in three dimensions, and the function that maps states back.

    A body of two coordinates with J = a, b and I = (c, d) is that of I1 = a, I2 = b, I13 = -d,
    I23 = c.
    """
    parts, omega = problem.body._reduction, problem.omega
    J, I = parts.parameters(2)
    plane = {"I1": J[..., 0], "I2": J[..., 1], "I13": -I[..., 1], "I23": I[..., 0]}
    steady = parts.steady[..., np.newaxis]

    def map_back(states: FloatArray) -> FloatArray:
        return np.where(steady, omega, parts.back(states, omega))

    reduced = Suslov3D._of(plane)
    return problem._replace(body=reduced, omega=parts.states(omega, 2)), map_back


def _criticality(problem: Problem) -> FloatArray:
    """Return t of the reduced body."""
    return IN_3D["criticality"].compute(in_plane(problem)[0])


def _first_integral(problem: Problem) -> FloatArray:
    """Return the modified energy over 2 a b, with the J of the two coordinates."""
    values: FloatArray = IN_ND["modified_energy"].compute(problem)
    J, _ = problem.body._reduction.parameters(2)
    return np.asarray(values / (2.0 * J.prod(axis=-1)))


def _density(problem: Problem) -> FloatArray:
    """Return the density of the reduced body over the powers of r, 1 where every state is steady.

    States with the same r are a sphere, whose area is the power of r that each part in E0 adds.
    """
    body, omega, eps = problem.body, problem.omega, problem.eps
    parts, values = body._reduction, np.ones(problem.batch)
    for size in (2, 3):
        has_size = ~parts.steady & (parts.count == size)
        if has_size.any():
            x = parts.states(omega, size)
            J, I = parts.parameters(size)
            with np.errstate(all="ignore"):
                area = (x ** parts.further(size)).prod(axis=-1)
                density = quantities.invariant_density_nd(J, I, eps, x) / area
            values = np.where(has_size, density, values)
    return np.asarray(values + 0.0 * omega.sum(axis=-1))


def _nd(name: str) -> dict[str, Formula]:
    """Return, by its name, the formula of a function of the core."""
    return {name: Formula(partial(values_by_constants, getattr(quantities, f"{name}_nd")))}


def _known(name: str, compute: Any, **options: Any) -> dict[str, Formula]:
    """Return, by its name, the formula of a function that is not known for all bodies."""
    return {name: Formula(compute, partial(check_known, function=name), **options)}


IN_ND = {
    **KAHAN,
    **_nd("energy"),
    **_nd("modified_energy"),
    **_nd("vector_field"),
    **_known("first_integral", _first_integral),
    **_known("criticality", _criticality),
    **_known("invariant_density", _density, poles=True),
    "reaction": Formula(_reaction),
    "momentum": Formula(_momentum),
}
