"""Kernels: functions called from Python that do a part of the work for a batch.

A parallel call is a loop over the parts, the same for all kernels. It takes the address of the
kernel and calls it: so Numba compiles a kernel once, for serial and for parallel calls. (Numba's
own `FunctionType` runs Python code in every call, where a signal is lost.) It takes the address of
the arguments too, because `prange` passes no nested tuples to its body.
"""

import functools
import inspect
from types import FunctionType, ModuleType

import numba
import numpy as np
from numba import config, prange, types

from .cache import enable_cache
from .llvm import call, pack
from .options import called_from_python, formula


class Kernel:
    """A function called from Python, cached on disk: `function(part, parts, *arguments)`.

    It does one of `parts` equal parts of the work for a batch. `name` is its name in the cache, and
    `names` say what stands for names that its module only declares, such as a `namespace`: Numba
    caches no closure.
    """

    def __init__(self, function, name=None, **names):
        self.function = function
        self.name = name or function.__name__
        self.names = function.__globals__ | names if names else function.__globals__
        self._addresses = {}

    def __deepcopy__(self, memo):
        return self

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
        if config.BOUNDSCHECK or config.DISABLE_JIT:  # exceptions do not leave a parallel loop
            for part in range(threads):
                self.compiled(part, threads, *arguments)
            return
        key = _key(arguments)
        if key not in self._addresses:
            types_of_all = map(numba.typeof, (0, 0, *arguments))
            self._addresses[key] = _address(self.compiled, *types_of_all)
        in_parts_address, start = _loop_over_parts()
        start(in_parts_address, self._addresses[key], threads, arguments)


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


def checked(module, arguments, optional=None):
    """Return the public names of a map's module; TypeError if its functions do not fit a loop.

    `arguments` names those of each function. Those that the module may lack are in `optional`, with
    what replaces them; all other functions of such a module begin with "_", so that a misspelled
    name is not ignored.
    """
    names = {name: each for name, each in vars(module).items() if not name.startswith("_")}
    own = {
        name: len(inspect.signature(getattr(each, "py_func", each)).parameters)
        for name, each in names.items()
        if getattr(each, "__module__", "") == module.__name__ and not isinstance(each, type)
    }
    names = (optional or {}) | names
    received = [f"no {name}" for name in arguments if name not in names]
    received += [f"also {name}" for name in own if optional and name not in arguments]
    received += [
        f"{name} of {own[name]} arguments"
        for name in own.keys() & arguments.keys()
        if own[name] != len(arguments[name].split())
    ]
    if received:
        calls = ", ".join(f"{name}({', '.join(each.split())})" for name, each in arguments.items())
        raise TypeError(f"{module.__name__}: expected {calls}, got {', '.join(received)}")
    return names


@formula
def share(count, part, parts):
    """Return the range of the items, `count` in all, of a part."""
    return count * part // parts, count * (part + 1) // parts


def _in_parts(function, kernel, data, parts):
    for part in prange(parts):
        call(function, (kernel, data, np.int64(part), parts))


def _start(in_parts_address, kernel, parts, arguments):
    function, data = pack(arguments)
    call(in_parts_address, (function, kernel, data, parts))


def _key(argument):
    """Return a key for the type of an argument, ten times faster than `numba.typeof`."""
    if isinstance(argument, tuple):
        return tuple(map(_key, argument))
    if isinstance(argument, np.ndarray):
        return argument.dtype, argument.ndim, argument.flags.num
    return type(argument)


def _address(compiled, *argument_types):
    """Return the address of a function for arguments of these types."""
    # A tuple, as of a call: the key by which Numba stores code in the cache.
    compiled.compile(argument_types)
    return types.CompileResultWAP(compiled.get_compile_result(types.void(*argument_types))).address


@functools.cache
def _loop_over_parts():
    """Return the address of the loop over parts, and the function that starts it."""
    in_parts = enable_cache(_in_parts, functools.partial(called_from_python, parallel=True))
    return _address(in_parts, *[types.int64] * 4), enable_cache(_start, called_from_python)
