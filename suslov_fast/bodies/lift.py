"""The definitions of the words of a lifted field, which `core.lift` evaluates."""

from typing import Any, NamedTuple


class Lift(NamedTuple):
    """The definitions of words by a state; see `bodies.lifting`. It can be hashed.

    given         components of the state
    coefficients  number of coefficients
    definitions   for each added variable its function, polynomial, and the place of its exponent
    words         the words after the state, as tuples of variables
    signs         components of the state that keep their signs along the motion
    """

    given: int
    coefficients: int
    definitions: tuple[Any, ...]
    words: tuple[tuple[int, ...], ...]
    signs: tuple[int, ...]
