"""Shorter formulas of mechanics: polynomials in sines, cosines and velocities, cos**2 + sin**2 = 1.

A formula is expanded into monomials. In an expansion sin**2 becomes
1 - cos**2, or cos**2 becomes 1 - sin**2, which leaves fewer monomials. Then common factors are
collected. Differences such as q - 1 may lose digits if they are expanded, so that the part of a
formula without velocities, such as a potential, stays as it is.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from ..core.expressions.programs import (
    depending,
    emitted_with_zeros,
    needed_for,
    program_of,
    renamed,
)
from .tolerances import MOST_MONOMIALS, ROUNDING_OF_COEFFICIENT

Monomial = tuple[tuple[int, int], ...]  # (operand, power), sorted
Polynomial = dict[Monomial, float]


class _TooLong(Exception):
    """An expansion has too many monomials, or a function of velocities."""


def shorter(values: Any, operands: Sequence[Any], velocities: Sequence[int] | None) -> list[Any]:
    """Return operands of the same formulas, expanded and collected if that needs less operations.

    values       the `Expressions` of the operands
    velocities   numbers of the velocities; None if parts without velocities are expanded, too
    """
    formulas = _Formulas(values, operands, velocities)
    found = [formulas.collected(a) for a in operands]
    is_shorter = _length(values, found) < _length(values, operands)
    return found if is_shorter else [*operands]


def _length(values: Any, operands: Sequence[Any]) -> int:
    return len(needed_for(values.operations, operands))


class _Formulas:
    """Expansions of the operands of some formulas.

    moving     the numbers of values that depend on velocities
    at_rest    {operand: operand of the same formula for the velocity 0}
    """

    def __init__(self, values: Any, operands: Sequence[Any], velocities: Any) -> None:
        self.values, self.is_whole = values, velocities is None
        self.known = dict[Any, Polynomial | None]()  # None for an expansion that is too long
        self.moving, self.at_rest = set[int](), dict[Any, Any]()
        if velocities is None:
            return
        program = program_of([*values.operations], [*operands])
        self.moving = depending(program.operations, velocities)
        new: dict[Any, Any] = dict.fromkeys(velocities, 0.0)
        for name, number, of in program.operations:
            new[number] = number
            if number in self.moving:
                new[number] = emitted_with_zeros(values.emit, name, [*renamed(of, new)])
        self.at_rest = dict(zip(operands, renamed(operands, new), strict=True))

    def collected(self, operand: Any) -> Any:
        """Return the operand of the collected formula; `operand` itself if it is too long."""
        if isinstance(operand, float) or not (self.is_whole or operand in self.moving):
            return operand
        try:
            polynomial = self._reduced(self.expanded(operand))
        except _TooLong:
            return operand
        if self.is_whole:
            return self._emitted(polynomial)
        moved = {m: c for m, c in polynomial.items() if any(a in self.moving for a, _ in m)}
        rest, total = self.at_rest[operand], self._emitted(moved)
        if isinstance(rest, float) and rest == 0.0:
            return total
        if isinstance(total, float) and total == 0.0:
            return rest
        return self.values.emit("fadd", total, rest)

    def expanded(self, operand: Any) -> Polynomial:
        """Return {monomial: coefficient} of an operand."""
        if isinstance(operand, float):
            return {(): operand} if operand else {}
        if operand not in self.known:
            self.known[operand] = None
            self.known[operand] = self._expanded(operand)
        if (found := self.known[operand]) is None:
            raise _TooLong
        return found

    def _expanded(self, operand: int) -> Polynomial:
        instruction, of = self.values.parts_of(operand)
        if instruction in ("fadd", "fsub"):
            a, b = map(self.expanded, of)
            return _sum(a, b, 1 if instruction == "fadd" else -1)
        if instruction == "fmul":
            a, b = map(self.expanded, of)
            return _product(a, b)
        if instruction and operand in self.moving:
            raise _TooLong
        return {((operand, 1),): 1.0}

    def _reduced(self, polynomial: Polynomial) -> Polynomial:
        """Return the polynomial with cos**2 + sin**2 = 1 for each angle."""
        angles: dict[Any, dict[str, int]] = {}
        for a in {a for monomial in polynomial for a, _ in monomial}:
            name, of = self.values.parts_of(a)
            if name in ("sin", "cos"):
                angles.setdefault(of[0], {})[name] = a
        for angle in sorted(angles):
            pair = [angles[angle].get(n) or self.values.emit(n, angle) for n in ("sin", "cos")]
            forms = [polynomial, *(_without_squares(polynomial, *p) for p in (pair, pair[::-1]))]
            polynomial = min(forms, key=len)
        return polynomial

    def _emitted(self, polynomial: Polynomial) -> Any:
        """Emit a polynomial, with the factor that most monomials have in common outside."""
        emit, total = self.values.emit, None
        if not polynomial:
            return 0.0
        counts = Counter(a for monomial in polynomial for a, _ in monomial)
        if not counts:
            return polynomial[()]
        most = max(counts.values())
        if len(polynomial) == 1:
            [(monomial, coefficient)] = polynomial.items()
            for a, power in sorted(monomial, key=lambda each: each[0] not in self.values.fixed):
                for _ in range(power):
                    total = a if total is None else emit("fmul", total, a)
            return total if coefficient == 1.0 else emit("fmul", coefficient, total)
        if most == 1:
            return self._sum_of([self._emitted({m: c}) for m, c in polynomial.items()])
        factor = min(a for a, count in counts.items() if count == most)
        inner, outer = dict[Monomial, float](), dict[Monomial, float]()
        for monomial, coefficient in polynomial.items():
            powers = dict(monomial)
            if factor in powers:
                powers[factor] -= 1
                rest = tuple((a, n) for a, n in powers.items() if n)
                inner[rest] = coefficient
            else:
                outer[monomial] = coefficient
        product = emit("fmul", factor, self._emitted(inner))
        return self._sum_of([product, self._emitted(outer)] if outer else [product])

    def _sum_of(self, operands: list[Any]) -> Any:
        total = operands[0]
        for a in operands[1:]:
            total = self.values.emit("fadd", total, a)
        return total


def _sum(a: Polynomial, b: Polynomial, sign: int) -> Polynomial:
    total = dict(a)
    for monomial, coefficient in b.items():
        old = total.get(monomial, 0.0)
        total[monomial] = old + sign * coefficient
        if abs(total[monomial]) <= ROUNDING_OF_COEFFICIENT * abs(old):
            del total[monomial]
    return _checked(total)


def _product(a: Polynomial, b: Polynomial) -> Polynomial:
    total: Polynomial = {}
    if len(a) * len(b) > 4 * MOST_MONOMIALS:
        raise _TooLong
    for m, c in a.items():
        part: Polynomial = {}
        for n, d in b.items():
            powers = dict(m)
            for atom, power in n:
                powers[atom] = powers.get(atom, 0) + power
            part[tuple(sorted(powers.items()))] = c * d
        total = _sum(total, part, 1)
    return total


def _checked(polynomial: Polynomial) -> Polynomial:
    if len(polynomial) > MOST_MONOMIALS:
        raise _TooLong
    return polynomial


def _without_squares(polynomial: Polynomial, s: int, c: int) -> Polynomial:
    """Return the polynomial with 1 - c**2 in place of s**2."""
    total: Polynomial = {}
    for monomial, coefficient in polynomial.items():
        powers = dict(monomial)
        half, odd = divmod(powers.pop(s, 0), 2)
        if odd:
            powers[s] = 1
        square: Polynomial = {(): 1.0, ((c, 2),): -1.0}
        part: Polynomial = {tuple(sorted(powers.items())): coefficient}
        for _ in range(half):
            part = _product(part, square)
        total = _sum(total, part, 1)
    return total
