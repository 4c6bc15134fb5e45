"""Bodies with which tests try each map: random ones, and a state without a next one."""

import numpy as np

from suslov_fast import Field, Map, Suslov3D, SuslovND, kahan
from suslov_fast.maps.map_records import MAPS


def random_3d(rng, shape):
    """Return parameters of bodies in three dimensions, some with I13 = 0."""
    return {
        "I1": rng.uniform(0.5, 4, shape),
        "I2": rng.uniform(0.5, 4, shape),
        "I13": rng.uniform(-1, 1, shape) * rng.choice([0, 1, 1], shape),
        "I23": rng.uniform(-1, 1, shape),
    }


def random_with_I3(rng, shape):
    """Return bodies with an admissible I3."""
    moments, products = rng.uniform(2, 4, (2, *shape)), rng.uniform(-0.1, 0.1, (2, *shape))
    I3 = rng.uniform(2.7, 3.3, shape)
    return Suslov3D(moments[0], moments[1], products[0], products[1], I3=I3)


def random_inertia(rng, shape=()):
    """Return tensors of inertia in three dimensions."""
    root = rng.normal(size=(*shape, 3, 3))
    matter = root @ root.swapaxes(-2, -1) + 0.1 * np.eye(3)
    return np.trace(matter, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - matter


def random_nd(rng, shape, m=4, equal=False):
    """Return bodies in n = m + 1 dimensions; with `equal`, all J of a body are equal."""
    J = rng.uniform(0.5, 4, (*shape, 1 if equal else m))
    return SuslovND(J=J * np.ones(m), I=rng.uniform(-0.5, 0.5, (*shape, m)) * J)


def random_field(rng, shape, D=5):
    """Return fields with normally distributed coefficients."""
    return Field.from_terms(*(rng.normal(size=(*shape, *(D,) * axes)) / 10 for axes in (3, 2, 1)))


def random_map(rng, shape):
    """Return maps of which orbits escape from some states, with a sine, a bend and a jump."""

    def f(x, a, b):
        y = np.mod(x[1] + a * np.sin(x[0]), 3.0)
        return 1 - a * x[0] ** 2 + y, b * x[0] + np.where(x[2] > 1, 0.1, 0.0), np.abs(x[2]) - b

    return Map(f, "x y z", a=rng.uniform(1, 2, shape), b=rng.uniform(0, 0.3, shape))


# Functions of (rng, shape), by the name of a map.
RANDOM = {
    "Suslov3D": (
        lambda rng, shape: Suslov3D(**random_3d(rng, shape)),
        random_with_I3,
        lambda rng, shape: Suslov3D(**random_3d(rng, shape), k=rng.uniform(-1, 1, shape)),
    ),
    "Map": (random_map,),
    "SuslovND": (random_nd, lambda rng, shape: random_nd(rng, shape, 3, equal=True)),
}
SQUARE = Field.from_terms([[[1]]])  # x' = x**2


def random_bodies(name):
    """Return the functions of a map that make random bodies."""
    return (random_field,) if MAPS[name].body is Field else RANDOM[name]


def quantity(name):
    """Return the function of (body, omega, eps) of this name: of `kahan`, or a method."""
    if name in kahan.__all__:
        return getattr(kahan, name)
    return lambda body, omega, *eps: getattr(body, name)(omega, *eps)


class Tensor:
    """An array of another package, which converts itself, or refuses to."""

    def __init__(self, values):
        self.values = values

    def __array__(self, dtype=None, copy=None):
        if self.values is None:
            raise RuntimeError("call detach() first")
        return np.asarray(self.values, dtype)
