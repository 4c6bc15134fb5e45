"""Long lists of operations, which one loop carries out in place of code of their own.

LLVM takes 10 s for the list of a chain of 1024 variables, and longer to optimise it. A `Program`
has the operations of a list in runs: those of a run have the same kind, and none waits for another
one. The code of `runs_code` is common to all programs: it takes run after run, and reads and
writes rows of W lanes. A sum of products, which is what most of a list consists of, is one
operation, whose sum stays in a register. Bits are those of `lists.step.evaluate`.

For one orbit, reading the places of operands takes longer than the arithmetic. So the values of a
run are in neighbouring rows, in the order in which a later run reads them. Operations whose
operands are in neighbouring rows, too, two thirds of those of a lattice, are regular runs, whose
code reads the places of the first operation alone.
"""

import functools
import math
from collections import Counter, defaultdict
from itertools import chain, pairwise, product
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
OF_TWO = ("pow", "hypot", "logaddexp", "atan2")
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
    """The numbers that are no rows: those of a table, constants, and copies of both.

    `places` has the places of values in the table. A regular run reads copies, one after the other.
    """

    def __init__(self, places):
        self.in_table, self.places = len(places), places
        self.constants, self.order = {}, [*range(self.in_table)]

    count = property(lambda self: len(self.order))

    def place(self, constant):
        """Return the place of a constant."""
        key = constant, math.copysign(1.0, constant)  # 0 equals -0
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


class _Run(NamedTuple):
    """Operations of one kind that do not wait for each other."""

    kind: int
    numbers: np.ndarray  # (operations,), of their values
    operands: np.ndarray  # (operations, operands), numbers of values


class Program:
    """Operations as runs, on `rows` rows of lanes.

    The first D rows have the values 0 to D - 1, and the rows `results` the values with these
    numbers. The first run copies the first D rows, to the order in which they are read. Within this
    class, these have the numbers after those of all values, and constants have negative numbers.
    """

    def __init__(self, D, operations, results, numbers):
        self._D, self.numbers = D, numbers
        operations = _with_sums(operations, results, numbers.places)
        runs = self._runs(operations, _tests(operations, results))
        runs = _in_order_of_use(runs, len(self._place))
        self.runs = self._placed(runs, results)
        self.rows, self.results = len(self._is_free), self._place[results]

    def _runs(self, operations, tests):
        """Return runs in a possible order, the first of which copies the first rows.

        Tests come last, because those of a kind then are in one run.
        """
        places, constants = self.numbers.places, {}
        count = 1 + max([self._D - 1, *places, *(number for _, number, _ in operations)])
        # How many operations a value waits for, one after the other: of tests, and of others.
        levels, runs = ([0] * count, [0] * count), defaultdict(list)

        def named(a):
            """Return a number in place of a constant."""
            if not isinstance(a, float):
                return a
            place = self.numbers.place(a)
            if place not in constants:
                constants[place] = -1 - len(constants)
                for level in levels:
                    level.append(0)
            return constants[place]

        for instruction, number, operands in operations:
            if float in map(type, operands):
                operands = tuple(map(named, operands))
            is_test = number in tests
            level = levels[is_test]
            level[number] = 1 + max(map(level.__getitem__, operands), default=0)
            is_sum = instruction == "sum"
            of_kind = operands[: 2 + len(operands) % 2] if is_sum else operands
            kinds = "".join("t" if a < 0 or a in places else "r" for a in of_kind)
            if is_sum:
                n = len(operands) // 2
                instruction = f"sum{n if n <= SHORT else 0}"
            key = is_test, level[number], _NUMBER_OF[instruction, kinds], len(operands)
            runs[key].append((number, operands))
        # The row of each value; the place of a number of the table, or of a constant.
        self._values, self._place = count, np.full(count + self._D + len(constants), -1)
        self._place[[*places]] = [*places.values()]
        self._place[[*constants.values()]] = [*constants]
        rows = np.arange(self._D)
        self._place[count + rows] = rows
        found = [_Run(_NUMBER_OF["copy", "r"], rows, count + rows[:, np.newaxis])]
        for key in sorted(runs):
            numbers, operands = zip(*runs[key], strict=True)
            found.append(_Run(key[2], np.array(numbers), np.array(operands)))
        return found

    def _placed(self, runs, results):
        """Give each value of runs a row; return `Runs`."""
        last = np.full(len(self._place), -1)  # run that reads a value, after which its row is free
        for n, (_, numbers, operands) in enumerate(runs):
            last[numbers] = last[operands] = n
        last[results] = len(runs)
        last[[*self.numbers.places]] = last[self._values :] = len(runs)  # they have no rows of runs
        ending, ends = np.argsort(last, kind="stable"), [*range(len(runs) + 1)]
        ends = np.searchsorted(last[ending], ends)
        heads, places, self._is_free = [], [np.empty(0, np.int32)], bytearray(self._D)
        for run, (kind, numbers, operands) in enumerate(runs):
            self._take_rows(numbers)
            of_run = np.column_stack([self._place[numbers], self._place[operands]])
            of_run = of_run.astype(np.int32)
            is_left = np.ones(len(of_run), bool)
            for begin, end in _regular(kind, of_run):
                first, is_left[begin:end] = of_run[begin].copy(), False
                for k, each in enumerate(operand_kinds(kind, operands.shape[1]), 1):
                    if each == "t":
                        first[k] = self.numbers.copied(of_run[begin:end, k])
                heads.append((len(KINDS) + kind, end - begin, first.nbytes))
                places.append(first)
            if is_left.any():
                left = of_run[is_left]
                heads.append((kind, left[0].nbytes, left.nbytes))
                places.append(left.ravel())
            ended = ending[ends[run] : ends[run + 1]]
            np.frombuffer(self._is_free, np.uint8)[self._place[ended]] = 1
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
            self._place[part] = range(first, first + n)


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


def _in_order_of_use(runs, count):
    """Return runs whose values are in the order in which a later run first reads them."""
    base = sum(operands.size for _, _, operands in runs)
    first, found = np.full(count, base), []  # the place where each value is first read
    for kind, numbers, operands in reversed(runs):
        order = np.argsort(first[numbers], kind="stable")
        numbers, operands = numbers[order], operands[order]
        base -= operands.size
        # By the first operands of all operations, then their second ones; the least place stays.
        first[operands.T.ravel()[::-1]] = np.arange(base, base + operands.size)[::-1]
        found.append(_Run(kind, numbers, operands))
    return found[::-1]


def _regular(kind, places):
    """Return the begins and ends of regular runs among operations of a kind with these places."""
    if len(places) < LEAST or kind not in REGULAR:
        return []
    kinds = operand_kinds(kind, places.shape[1] - 1)
    in_rows = [0, *(k for k, each in enumerate(kinds, 1) if each == "r")]
    follows = (np.diff(places[:, in_rows], axis=0) == 1).all(axis=1)
    ends = [0, *(np.flatnonzero(~follows) + 1).tolist(), len(places)]
    return [(a, b) for a, b in pairwise(ends) if b - a >= LEAST]


def _with_sums(operations, results, places):
    """Return operations in which products and sums of them are "sum", with a start and factors.

    A value that is used elsewhere, too, keeps an operation of its own.
    """
    found, kinds = {}, {}
    uses = Counter(chain.from_iterable(operands for *_, operands in operations))
    uses.update(results)

    for instruction, number, operands in operations:
        a, b = (*operands, None)[:2]
        if instruction == "sum":
            first = operands[len(operands) % 2]
            kinds[number] = "t" if isinstance(first, float) or first in places else "r"
        elif instruction == "fmul":
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
    numbers = Numbers(places)
    results = [copies.get(name, name) for name in results]
    return Program(len(rows), renamed, results, numbers), numbers


@functools.lru_cache(16)
def programs_of(step, are_rare):
    """Return the programs of a step, a list of one, with numbers of its own.

    The usual one has the values `after` and `good`; for states where `good` is false that of the
    rare one has `after_rare`, `good`, `accurate`, `negative`, and `changed` if that is not None.
    """
    operations, results = step.usual, [*step.after, step.good]
    if are_rare:
        operations = [*step.usual, *step.rare]
        results = [*step.after_rare, step.good, step.accurate, step.negative]
        results += [] if step.changed is None else [step.changed]
    return [Program(step.D, operations, results, Numbers(step.places))]
