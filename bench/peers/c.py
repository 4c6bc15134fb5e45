"""C through gcc, vectorised over blocks of trajectories: the map, in several forms."""

import formulas
import numpy as np
from native import call

NUMBERS = tuple(map(float, (*formulas.BODY, formulas.EPS)))


def _call(name, omega0, to, steps, threads, *flags):
    sizes = len(omega0), int(steps)
    call("peers/peers.c", name, omega0, to, *sizes, *NUMBERS, int(threads), flags=flags)
    return to


def as_printed(omega0, steps, threads):
    """(ds2) as printed, two divisions per step."""
    return _call("as_printed", omega0, np.empty_like(omega0), steps, threads)


def parameter_free(omega0, steps, threads):
    """The parameter-free form, one division per step."""
    return _call("parameter_free", omega0, np.empty_like(omega0), steps, threads)


def projective(omega0, steps, threads):
    """The parameter-free form as a quotient, one division per four steps."""
    # Slower with FMA: each would wait longer for the one before.
    without = "-ffp-contract=off"
    return _call("projective", omega0, np.empty_like(omega0), steps, threads, without)


def stored(omega0, steps, threads, out):
    """All states, (steps + 1, batch, 2), with plain stores."""
    return _call("stored", omega0, out, steps, threads)


def stored_streaming(omega0, steps, threads, out):
    """All states, (steps + 1, batch, 2), with stores past the caches."""
    return _call("stored_streaming", omega0, out, steps, threads)


def _call_nd(name, body, omega0, eps, steps):
    final = np.empty_like(omega0)
    J, I = np.ascontiguousarray(body.J), np.ascontiguousarray(body.I)
    call("peers/peers.c", name, omega0, final, *omega0.shape, steps, J, I, float(eps))
    return final


def eliminate(body, omega0, eps, steps):
    """(dsn) by elimination with partial pivoting, one trajectory after the other, one thread."""
    return _call_nd("eliminate", body, omega0, eps, steps)


def rank2(body, omega0, eps, steps):
    """(dsn) by sums over the components, 32 trajectories side by side, one thread."""
    return _call_nd("rank2", body, omega0, eps, steps)
