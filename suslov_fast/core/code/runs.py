"""Long lists of operations, which one loop carries out in place of code of their own.

LLVM takes 10 s for the list of a chain of 1024 variables, and longer to optimise it. A `Program`
has the operations of a list in runs: those of a run have the same kind, and none waits for another
one. The code of `listed_code` is common to all programs: it takes run after run, and reads and
writes rows of W lanes. A sum of products, which is what most of a list consists of, is one
operation, whose sum stays in a register. Bits are those of `operations.evaluate`.

For one orbit, reading the places of operands takes longer than the arithmetic. So the values of a
run are in neighbouring rows, in the order in which a later run reads them. Operations whose
operands are in neighbouring rows, too, two thirds of those of a lattice, are regular runs, whose
code reads the places of the first operation alone.
"""

import functools
import math
from collections import Counter, defaultdict
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np

from ..lists.right_hand_side import needed_for
from ..lists.step import OF_LIBRARY, OF_LISTS, OF_TRUTH_VALUES

# An operation is (instruction, kinds of its operands): "r" is a row, "t" a number of the table.
# "sum" is a start, if there is one, plus products; its length is their number, 0 if above SHORT.
SHORT = 3
JOINING = ("and", "or", "xor")
ARITHMETIC = ("fadd", "fsub", "fdiv", "max", "min", "copysign")
CALLED = (*OF_LISTS, *OF_LIBRARY)
OF_TWO = ("pow", "hypot", "atan2")
KINDS = [
    *((f"sum{n}", start + pair) for n in range(SHORT + 1) for start in ("", "r", "t")
      for pair in ("rr", "tr")),
    *((instruction, a + b) for instruction in (*ARITHMETIC, *OF_TRUTH_VALUES, *OF_TWO)
      if instruction not in JOINING for a, b in product("rt", "rt")),
    *((instruction, "rr") for instruction in JOINING),
    *(("select", "r" + a + b) for a, b in product("rt", "rt")),
    *((function, "r") for function in CALLED if function not in OF_TWO),
    *((function, "r") for function in ("fabs", "sqrt", "floor")),
    ("copy", "r"),
]  # fmt: skip
_NUMBER_OF = {kind: number for number, kind in enumerate(KINDS)}
LEAST = 8  # operations of a regular run
# Kinds that have regular runs. Others are rare, and LLVM would compile a loop for each.
REGULAR = [
    number
    for number, (instruction, kinds) in enumerate(KINDS)
    if kinds.count("t") < 2 and instruction not in CALLED
]


def operand_kinds(kind, n=2):
    """Return the kinds of the operands of an operation of a kind; a long sum has n of them."""
    instruction, kinds = KINDS[kind]
    if "sum" not in instruction:
        return kinds
    return kinds[:-2] + kinds[-2:] * (int(instruction[3:]) or n // 2)


class Runs(NamedTuple):
    """Runs of operations.

    The kind of a regular run is larger by the number of KINDS. `heads` has the number of its
    operations in place of the bytes of one, and `places` those of its first operation.
    """

    heads: np.ndarray  # (runs, 3): the kind, and the bytes of `places` of an operation and of all
    places: np.ndarray  # of each operation: the row of its value, and places of its operands


class Numbers:
    """The numbers that are no rows: those of `Step.table`, constants, and copies of both.

    A regular run reads copies, one after the other.
    """

    def __init__(self, step):
        self.in_table, self.step = len(step.table), step
        self.constants, self.order = {}, [*range(self.in_table)]

    def place(self, operand):
        """Return the place of a constant or of a value of the table."""
        if not isinstance(operand, float):
            return self.step.places[operand]
        key = operand, math.copysign(1.0, operand)  # 0 equals -0
        if key not in self.constants:
            self.order.append(self.in_table + len(self.constants))
            self.constants[key] = len(self.order) - 1
        return self.constants[key]

    def copied(self, places):
        """Return the place of the first of copies of numbers."""
        self.order += [self.order[place] for place in places]
        return len(self.order) - len(places)

    @functools.cached_property
    def _arrays(self):
        constants = np.array([constant for constant, _ in self.constants], float)
        return constants[:, np.newaxis], np.array(self.order, int)

    def of(self, table):
        """Return the numbers (-, W) of a table (n, W), when all have places."""
        constants, order = self._arrays
        constants = np.broadcast_to(constants, (len(constants), table.shape[1]))
        return np.concatenate([table, constants])[order]


class Program:
    """Operations of a step (`operations.Step`) as runs, on `rows` rows of lanes.

    The first D rows have the state, and the rows `results` the values with these numbers. The first
    run copies the state, to the order in which it is read.
    """

    def __init__(self, step, operations, results, numbers):
        self.step, self.numbers = step, numbers
        uses = Counter(a for *_, operands in operations for a in operands)
        uses.update(results)
        operations = _with_sums(operations, uses, step.places)
        runs = _in_order_of_use(self._runs(operations, _tests(operations, results)))
        last = {}  # run that reads a value, after which its row is free
        for n, (_, values) in enumerate(runs):
            for number, operands in values:
                last.update(dict.fromkeys((number, *operands), n))
        last.update(dict.fromkeys([*range(-step.D, 0), *results], np.inf))
        ending = defaultdict(list)
        for number, n in last.items():
            ending[n].append(number)
        self._is_free, self._row = bytearray(step.D), {-1 - k: k for k in range(step.D)}
        self.runs = self._placed(runs, ending)
        self.rows = len(self._is_free)
        self.results = np.array([self._row[number] for number in results])

    def _runs(self, operations, tests):
        """Return runs ((kind, operands of each), [(number, operands)]), in a possible order.

        The first one copies the state, whose values -1 - k become the values k. Tests come last,
        because those of a kind then are in one run.
        """
        levels, runs = ({}, {}), defaultdict(list)
        runs[False, 0, _NUMBER_OF["copy", "r"], 1] = [(k, (-1 - k,)) for k in range(self.step.D)]
        for instruction, number, operands in operations:
            kinds = "".join("t" if self._is_in_table(a) else "r" for a in operands)
            is_test = number in tests
            level = levels[is_test]
            level[number] = 1 + max((level.get(a, 0) for a in operands), default=0)
            if instruction == "sum":
                n = len(operands) // 2
                instruction = f"sum{n if n <= SHORT else 0}"
                kinds = kinds[: 2 + len(operands) % 2]
            kind = _NUMBER_OF[instruction, kinds], len(operands)
            runs[is_test, level[number], *kind].append((number, operands))
        return [(key[2:], runs[key]) for key in sorted(runs)]

    def _is_in_table(self, operand):
        return isinstance(operand, float) or operand in self.step.places

    def _placed(self, runs, ending):
        """Give each value of runs a row; return `Runs`."""
        heads, places = [], [np.empty(0, np.int32)]
        for run, ((kind, n), operations) in enumerate(runs):
            self._take_rows([number for number, _ in operations])
            of_run = np.array(
                [[self._row[number], *map(self._place, of)] for number, of in operations], np.int32
            )
            is_left = np.ones(len(of_run), bool)
            for begin, end in _regular(kind, of_run):
                first, is_left[begin:end] = of_run[begin].copy(), False
                for k, each in enumerate(operand_kinds(kind, n), 1):
                    if each == "t":
                        first[k] = self.numbers.copied(of_run[begin:end, k])
                heads.append((len(KINDS) + kind, end - begin, first.nbytes))
                places.append(first)
            if is_left.any():
                left = of_run[is_left]
                heads.append((kind, left[0].nbytes, left.nbytes))
                places.append(left.ravel())
            for number in ending[run]:
                if number in self._row:
                    self._is_free[self._row[number]] = 1
        return Runs(np.array(heads, np.int64).reshape(-1, 3), np.concatenate(places))

    def _take_rows(self, numbers):
        """Give values free rows that follow each other, or as many of them as possible."""
        parts = [numbers]
        while parts:
            part = parts.pop()
            n, first = len(part), self._is_free.find(b"\1" * len(part))
            if first < 0 and n > 1:
                parts += part[n // 2 :], part[: n // 2]
                continue
            if first < 0:
                first = len(self._is_free)
            self._is_free[first : first + n] = bytes(n)
            self._row.update(zip(part, range(first, first + n), strict=True))

    def _place(self, operand):
        return self.numbers.place(operand) if self._is_in_table(operand) else self._row[operand]


def _tests(operations, results):
    """Return the numbers of values that only lead to truth values among the results."""
    instructions = {number: instruction for instruction, number, _ in operations}
    needed = {a for a in results if instructions.get(a) not in OF_TRUTH_VALUES}
    tests = set()
    for _, number, operands in reversed(operations):
        if number in needed:
            needed.update(operands)
        else:
            tests.add(number)
    return tests


def _in_order_of_use(runs):
    """Return runs whose values are in the order in which a later run first reads them."""
    first = {}
    for run in reversed(range(len(runs))):
        (_, n), operations = runs[run]
        operations.sort(key=lambda operation: first.get(operation[0], (len(runs),)))
        for slot in reversed(range(n)):
            for place in reversed(range(len(operations))):
                first[operations[place][1][slot]] = run, slot, place
    return runs


def _regular(kind, places):
    """Return the begins and ends of regular runs among operations of a kind with these places."""
    if len(places) < LEAST or kind not in REGULAR:
        return []
    kinds = operand_kinds(kind, places.shape[1] - 1)
    in_rows = [0, *(k for k, each in enumerate(kinds, 1) if each == "r")]
    follows = (np.diff(places[:, in_rows], axis=0) == 1).all(axis=1)
    ends = [0, *(np.flatnonzero(~follows) + 1).tolist(), len(places)]
    return [(a, b) for a, b in pairwise(ends) if b - a >= LEAST]


def _with_sums(operations, uses, places):
    """Return operations in which products and sums of them are "sum", with a start and factors.

    A value that is used elsewhere, too, keeps an operation of its own.
    """
    found, kinds = {}, {}
    for instruction, number, operands in operations:
        a, b = (*operands, None)[:2]
        if instruction == "fmul":
            if isinstance(b, float) or b in places:
                a, b = b, a
            kinds[number] = "t" if isinstance(a, float) or a in places else "r"
            instruction, operands = "sum", (a, b)
        elif instruction == "fadd" and b in kinds and uses[b] == 1 and len(found[b][1]) == 2:
            start = (a,)
            if uses[a] == 1 and kinds.get(a) == kinds[b]:
                start = found.pop(a)[1]
            kinds[number] = kinds[b]
            instruction, operands = "sum", (*start, *found.pop(b)[1])
        found[number] = instruction, operands
    return [(instruction, number, operands) for number, (instruction, operands) in found.items()]


class _Inputs(NamedTuple):
    """The attributes of a step that `Program` reads."""

    D: int
    places: dict
    table: list


def program_of(rows, table, operations, results):
    """Return the `Program` of the operations that the values `results` need, and its `Numbers`.

    Values are given as `rows` of lanes, and as numbers of a `table`. A truth value among the
    results is true where its row has the sign bit.
    """
    first = len(rows) + len(table)
    names = dict(zip([*rows, *table], range(first), strict=True))
    places = {names[number]: k for k, number in enumerate(table)}
    renamed = []

    def add(instruction, *operands):
        renamed.append((instruction, first + len(renamed), operands))
        return renamed[-1][1]

    for instruction, number, operands in needed_for(operations, results):
        operands = (a if isinstance(a, float) else names[a] for a in operands)
        names[number] = add(instruction, *operands)
    results = [names[number] for number in results]
    copies = {name: add("fadd", name, -0.0) for name in results if name in places}
    of_list = _Inputs(len(rows), places, table)
    numbers = Numbers(of_list)
    results = [copies.get(name, name) for name in results]
    return Program(of_list, renamed, results, numbers), numbers


class Programs(NamedTuple):
    """The programs of a step: for all states, and for states where `good` is false."""

    usual: Program  # its results are `Step.after` and `good`
    rare: Program  # `after_rare`, `good`, `accurate`, `negative`; `changed` if it is not None
    numbers: Numbers  # that both read
    rows: int


@functools.lru_cache(8)
def programs_of(step):
    """Return the `Programs` of a step."""
    numbers = Numbers(step)
    usual = Program(step, step.usual, [*step.after, step.good], numbers)
    results = [*step.after_rare, step.good, step.accurate, step.negative]
    results += [] if step.changed is None else [step.changed]
    rare = Program(step, [*step.usual, *step.rare], results, numbers)
    return Programs(usual, rare, numbers, max(usual.rows, rare.rows))
