"""Kernels: functions called from Python that do a part of the work for a batch.

A parallel call is a loop over the parts. It takes the address of the kernel and calls it: so Numba
compiles a kernel once, for serial and for parallel calls, and one loop serves all kernels with
arguments of the same types. (Numba's own `FunctionType` runs Python code in every call, where a
signal is lost.) `prange` passes no nested tuples to its body, hence one loop for each number of
arguments.
"""

import functools
from types import FunctionType, ModuleType

import numba
import numpy as np
from numba import config, prange, types

from .cache import enable_cache
from .instructions import call
from .options import called_from_python, formula


class Kernel:
    """A function called from Python, cached on disk: `function(part, parts, *arguments)`.

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
        self._loops = {}

    @functools.cached_property
    def compiled(self):
        """The function, compiled when it is first called."""
        named = FunctionType(self.function.__code__, self.names, self.name)
        named.__qualname__ = self.name
        if config.DISABLE_JIT:
            return np.errstate(all="ignore")(named)  # compiled code does not warn either
        return enable_cache(named, called_from_python)

    def serial(self, *arguments):
        """Do all the work in this thread."""
        self.compiled(0, 1, *arguments)

    def parallel(self, threads, *arguments):
        """Do the work in several threads."""
        if config.BOUNDSCHECK:  # an exception does not leave a parallel loop
            return self.serial(*arguments)
        kinds = _kinds(arguments)
        if kinds not in self._loops:
            self._loops[kinds] = _loop(self.compiled, arguments)
        loop, address = self._loops[kinds]
        return loop(address, threads, *arguments)


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


def _loop_2(kernel, parts, a, b):
    for part in prange(parts):
        call(kernel, (np.int64(part), parts, a, b))


def _loop_3(kernel, parts, a, b, c):
    for part in prange(parts):
        call(kernel, (np.int64(part), parts, a, b, c))


def _loop_4(kernel, parts, a, b, c, d):
    for part in prange(parts):
        call(kernel, (np.int64(part), parts, a, b, c, d))


def _loop_5(kernel, parts, a, b, c, d, e):
    for part in prange(parts):
        call(kernel, (np.int64(part), parts, a, b, c, d, e))


def _loop_6(kernel, parts, a, b, c, d, e, f):
    for part in prange(parts):
        call(kernel, (np.int64(part), parts, a, b, c, d, e, f))


def _loop_7(kernel, parts, a, b, c, d, e, f, g):
    for part in prange(parts):
        call(kernel, (np.int64(part), parts, a, b, c, d, e, f, g))


def _loop_8(kernel, parts, a, b, c, d, e, f, g, h):
    for part in prange(parts):
        call(kernel, (np.int64(part), parts, a, b, c, d, e, f, g, h))


def _loop_9(kernel, parts, a, b, c, d, e, f, g, h, i):
    for part in prange(parts):
        call(kernel, (np.int64(part), parts, a, b, c, d, e, f, g, h, i))


_LOOPS = {
    2: _loop_2, 3: _loop_3, 4: _loop_4, 5: _loop_5, 6: _loop_6, 7: _loop_7, 8: _loop_8, 9: _loop_9
}  # fmt: skip


def _kinds(argument):
    """Return a key for the type of an argument, ten times faster than `numba.typeof`."""
    if isinstance(argument, tuple):
        return tuple(map(_kinds, argument))
    if isinstance(argument, np.ndarray):
        return argument.dtype, argument.ndim, argument.flags.num
    return type(argument)


def _loop(compiled, arguments):
    """Return the compiled loop for arguments of these types, and the address of the kernel."""
    if config.DISABLE_JIT:
        return _LOOPS[len(arguments)], compiled
    kinds = tuple(map(numba.typeof, arguments))
    # A tuple, as of a call: the key by which Numba stores code in the cache.
    signature = types.int64, types.int64, *kinds
    compiled.compile(signature)
    result = compiled.get_compile_result(types.void(*signature))
    return _compiled_loop(*kinds), types.CompileResultWAP(result).address


@functools.cache
def _compiled_loop(*kinds):
    """Compile the loop for arguments of these types."""
    loop = enable_cache(_LOOPS[len(kinds)], functools.partial(called_from_python, parallel=True))
    loop.compile((types.int64, types.int64, *kinds))
    return loop
