"""Reduction of solved bodies from n to three dimensions: see `_kernels.reduced_states`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._bodies.body_3d import Suslov3D
from .._checks import FloatArray
from .._kernels import reduced_states
from . import threads as _threads
from .arguments import States
from .layout import flat_arrays, for_kernel, for_loops

# Cost of the reduction of a trajectory, in steps of the 3D map.
_REDUCING = 30


class Reduced(NamedTuple):
    """Trajectories of bodies with n > 3 reduced to 3D bodies, with the arrays of the kernel."""

    three: FloatArray
    state: FloatArray
    along: FloatArray
    across: FloatArray
    unit: FloatArray
    fits: NDArray[np.bool_]

    def states(self, threads: int | None) -> States:
        """Return the states of the 3D bodies."""
        body, size = Suslov3D(*self.three.T[:4]), self.state.shape[:1]
        return States(body, self.state, self.three[:, 4], size, threads)

    def expand(self, states: FloatArray, out: FloatArray, begin: int, threads: int | None) -> None:
        """Convert 3D states (rows, b, 2) to `out` (rows, B, m), from trajectory `begin` on."""
        work = states.size * (1 + out.shape[-1] // 2)
        arguments = for_kernel(states), self.along, self.across, out, begin
        _threads.call_kernel(reduced_states.expand, work, threads, *arguments)


def reduction(
    parameters: tuple[FloatArray, ...], omega: FloatArray, threads: int | None
) -> Reduced:
    size, m = omega.shape
    three, state = np.empty((size, 5)), np.empty((size, 2))
    along, across = np.empty((size, m)), np.empty((size, m))
    reduced = Reduced(three, state, along, across, np.empty(size), np.empty(size, bool))
    _threads.call_kernel(
        reduced_states.reduce, size * (_REDUCING + 8 * m), threads, parameters, omega, *reduced
    )
    return reduced


def reduced_of(states: States) -> Reduced:
    body, omega, eps, batch, threads, *_ = states
    return reduction(for_loops(body, eps, batch), flat_arrays(omega, batch), threads)


def in_3d(states: States) -> States:
    """Return the states of the 3D body of a body with n = 3."""
    return states._replace(body=Suslov3D(*of_n_3(states.body.J, states.body.I)))


def of_n_3(J: FloatArray, I: FloatArray) -> tuple[FloatArray, ...]:
    """Return I1, I2, I13, I23 of the 3D body equivalent to a body with n = 3."""
    return J[..., 0], J[..., 1], -I[..., 1], I[..., 0]
