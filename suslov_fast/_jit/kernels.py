"""Kernels: functions called from Python that do a part of the work for a batch."""

import functools
from types import FunctionType, ModuleType

import numpy as np
from numba import config

from .cache import enable_cache
from .options import called_from_python, formula


class Kernel:
    """A function called from Python: `kernel.compiled(part, parts, *arguments)`, cached on disk.

    It does one of `parts` equal parts of the work for a batch.

    Parameters
    ----------
    function : callable
        The function.
    name : str, optional
        Its name in the cache, by default its own.
    **names
        What names of the function stand for that its module only declares, such as a `namespace`.
        Numba caches no closure.
    """

    def __init__(self, function, name=None, **names):
        self.function = function
        self.name = name or function.__name__
        self.names = function.__globals__ | names if names else function.__globals__

    @functools.cached_property
    def compiled(self):
        """The function, compiled when it is first called."""
        named = FunctionType(self.function.__code__, self.names, self.name)
        named.__qualname__ = self.name
        if config.DISABLE_JIT:
            return np.errstate(all="ignore")(named)  # compiled code does not warn either
        return enable_cache(named, called_from_python)


def kernel(function):
    """Compile a function when it is first called from Python."""
    return Kernel(function)


def namespace(name, **contents):
    """Return a module of functions and constants, whose attributes Numba resolves as it compiles.

    A loop whose file declares `map = namespace("map")`, empty, and that calls `map.advance` thus
    serves several maps.
    """
    module = ModuleType(name)
    vars(module).update(contents)
    return module


@formula
def share(count, part, parts):
    """Return the range of the items, `count` in all, of a part."""
    return count * part // parts, count * (part + 1) // parts
