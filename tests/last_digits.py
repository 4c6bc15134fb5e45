"""LAPACK of another processor: NumPy's linear algebra with other last digits.

OpenBLAS has kernels for each type of processor, and their results differ in the last digits. A
chaotic orbit turns these into its first digits. Numbers that a page prints, and those that tests
compare, have to hold on all processors.
"""

import contextlib
from types import SimpleNamespace

import numpy as np

try:
    from numpy.linalg import _linalg as linalg
except ImportError:  # NumPy 1
    from numpy.linalg import linalg

# This processor, and seeds of others: of 100 seeds 17 print what a page of 2.1.0 printed.
PROCESSORS = None, 1, 2, 3
CHANGE = 2.0**-52  # relative
_SHORT = np.uint64(2**26 - 1)  # numbers without these bits, as 0, 1 and 0.5, are exact everywhere


def changed(values, seed):
    """Return floating-point values, changed by up to CHANGE where they are rounded.

    The change depends on the modulus alone, so that equal and conjugate numbers remain so, and a
    call returns the same again.
    """
    if not isinstance(values, (np.ndarray, np.generic)) or values.dtype not in (float, complex):
        return values
    parts = np.array(values, ndmin=1, order="C").view(np.float64)
    bits = abs(parts).view(np.uint64)
    is_rounded, mixed = (bits & _SHORT) != 0, bits + np.uint64(seed)
    for factor in (0xBF58476D1CE4E5B9, 0x94D049BB133111EB):  # of SplitMix64
        mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(factor)
    change = CHANGE * ((mixed >> np.uint64(11)) / 2.0**52 - 1)
    parts *= np.where(is_rounded, 1 + change, 1.0)
    return parts.view(values.dtype).reshape(values.shape)[()]


@contextlib.contextmanager
def other_last_digits(seed):
    """Change last digits of what NumPy's LAPACK returns; yield the names of what was called.

    With None nothing is changed.
    """
    called, lapack = [], linalg._umath_linalg

    def other(name):
        def function(*args, **options):
            called.append(name)
            found = getattr(lapack, name)(*args, **options)
            if seed is None:
                return found
            if isinstance(found, tuple):
                return tuple(changed(each, seed) for each in found)
            return changed(found, seed)

        return function

    functions = {name: other(name) for name in dir(lapack) if callable(getattr(lapack, name))}
    linalg._umath_linalg = SimpleNamespace(**vars(lapack) | functions)
    try:
        yield called
    finally:
        linalg._umath_linalg = lapack
