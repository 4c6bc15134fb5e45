"""Random bodies, for tests of maps."""

from typing import Any

import numpy as np

from .fields.field import QuadraticField
from .nd import SuslovND
from .rigid import Suslov3D


def random_3d(rng: np.random.Generator, shape: tuple[int, ...]) -> dict[str, Any]:
    """Return parameters of bodies in three dimensions, some with I13 = 0."""
    return {
        "I1": rng.uniform(0.5, 4, shape),
        "I2": rng.uniform(0.5, 4, shape),
        "I13": rng.uniform(-1, 1, shape) * rng.choice([0, 1, 1], shape),
        "I23": rng.uniform(-1, 1, shape),
    }


def random_with_I3(rng: np.random.Generator, shape: tuple[int, ...]) -> Suslov3D:
    """Return bodies with an admissible I3."""
    moments, products = rng.uniform(2, 4, (2, *shape)), rng.uniform(-0.1, 0.1, (2, *shape))
    I3 = rng.uniform(2.7, 3.3, shape)
    return Suslov3D(moments[0], moments[1], products[0], products[1], I3)


def random_nd(
    rng: np.random.Generator, shape: tuple[int, ...], m: int = 4, equal: bool = False
) -> SuslovND:
    """Return bodies in n = m + 1 dimensions; with `equal`, all J of a body are equal."""
    J = rng.uniform(0.5, 4, (*shape, 1 if equal else m))
    return SuslovND(J * np.ones(m), rng.uniform(-1, 1, (*shape, m)))


def random_field(rng: np.random.Generator, shape: tuple[int, ...], D: int = 5) -> QuadraticField:
    """Return fields with normally distributed coefficients."""
    return QuadraticField(*(rng.normal(size=(*shape, *(D,) * axes)) / 10 for axes in (3, 2, 1)))
