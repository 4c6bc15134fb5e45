"""The fields and maps of the page "A zoo of Kahan maps"."""

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from ..bodies.rigid import Suslov3D
from ..fields.field import Field
from ..fields.map import Map
from ..keywords import public
from .birational_maps import RationalMap
from .exact_maps import rational_map


def of(f: Callable[..., Any], n: int = 0, make: Any = Field) -> Any:
    """Return the field of F(x) = f(x1, ..., xn), or ``make(F, n)``; n = 0 counts f's arguments."""
    return make(lambda x: f(*x), n or f.__code__.co_argcount)


def _chain(*x: Any) -> Any:
    """Return rates of the Volterra chain: species k eats k + 1, and the last eats the first."""
    return [x[k] * (x[(k + 1) % len(x)] - x[k - 1]) for k in range(len(x))]


def _rotors(*beta: int) -> Any:
    """Return the gyrostat of Zhukovsky and Volterra, with the constant momentum beta of rotors."""
    return of(lambda x, y, z: np.array((y * z, 2 * z * x, -3 * x * y)) + np.cross((x, y, z), beta))


def _top(w: Sequence[Any], v: Callable[[Any], Any]) -> Field:
    """Return the field m' = m x (w m) + p x v(p), p' = p x (w m): Kirchhoff's for v(p) = b p."""

    def field(x: Any) -> Any:
        m, p = np.array(x[:3]), np.array(x[3:])
        return [*(np.cross(m, w * m) + np.cross(p, v(p))), *np.cross(p, w * m)]

    return Field(field, 6)


def _in_potential(slope: Callable[..., Any], I2: int = 1) -> Field:
    """Return Suslov's problem with moments 1 and I2, for a potential with the gradient slope(g)."""

    def field(w1: Any, w2: Any, *g: Any) -> Any:
        torque = np.cross(g, slope(*g))
        return torque[0], torque[1] / I2, *np.cross(g, (w1, w2, 0))

    return of(field, 5)


def _on_so4(*moments: int) -> Field:
    """Return Suslov's problem on so(4): Omega_34 = 0, M_ij = (moments_i + moments_j) Omega_ij."""
    pairs = [(i, j) for i in range(4) for j in range(i + 1, 4)][:-1]

    def field(*x: Any) -> Any:
        W = np.zeros((4, 4), object)
        for (i, j), value in zip(pairs, x, strict=True):
            W[i, j], W[j, i] = value, -value
        square, m = W @ W, moments
        return [Fraction(m[i] - m[j], m[i] + m[j]) * square[i, j] for i, j in pairs]

    return of(field, 5)


def _nambu(x: Any, y: Any, z: Any) -> Any:
    """Return the cross product of the gradients of 2 x^2 + y^2 + z^2 + x y and z^2 + x y + x z."""
    return np.cross((4 * x + y, x + 2 * y, 2 * z), (y + z, x, x + 2 * z))


def _henon_heiles(q1: Any, q2: Any, p1: Any, p2: Any) -> Any:
    return (p1**2 + p2**2 + q1**2 + q2**2) / 2 + q1**2 * q2 - q2**3 / 3


def _recurrence(z: Callable[[Any, Any], Any]) -> tuple[RationalMap, None]:
    """Return the map (x, y) -> (y, z(x, y)) of a reversible recurrence, and None for its eps."""
    back = Map(lambda x: (z(x[1], x[0]), x[0]), 2)
    return rational_map(Map(lambda x: (x[1], z(*x)), 2), back), None


@public
def zoo() -> dict[str, tuple[Field | RationalMap, Fraction | None]]:
    """Return the fields of the page "A zoo of Kahan maps", by name, each with a step size.

    The first fifteen have integrable maps. The last three are recurrences of second order, not
    Kahan maps, and integrable too.

    Returns
    -------
    dict
        Pairs of a field or map and a step size, None for a map.

    Examples
    --------
    >>> from suslov_fast import iterate
    >>> from suslov_fast.integrability import zoo
    >>> field, eps = zoo()["Euler top"]
    >>> field
    Field(x1' = 2*x2*x3, x2' = -3*x3*x1, x3' = x1*x2)
    >>> iterate(field, [1, 0.5, 0.2], float(eps), steps=2).states.shape
    (3, 3)
    >>> zoo()["Lyness"]
    (rational_map(x2, (x2 + 3)/x1), None)
    """
    I, hamiltonian = (4, 2, -0.5, -0.25), Field.from_hamiltonian
    fields = {
        "Suslov body": ("1/4", Suslov3D(*I).field()),
        "Suslov gyrostat": ("1/4", Suslov3D(*I, k=0.5).field()),
        "cubic Hamiltonian": (
            "1/2",
            of(lambda x, y: (y**2 - x**2) / 2 + x**3 / 3, make=hamiltonian),
        ),
        "Nahm, octahedral": ("1/4", of(lambda x, y: (2 * x**2 - 12 * y**2, -6 * x * y - 4 * y**2))),
        "Euler top": ("1/2", of(lambda x, y, z: (2 * y * z, -3 * z * x, x * y))),
        "Zhukovsky-Volterra, one beta": ("1/2", _rotors(1, 0, 0)),
        "Nambu": ("1/4", of(_nambu)),
        "Volterra chain, N = 3": ("1/4", of(_chain, 3)),
        "Volterra chain, N = 4": ("1/4", of(_chain, 4)),
        "Lagrange top": ("1/4", _top((1, 1, Fraction(1, 2)), lambda p: (0, 0, 1))),
        "Kirchhoff": ("1/4", _top((1, 1, 2), lambda p: (1, 1, 3) * p)),
        "Clebsch": ("1/4", _top((1, 1, 1), lambda p: (1, 2, 5) * p)),
        "Klebsch-Tisserand": ("1/4", _in_potential(lambda *g: (0, 0, g[2]))),
        "Suslov, Lagrange axis": ("1/4", _in_potential(lambda *g: (0, 0, 1))),
        "Suslov on so(4)": ("1/4", _on_so4(1, 2, 5, 5)),
        "Lotka-Volterra": ("1/2", of(lambda x, y: (x * (1 - y), y * (x - 1)))),
        "Zhukovsky-Volterra, two betas": ("5/4", _rotors(1, 2, 0)),
        "Zhukovsky-Volterra, three betas": ("1", _rotors(1, 2, 3)),
        "Volterra chain, N = 5": ("3/4", of(_chain, 5)),
        "body in a fluid": ("1/4", _top((1, 2, 4), lambda p: (1, 3, 2) * p)),
        "Henon-Heiles": ("1/4", of(_henon_heiles, make=hamiltonian)),
        "Kharlamova": ("1/4", _in_potential(lambda *g: (1, 2, 0), I2=2)),
        "Lorenz": ("1/64", of(lambda x, y, z: (10 * (y - x), x * (28 - z) - y, x * y - 8 * z / 3))),
        "generic planar field": (
            "1/4",
            of(lambda x, y: (x**2 - y - x / 8, (x * y + y**2) / 2 + x - y / 8)),
        ),
    }
    return {
        **{name: (field, Fraction(eps)) for name, (eps, field) in fields.items()},
        "Lyness": _recurrence(lambda x, y: (y + 3) / x),
        "McMillan": _recurrence(lambda x, y: 6 * y / (1 + y**2) - x),
        # The polarization of x'' = -x^3: z - 2 y + x = -x y z / 4.
        "Hone-Quispel": _recurrence(lambda x, y: (2 * y - x) / (1 + x * y / 4)),
    }
