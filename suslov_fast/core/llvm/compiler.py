"""The machine code that LLVM makes of texts, see `llvm.text`.

LLVM forms no FMA and keeps the order of operations. Compiling takes 0.3 to 0.5 ms an operation.
Machine code stays as long as its `Address`.
"""

import ctypes
import itertools
import os
import threading

from llvmlite import binding
from numba import config

from ..numba.decorators import advice_on_numba, free_in_children
from .tolerances import LEAST_TEXT, MOST_TEXT

# LLVM's highest level of optimisation. At 0 compiling takes .5 to .6 of the time, and steps 1.3 to
# 2.2 times as long, with the same bits: measured on six fields, of 2 to 24 variables.
LEVEL = 0 if os.environ.get("SUSLOV_FAST_OPT") == "0" else 2


def pointer(kind):
    """Return how this LLVM writes a pointer to type `kind`: for "i64" it is "ptr" or "i64*"."""
    return "ptr" if binding.llvm_version_info[0] > 16 else f"{kind}*"


class Address(int):
    """The address of machine code; the code stays in memory as long as this object."""


known_codes = {}  # {(key, level, lasts): address}, see `compiled`
_engines = {}  # engines by level of optimisation, and by whether their code lasts
_numbers = itertools.count()  # numbers that make names unique, also after Ctrl-C
_lock = threading.RLock()  # reentrant, because a signal may arrive while code is compiled
free_in_children(_lock)


def code_of(text_of, step, W=1, *options, lasts=False):
    """Return the `Address` of the function that text_of(step, name, W, *options) writes; cached."""
    key = text_of, step.key, W, *options
    level = 0 if step.is_long else 2
    return compiled(key, lambda name: text_of(step, name, W, *options), level, lasts)


def compiled(key, text_of, level=2, lasts=False):
    """Return the `Address` of the function in the text `text_of(name)`, cached by `key`.

    `level` is LLVM's optimisation level. If `lasts`, the code stays until the process ends.
    """
    key = key, level, lasts
    with _lock:
        if key not in known_codes:
            _free_old()
            name = f"code_{next(_numbers)}"
            text = text_of(name)  # outside `try`: an error here is the package's, not LLVM's
            try:
                known_codes[key] = _compile(text, name, level, lasts)
            # LLVM cannot read the text, or llvmlite has removed or changed a function.
            except (RuntimeError, AttributeError, TypeError) as error:
                advice = advice_on_numba() or "please report this"
                raise RuntimeError(f"LLVM refuses code of a field ({error}); {advice}") from error
        return known_codes[key]


def _free_old():
    """Drop cached codes that need not last, and their engines, if their texts reach MOST_TEXT."""
    # A signal handler may compile or free codes between any two lines, so the loops need copies.
    old = {key: code for key, code in known_codes.copy().items() if not key[-1]}
    if sum(code.length for code in old.values()) >= MOST_TEXT:
        for key in old:
            known_codes.pop(key, None)
        for key in _engines.copy():
            if not key[-1]:
                _engines.pop(key, None)


def _compile(text, name, level, lasts):
    """Return the `Address` of the function `name` in `text`, compiled at an optimisation level."""
    module = binding.parse_assembly(text)
    kind = level, lasts
    if kind in _engines:
        _engines[kind].add_module(module)
    else:
        _engines[kind] = binding.create_mcjit_compiler(module, _machine(level))
    engine = _engines[kind]
    try:
        engine.finalize_object()
        address = Address(engine.get_function_address(name))
    finally:
        engine.remove_module(module)
    address.engine, address.length = engine, max(len(text), LEAST_TEXT)
    address.call = _CALL(address)  # takes the address of an array; made once, to save time
    return address


def _machine(level):
    """Return LLVM's target machine for Numba's processor and features, at an optimisation level."""
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    target = binding.Target.from_triple(binding.get_process_triple())
    cpu, opt = config.CPU_NAME or binding.get_host_cpu_name(), min(level, LEVEL)
    return target.create_target_machine(cpu=cpu, features=_features(), opt=opt, jit=True)


def _features():
    """Return the processor features for which code is compiled, such as "+avx2,+fma"."""
    if config.CPU_FEATURES is not None:
        return config.CPU_FEATURES
    return "" if config.CPU_NAME else binding.get_host_cpu_features().flatten()


def numbers_in_register():
    """Return how many doubles a vector register of the processor surely holds: 8, 4 or 2."""
    features = _features().split(",")
    return 8 if "+avx512f" in features else 4 if "+avx2" in features else 2


_CALL = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)


def address_of(array):
    """Return the address of a writeable contiguous array, or 0 if empty: faster than NumPy."""
    return ctypes.addressof(ctypes.c_char.from_buffer(array)) if array.size else 0


def call(address, array):
    """Call the code at an `Address` with the address of an array; return the integer result."""
    return address.call(address_of(array))
