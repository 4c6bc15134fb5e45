"""Numba: its options, its cache, calls of kernels, universal functions, rows of an output.

formula     a function of numbers, which LLVM inlines: loops over lanes that call it become SIMD
function    a function that kernels call
inlined     the same, compiled as a part of its callers
c_function  what machine code calls by its address
kernel      what Python calls: `kernel.serial(*arguments)`, `kernel.parallel(threads, *arguments)`
            for `function(part, parts, *arguments)`, which does one of `parts` parts of the work
for_users   a formula that users call, from their own compiled loops and from Python
universal   a universal function of NumPy, made of a function of one state

Each is compiled on its first call. With NUMBA_DISABLE_JIT=1 all are Python functions; with
NUMBA_BOUNDSCHECK=1 indices are checked, and parts run one after the other. A loop becomes SIMD if

- its numbers are rows b[ROW, lane] of one array with constant numbers of rows and lanes: then LLVM
  need not test whether arrays overlap; indices that do not begin at 0 are unsigned,
- it calls formulas without branches (`select`), and nothing of the C library.

All of them can be called from Python; `.py_func` is the Python function that was compiled. Constant
integers have types of their own: a function that takes one is compiled for each value.
"""

import functools
import gc
import os
import re
from contextlib import contextmanager, suppress

import numba
import numpy as np
from numba import config, prange, types
from numba.extending import overload, typeof_impl

from .cache import kept_folders, name_with_digest, use_cache
from .llvm import call_address, pack

# The newest Numba that this version was tested with.
TESTED = 0, 68
# The default error model tests every divisor: that costs 30 % and prevents SIMD. Other threads of
# Python run while a kernel does. Without fastmath no FMA is formed and no sum reordered: serial,
# parallel, vectorised and interpreted runs agree to the bit.
_OPTIONS = {"error_model": "numpy", "nogil": True}
# A wrapper, for calls from Python or from C, takes as long to compile as a short function.
_FOR_USERS = _OPTIONS | {"forceinline": True, "no_cfunc_wrapper": True}
_FORMULA = _FOR_USERS | {"no_cpython_wrapper": True}
_FUNCTION = _FORMULA | {"forceinline": False}


# -------------------------------------------------------------------------------------- functions
def _cached(compile_with, py_function):
    """Compile a function on its first call, with a cache if there is a folder for it."""
    name_with_digest(py_function)
    compiled = compile_with(py_function)
    # Numba would cache code with and without checks of bounds under one name.
    if not (config.BOUNDSCHECK or config.DISABLE_JIT):
        use_cache(compiled, py_function)
    return compiled


_pauses = []  # of the garbage collector, one for each thread that compiles


@contextmanager
def _compiling():
    """Pause Python's garbage collector, which takes an eighth of the time of compiling.

    Where that fails with a Numba newer than the last that was tested, the error says so.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    _pauses.append(was_enabled)
    try:
        yield
    except Exception as error:
        running = tuple(map(int, re.findall(r"\d+", numba.__version__)[:2]))
        if running <= TESTED or isinstance(error, IndexError):  # an index is no fault of Numba's
            raise
        tested, next_one = (f"{TESTED[0]}.{TESTED[1] + k}" for k in (0, 1))
        raise RuntimeError(
            f"compiling failed with numba {numba.__version__}; the newest numba that this version "
            f"of suslov_fast was tested with is {tested}: pip install 'numba<{next_one}'"
        ) from error
    finally:
        _pauses.pop()
        if was_enabled:
            gc.enable()


def _after_fork():
    """End in a child what a thread began that compiled in the parent."""
    global_compiler_lock.release()
    if any(_pauses):
        gc.enable()


# A fork waits for a thread that compiles: its child would wait forever for the lock of this thread.
with suppress(ImportError, AttributeError):  # names that Numba does not promise; or Windows
    from numba.core.compiler_lock import global_compiler_lock

    os.register_at_fork(
        before=global_compiler_lock.acquire,
        after_in_parent=global_compiler_lock.release,
        after_in_child=_after_fork,
    )


class Function:
    """A function that compiled code calls.

    It has no Python wrapper, which would add a fifth to first calls. A call from Python compiles a
    second version, with a wrapper and checks of indices. `for_users` has a wrapper in the cache,
    because its functions are called from Python.
    """

    def __init__(self, options, py_func):
        self.py_func = py_func
        self.compiled = _cached(numba.njit(**options), py_func)

    @functools.cached_property
    def _for_calls(self):
        return numba.njit(boundscheck=True, **_OPTIONS)(self.py_func)

    def __call__(self, *arguments):
        return self._for_calls(*arguments)


@typeof_impl.register(Function)
def _type_of_function(function, context):
    return numba.typeof(function.compiled)


function = functools.partial(Function, _FUNCTION)
formula = functools.partial(Function, _FORMULA)
for_users = functools.partial(_cached, numba.njit(**_FOR_USERS))
inlined = numba.njit(inline="always", **_FOR_USERS | {"forceinline": False})


class CFunction:
    """A function that machine code calls by its address, compiled when the address is asked for."""

    def __init__(self, signature, py_func):
        self.signature, self.py_func = signature, py_func

    @functools.cached_property
    def _compiled(self):
        build = functools.partial(numba.cfunc, self.signature, **_OPTIONS)
        name_with_digest(self.py_func)
        with _compiling():
            with suppress(Exception):  # no writable folder, or a file that cannot be read
                return build(cache=not config.BOUNDSCHECK)(self.py_func)
            return build(cache=False)(self.py_func)

    @property
    def address(self):
        return self._compiled.address

    def compile(self):
        """Compile the function now."""
        return self._compiled

    @property
    def is_compiled(self):
        return "_compiled" in vars(self)


def c_function(signature):
    """Return the decorator that makes a `CFunction`."""
    return functools.partial(CFunction, signature)


# ---------------------------------------------------------------------------------------- kernels
class Kernel:
    """A compiled kernel, whose arguments are numbers, arrays and tuples of them."""

    def __init__(self, py_function):
        self.py_func = py_function
        self.compiled = _cached(numba.njit(**_OPTIONS), py_function)
        if config.DISABLE_JIT:  # compiled code does not warn
            self.compiled = np.errstate(all="ignore")(py_function)

    def serial(self, *arguments):
        """Call the kernel for all of the work."""
        with _compiling():
            self.compiled(0, 1, *arguments)
        self.serial = functools.partial(self.compiled, 0, 1)  # from now on it is compiled

    def __call__(self, part, parts, *arguments):
        return self.compiled(part, parts, *arguments)

    def parallel(self, threads, *arguments):
        addresses = None
        # Exceptions do not leave a parallel loop.
        if not (config.BOUNDSCHECK or config.DISABLE_JIT):
            addresses = _addresses(self.compiled, numba.typeof(arguments))
        if addresses is None:
            for part in range(threads):
                self.compiled(part, threads, *arguments)
        else:
            _start(*addresses, threads, arguments)


kernel = Kernel  # the decorator


# A parallel call is a loop over parts, which calls the kernel by its address: so a kernel is
# compiled once, for serial and parallel calls, and this loop once for all kernels (each `prange`
# takes seconds). It takes the address of the arguments, too: `prange` passes no nested tuples.
@functools.partial(_cached, numba.njit(parallel=True, **_OPTIONS))
def _loop(call_part, kernel, data, parts):
    for part in prange(parts):
        call_address(call_part, kernel, data, np.int64(part), parts)


@functools.partial(_cached, numba.njit(**_OPTIONS))
def _start(loop, kernel, parts, arguments):
    call_part, data = pack(arguments)
    # By its address, too: a loop is loaded with its threads, the code of its callers without.
    call_address(loop, call_part, kernel, data, parts)


@functools.cache
def _addresses(compiled, kind):
    """Return the addresses of the loop over parts, and of a kernel for a tuple of this type.

    What calls them needs private names: `get_compile_result`, `CompileResultWAP`, and those of
    `llvm`. Where one is missing or another function now, this is None, and parts run serially.
    """
    word, found = types.int64, []
    with _compiling(), suppress(Exception):
        for each, kinds in ((_loop, (word,) * 4), (compiled, (word, word, *kind))):
            each.compile(kinds)  # a tuple, as of a call: the key of the code in the cache
            code = each.get_compile_result(types.void(*kinds))
            found.append(types.CompileResultWAP(code).address)
        _start.compile((word, word, word, kind))
        return found
    return None


# ---------------------------------------------------------------------------- universal functions
class Universal:
    """A universal function of float64 numbers, made from a function of one state.

    In a layout such as "(),(d)->(d,d),()" the function writes to its last two arguments; a scalar
    output is an array of one number.
    """

    def __init__(self, layout, py_function):
        self.layout, self.py_func = layout, py_function
        sides = [re.findall(r"\(([^)]*)\)", side) for side in layout.split("->")]
        self.inputs, self.outputs = [[re.findall(r"\w+", each) for each in side] for side in sides]

    def __call__(self, *arguments, **options):
        with np.errstate(all="ignore"):  # NumPy would warn of each NaN
            return self.compiled(*arguments, **options)

    @functools.cached_property
    def compiled(self):
        if config.DISABLE_JIT:
            kinds = [float] * len(self.outputs)
            return np.vectorize(self._interpreted, otypes=kinds, signature=self.layout)
        dimensions = [*map(len, self.inputs), *(len(axes) or 1 for axes in self.outputs)]
        kinds = [types.Array(types.float64, d, "A") if d else types.float64 for d in dimensions]
        build = functools.partial(numba.guvectorize, [types.void(*kinds)], self.layout)
        name_with_digest(self.py_func, of_all=True)
        with _compiling():
            with suppress(Exception), kept_folders():  # none, or a file that cannot be read
                compiled = build(cache=not config.BOUNDSCHECK)(self.py_func)
                if _is_whole(compiled):
                    return compiled
            return build(cache=False)(self.py_func)

    def _interpreted(self, *arguments):
        arguments, sizes = [np.asarray(each, float)[()] for each in arguments], {}
        for axes, each in zip(self.inputs, arguments, strict=True):
            sizes |= zip(axes, np.shape(each), strict=True)
        results = [np.empty([sizes[axis] for axis in axes]) for axes in self.outputs]
        self.py_func(*arguments, *map(np.atleast_1d, results))
        return tuple(results) if len(results) > 1 else results[0]


def _is_whole(compiled):
    """True if a universal function can be called: `gufunc_builder`, `_cres`, `build`.

    If two processes wrote to the cache at once, its wrapper may be of other code: then the address
    is 0. Without these names nothing is told, and the process compiles for itself.
    """
    [code] = compiled.gufunc_builder._cres.values()
    return bool(compiled.gufunc_builder.build(code)[1])


def universal(layout):
    """Return the decorator that makes a universal function with this layout."""
    return functools.partial(Universal, layout)


# ------------------------------------------------------------------------------------- in kernels
@formula
def select(condition, first, second):
    """Return `first` where the condition holds, else `second`; compute both, without a branch."""
    return first if condition else second


def of_kind(name):
    """Return the function `name` of the class of its first argument, a named tuple."""

    def call(first, *others):
        return getattr(type(first), name)(first, *others)

    @overload(call, jit_options=_FORMULA, strict=False)
    def choose(first, *others):
        chosen = getattr(getattr(first, "instance_class", None), name, None)
        return chosen and chosen.py_func

    return call


@formula
def lesser(a, b):
    """Return the smaller number. (Each kernel would compile its own `min`.)"""
    return a if a < b else b


@formula
def share(count, part, parts):
    """Return the range of the items, `count` in all, of a part."""
    return count * part // parts, count * (part + 1) // parts


# ------------------------------------------------------------------- rows of parameters and outputs
# Large outputs leave past the caches, in whole lines: 2.1 times as fast.
# Outputs of fewer numbers stay in the caches, where they are read again.
STREAM_FROM = np.inf if config.DISABLE_JIT else 2**20


@formula
def pick(parameter, i):
    """Return the parameter of trajectory i: there is one for each, or one for all."""
    return parameter[i if i < parameter.size else 0]


def _row(array, i):
    """Return row i of an array of numbers, or the one of all; an array of indices as it is."""
    is_float = getattr(array, "dtype", None) == np.float64
    return array[i % len(array)] if is_float else array


@overload(_row, jit_options=_FORMULA)
def _row_of_type(array, i):
    if getattr(array, "dtype", None) == types.float64:
        return lambda array, i: array[i % len(array)]
    return lambda array, i: array


def rows_of(arrays, i):
    """Return the tuple of the rows of trajectory i."""
    return tuple(_row(array, i) for array in arrays)


@overload(rows_of, jit_options=_FORMULA)
def _rows_of_types(arrays, i):
    if len(arrays) == 0:
        return lambda arrays, i: ()
    return lambda arrays, i: (_row(arrays[0], i), *rows_of(arrays[1:], i))


@inlined
def are_common(parameters):
    """True if all trajectories have the same body and step size, six arrays of one number."""
    I1, I2, I13, I23, k, eps = parameters
    return I1.size * I2.size * I13.size * I23.size * k.size * eps.size == 1
