"""Checks of arguments that several public functions have."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ..checks import integer, short, wrong
from .polynomials import Exponents, exponents_up_to

_MOST = 500  # monomials of relations along orbits


def check_unknowns(name: str, degree: int, n: int, most: int = 300) -> None:
    """Raise an error if polynomials of a degree in n variables have too many coefficients."""
    if (unknowns := math.comb(n + degree, n)) > most:
        largest = next(d for d in range(degree) if math.comb(n + d + 1, n) > most)
        expected = f"at most {largest} for {n} variables ({math.comb(n + largest, n)} coefficients)"
        raise wrong(name, expected, f"{degree} ({unknowns} coefficients)")


def exponents_of(monomials: Any, n: int) -> Exponents:
    """Return the exponents of monomials in n variables, those up to a degree in ascending order."""
    if isinstance(monomials, int | np.integer):
        degree = integer("monomials", monomials, 0)
        check_unknowns("monomials", degree, n, _MOST)
        return exponents_up_to(degree, n)
    expected = f"a degree, or a list of at most {_MOST} different tuples of {n} exponents"
    try:
        exponents = tuple(tuple(integer("monomials", e, 0) for e in each) for each in monomials)
    except TypeError:
        raise wrong("monomials", expected, short(monomials), TypeError) from None
    are_different = len({*exponents}) == len(exponents)
    if {*map(len, exponents)} != {n} or not are_different or len(exponents) > _MOST:
        raise wrong("monomials", expected, short(monomials))
    return exponents


def progress_function(progress: Any) -> Callable[[int, int], object]:
    """Return the function to call with the numbers of parts done and known; None does nothing."""
    if progress is None:
        return lambda done, parts: None
    if not callable(progress):
        expected = "a function that is called as progress(done, parts)"
        raise wrong("progress", expected, type(progress).__name__, TypeError)
    return progress  # type: ignore[no-any-return]
