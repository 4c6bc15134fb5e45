"""JAX on the CPU: loops compiled over the batch, in double precision."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from problem import BODY, EPS

from . import printed

I1, I2, I13, I23 = map(float, BODY.parameters)
A, D = I1 * I2, I13**2 * I2 + I23**2 * I1
SX, SY = EPS / (2 * A) ** 0.5, EPS / (2 * A)


def _in_doubles(function):
    """Run it with 64 bits, and leave the process as it was."""

    @functools.wraps(function)
    def wrapped(*arguments, **options):
        before = jax.config.jax_enable_x64
        jax.config.update("jax_enable_x64", True)
        try:
            return function(*arguments, **options)
        finally:
            jax.config.update("jax_enable_x64", before)

    return wrapped


def _enter(p, q):
    return SX * (I13 * p + I23 * q), SY * (I23 * I1 * p - I13 * I2 * q)


def _leave(X, Y):
    x, y = X / SX, Y / SY
    return (I13 * I2 * x + I23 * y) / D, (I23 * I1 * x - I13 * y) / D


def _advance(X, Y):
    X_next = X * (1 + Y) / (1 - Y + X * X)
    return X_next, Y - X * X_next


@jax.jit
def _printed(omega0, steps):
    loop = jax.lax.fori_loop(0, steps, lambda n, state: printed.step(*state), tuple(omega0.T))
    return jnp.stack(loop, axis=-1)


@jax.jit
def _parameter_free(omega0, steps):
    loop = jax.lax.fori_loop(0, steps, lambda n, state: _advance(*state), _enter(*omega0.T))
    return jnp.stack(_leave(*loop), axis=-1)


@functools.partial(jax.jit, static_argnums=1)
def _stored(omega0, steps):
    def body(state, _):
        following = _advance(*state)
        return following, jnp.stack(_leave(*following), axis=-1)

    return jax.lax.scan(body, _enter(*omega0.T), length=steps)[1]


@_in_doubles
def as_printed(omega0, steps, threads):
    """(ds2) as printed."""
    return np.asarray(_printed(omega0, steps))


@_in_doubles
def parameter_free(omega0, steps, threads):
    """The parameter-free form."""
    return np.asarray(_parameter_free(omega0, steps))


@_in_doubles
def stored(omega0, steps, threads, out):
    """The parameter-free form, states 1 ... steps, in a new array."""
    return np.asarray(_stored(omega0, steps))
