"""C compiled by gcc: several forms of the map, vectorised over blocks of trajectories."""

import formulas
import numpy as np
from native import call

NUMBERS = tuple(map(float, (*formulas.BODY, formulas.EPS)))
# One division per four steps. FMA would lengthen the chain of dependent operations.
PROJECTIVE = "-ffp-contract=off"


def saved_states(name, *flags):
    """All states, (steps + 1, batch, 2), by a C function."""

    def states(omega0, steps, threads, out):
        sizes = len(omega0), int(steps)
        call("peers/peers.c", name, omega0, out, *sizes, *NUMBERS, int(threads), flags=flags)
        return out

    return states


def last_states(name, *flags):
    """Last states by a C function."""
    states = saved_states(name, *flags)
    return lambda omega0, steps, threads: states(omega0, steps, threads, np.empty_like(omega0))


as_printed, as_printed_once = last_states("as_printed"), last_states("as_printed_once")
parameter_free = last_states("parameter_free")
projective = last_states("projective", PROJECTIVE)
stored, stored_streaming = saved_states("stored"), saved_states("stored_streaming")


def in_n_dimensions(name):
    """Last states in n dimensions by a C function, on one thread."""

    def last(body, omega0, eps, steps):
        final = np.empty_like(omega0)
        J, I = np.ascontiguousarray(body.J), np.ascontiguousarray(body.I)
        call("peers/peers.c", name, omega0, final, *omega0.shape, steps, J, I, float(eps))
        return final

    return last


eliminate, eliminate_lanes = in_n_dimensions("eliminate"), in_n_dimensions("eliminate_lanes")
rank2 = in_n_dimensions("rank2")
