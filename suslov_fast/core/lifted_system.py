"""Whole steps of one state of a lifted field, for compiled loops of users: see `lift`."""

from typing import Any, NamedTuple

import numpy as np

from .careful import crosses_0, of_rounding
from .codes import OK, PASSED_POLE
from .field_system import take_stages
from .generated import text_of_stage, text_of_step
from .listed import programs_of, words_program
from .listed_code import text_of_listed_lift, text_of_listed_step
from .llvm import call_code, with_address
from .machine_code import Text, code_of
from .numba import function
from .stages import weights_of
from .steps_field import scheme_of


@with_address
class LiftedSystem(NamedTuple):
    """A lifted field and a step size, with addresses of this process."""

    address: int  # of the code of `generated.text_of_step`, 0 without a plan of elimination
    lift: int  # address of the code of `text_of_lift`
    half: Any  # (stages, T), half of the step size of a stage times the values of the terms
    whole: Any  # (T,), the same of the whole step
    table: Any  # (stages, n), see `Step.table`
    lift_table: Any  # (m,), numbers for the code at `lift`
    weights: Any  # (stages,), at the ends of columns, else 0
    sums: bool  # see `Scheme.sums_increments`
    indices: Any  # (3, T)
    signs: Any  # components that keep their signs along the motion
    words: int
    dimension: int


def text_of_lift(step, name, *_):
    """Return the text of i64 name(x, table): write the words of a state behind it.

    It returns 2 if det(1 - h f') < 0, else 0.
    """
    text, given = Text(1), step.given
    text.add(f"define i64 @{name}(i64 %x, i64 %table) #0 {{")
    text.label("entry")

    def load(number):
        row, place = ("%x", number) if number < given else ("%table", step.places[number])
        return text.load("double", text.plus(row, 8 * place))

    values = {}
    text.carry_out(step.prologue, values, load)
    for k, number in enumerate(step.lifted, given):
        word = values[number] if number in values else load(number)
        text.store("double", word, text.plus("%x", 8 * k))
    text.add(f"  ret i64 {text.integer('mul', 2, text.bits(values[step.turned]))}")
    return text.finished()


def lifted_system_of(indices, values, half_eps, stages, D, lift):
    """Return the system of a lifted field, from the values of its terms and of its lift.

    It is None without machine code.
    """
    step = scheme_of(indices, D, stages, lift).step
    whole = half_eps * values[: step.T]
    half = np.outer(stages.fractions, whole)
    others = np.broadcast_to(values[step.T :], (len(half), len(values) - step.T))
    table = np.ascontiguousarray(step.table_of(np.hstack([half, others]).T).T)
    # The code lasts, because users may store the system anywhere.
    text_of, of_lift, first = text_of_stage if stages.columns else text_of_step, text_of_lift, table
    if step.is_long:
        text_of, of_lift = text_of_listed_step, text_of_listed_lift
        first = words_program(step)[1].of(table[:1].T).T
        table = programs_of(step).numbers.of(table.T).T if step.usual else table
    codes = [code_of(text_of, step, lasts=True) if step.usual else 0]
    codes.append(code_of(of_lift, step, lasts=True))
    if None in codes:
        return None
    signs, weights = np.array(lift.signs, np.int64), np.ascontiguousarray(weights_of(stages)[:, 0])
    sums = text_of is text_of_stage and bool(step.usual)
    of_stages = half, whole, np.ascontiguousarray(table), first[0].copy(), weights, sums
    return LiftedSystem(*map(int, codes), *of_stages, step.indices, signs, D, lift.given)


@function
def lifted_memory(system):
    """The memory of `lifted_step_of_one`."""
    M = system.words
    return np.empty((M, M + 1, 1)), np.empty((2, M)), np.empty((5, M))


@function
def lifted_step_of_one(system, state, out, memory):
    """Write the state that follows `state` to `out`; return its status. For `compiled`."""
    matrix, units, rows = memory
    base, total, of_column = rows[0], rows[1], rows[2:]
    x = of_column[0]
    D, M = len(state), system.words
    for i in range(D):
        base[i] = state[i]
    passed = call_code(system.lift, (base.ctypes.data, system.lift_table.ctypes.data)) == 2
    for i in range(M):
        x[i] = base[i]
    status, _ = take_stages(system, base, of_column, total, matrix, units)
    for i in system.signs:
        if crosses_0(base[i], x[i]):
            if of_rounding(system.indices, system.whole, base, i, x[i]):
                x[i] = -x[i]
            else:
                passed = True
    for i in range(D):
        out[i] = x[i] if status == OK else np.nan
    return PASSED_POLE if passed and status == OK else status


# What `compiled` calls for a system of this kind.
LiftedSystem.memory, LiftedSystem.one_step = lifted_memory, lifted_step_of_one
