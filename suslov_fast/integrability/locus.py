"""For which values of a parameter has a map more relations along its orbits?"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from ..bodies.field import QuadraticField
from ..checks import integer, kind_of, wrong
from . import arithmetic
from .arithmetic import Exponents
from .bases import exponents_of
from .maps import RationalMap
from .residues import Maps, relations, residue

_GENERAL = 3  # general values that tell how many relations there are in general
_PRIMES = 211, 223  # all of whose residues are tried
_STARTS = 3  # orbits modulo these: some of them are short
_EXTRA = 10  # points more than monomials
_ENTRIES = 2_000_000  # of matrices whose ranks are computed together


class Special(NamedTuple):
    """A value of a parameter with more relations than a general one."""

    value: Fraction
    relations: int
    degenerate: str  # "" or why the field is no longer of the same kind


class Locus(list[Special]):
    """The values that `locus` found, in ascending order.

    `generic` is the number of relations of a general value and `height` the largest numerator or
    denominator that was looked at. `left_out` has the values for which there is no field or map,
    and `algebraic`, by prime, the residues with more relations that belong to no listed value:
    those of algebraic numbers, or of fractions of a greater height.
    """

    def __init__(
        self,
        found: Sequence[Special],
        generic: int,
        height: int,
        left_out: Sequence[Fraction],
        algebraic: dict[int, tuple[int, ...]],
    ) -> None:
        super().__init__(found)
        self.generic, self.height = generic, height
        self.left_out, self.algebraic = tuple(left_out), algebraic

    def __repr__(self) -> str:
        found = ", ".join(
            f"{each.value} ({each.relations}{f', {each.degenerate}' * bool(each.degenerate)})"
            for each in self
        )
        text = f"general values: {self.generic} relations; "
        text += f"more at {found}" if found else "more at none"
        text += f", of all fractions of height up to {self.height}"
        if self.left_out:
            text += f" but {', '.join(map(str, self.left_out))}, without a map"
        if others := [f"{len(r)} modulo {p}" for p, r in self.algebraic.items() if r]:
            text += f"; residues of other values: {', '.join(others)}"
        return f"Locus({text})"


def locus(
    f: Callable[[Any], Any],
    degree: int,
    *,
    height: int = 10,
    monomials: Sequence[Sequence[int]] | None = None,
    seed: int = 0,
    progress: Any = None,
) -> Locus:
    """Find the values of a parameter for which a map has more relations along its orbits.

    For each fraction up to a height, the linear relations between monomials along an orbit are
    counted modulo a prime, at a general eps. Values with more relations than general ones are
    confirmed modulo another prime, from another point, and at another eps. More relations may mean
    more integrals, or invariant curves only: `report` says which.

    Parameters
    ----------
    f : callable
        It takes a number, the parameter, and returns a QuadraticField or a map. It is called with
        fractions.
    degree : int
        Largest degree of the monomials.
    height : int, optional
        Largest numerator and denominator of the values, by default 10.
    monomials : sequence of exponents, optional
        The exponents (e1, ..., eD) of the monomials, in place of all up to the degree.
    seed : int, optional
        Seed of the random primes, points and step sizes.
    progress : callable, optional
        Called as ``progress(done, parts)`` after each group of values.

    Returns
    -------
    Locus
        A list of named tuples `value, relations, degenerate`.

    Raises
    ------
    TypeError, ValueError
        If f returns something else, or fields of different dimensions.
    ArithmeticError
        If there is no map for general values.

    Examples
    --------
    >>> from suslov_fast import QuadraticField
    >>> from suslov_fast.integrability import locus
    >>> def henon_heiles(c):
    ...     H = lambda x: (x[2]**2 + x[3]**2) / 2 + x[0]**2*x[1] + c*x[1]**3 / 3
    ...     return QuadraticField.from_hamiltonian(H, 4)
    >>> locus(henon_heiles, degree=3, height=3)
    Locus(general values: 0 relations; more at 1 (2), of all fractions of height up to 3)
    """
    degree, height = integer("degree", degree, 1), integer("height", height, 1)
    rng = random.Random(integer("seed", seed, 0))
    if progress is not None and not callable(progress):
        expected = "None or a callable (done, parts)"
        raise wrong("progress", expected, type(progress).__name__, TypeError)
    of = _Values(f, degree, monomials)
    general = [
        Fraction(rng.randrange(10**3, 10**6), rng.randrange(10**3, 10**6) | 1)
        for _ in range(_GENERAL)
    ]
    values = fractions_up_to(height)
    parts = 2 + len(_PRIMES)

    def done(count: int) -> None:
        if progress is not None:
            progress(count, parts)

    of.first(general)
    usual = [each for each in of.counts(general, rng) if each >= 0]
    if not usual:
        raise ArithmeticError("f: expected a map for general values, got none")
    generic = min(usual)
    first = of.counts(values, rng)
    done(1)
    more = [v for v, count in zip(values, first, strict=True) if count > generic]
    again = of.counts(more, rng)
    counts = dict(zip(values, first, strict=True))
    found = [
        Special(v, min(count, counts[v]), of.degenerate(v))
        for v, count in zip(more, again, strict=True)
        if count > generic
    ]
    done(2)
    algebraic = {}
    for number, p in enumerate(_PRIMES, start=3):
        algebraic[p] = of.other_residues(p, generic, [each.value for each in found], rng)
        done(number)
    left_out = [v for v, count in counts.items() if count < 0]
    return Locus(found, generic, height, left_out, algebraic)


def fractions_up_to(height: int) -> list[Fraction]:
    """Return the fractions whose numerator and denominator are at most `height`, ascending."""
    pairs = ((a, b) for b in range(1, height + 1) for a in range(-height, height + 1))
    return sorted({Fraction(a, b) for a, b in pairs})


def _is_arithmetic(error: BaseException) -> bool:
    """Return True for an error of f without a value, also where a tracer of f reports it."""
    return isinstance(error, ArithmeticError) or isinstance(error.__cause__, ArithmeticError)


class _Values:
    """The fields or maps of a function at exact numbers, and their relations."""

    def __init__(self, f: Any, degree: int, monomials: Any) -> None:
        if not callable(f):
            raise wrong("f", "a function of the parameter", kind_of(f), TypeError)
        self._f, self._degree, self._monomials = f, degree, monomials
        self._known: dict[Fraction, Any] = {}
        self._exponents: Exponents = ()
        self._shape: Any = None

    def first(self, values: Sequence[Fraction]) -> None:
        """Find out what f returns, from general values."""
        error: Any = None
        for value in values:
            try:
                given = self._f(value)
            except (ArithmeticError, ValueError) as raised:
                if not _is_arithmetic(raised):
                    raise
                error = raised
                continue
            is_field = isinstance(given, QuadraticField)
            if (not is_field and not isinstance(given, RationalMap)) or (is_field and given.shape):
                got = f"{kind_of(given)} at {value}"
                raise wrong("f", "a single QuadraticField or map for each number", got, TypeError)
            self._shape = given.dimension, is_field
            given_monomials = self._degree if self._monomials is None else self._monomials
            self._exponents = exponents_of(given_monomials, given.dimension)
            return
        raise ArithmeticError("f: expected a map for general values, got none") from error

    def at(self, value: Fraction) -> Any:
        """Return the field or map; None if there is none."""
        if value not in self._known:
            try:
                given = self._f(value)
            except (ArithmeticError, ValueError) as error:
                if not _is_arithmetic(error):
                    raise
                given = None
            if given is not None:
                shape = getattr(given, "dimension", None), isinstance(given, QuadraticField)
                if shape != self._shape:
                    kind = "field" if self._shape[1] else "map"
                    expected = f"a {kind} of {self._shape[0]} variables for each number"
                    raise wrong("f", expected, f"{kind_of(given)} at {value}")
            self._known[value] = given
        return self._known[value]

    def counts(self, values: Sequence[Fraction], rng: random.Random) -> list[int]:
        """Return the numbers of relations, of general orbits and eps; -1 if there is no map."""
        p = arithmetic.random_prime(rng, 31)
        eps, draws = rng.randrange(2, p), np.random.default_rng(rng.getrandbits(32))
        return self._counts(values, p, eps, draws)

    def _counts(self, values: Sequence[Fraction], p: int, eps: int, draws: Any) -> list[int]:
        found = dict.fromkeys(values, -1)
        there = [v for v in values if self.at(v) is not None]
        size = max(1, _ENTRIES // len(self._exponents) ** 2)
        state = draws.bit_generator.state
        for begin in range(0, len(there), size):
            part = there[begin : begin + size]
            draws.bit_generator.state = state  # the same point for all
            maps = Maps([self.at(v) for v in part], p, eps)
            counts = relations(maps, self._exponents, draws, _EXTRA)
            found |= dict(zip(part, map(int, counts), strict=True))
        return [found[v] for v in values]

    def other_residues(
        self, p: int, generic: int, known: Sequence[Fraction], rng: random.Random
    ) -> tuple[int, ...]:
        """Return the residues modulo a small prime with more relations that no known value has."""
        residues = {residue(v, p) for v in known}
        values = [Fraction(k) for k in range(p) if k not in residues]
        for _ in range(_STARTS):
            eps, least = rng.randrange(2, p - 1), dict.fromkeys(values, math.inf)
            for _ in range(_STARTS):
                draws = np.random.default_rng(rng.getrandbits(32))
                counts = self._counts(values, p, eps, draws)
                for v, count in zip(values, counts, strict=True):
                    least[v] = min(least[v], count if count >= 0 else math.inf)
            values = [v for v, count in least.items() if generic < count < math.inf]
        return tuple(map(int, values))

    def degenerate(self, value: Fraction) -> str:
        """Return why a field is of another kind than in general; "" if it is not."""
        given = self.at(value)
        if not isinstance(given, QuadraticField):
            return ""
        if not np.any(given.table[:, :-1, :-1] != 0):
            return "the field is linear"
        rows = zip(given.names, given.table, strict=True)
        zeros = [name for name, row in rows if not np.any(row != 0)]
        return " and ".join(f"{name}' = 0" for name in zeros)
