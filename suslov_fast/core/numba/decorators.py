"""The options of Numba, as decorators; calls of kernels; helpers for compiled functions.

formula     a function of numbers, which LLVM inlines: loops over lanes that call it become SIMD
function    a function that kernels call
inlined     a function that is compiled as a part of its callers
c_function  a function that machine code calls by its address
kernel      a function(part, parts, *arguments) that does one of `parts` parts of the work; Python
            calls `kernel.serial(*arguments)` or `kernel.parallel(threads, *arguments)`
for_users   a formula that users call from Python and from their own compiled loops

Each is compiled when first called (a `c_function` when its address is read); but Python runs a
`formula` or `function` uncompiled. `.py_func` is the Python function. Until small calls of a
kernel have taken WARM_UP seconds, Python or NumPy runs them, with the same bits. With
NUMBA_DISABLE_JIT=1 all are Python functions; NUMBA_BOUNDSCHECK=1 checks indices. A function that
takes a constant integer is compiled for each value, because constants have their own types. A loop
over lanes becomes SIMD if

- its numbers are rows b[ROW, lane] of one array with constant numbers of rows and lanes, so that
  LLVM knows that they do not overlap; an index that does not begin at 0 must be unsigned;
- it calls formulas without branches (`select`), and no functions of the C library.
"""

import ctypes
import functools
import gc
import importlib
import math
import os
import re
from contextlib import contextmanager, suppress
from threading import get_ident
from time import perf_counter
from types import FunctionType

import numba
import numpy as np
from numba import config, prange, types
from numba.extending import overload, typeof_impl

from ..cached import cached_property
from .arrays import array_at, pack
from .cache import is_kept, use_cache
from .interrupts import uninterrupted
from .intrinsics import call_address, call_code, select
from .threads import in_parts

TESTED = 0, 68  # the newest Numba with which this version was tested
# The default error model tests each divisor, which costs 30 % and prevents SIMD. Without the GIL
# other Python threads run during a kernel. Without fastmath LLVM forms no FMA and reorders no sum,
# so that serial, parallel, vectorised and interpreted runs agree to the bit.
_OPTIONS = {"error_model": "numpy", "nogil": True}
# No needless wrappers for calls from C or Python: each compiles as slowly as a short function.
_FOR_USERS = _OPTIONS | {"forceinline": True, "no_cfunc_wrapper": True}
_FORMULA = _FOR_USERS | {"no_cpython_wrapper": True}
_FUNCTION = _FORMULA | {"forceinline": False}


def free_in_children(lock):
    """Keep a lock free in forked children, which would wait for a thread that they lack."""
    if hasattr(os, "register_at_fork"):  # Windows has no fork
        os.register_at_fork(
            before=lock.acquire, after_in_parent=lock.release, after_in_child=lock.release
        )


with suppress(ImportError, AttributeError):  # a private name of Numba
    free_in_children(importlib.import_module("numba.core.compiler_lock").global_compiler_lock)


# -------------------------------------------------------------------------------------- functions
def _cached(compile_with, py_function):
    """Return compile_with(py_function), compiled at its first call; cached if there is a folder."""
    compiled = compile_with(py_function)
    # Numba would cache code with and without bounds checks under the same name.
    if not (config.BOUNDSCHECK or config.DISABLE_JIT):
        use_cache(compiled, py_function)
    return compiled


@functools.cache
def _load_registries():
    """Import what Numba compiles with. Ctrl-C and other threads wait, and never see half of it."""
    with uninterrupted(), suppress(ImportError, AttributeError):  # private names of Numba
        registry = importlib.import_module("numba.core.registry")
        with importlib.import_module("numba.core.compiler_lock").global_compiler_lock:
            registry.cpu_target.target_context.refresh()


@contextmanager
def _compiling():
    """Pause Python's garbage collector while a block compiles: it takes an eighth of the time."""
    _load_registries()
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    except Exception as error:  # of any class: a newer Numba may raise anything
        # An IndexError comes from a kernel that checks indices or is interpreted, not from Numba.
        if not advice_on_numba() or isinstance(error, (IndexError, MemoryError)):
            raise
        text = f"compiling failed with numba {numba.__version__}; {advice_on_numba()}"
        raise RuntimeError(text) from error
    finally:
        if was_enabled:
            gc.enable()


def advice_on_numba():
    """Return what to install if Numba is newer than TESTED, else an empty text."""
    running = tuple(map(int, re.findall(r"\d+", numba.__version__)[:2]))
    tested, next_one = (f"{TESTED[0]}.{TESTED[1] + k}" for k in (0, 1))
    return (running > TESTED) * (
        "the newest numba that this version of suslov_fast was tested with is "
        f"{tested}: pip install 'numba<{next_one}'"
    )


# ------------------------------------------------------------------------- before it is compiled
# Small calls are interpreted until they have taken so many seconds; then compiling pays off.
WARM_UP = 1.0
# NumPy takes _IN_NUMPY (trajectories + _CALL_IN_NUMPY) seconds per component and step.
_IN_NUMPY, _CALL_IN_NUMPY = 5e-8, 500


@functools.cache
def as_python(py_function, of_arrays=False):
    """Return a copy of a function that calls no compiled code; its results have the same bits.

    If `of_arrays`, the copy computes with arrays: `select` is `numpy.where`, and `math` is `numpy`.
    """
    names = {}
    code = py_function.__code__
    twin = FunctionType(
        code, names, code.co_name, py_function.__defaults__, py_function.__closure__
    )
    names.update(py_function.__globals__)
    for name in code.co_names:
        if called := getattr(names.get(name), "py_func", None):
            names[name] = as_python(called, of_arrays)
    if of_arrays:
        names.update(select=np.where, math=np)
    return twin


def _call_code(address, numbers):
    kind = ctypes.CFUNCTYPE(*[ctypes.c_int64] * (1 + len(numbers)))
    with calling_python():
        return kind(int(address))(*map(int, numbers))


def _array_at(address, shape, dtype):
    memory = ctypes.c_char * (math.prod(map(int, shape)) * np.dtype(dtype).itemsize)
    return np.ndarray(tuple(map(int, shape)), dtype, memory.from_address(int(address)))


call_code.py_func, array_at.py_func = _call_code, _array_at


class Tiered:
    """A function that Python interprets in small calls, until they take WARM_UP seconds."""

    seconds = 0.0  # seconds that interpreted calls have taken

    def is_warming_up(self, seconds):
        """Return True if a call of `seconds` and all earlier calls take less than WARM_UP."""
        settings = config.DISABLE_JIT or config.BOUNDSCHECK
        return not settings and self.seconds + seconds < WARM_UP

    def interpret(self, function, *arguments):
        """Call a function in Python; add the time it takes to `seconds`."""
        began = perf_counter()
        try:
            with np.errstate(all="ignore"):
                return function(*arguments)
        finally:
            self.seconds += perf_counter() - began


# ------------------------------------------------------------------------------ compiled functions
class Function:
    """A function that is compiled for compiled code; calls from Python run the Python function.

    A wrapper of the compiled code for Python would make first calls a fifth longer.
    """

    def __init__(self, options, py_func):
        self.py_func = py_func
        self.compiled = _cached(numba.njit(**options), py_func)

    def __call__(self, *arguments):
        with np.errstate(all="ignore"):
            return as_python(self.py_func)(*arguments)

    @property
    def of_arrays(self):
        """The function for arrays of numbers, in NumPy."""
        return as_python(self.py_func, of_arrays=True)


@typeof_impl.register(Function)
def _type_of_function(function, context):
    return numba.typeof(function.compiled)


function = functools.partial(Function, _FUNCTION)
formula = functools.partial(Function, _FORMULA)
for_users = functools.partial(_cached, numba.njit(**_FOR_USERS))


def inlined(py_func):
    """Return a function that Numba compiles as a part of its callers."""
    compiled = numba.njit(inline="always", **_FOR_USERS | {"forceinline": False})(py_func)
    if config.DISABLE_JIT:  # then `compiled` is the Python function
        compiled.py_func = py_func
    return compiled


_raised = {}  # errors of Python functions that machine code has called, by thread


@contextmanager
def calling_python():
    """Run a block of machine code that may call Python; then raise Python's error, or Ctrl-C."""
    with uninterrupted():
        yield
    if error := _raised.pop(get_ident(), None):
        raise error


class CFunction(Tiered):
    """A function of integers that machine code calls, compiled when its address is first read."""

    def __init__(self, py_func):
        self.py_func = py_func
        self.kinds = (types.int64,) * py_func.__code__.co_argcount
        self.compiled = _cached(numba.njit(**_OPTIONS), py_func)

    @cached_property
    def _address_of_code(self):
        with _compiling():
            return _address(self.compiled, self.kinds)

    def address(self, seconds=math.inf):
        """Return the address of machine code, or of a Python function for little work.

        The Python function serves while nothing is compiled and all calls together, with this one
        of about so many `seconds`, take less than WARM_UP. It must run within `calling_python`.
        """
        is_small = not self.is_compiled and self.is_warming_up(seconds)
        if config.DISABLE_JIT or (is_small and not is_kept(self.compiled, self.kinds)):
            return ctypes.cast(self._callback, ctypes.c_void_p).value
        return self._address_of_code

    @cached_property  # the cache keeps the callback alive
    def _callback(self):
        function = as_python(self.py_func)

        def called(*arguments):
            try:
                return self.interpret(function, *arguments) or 0
            except Exception as error:  # ctypes would print and forget it
                _raised[get_ident()] = error
                return 0

        return ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * len(self.kinds))(called)

    @property
    def is_compiled(self):
        return "_address_of_code" in vars(self)


c_function = CFunction  # the decorator


# ---------------------------------------------------------------------------------------- kernels
class Kernel(Tiered):
    """A compiled kernel; its arguments are numbers, arrays and tuples of them."""

    # in_numpy(*arguments) does the work of a kernel of steps for all trajectories side by side,
    # with the same bits, and returns True; it returns False if only the kernel can do it.
    in_numpy = None
    in_python = None  # a function that replaces the interpreted kernel, with the same bits
    is_compiled = False

    def __init__(self, py_function):
        self.py_func = py_function
        self.compiled = _cached(numba.njit(**_OPTIONS), py_function)
        if config.DISABLE_JIT:
            self.compiled = lambda *arguments: self.interpret(as_python(py_function), *arguments)

    def serial(self, *arguments):
        """Call the kernel for all of the work, in this thread."""
        if self.is_compiled:
            self.compiled(0, 1, *arguments)
            return
        with _compiling():
            self.compiled(0, 1, *arguments)
        self.is_compiled = True

    def interpreted_or_serial(self, seconds, *arguments):
        """Do what `serial` does, in Python if that takes few `seconds` and nothing is compiled."""
        if self.is_compiled or not self.is_warming_up(seconds) or self._is_kept(arguments):
            self.serial(*arguments)
        else:
            self.interpret(self.in_python or as_python(self.py_func), 0, 1, *arguments)

    def by_numpy(self, *arguments):
        """Return True after taking the steps by NumPy: if they are few and nothing is compiled."""
        if self.in_numpy is None or self.is_compiled:
            return False
        _, x0, span, _ = arguments
        trajectories, states = span.end - span.begin, span.stop - span.start
        numbers = x0.shape[1] * (trajectories + _CALL_IN_NUMPY) * (states + 2)
        if not self.is_warming_up(_IN_NUMPY * numbers) or self._is_kept(arguments):
            return False
        with suppress(MemoryError):  # the kernel needs less memory than NumPy
            return self.interpret(self.in_numpy, *arguments)
        return False

    def _is_kept(self, arguments):
        return is_kept(self.compiled, (*[types.intp] * 2, *numba.typeof(arguments)))

    def __call__(self, part, parts, *arguments):
        return self.compiled(part, parts, *arguments)

    def parallel(self, threads, *arguments):
        """Call the kernel in each of `threads` threads, for one part of the work each."""
        # Kernels that check indices or are interpreted may raise, which `prange` ignores.
        if config.BOUNDSCHECK or config.DISABLE_JIT:
            in_parts(threads, lambda part: self.compiled(part, threads, *arguments), [], threads)
        else:
            kind = self.compiled, _kind(arguments)
            if kind not in known_addresses:
                known_addresses[kind] = _addresses(self.compiled, numba.typeof(arguments))
            _start(*known_addresses[kind], threads, arguments)
        self.is_compiled = True


kernel = Kernel  # the decorator


# A parallel call is a loop over parts that calls the kernel by its address. So each kernel is
# compiled once, for serial and parallel calls, and this loop once for all kernels, because each
# `prange` takes seconds. The loop takes the address of the arguments, because `prange` cannot pass
# nested tuples.
@functools.partial(_cached, numba.njit(parallel=True, **_OPTIONS))
def _loop(call_part, kernel, data, parts):
    for part in prange(parts):
        call_address(call_part, kernel, data, np.int64(part), parts)


@functools.partial(_cached, numba.njit(**_OPTIONS))
def _start(loop, kernel, parts, arguments):
    call_part, data = pack(arguments)
    # Call the loop by its address: compiled code that contains the loop starts threads when loaded.
    call_address(loop, call_part, kernel, data, parts)


known_addresses = {}  # results of `_addresses`, by kernel and kind of its arguments


def _kind(argument):
    """Return a dict key for Numba's type of an argument; `numba.typeof` takes 0.1 ms for all."""
    if isinstance(argument, tuple):
        return type(argument), *map(_kind, argument)
    if isinstance(argument, np.ndarray):
        return argument.dtype, argument.ndim, argument.flags.num
    return type(argument)


def _addresses(compiled, kind):
    """Return the addresses of the loop over parts, and of a kernel for a tuple of type `kind`."""
    words = (types.int64,) * 4
    with _compiling():
        _start.compile((*words[:3], kind))
        return _address(_loop, words), _address(compiled, (*words[:2], *kind))


def _address(dispatcher, kinds):
    """Compile a function of Numba for arguments of types `kinds`; return its address."""
    dispatcher.compile(kinds)  # a tuple, as in a call, because it is the key in the cache
    # A private name of Numba: without it the error says which Numba was tested (`_compiling`).
    return types.CompileResultWAP(dispatcher.overloads[tuple(kinds)]).address


# ------------------------------------------------------------------------------------- in kernels
# A typed 0: for a literal 0 Numba compiles a called function again, or infers types of sums twice.
ZERO = np.int64(0)


def of_kind(name):
    """Return a function for compiled code that calls type(x).<name>(x, *others) of a tuple x."""

    def call(first, *others):
        return getattr(type(first), name)(first, *others)

    @overload(call, jit_options=_FORMULA, strict=False)
    def choose(first, *others):
        chosen = getattr(getattr(first, "instance_class", None), name, None)
        return chosen and chosen.py_func

    return call


@formula
def lesser(a, b):
    """Return the smaller number, b if they are equal; Numba would compile `min` in each kernel."""
    return select(a < b, a, b)


@formula
def share(count, part, parts):
    """Return begin and end of the items of part `part`; `parts` parts share `count` items."""
    return count * part // parts, count * (part + 1) // parts
