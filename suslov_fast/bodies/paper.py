"""The four pictures of the paper: their bodies and step sizes (end of Section 4)."""

from __future__ import annotations

from typing import NamedTuple

from .rigid import Suslov3D


class Picture(NamedTuple):
    """A body, a step size, and the extent of the axes, which the paper does not state."""

    body: Suslov3D
    eps: float
    extent: float


PICTURES = {
    1: Picture(Suslov3D(4, 1, -0.5, -0.3), 0.2, 4.0),
    2: Picture(Suslov3D(4, 3, -0.4, -0.2), 0.2, 10.0),
    3: Picture(Suslov3D(4, 2, 0, -0.2), 0.02, 100.0),
    4: Picture(Suslov3D(3, 3, -0.2, -0.2), 1.0, 3.0),
}
