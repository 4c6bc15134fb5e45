"""Kahan's map of quadratic fields: NumPy and C for any of them, C, heyoka and JAX for some.

Where LLVM refuses the code of a field, this package itself carries out its steps in NumPy.
"""

import functools

import numpy as np
from native import call
from numba import get_num_threads
from problem import EPS_FIELD as EPS, sparse_field

WRITTEN = {3: "lorenz", 4: "henon_heiles"}  # for these fields, by their dimensions


def tables_of(field):
    """Return q, symmetric in its last axes, and l of a field without a constant."""
    (i, j, k), values = field.terms
    whole = np.zeros((field.dimension, *[field.dimension + 1] * 2))
    whole[i, j, k] = values
    whole = (whole + whole.swapaxes(1, 2)) / 2
    return whole[:, :-1, :-1].copy(), 2 * whole[:, :-1, -1]


def in_numpy(field, x, steps):
    """The batched solver of NumPy; fields without a constant."""
    (quadratic, linear), D = tables_of(field), x.shape[1]
    table = quadratic.reshape(D * D, D).T
    for _ in range(steps):
        half = (x @ table).reshape(-1, D, D)  # of the derivative of the quadratic part
        f = (half + linear) @ x[..., np.newaxis]
        x = x + EPS * np.linalg.solve(np.eye(D) - EPS * (half + linear / 2), f)[..., 0]
    return x


def _lorenz_step(x, y, z):
    """The step of the Lorenz system, solved by hand."""
    h = EPS / 2
    # A d = f with d half of the increment: first the third unknown goes, then the first.
    f = 10 * (y - x), 28 * x - y - x * z, x * y - 8 / 3 * z
    a22 = 1 + h * 8 / 3
    a10, a11 = -h * (28 - z) + h * x * (h * y) / a22, 1 + h + h * x * (h * x) / a22
    g1 = f[1] - h * x * f[2] / a22
    a00, a01 = 1 + h * 10, -h * 10
    d1 = (g1 * a00 - a10 * f[0]) / (a11 * a00 - a10 * a01)
    d0 = (f[0] - a01 * d1) / a00
    d2 = (f[2] + h * y * d0 + h * x * d1) / a22
    return x + EPS * d0, y + EPS * d1, z + EPS * d2


@functools.cache
def _lorenz_by_heyoka():
    """A function of arrays (3, batch)."""
    import heyoka as hy

    variables = hy.make_vars("x", "y", "z")
    return hy.cfunc(list(_lorenz_step(*variables)), vars=list(variables))


@functools.cache
def _lorenz_by_jax():
    import jax

    jax.config.update("jax_enable_x64", True)

    def last(states, steps):
        return jax.lax.fori_loop(0, steps, lambda _, each: _lorenz_step(*each), states)

    return jax.jit(last)


def in_jax(field, x, steps):
    """The Lorenz system by a loop that JAX compiles."""
    final = _lorenz_by_jax()(tuple(np.ascontiguousarray(each) for each in x.T), steps)
    return np.stack(final, axis=-1)


def in_heyoka(field, x, steps):
    """The Lorenz system by a function that heyoka compiles; blocks of states stay in the caches."""
    step, final = _lorenz_by_heyoka(), np.empty_like(x)
    for begin in range(0, len(x), 256):
        now = np.ascontiguousarray(x[begin : begin + 256].T)
        other = np.empty_like(now)
        for _ in range(steps):
            now, other = step(inputs=now, outputs=other), now
        final[begin : begin + 256] = now.T
    return final


def in_c(field, x, steps, flags=()):
    """The Lorenz system and that of Hénon and Heiles written out; elimination that does not know
    of zeros for chains and others.
    """
    final, (batch, D) = np.empty_like(x), x.shape
    run = int(steps), EPS
    if D in WRITTEN:
        given = WRITTEN[D], x, final, batch, *run
    elif field == sparse_field(D):
        given = "volterra", x, final, batch, D, *run
    else:
        given = "dense", x, final, batch, D, *run, *tables_of(field)
    call("peers/fields.c", *given, get_num_threads(), flags=flags)
    return final


def in_c_without_fma(field, x, steps):
    """The same, where no product and sum are rounded together, as in this package."""
    return in_c(field, x, steps, ("-ffp-contract=off",))
