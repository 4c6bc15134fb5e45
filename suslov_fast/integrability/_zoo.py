"""The fields of the page "A zoo of Kahan maps"."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction as F
from typing import Any

from .._bodies.body_3d import Suslov3D, SuslovGyrostat
from .._bodies.field import QuadraticField


def _cross(a: Sequence[Any], b: Sequence[Any]) -> tuple[Any, ...]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _sum(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    return [k + l for k, l in zip(a, b, strict=True)]


def _chain(N: int) -> Callable[[Any], Any]:
    """Each species eats the next and is eaten by the one before, periodically."""
    return lambda x: [x[k] * (x[(k + 1) % N] - x[k - 1]) for k in range(N)]


def _rotors(*beta: int) -> Callable[[Any], Any]:
    """The gyrostat of Zhukovsky and Volterra."""
    return lambda x: _sum((x[1] * x[2], 2 * x[2] * x[0], -3 * x[0] * x[1]), _cross(x, beta))


def _in_fluid(a: Sequence[int], b: Sequence[int]) -> Callable[[Any], Any]:
    """Kirchhoff's equations for 2 H = sum a_i m_i^2 + b_i p_i^2."""

    def field(x: Any) -> list[Any]:
        m, p = x[:3], x[3:]
        u, v = ([k * l for k, l in zip(*each, strict=True)] for each in ((a, m), (b, p)))
        return [*_sum(_cross(m, u), _cross(p, v)), *_cross(p, u)]

    return field


def _lagrange(x: Any) -> list[Any]:
    """A heavy symmetric top in the frame of the body."""
    m, p = x[:3], x[3:]
    turn = (m[0], m[1], m[2] / 2)
    return [*_sum(_cross(m, turn), _cross(p, (0, 0, 1))), *_cross(p, turn)]


def _nambu(x: Any) -> tuple[Any, ...]:
    """Cross product of the gradients of 2 x1^2 + x2^2 + x3^2 + x1 x2 and x3^2 + x1 x2 + x1 x3."""
    x1, x2, x3 = x
    return _cross((4 * x1 + x2, x1 + 2 * x2, 2 * x3), (x2 + x3, x1, x1 + 2 * x3))


def _henon_heiles(x: Any) -> Any:
    q1, q2, p1, p2 = x
    return (p1**2 + p2**2 + q1**2 + q2**2) / 2 + q1**2 * q2 - q2**3 / 3


def zoo() -> dict[str, tuple[QuadraticField, F]]:
    """Return the fields of the page "A zoo of Kahan maps", by name, each with a step size.

    The first twelve have integrable maps.

    Examples
    --------
    >>> from suslov_fast import iterate
    >>> from suslov_fast.integrability import zoo
    >>> field, eps = zoo()["Euler top"]
    >>> field
    QuadraticField(x1' = 2*x2*x3, x2' = -3*x1*x3, x3' = x1*x2)
    >>> iterate(field, [1, 0.5, 0.2], float(eps), steps=2).x.shape
    (3, 3)
    """
    of, hamiltonian = QuadraticField.from_function, QuadraticField.from_hamiltonian
    quarter, half = F(1, 4), F(1, 2)
    return {
        "Suslov body": (QuadraticField.of(Suslov3D(4, 2, -0.5, -0.25)), quarter),
        "Suslov gyrostat": (
            QuadraticField.of(SuslovGyrostat(4, 2, -0.5, -0.25, k=0.5)),
            quarter,
        ),
        "cubic Hamiltonian": (
            hamiltonian(lambda x: (x[1] ** 2 - x[0] ** 2) / 2 + x[0] ** 3 / 3, 2),
            half,
        ),
        "Nahm, octahedral": (
            of(lambda x: (2 * x[0] ** 2 - 12 * x[1] ** 2, -6 * x[0] * x[1] - 4 * x[1] ** 2), 2),
            quarter,
        ),
        "Euler top": (of(lambda x: (2 * x[1] * x[2], -3 * x[2] * x[0], x[0] * x[1]), 3), half),
        "Zhukovsky-Volterra, one beta": (of(_rotors(1, 0, 0), 3), half),
        "Nambu": (of(_nambu, 3), quarter),
        "Volterra chain, N = 3": (of(_chain(3), 3), quarter),
        "Volterra chain, N = 4": (of(_chain(4), 4), quarter),
        "Lagrange top": (of(_lagrange, 6), quarter),
        "Kirchhoff": (of(_in_fluid((1, 1, 2), (1, 1, 3)), 6), quarter),
        "Clebsch": (of(_in_fluid((1, 1, 1), (1, 2, 5)), 6), quarter),
        "Lotka-Volterra": (of(lambda x: (x[0] * (1 - x[1]), x[1] * (x[0] - 1)), 2), half),
        "Zhukovsky-Volterra, two betas": (of(_rotors(1, 2, 0), 3), F(5, 4)),
        "Zhukovsky-Volterra, three betas": (of(_rotors(1, 2, 3), 3), F(1)),
        "Volterra chain, N = 5": (of(_chain(5), 5), F(3, 4)),
        "body in a fluid": (of(_in_fluid((1, 2, 4), (1, 3, 2)), 6), quarter),
        "Henon-Heiles": (hamiltonian(_henon_heiles, 4), quarter),
        "Lorenz": (
            of(
                lambda x: (
                    10 * (x[1] - x[0]),
                    x[0] * (28 - x[2]) - x[1],
                    x[0] * x[1] - F(8, 3) * x[2],
                ),
                3,
            ),
            F(1, 64),
        ),
        "generic planar field": (
            of(
                lambda x: (
                    -x[0] / 8 - x[1] + x[0] ** 2,
                    x[0] - x[1] / 8 + x[0] * x[1] / 2 + x[1] ** 2 / 2,
                ),
                2,
            ),
            quarter,
        ),
    }
