"""Units of bodies and states in n dimensions, as `_formulas.units` in three: logarithms of powers
of two in which their components are of the order of 1.
"""

import numpy as np

from .._formulas.elementary import exponent, larger, smaller
from .._jit import inner


@inner
def unit_of(values, default):
    """Return the unit of the largest component; `default` if all are 0."""
    largest = 0.0
    for i in range(values.size):
        largest = larger(abs(values[i]), largest)
    return exponent(largest) if largest > 0.0 else default


@inner
def unit_of_moments(J):
    """Return the unit halfway between the largest and the smallest component."""
    largest, smallest = 0.0, np.inf
    for i in range(J.size):
        largest, smallest = larger(J[i], largest), smaller(J[i], smallest)
    return np.floor(0.5 * (exponent(largest) + exponent(smallest)))
