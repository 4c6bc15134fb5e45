"""Bounds on what a file may ask of its reader, so that a small file cannot take hours or memory.

Lists are measured before anything is computed with them; for equations see `texts`.
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
_MOST_AXES = 64  # of lists in lists, as in arrays of NumPy
_COMMON_BITS = 2**12  # of the denominator that the numbers of a Hamiltonian share


def check_axes(name: str, value: Any) -> None:
    """Raise ValueError for lists and dictionaries that are nested more deeply than arrays."""
    level, axes = [value], 0
    while level := [each for item in level for each in _inside(item)]:
        axes += 1
        if axes > _MOST_AXES:
            raise wrong(name, f"lists of at most {_MOST_AXES} axes", "lists of more")


def _inside(value: Any) -> Iterable[Any]:
    """Return the lists and dictionaries in a list or a dictionary."""
    items = value.values() if isinstance(value, dict) else value
    return (each for each in items if isinstance(each, (list, dict)))


def check_denominators(name: str, values: Iterable[Any]) -> None:
    """Raise ValueError for numbers whose common denominator is so long that sums take minutes."""
    common = 1
    for value in values:
        if isinstance(value, Fraction):
            common = math.lcm(common, value.denominator)
            if common.bit_length() > _COMMON_BITS:
                raise wrong(name, f"fractions with a denominator below 2**{_COMMON_BITS}", "others")
