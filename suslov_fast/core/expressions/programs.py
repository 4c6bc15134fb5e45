"""Expression programs: values, the operations that compute them, and programs made of programs."""

import math
from itertools import chain
from typing import NamedTuple

import numpy as np

from .function_records import same
from .numpy_evaluation import FUNCTIONS, OF_NUMBERS, OF_TRUTH_VALUES
from .values import Number


def length_of(operations):
    """Return how many machine instructions `operations` take; a "sum" of n operands takes n - 1."""
    return sum(len(of) - 1 if instruction == "sum" else 1 for instruction, _, of in operations)


_NUMBERS = {int}  # the types of operands that are no constants


class Values:
    """Numbered values, and the operations that compute them, in order.

    The first `count` values need no operation. An operand is the number of a value, an integer, or
    a constant, a float. `fixed` contains the numbers of values that depend on parameters alone.
    """

    def __init__(self, count, fixed):
        self.count, self.fixed, self.operations = count, set(fixed), []

    def emit(self, instruction, *operands):
        """Add the operation `instruction` on `operands`; return the number of its value."""
        number = self.count
        self.count += 1
        self.operations.append((instruction, number, operands))
        if instruction in OF_NUMBERS and all(map(self.is_fixed, operands)):
            self.fixed.add(number)
        return number

    def is_fixed(self, operand):
        """Return True if an operand is a constant, or depends on parameters alone."""
        return isinstance(operand, float) or operand in self.fixed

    def total(self, start, products):
        """Return the operand of start + a c + ..., for the pairs (a, c) in `products`; None is 0.

        Pairs with a factor that depends on parameters alone are in "sum" operations of their own.
        """
        return self.total_of(start, [*chain.from_iterable(products)])

    def total_of(self, start, factors):
        """Return `total`, start + a c + ..., for a flat list of factors [a, c, ...]."""
        operands, kind = [] if start is None else [start], None
        if factors and self.fixed.isdisjoint(factors) and float not in map(type, factors):
            return self.emit("sum", *operands, *factors)
        for a, c in zip(factors[::2], factors[1::2], strict=True):
            of_pair = self.is_fixed(a) + self.is_fixed(c)
            if len(operands) > 1 and of_pair != kind:
                operands = [self.emit("sum", *operands)]
            if of_pair == 2:
                product = self.emit("fmul", a, c)
                operands = [self.emit("fadd", *operands, product) if operands else product]
            else:
                operands += (c, a) if self.is_fixed(c) else (a, c)
            kind = of_pair
        if len(operands) > 1:
            return self.emit("sum", *operands)
        return operands[0] if operands else None

    def number(self, operand):
        """Return the `Number` of an operand, to write formulas with Python's operators."""
        return Number(self.emit, operand)


def dot(emit, pairs, total=None):
    """Emit total + a b + ... for pairs (a, b); return its operand, or None if it has no terms."""
    for a, b in pairs:
        product = emit("fmul", a, b)
        total = product if total is None else emit("fadd", total, product)
    return total


class Program(NamedTuple):
    """Operations (instruction, number of value, operands), and results: numbers, or constants."""

    operations: list
    results: list


class Expressions(Values):
    """Values without repetition: equal operations share a value, and constants are computed.

    of            {number of a value: (instruction, operands)}
    fixed_truths  numbers of truth values that depend on parameters alone
    written       {number of a value: (name, operands, ...)} of functions that a user wrote, such as
                  powers, which may take several operations
    """

    def __init__(self, count, fixed=()):
        super().__init__(count, fixed)
        self._known, self.of, self.written, self.fixed_truths = {}, {}, {}, set()

    def emit(self, instruction, *operands):
        """Return the number of the value of an operation, or a constant if it is constant."""
        # In keys constants are texts: else 1.0 would equal the number 1 of a value, and 0.0 -0.0.
        key = instruction, *operands
        if {*map(type, operands)} != _NUMBERS:
            operands = (*(float(a) if isinstance(a, float) else a for a in operands),)
            key = instruction, *(repr(a) if type(a) is float else a for a in operands)
        if key not in self._known:
            self._known[key] = self._new(instruction, operands)
        return self._known[key]

    def take_written(self, others, new):
        """Copy `written` functions from `others`; `new` is {number there: operand here}."""
        for number, (name, operands, *tables) in others.written.items():
            of = [a if isinstance(a, float) else new.get(a) for a in operands]
            place = new.get(number)
            if isinstance(place, int) and None not in of:
                self.written.setdefault(place, (name, (*of,), *tables))

    def _new(self, instruction, operands):
        is_constant = all(type(a) is float for a in operands)
        is_number = instruction not in OF_TRUTH_VALUES and not instruction.startswith("matrix ")
        if is_constant and is_number:
            with np.errstate(all="ignore"):
                return float(FUNCTIONS[instruction](*operands))
        simple = self._simpler(instruction, operands)
        if simple is not None:
            return simple
        number = super().emit(instruction, *operands)
        if all(self.is_fixed(a) or a in self.fixed_truths for a in operands):
            is_truth = instruction in OF_TRUTH_VALUES
            (self.fixed_truths if is_truth else self.fixed).add(number)
        self.of[number] = instruction, operands
        return number

    def parts_of(self, operand):
        """Return the instruction and the operands of a value; ("", ()) for a constant."""
        return ("", ()) if isinstance(operand, float) else self.of.get(operand, ("", ()))

    def _simpler(self, instruction, operands):
        """Return an operand equal to `instruction` on `operands` by cheaper operations, or None."""
        if instruction == "fdiv" and _is_power_of_2(operands[1]):
            return self.emit("fmul", 1.0 / operands[1], operands[0])
        if instruction == "fmul":
            a, b = operands
            if isinstance(b, float):
                return self.emit("fmul", b, a)
            if isinstance(a, float) and a == 1.0:
                return b
            inner, of = self.parts_of(b)
            has_constants = isinstance(a, float) and of and isinstance(of[0], float)
            if inner == "fmul" and has_constants and any(map(_is_power_of_2, (a, of[0]))):
                return self.emit("fmul", a * of[0], of[1])
            if inner == "fsub" and isinstance(a, float) and a == -1.0:
                return self.emit("fsub", *of[::-1])
        if instruction in ("fadd", "fsub"):
            inner, of = self.parts_of(operands[1])
            if inner == "fmul" and isinstance(of[0], float) and of[0] == -1.0:
                other = "fsub" if instruction == "fadd" else "fadd"
                return self.emit(other, operands[0], of[1])
        if instruction == "select" and same(*operands[1:]):
            return operands[1]
        return None


def _is_power_of_2(operand):
    """Return True for a constant +-2**n, n from -100 to 98, which multiplies without rounding."""
    if not isinstance(operand, float):
        return False
    fraction, exponent = math.frexp(operand)
    return abs(fraction) == 0.5 and abs(exponent) < 100


def folded(emit, name, of):
    """Emit an operation; truth values of operands and of the result may be True or False."""
    if name in OF_TRUTH_VALUES and all(isinstance(a, (float, bool)) for a in of):
        return bool(FUNCTIONS[name](*of))
    if not any(isinstance(a, bool) for a in of):
        return emit(name, *of)
    if name == "select":
        return of[1] if of[0] else of[2]
    known, other = of if isinstance(of[0], bool) else of[::-1]
    if name == "xor":
        return emit("xor", other, emit("oeq", 0.0, 0.0)) if known else other
    return other if known == (name == "and") else known


def is_zero(operand):
    """Return True if an operand is the constant 0."""
    return isinstance(operand, float) and operand == 0.0


def emitted_with_zeros(emit, name, of):
    """Emit an operation; products with 0 are 0, and sums with 0 are the other operand."""
    if name == "fmul" and any(map(is_zero, of)):
        return 0.0
    if name in ("fadd", "fsub") and is_zero(of[1]):
        return of[0]
    if name == "fadd" and is_zero(of[0]):
        return of[1]
    if name == "fsub" and is_zero(of[0]):
        return emit("fmul", -1.0, of[1])
    return emit(name, *of)


def in_order(values, results, more=0):
    """Return a copy of `Expressions` without needless operations, and the results in the copy.

    Operations are in the order in which `results` need them. The copy has `more` new parameters
    after the given values.
    """
    given = values.count - len(values.operations)
    fixed = [*(a for a in values.fixed if a < given), *range(given, given + more)]
    ordered = Expressions(given + more, fixed)
    new = {a: a for a in range(given)}
    results = emitted(ordered, Program([*_depth_first(values, results)], results), new)
    ordered.take_written(values, new)
    return ordered, results


def _depth_first(values, results):
    """Yield the operations that `results` depend on, each after the operations of its operands."""
    done, stack = set(), [(a, False) for a in reversed(results)]
    while stack:
        number, is_ready = stack.pop()
        if isinstance(number, float) or number in done or number not in values.of:
            continue
        instruction, operands = values.of[number]
        if is_ready:
            done.add(number)
            yield instruction, number, operands
        else:
            stack.append((number, True))
            stack.extend((a, False) for a in reversed(operands))


def needed_for(operations, results):
    """Return the operations, in order, that the operands `results` depend on."""
    needed, found = {a for a in results if type(a) is int}, []
    for operation in reversed(operations):
        if operation[1] in needed:
            found.append(operation)
            needed.update(a for a in operation[2] if not isinstance(a, float))
    return found[::-1]


def program_of(operations, results):
    """Return the `Program` of the operands `results`, with the operations that they depend on."""
    return Program(needed_for(operations, results), results)


def depending(operations, given):
    """Return the set of `given` numbers of values, and of all values that depend on these."""
    numbers = {*given}
    for _, number, operands in operations:
        if any(a in numbers for a in operands if not isinstance(a, float)):
            numbers.add(number)
    return numbers


def renamed(operands, new):
    """Return operands, renamed by `new`, {old: new}; constants and operands not in `new` stay."""
    return [a if isinstance(a, float) else new.get(a, a) for a in operands]


def emitted(values, program, new=None):
    """Add the operations of a `Program` to `values`; return the results there.

    `new` is {operand of the program: operand in `values`}; values of operations are added to it.
    Operands that it lacks keep their numbers.
    """
    new = {} if new is None else new
    for name, number, operands in program.operations:
        new[number] = values.emit(name, *renamed(operands, new))
    return renamed(program.results, new)


def united(programs):
    """Return one `Program` with the results of several; a number has the same value in all."""
    operations = {each[1]: each for program in programs for each in program.operations}
    results = [a for program in programs for a in program.results]
    return Program([operations[number] for number in sorted(operations)], results)
