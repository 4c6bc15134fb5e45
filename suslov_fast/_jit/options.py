"""Every option of Numba that the package uses, with the reason for it."""

import types
from functools import cached_property

import numba
import numpy as np
from numba import config

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


def inner(function):
    """Compile a loop that kernels call."""
    return numba.njit(**_INNER)(_distinct(function))


def formula(function):
    """Compile a formula: LLVM inlines it, so that a loop over lanes that calls it becomes SIMD."""
    return numba.njit(forceinline=True, **_INNER)(_distinct(function))


def _distinct(function):
    """Name a closure after what it holds.

    Numba numbers symbols anew in each process. A closure that comes with a kernel from the cache
    and another one of the same factory could have the same name, and LLVM would take one for both.
    """
    held = [cell.cell_contents for cell in function.__closure__ or ()]
    if held:
        names = [getattr(getattr(each, "py_func", each), "__qualname__", each) for each in held]
        function.__qualname__ += f"({', '.join(map(str, names))})"
    return function


class Kernel:
    """A loop over `prange` that Python calls, compiled twice from one body.

    Attributes
    ----------
    serial, parallel : callable
        The two builds. Each is made when it is first used, compiled when it is first called, and
        cached on disk.
    """

    def __init__(self, function):
        self.function = function

    @cached_property
    def serial(self):
        return self._build(parallel=False)

    @cached_property
    def parallel(self):
        # Numba does not check bounds in parallel builds.
        return self.serial if config.BOUNDSCHECK else self._build(parallel=True)

    def _build(self, parallel):
        function = self.function
        if config.DISABLE_JIT:
            return np.errstate(all="ignore")(function)  # compiled code does not warn either
        # Numba names cache files after the function: two builds need two names.
        name = f"{function.__name__}_{'parallel' if parallel else 'serial'}"
        named = types.FunctionType(function.__code__, function.__globals__, name)
        named.__qualname__ = name
        return enable_cache(named, numba.njit(parallel=parallel, **OPTIONS))


def kernel(function):
    """Compile a kernel when it is first called."""
    return Kernel(function)
