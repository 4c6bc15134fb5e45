"""The fields and maps of the page "A zoo of Kahan maps"."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

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


def _cross(a: Sequence[Any], b: Sequence[Any]) -> tuple[Any, ...]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _rotors(*beta: int) -> QuadraticField:
    """The gyrostat of Zhukovsky and Volterra."""

    def field(x: Any, y: Any, z: Any) -> list[Any]:
        turn = _cross((x, y, z), beta)
        return [a + b for a, b in zip((y * z, 2 * z * x, -3 * x * y), turn, strict=True)]

    return _of(field)


def _top(w: Callable[..., Any], v: Callable[..., Any]) -> QuadraticField:
    """A body with m' = m x w(m) + p x v(p), p' = p x w(m)."""

    def field(x: Any) -> list[Any]:
        m, p = x[:3], x[3:]
        torque = zip(_cross(m, w(*m)), _cross(p, v(*p)), strict=True)
        return [*(a + b for a, b in torque), *_cross(p, w(*m))]

    return QuadraticField.from_function(field, 6)


def _in_fluid(a: Sequence[int], b: Sequence[int]) -> QuadraticField:
    """Kirchhoff's equations for 2 H = sum a_i m_i^2 + b_i p_i^2."""
    w, v = (lambda *x, c=c: [k * l for k, l in zip(c, x, strict=True)] for c in (a, b))
    return _top(w, v)


def _nambu(x: Any, y: Any, z: Any) -> tuple[Any, ...]:
    """Cross product of the gradients of 2 x^2 + y^2 + z^2 + x y and z^2 + x y + x z."""
    return _cross((4 * x + y, x + 2 * y, 2 * z), (y + z, x, x + 2 * z))


def _cubic(x: Any) -> Any:
    return (x[1] ** 2 - x[0] ** 2) / 2 + x[0] ** 3 / 3


def _henon_heiles(x: Any) -> Any:
    q1, q2, p1, p2 = x
    return (p1**2 + p2**2 + q1**2 + q2**2) / 2 + q1**2 * q2 - q2**3 / 3


def _lyness(x: Any) -> Any:
    return x[1], (x[1] + 3) / x[0]


def _mcmillan(x: Any) -> Any:
    return x[1], 6 * x[1] / (1 + x[1] ** 2) - x[0]


def _hone_quispel(x: Any) -> Any:
    """The polarization of x'' = -x^3 with the step 1/2: z - 2 y + x = -x y z / 4."""
    return x[1], (2 * x[1] - x[0]) / (1 + x[0] * x[1] / 4)


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
        "cubic Hamiltonian": ("1/2", hamiltonian(_cubic, 2)),
        "Nahm, octahedral": (
            "1/4",
            _of(lambda x, y: (2 * x**2 - 12 * y**2, -6 * x * y - 4 * y**2)),
        ),
        "Euler top": ("1/2", _of(lambda x, y, z: (2 * y * z, -3 * z * x, x * y))),
        "Zhukovsky-Volterra, one beta": ("1/2", _rotors(1, 0, 0)),
        "Nambu": ("1/4", _of(_nambu)),
        "Volterra chain, N = 3": ("1/4", _chain(3)),
        "Volterra chain, N = 4": ("1/4", _chain(4)),
        "Lagrange top": ("1/4", _top(lambda x, y, z: (x, y, z / 2), lambda *p: (0, 0, 1))),
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
    maps = {"Lyness": _lyness, "McMillan": _mcmillan, "Hone-Quispel": _hone_quispel}
    return {
        **{name: (field, Fraction(eps)) for name, (eps, field) in fields.items()},
        **{name: (_reversed(f), None) for name, f in maps.items()},
    }
