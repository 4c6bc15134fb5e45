"""Every option of Numba that the package uses, each with its reason."""

import types
from contextlib import suppress
from functools import cached_property

import numba
import numpy as np
from numba import config

from .cache import KernelCache
from .pipeline import Loops

_OPTIONS = {
    # The default model tests every divisor and raises; the test costs 30 % and blocks SIMD.
    "error_model": "numpy",
    # Other Python threads run while a kernel does.
    "nogil": True,
    # No fastmath: without it no FMA is formed and no sum is reordered, so that serial, parallel,
    # vectorised and interpreted runs agree bit for bit.
    "fastmath": False,
    # Nothing calls a kernel from C.
    "no_cfunc_wrapper": True,
}


class Loop:
    """A loop over `prange`, compiled twice from one body: `serial` and `parallel`.

    Each build is made when it is first asked for, which a module is imported faster without, and
    compiles when it is first called. Both are cached on disk.
    """

    def __init__(self, function):
        self._function = function

    @cached_property
    def serial(self):
        return _cached(self._function, "serial", parallel=False)

    @cached_property
    def parallel(self):
        return _cached(self._function, "parallel", parallel=True)


def _cached(function, build, parallel):
    # Numba names a cache file after the function: two builds of one function need two names.
    named = types.FunctionType(
        function.__code__,
        function.__globals__,
        f"{function.__name__}_{build}",
        closure=function.__closure__,
    )
    named.__qualname__ = named.__name__
    if config.DISABLE_JIT:
        return np.errstate(all="ignore")(named)  # compiled code does not warn either
    compiled = numba.njit(parallel=parallel, pipeline_class=Loops, **_OPTIONS)(named)
    # No writable folder, or a Numba whose cache works otherwise: compile in each process.
    with suppress(RuntimeError, AttributeError, OSError):
        compiled._cache = KernelCache(named)
    return compiled
