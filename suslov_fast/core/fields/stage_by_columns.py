"""Machine code of stages of fields whose elimination is by columns (`lists.sparse`).

Runs carry out the lists before and after elimination, `lists.step.StepByColumns`.
"""

import functools
from typing import NamedTuple

from ..code.runs import program_of
from ..code.runs_code import add_runs, take_accurate, take_if_good
from ..code.sparse_code import Arrays, add_factors, add_solution
from ..code.text import Code, Integers


class ColumnsPlan(NamedTuple):
    """The integers of an array that the code takes, before those of `Arrays` and of programs."""

    x: int  # addresses of the D values of `StepByColumns.given`: x,
    half: int
    pivots: int
    diagonal: int
    next: int
    entries: int  # of N, and 1
    factors: int
    scratch: int
    on_diagonal: int  # address of the numbers of entries on the diagonal; of 1 for 0
    rows: int  # of all programs
    changed: int  # place of `changed` among the results, that of `negative` if there is none
    is_constant: int  # 1 if the matrix depends on the table alone
    factorized: int  # the table of the factors, if it is constant
    is_rare: int  # 1 if the rare programs are there


SLOT = ColumnsPlan(*range(len(ColumnsPlan._fields)))
OF_PROGRAM = 4  # addresses of heads and places, number of runs, address of the rows of results
ENTRIES, TESTS, OF_NEXT, RARE = range(4)
GIVEN = 1, 4, 1, 5  # times D given values that each reads
OF_ARRAYS = range(len(Arrays._fields))


def text_of_stage_by_columns(name, W, for_each):
    """Return the text of i64 name(x, tables, plan), see `runs_code.text_of_stage_by_runs`.

    `tables` is the address of those of the numbers of all programs.
    """
    text = Code(W)

    def arrays_of(*_):  # the plan stands in place of a table
        plan = Integers(text, "%table")
        return Arrays(*(plan[len(SLOT) + k] for k in OF_ARRAYS))

    add_runs(text, f"{name}_runs", for_each)
    add_factors(text, f"{name}_factors", arrays_of)
    add_solution(text, f"{name}_solution", arrays_of)
    text.begin(name, "x", "tables", "plan")
    x, tables, plan = text.array("%x"), Integers(text, "%tables"), Integers(text, "%plan")
    a, arrays = ColumnsPlan(*(plan[k] for k in SLOT)), plan.after(len(SLOT))
    of, programs = Arrays(*(arrays[k] for k in OF_ARRAYS)), arrays.after(len(OF_ARRAYS))
    rows, entries, D = text.array(a.rows), text.array(a.entries), of.D

    def run(program, given):
        """Carry out a program; return its results, from those of a place on."""
        *runs, results = (programs[OF_PROGRAM * program + k] for k in range(OF_PROGRAM))
        text.copy(a.x, rows, D * given)
        text.invoke(f"{name}_runs", rows, tables[program], *runs)
        places = Integers(text, results)
        return lambda k: rows[places[k]]

    def solve(result, first, right):
        for k in text.each(D):
            text.array(right)[k] = result(k + first)
        text.invoke(f"{name}_solution", a.factors, "%plan", right, a.scratch)

    text.copy(x, a.x, D)
    result = run(ENTRIES, 1)
    for k in text.each(of.entries):
        entries[k] = result(k)
    with text.when(a.factorized.differs(tables[ENTRIES])):
        text.invoke(f"{name}_factors", entries, "%plan", a.factors, a.scratch)
        plan[SLOT.factorized] = tables[ENTRIES] * a.is_constant
    solve(result, of.entries, a.half)
    pivots, diagonal, inverses = map(text.array, (a.pivots, a.diagonal, a.factors))
    on_diagonal = Integers(text, a.on_diagonal)
    for k in text.each(D):
        pivots[text.short(of.order, k)] = 1.0 / inverses[k]
        diagonal[k] = entries[on_diagonal[k]]
    take_if_good(text, x, D, run(TESTS, GIVEN[TESTS]))
    with text.when(a.is_rare.equals(0)):
        text.leave("i64 -1")
    solve(run(OF_NEXT, 1), 0, a.next)
    take_accurate(text, x, D, run(RARE, GIVEN[RARE]), D, D + a.changed)
    return text.finished()


@functools.lru_cache(16)
def parts_of(step, are_rare):
    """Return the programs of a `StepByColumns`: the usual ones, or the others."""

    def program(part, results):
        given, operations = GIVEN[part], [*step.usual, *step.rare]
        if given == 1:
            return program_of(range(step.D), step.table, operations, results)[0]
        operations = [each for each in operations if each[1] not in step.before]
        return program_of(step.given[: given * step.D], [], operations, results)[0]

    if not are_rare:
        first = program(ENTRIES, [*step.entries, *step.right])
        return [first, program(TESTS, [*step.after, step.good])]
    results = [*step.after_rare, step.accurate, step.negative]
    results += [] if step.changed is None else [step.changed]
    return [program(OF_NEXT, step.of_next), program(RARE, results)]
