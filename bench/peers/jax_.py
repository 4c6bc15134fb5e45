"""JAX on the CPU: loops compiled over the batch, in double precision."""

import functools

import formulas
import jax
import jax.numpy as jnp
import numpy as np

MAP = formulas.Formulas()


def _in_doubles(function):
    """Run a function with 64 bits, and leave the process as it was."""

    @functools.wraps(function)
    def wrapped(*arguments):
        before = jax.config.jax_enable_x64
        jax.config.update("jax_enable_x64", True)
        try:
            return np.asarray(function(*arguments))
        finally:
            jax.config.update("jax_enable_x64", before)

    return wrapped


@jax.jit
def _final(omega0, steps):
    start = MAP.enter(*omega0.T)
    end = jax.lax.fori_loop(0, steps, lambda n, state: formulas.advance(*state), start)
    return jnp.stack(MAP.leave(*end), axis=-1)


@functools.partial(jax.jit, static_argnums=1)
def _stored(omega0, steps):
    def body(state, _):
        following = formulas.advance(*state)
        return following, jnp.stack(MAP.leave(*following), axis=-1)

    return jax.lax.scan(body, MAP.enter(*omega0.T), length=steps)[1]


@_in_doubles
def final(omega0, steps, threads):
    """The parameter-free form."""
    return _final(omega0, steps)


@_in_doubles
def stored(omega0, steps, threads, out):
    """The parameter-free form, states 1 ... steps, in a new array."""
    return _stored(omega0, steps)
