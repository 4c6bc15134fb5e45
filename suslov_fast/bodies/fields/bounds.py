"""Bounds on what a file may ask of its reader, so that a small file cannot take hours or memory.

For equations see `texts`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from fractions import Fraction
from typing import Any

from ...checks import wrong

LONGEST_NAME = 200  # characters
MOST_VARIABLES = 2**20
LONGEST_NUMBER = 10_000  # characters of a text "p/q"
LARGEST_EXPONENT = 400  # of a number that is raised to a number, and of 10 in a decimal
_COMMON_BITS = 2**12  # of the denominator that the numbers of a Hamiltonian share


def check_denominators(name: str, values: Iterable[Any]) -> None:
    """Raise ValueError for numbers whose common denominator is so long that sums take minutes."""
    common = 1
    for value in values:
        if isinstance(value, Fraction):
            common = math.lcm(common, value.denominator)
            if common.bit_length() > _COMMON_BITS:
                raise wrong(name, f"fractions with a denominator below 2**{_COMMON_BITS}", "others")
