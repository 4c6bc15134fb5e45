"""Long lists of operations, which one loop carries out in place of code of their own.

LLVM takes 10 s for the list of a chain of 1024 variables, and longer to optimise it. A `Program`
has the operations of a list in runs: those of a run have the same kind, and none waits for another
one. The code of `runs_code` is common to all programs: it takes run after run, and reads and
writes rows of W lanes. A sum of products, which is what most of a list consists of, is one
operation, whose sum stays in a register. Bits are those of `lists.step.evaluate`.
"""

import functools
import math
from collections import Counter, defaultdict
from itertools import chain, product
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
]  # fmt: skip
_NUMBER_OF = {kind: number for number, kind in enumerate(KINDS)}


class Runs(NamedTuple):
    """Runs of operations."""

    heads: np.ndarray  # (runs, 3): the kind, and the bytes of `places` of an operation and of all
    places: np.ndarray  # of each operation: the row of its value, and places of its operands


class Numbers:
    """The numbers that are no rows: those of a table, whose values have `places`, and constants."""

    def __init__(self, places):
        self.in_table, self.places, self.constants = len(places), places, {}

    count = property(lambda self: self.in_table + len(self.constants))

    def place(self, constant):
        """Return the place of a constant."""
        key = constant, math.copysign(1.0, constant)  # 0 equals -0
        return self.constants.setdefault(key, self.count)

    def of(self, table):
        """Return the numbers (-, W) of a table (n, W), when all have places."""
        constants = np.array([constant for constant, _ in self.constants], float)[:, np.newaxis]
        return np.concatenate([table, np.broadcast_to(constants, (len(constants), table.shape[1]))])


class Program:
    """Operations as runs, on `rows` rows of lanes.

    The first D rows have the values 0 to D - 1, and the rows `results` the values with these
    numbers. Within this class constants have negative numbers.
    """

    def __init__(self, D, operations, results, numbers):
        self.rows, self.numbers = D, numbers
        operations = _with_sums(operations, results, numbers.places)
        self.runs = self._placed(self._runs(operations), results)
        self.results = self._place[results]

    def _runs(self, operations):
        """Return runs in a possible order: the kind, and the numbers of values and operands."""
        places, constants = self.numbers.places, {}
        count = 1 + max([self.rows - 1, *places, *(number for _, number, _ in operations)])
        # How many operations a value waits for, one after the other.
        level, runs = [0] * count, defaultdict(list)

        def named(a):
            """Return a number in place of a constant."""
            if not isinstance(a, float):
                return a
            place = self.numbers.place(a)
            if place not in constants:
                constants[place] = -1 - len(constants)
                level.append(0)
            return constants[place]

        for instruction, number, operands in operations:
            if float in map(type, operands):
                operands = tuple(map(named, operands))
            level[number] = 1 + max(map(level.__getitem__, operands), default=0)
            is_sum = instruction == "sum"
            of_kind = operands[: 2 + len(operands) % 2] if is_sum else operands
            kinds = "".join("t" if a < 0 or a in places else "r" for a in of_kind)
            if is_sum:
                n = len(operands) // 2
                instruction = f"sum{n if n <= SHORT else 0}"
            key = level[number], _NUMBER_OF[instruction, kinds], len(operands)
            runs[key].append((number, *operands))
        # The row of each value; the place of a number of the table, or of a constant.
        self._place = np.full(count + len(constants), -1)
        self._place[: self.rows] = range(self.rows)
        self._place[[*places]] = [*places.values()]
        self._place[[*constants.values()]] = [*constants]
        return [(key[1], np.array(runs[key])) for key in sorted(runs)]

    def _placed(self, runs, results):
        """Give each value of runs a row; return `Runs`."""
        last = np.full(len(self._place), -1)  # run that reads a value, after which its row is free
        for n, (_, numbers) in enumerate(runs):
            last[numbers] = n
        last[self._place.size - len(self.numbers.constants) :] = len(runs)
        last[[*self.numbers.places, *results]] = len(runs)
        ending, ends = np.argsort(last, kind="stable"), [*range(len(runs) + 1)]
        ends = np.searchsorted(last[ending], ends)
        heads, places, free = [], [np.empty(0, np.int32)], np.empty(0, np.int64)
        for run, (kind, numbers) in enumerate(runs):
            taken, free = np.split(free, [len(numbers)])
            more = len(numbers) - len(taken)
            self._place[numbers[:, 0]] = [*taken, *range(self.rows, self.rows + more)]
            self.rows += more
            of_run = self._place[numbers].astype(np.int32)
            heads.append((kind, of_run[0].nbytes, of_run.nbytes))
            places.append(of_run.ravel())
            free = np.append(self._place[ending[ends[run] : ends[run + 1]]], free)
        return Runs(np.array(heads, np.int64).reshape(-1, 3), np.concatenate(places))


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
