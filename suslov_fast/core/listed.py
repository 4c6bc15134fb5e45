"""Long lists of operations, which one loop carries out in place of code of their own.

LLVM takes 10 s for the list of a chain of 1024 variables, and longer to optimise it. A `Program`
has the operations of a list in runs: those of a run have the same kind, and none waits for another
one. The code of `listed_code` is common to all programs: it takes run after run, and reads and
writes rows of W lanes. A sum of products, which is what most of a list consists of, is one
operation, whose sum stays in a register. Bits are those of `operations.evaluate`.
"""

import functools
from collections import Counter, defaultdict
from itertools import product
from typing import NamedTuple

import numpy as np

from .operations import OF_LIBRARY, OF_NUMBERS, OF_TRUTH_VALUES

# An operation is (instruction, kinds of its operands): "r" is a row, "t" a number of the table.
# "sum" is a start, if there is one, plus products; its length is their number, 0 if above SHORT.
SHORT = 3
JOINING = ("and", "or", "xor")
KINDS = [
    *((f"sum{n}", start + pair) for n in range(SHORT + 1) for start in ("", "r", "t")
      for pair in ("rr", "tr")),
    *((instruction, a + b) for instruction in (*OF_NUMBERS, *OF_TRUTH_VALUES)
      if instruction not in ("fmul", "fabs", "select", "sqrt", *OF_LIBRARY, *JOINING)
      for a, b in product("rt", "rt")),
    *((instruction, "rr") for instruction in JOINING),
    *(("select", "r" + a + b) for a, b in product("rt", "rt")),
    ("fabs", "r"),
    ("sqrt", "r"),
]  # fmt: skip
_NUMBER_OF = {kind: number for number, kind in enumerate(KINDS)}


class Runs(NamedTuple):
    """Runs of operations."""

    heads: np.ndarray  # (runs, 3): the kind, and the bytes of `places` of an operation and of all
    places: np.ndarray  # of each operation: the row of its value, and places of its operands


class Program:
    """Operations of a step (`operations.Step`) as runs, on `rows` rows of lanes.

    The first D rows have the state, and the rows `results` the values with these numbers. Tables
    have the numbers of `Step.table`, and after them `constants`.
    """

    def __init__(self, step, operations, results, constants):
        self.step, self.constants = step, constants
        uses = Counter(a for *_, operands in operations for a in operands)
        uses.update(results)
        runs = self._runs(_with_sums(operations, uses, step.places))
        last = {}  # run that reads a value, after which its row is free
        for n, (_, values) in enumerate(runs):
            for number, operands in values:
                last.update(dict.fromkeys((number, *operands), n))
        last.update(dict.fromkeys([*range(step.D), *results], np.inf))
        ending = defaultdict(list)
        for number, n in last.items():
            ending[n].append(number)
        self.rows, self._free, self._row = step.D, [], {k: k for k in range(step.D)}
        self.runs = self._placed(runs, ending)
        self.results = np.array([self._row[number] for number in results])

    def _runs(self, operations):
        """Return runs ((kind, operands of each), [(number, operands)]), in a possible order."""
        level, runs = {}, defaultdict(list)
        for instruction, number, operands in operations:
            kinds = "".join("t" if self._is_in_table(a) else "r" for a in operands)
            level[number] = 1 + max((level.get(a, 0) for a in operands), default=0)
            if instruction == "sum":
                n = len(operands) // 2
                instruction = f"sum{n if n <= SHORT else 0}"
                kinds = kinds[: 2 + len(operands) % 2]
            kind = _NUMBER_OF[instruction, kinds], len(operands)
            runs[level[number], *kind].append((number, operands))
        return [((kind, n), runs[level, kind, n]) for level, kind, n in sorted(runs)]

    def _is_in_table(self, operand):
        return isinstance(operand, float) or operand in self.step.places

    def _placed(self, runs, ending):
        """Give each value of runs a row; return `Runs`."""
        heads, places = [], []
        for run, ((kind, n), operations) in enumerate(runs):
            heads.append((kind, 4 * (n + 1), 4 * (n + 1) * len(operations)))
            for number, operands in operations:
                if not self._free:
                    self._free.append(self.rows)
                    self.rows += 1
                self._row[number] = self._free.pop()
                places.append(self._row[number])
                places += map(self._place, operands)
            self._free += [self._row[number] for number in ending[run] if number in self._row]
        return Runs(np.array(heads, np.int64).reshape(-1, 3), np.array(places, np.int32))

    def _place(self, operand):
        if isinstance(operand, float):
            first = len(self.step.table)
            return self.constants.setdefault(operand, first + len(self.constants))
        return self.step.places[operand] if operand in self.step.places else self._row[operand]


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


class Programs(NamedTuple):
    """The programs of a step: for all states, and for states where `good` is false."""

    usual: Program  # its results are `Step.after` and `good`
    rare: Program  # `after_rare`, `accurate`, `negative`, and `changed` if it is not None
    constants: np.ndarray
    rows: int


@functools.lru_cache(8)
def programs_of(step):
    """Return the `Programs` of a step."""
    constants = {}
    usual = Program(step, step.usual, [*step.after, step.good], constants)
    results = [*step.after_rare, step.accurate, step.negative]
    results += [] if step.changed is None else [step.changed]
    rare = Program(step, [*step.usual, *step.rare], results, constants)
    return Programs(usual, rare, np.array([*constants], float), max(usual.rows, rare.rows))
