"""C compiled by gcc: several forms of the map, vectorised over blocks of trajectories."""

from functools import partial

import formulas
import numpy as np
from native import call
from numba import get_num_threads

NUMBERS = tuple(map(float, (*formulas.BODY, formulas.EPS)))


def saved_states(name, omega0, steps, every, out, flags=()):
    """All states, (steps + 1, batch, 2), by a C function; or only the last ones, (batch, 2)."""
    sizes = len(omega0), int(steps)
    call("peers/peers.c", name, omega0, out, *sizes, *NUMBERS, get_num_threads(), flags=flags)
    return out


def last_states(name, omega0, steps, flags=()):
    return saved_states(name, omega0, steps, None, np.empty_like(omega0), flags)


def in_n_dimensions(name, body, omega0, eps, steps):
    """Last states by a C function, on one thread."""
    final, arrays = np.empty_like(omega0), map(np.ascontiguousarray, (body.J, body.I))
    call("peers/peers.c", name, omega0, final, *omega0.shape, steps, *arrays, float(eps))
    return final


as_printed = partial(last_states, "as_printed")
parameter_free = partial(last_states, "parameter_free")
# One division per four steps. FMA would lengthen the chain of dependent operations.
projective = partial(last_states, "projective", flags=("-ffp-contract=off",))
stored = partial(saved_states, "stored")
stored_streaming = partial(saved_states, "stored_streaming")
eliminate = partial(in_n_dimensions, "eliminate")
eliminate_lanes = partial(in_n_dimensions, "eliminate_lanes")
rank2 = partial(in_n_dimensions, "rank2")
