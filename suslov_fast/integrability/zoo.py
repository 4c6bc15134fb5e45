"""The fields and maps of the page "A zoo of Kahan maps"."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from ..bodies.field import QuadraticField
from ..bodies.rigid import Suslov3D, SuslovGyrostat
from .maps import RationalMap
from .rational import rational_map


def _of(f: Callable[..., Any]) -> QuadraticField:
    """Return the field of a function of D numbers."""
    return QuadraticField.from_function(lambda x: f(*x), f.__code__.co_argcount)


def _chain(N: int) -> QuadraticField:
    """Each species eats the next and is eaten by the one before, periodically."""
    of = QuadraticField.from_function
    return of(lambda x: [x[k] * (x[(k + 1) % N] - x[k - 1]) for k in range(N)], N)


def _rotors(*beta: int) -> QuadraticField:
    """The gyrostat of Zhukovsky and Volterra."""

    def field(x: Any) -> Any:
        return np.array((x[1] * x[2], 2 * x[2] * x[0], -3 * x[0] * x[1])) + np.cross(x, beta)

    return QuadraticField.from_function(field, 3)


def _top(w: Sequence[Any], v: Callable[[Any], Any]) -> QuadraticField:
    """A body with m' = m x (w m) + p x v(p), p' = p x (w m)."""

    def field(x: Any) -> Any:
        m, p = np.array(x[:3]), np.array(x[3:])
        return [*(np.cross(m, w * m) + np.cross(p, v(p))), *np.cross(p, w * m)]

    return QuadraticField.from_function(field, 6)


def _in_fluid(a: Sequence[int], b: Sequence[int]) -> QuadraticField:
    """Kirchhoff's equations for 2 H = sum a_i m_i^2 + b_i p_i^2."""
    return _top(a, lambda p: b * p)


def _nambu(x: Any, y: Any, z: Any) -> Any:
    """Cross product of the gradients of 2 x^2 + y^2 + z^2 + x y and z^2 + x y + x z."""
    return np.cross((4 * x + y, x + 2 * y, 2 * z), (y + z, x, x + 2 * z))


def _henon_heiles(x: Any) -> Any:
    q1, q2, p1, p2 = x
    return (p1**2 + p2**2 + q1**2 + q2**2) / 2 + q1**2 * q2 - q2**3 / 3


def _reversed(f: Callable[[Any], Any]) -> RationalMap:
    """Return the map (x, y) to (y, z) of a recurrence that is the same backwards."""
    return rational_map(f, 2, inverse=lambda x: f(x[::-1])[::-1])


def zoo() -> dict[str, tuple[QuadraticField | RationalMap, Fraction | None]]:
    """Return the fields of the page "A zoo of Kahan maps", by name, each with a step size.

    The first twelve have integrable maps. The last three are maps (map, None) of second-order
    recurrences, no Kahan maps, and integrable.

    Examples
    --------
    >>> from suslov_fast import iterate
    >>> from suslov_fast.integrability import zoo
    >>> field, eps = zoo()["Euler top"]
    >>> field
    QuadraticField(x1' = 2*x2*x3, x2' = -3*x1*x3, x3' = x1*x2)
    >>> iterate(field, [1, 0.5, 0.2], float(eps), steps=2).x.shape
    (3, 3)
    >>> zoo()["Lyness"]
    (rational_map(x2, (x2 + 3)/x1), None)
    """
    I, hamiltonian = (4, 2, -0.5, -0.25), QuadraticField.from_hamiltonian
    fields = {
        "Suslov body": ("1/4", QuadraticField.of(Suslov3D(*I))),
        "Suslov gyrostat": ("1/4", QuadraticField.of(SuslovGyrostat(*I, k=0.5))),
        "cubic Hamiltonian": (
            "1/2",
            hamiltonian(lambda x: (x[1] ** 2 - x[0] ** 2) / 2 + x[0] ** 3 / 3, 2),
        ),
        "Nahm, octahedral": (
            "1/4",
            _of(lambda x, y: (2 * x**2 - 12 * y**2, -6 * x * y - 4 * y**2)),
        ),
        "Euler top": ("1/2", _of(lambda x, y, z: (2 * y * z, -3 * z * x, x * y))),
        "Zhukovsky-Volterra, one beta": ("1/2", _rotors(1, 0, 0)),
        "Nambu": ("1/4", _of(_nambu)),
        "Volterra chain, N = 3": ("1/4", _chain(3)),
        "Volterra chain, N = 4": ("1/4", _chain(4)),
        "Lagrange top": ("1/4", _top((1, 1, Fraction(1, 2)), lambda p: (0, 0, 1))),
        "Kirchhoff": ("1/4", _in_fluid((1, 1, 2), (1, 1, 3))),
        "Clebsch": ("1/4", _in_fluid((1, 1, 1), (1, 2, 5))),
        "Lotka-Volterra": ("1/2", _of(lambda x, y: (x * (1 - y), y * (x - 1)))),
        "Zhukovsky-Volterra, two betas": ("5/4", _rotors(1, 2, 0)),
        "Zhukovsky-Volterra, three betas": ("1", _rotors(1, 2, 3)),
        "Volterra chain, N = 5": ("3/4", _chain(5)),
        "body in a fluid": ("1/4", _in_fluid((1, 2, 4), (1, 3, 2))),
        "Henon-Heiles": ("1/4", hamiltonian(_henon_heiles, 4)),
        "Lorenz": (
            "1/64",
            _of(lambda x, y, z: (10 * (y - x), x * (28 - z) - y, x * y - 8 * z / 3)),
        ),
        "generic planar field": (
            "1/4",
            _of(lambda x, y: (-x / 8 - y + x**2, x - y / 8 + x * y / 2 + y**2 / 2)),
        ),
    }
    # The last one is the polarization of x'' = -x^3: z - 2 y + x = -x y z / 4.
    maps: dict[str, Callable[[Any], Any]] = {
        "Lyness": lambda x: (x[1], (x[1] + 3) / x[0]),
        "McMillan": lambda x: (x[1], 6 * x[1] / (1 + x[1] ** 2) - x[0]),
        "Hone-Quispel": lambda x: (x[1], (2 * x[1] - x[0]) / (1 + x[0] * x[1] / 4)),
    }
    return {
        **{name: (field, Fraction(eps)) for name, (eps, field) in fields.items()},
        **{name: (_reversed(f), None) for name, f in maps.items()},
    }
