"""Every option of Numba that the package uses, with the reason for it."""

import hashlib
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
    """Compile a formula: LLVM inlines it, so a loop over lanes that calls it becomes SIMD."""
    return numba.njit(forceinline=True, **_INNER)(_distinct(function))


def _distinct(function):
    """Name a function defined by a factory after its free variables.

    Numba distinguishes functions of one name by a counter in the process. Those of two processes,
    loaded from the cache by a third, could have the same symbol, and LLVM would link only one.
    """
    if function.__closure__:
        parts = [
            getattr(cell.cell_contents, "py_func", cell.cell_contents)
            for cell in function.__closure__
        ]
        names = [f"{p.__module__}.{p.__qualname__}" if callable(p) else repr(p) for p in parts]
        function.__qualname__ += "_" + hashlib.sha256(repr(names).encode()).hexdigest()[:12]
    return function


class Kernel:
    """A loop over `prange` called from Python, compiled twice: serial and parallel.

    Parameters
    ----------
    function : callable
        The loop.
    name : str, optional
        Its name in the cache, by default its own.
    **names
        Functions that free names of the loop stand for. Numba caches no function with a closure.

    Attributes
    ----------
    serial, parallel : callable
        The two builds. Each is made when it is first used, compiled when it is first called, and
        cached on disk.
    """

    def __init__(self, function, name=None, **names):
        self.function = function
        self.name = name or function.__name__
        self.names = function.__globals__ | names if names else function.__globals__

    @cached_property
    def serial(self):
        return self._build(parallel=False)

    @cached_property
    def parallel(self):
        # Numba does not check bounds in parallel builds.
        return self.serial if config.BOUNDSCHECK else self._build(parallel=True)

    def _build(self, parallel):
        # Numba names cache files after the function: two builds need two names.
        name = f"{self.name}_{'parallel' if parallel else 'serial'}"
        named = types.FunctionType(self.function.__code__, self.names, name)
        named.__qualname__ = name
        if config.DISABLE_JIT:
            return np.errstate(all="ignore")(named)  # compiled code does not warn either
        return enable_cache(named, numba.njit(parallel=parallel, **OPTIONS))


def kernel(function):
    """Compile a kernel when it is first called."""
    return Kernel(function)
