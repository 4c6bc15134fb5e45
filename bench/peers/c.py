"""C through gcc, vectorised over blocks of trajectories: the map, in several forms."""

import ctypes

import numpy as np
from gcc import library, pointer
from problem import BODY, EPS

_library = library("peers/peers.c")


def _call(name, omega0, to, steps, threads, library=_library):
    function = getattr(library, name, None)
    if function is None:
        raise ImportError("no streaming stores for this processor")
    numbers = map(ctypes.c_double, (*BODY.parameters, EPS))
    sizes = map(ctypes.c_long, (len(omega0), steps))
    function(pointer(omega0), pointer(to), *sizes, *numbers, ctypes.c_int(threads))
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
    without = library("peers/peers.c", "-ffp-contract=off")
    return _call("projective", omega0, np.empty_like(omega0), steps, threads, without)


def stored(omega0, steps, threads, out):
    """All states, (steps + 1, batch, 2), with plain stores."""
    return _call("stored", omega0, out, steps, threads)


def stored_streaming(omega0, steps, threads, out):
    """All states, (steps + 1, batch, 2), with stores past the caches."""
    return _call("stored_streaming", omega0, out, steps, threads)


def jump(omega0, n, threads):
    """State n by the closed form."""
    final = np.empty_like(omega0)
    numbers = map(ctypes.c_double, (n, *BODY.parameters, EPS))
    library("peers/closed_form.c", "-ffast-math").jump(
        *(pointer(omega0), pointer(final), ctypes.c_long(len(omega0)), *numbers),
        ctypes.c_int(threads),
    )
    return final


def _call_nd(function, body, omega0, eps, steps):
    final = np.empty_like(omega0)
    sizes = map(ctypes.c_long, (*omega0.shape, steps))
    J, I = np.ascontiguousarray(body.J), np.ascontiguousarray(body.I)
    function(pointer(omega0), pointer(final), *sizes, pointer(J), pointer(I), ctypes.c_double(eps))
    return final


def eliminate(body, omega0, eps, steps):
    """(dsn) by elimination with partial pivoting, one trajectory after the other, one thread."""
    return _call_nd(_library.eliminate, body, omega0, eps, steps)


def rank2(body, omega0, eps, steps):
    """(dsn) by sums over the components, 32 trajectories side by side, one thread."""
    return _call_nd(_library.rank2, body, omega0, eps, steps)
