"""Every option of Numba that the package uses, with the reason for it."""

from collections.abc import Callable
from typing import TypeVar

import numba

from .cache import enable_cache

OPTIONS = {
    # The default model tests every divisor and raises; the test costs 30 % and prevents SIMD.
    "error_model": "numpy",
    # Other Python threads run while a kernel does.
    "nogil": True,
    # No fastmath: no FMA is formed and no sum is reordered, so that serial, parallel, vectorised
    # and interpreted runs agree bit for bit.
    "fastmath": False,
}
# Only kernels are called from Python. Each wrapper takes as long to compile as a short function.
_INNER = OPTIONS | {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


Function = TypeVar("Function", bound=Callable)


def called_from_python(function, parallel=False):
    """Compile a function with a Python wrapper."""
    return numba.njit(parallel=parallel, **OPTIONS)(function)


def inner(function):
    """Compile a loop that kernels call."""
    return enable_cache(function, numba.njit(**_INNER))


def formula(function):
    """Compile a formula: LLVM inlines it, so a loop over lanes that calls it becomes SIMD."""
    return enable_cache(function, numba.njit(forceinline=True, **_INNER))


def for_users(function: Function) -> Function:
    """Compile a `formula` that users call, from their own compiled loops and from Python."""
    options = OPTIONS | {"no_cfunc_wrapper": True}
    return enable_cache(function, numba.njit(forceinline=True, **options))


def inlined(function):
    """Have Numba inline a function before it compiles: it is compiled only as part of its caller.

    That is for functions with one caller, and for those that return arrays on the `stack`: a
    `formula` has a stack frame until LLVM inlines it, so that LLVM may use its memory again.
    """
    return enable_cache(function, numba.njit(inline="always", **_INNER))
