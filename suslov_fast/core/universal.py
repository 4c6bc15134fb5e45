"""Universal functions of NumPy, from functions of one state."""

import functools
import re
from contextlib import suppress
from pathlib import Path

import numba
import numpy as np
from numba import config, types
from numba.core.caching import FunctionCache

from .numba import delete_files, digests


def universal(layout):
    """Make a universal function of float64 numbers from the function of one state.

    In a layout such as "(),(d)->(d,d),()" the function writes to its last two arguments; a number
    that it writes is an array of one.
    """
    return functools.partial(Universal, layout)


class Universal:
    """A universal function, compiled when it is first called, and cached on disk as kernels are."""

    def __init__(self, layout, py_function):
        self.layout, self.py_function = layout, py_function
        sides = [re.findall(r"\(([^)]*)\)", side) for side in layout.split("->")]
        self.inputs, self.outputs = [[re.findall(r"\w+", each) for each in side] for side in sides]
        functools.update_wrapper(self, py_function)

    def __call__(self, *arguments, **options):
        with np.errstate(all="ignore"):  # NumPy would warn of each NaN
            return self.compiled(*arguments, **options)

    @functools.cached_property
    def compiled(self):
        if config.DISABLE_JIT:
            kinds = [float] * len(self.outputs)
            return np.vectorize(self._interpreted, otypes=kinds, signature=self.layout)
        name = self.py_function.__qualname__
        self.py_function.__qualname__ = "_".join((name, *digests()))
        for stale in () if config.BOUNDSCHECK else (True, False):
            with suppress(Exception):  # a file that cannot be read; or no folder
                delete_files(Path(FunctionCache(self.py_function).cache_path), name, stale)
                return self._compile(cache=True)
        return self._compile(cache=False)

    def _compile(self, cache):
        dimensions = [*map(len, self.inputs), *(len(axes) or 1 for axes in self.outputs)]
        kinds = [types.Array(types.float64, d, "A") if d else types.float64 for d in dimensions]
        build = numba.guvectorize([types.void(*kinds)], self.layout, cache=cache, nopython=True)
        return build(self.py_function)

    def _interpreted(self, *arguments):
        arguments, sizes = [np.asarray(each, float)[()] for each in arguments], {}
        for axes, each in zip(self.inputs, arguments, strict=True):
            sizes |= zip(axes, np.shape(each), strict=True)
        results = [np.empty([sizes[axis] for axis in axes]) for axes in self.outputs]
        self.py_function(*arguments, *map(np.atleast_1d, results))
        return tuple(results) if len(results) > 1 else results[0]
