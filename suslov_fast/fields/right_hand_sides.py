"""Right-hand sides of fields for the integrators of the motion, from equations or from terms."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray
from ..core.expressions.dense_product import ENTRY, is_matrix
from ..core.expressions.full_quadratic import DenseRightHandSide, dense_parameters
from ..core.expressions.numpy_evaluation import OF_TRUTH_VALUES
from ..core.expressions.programs import Expressions, depending, emitted, in_order
from ..core.expressions.right_hand_side import RightHandSide
from ..core.expressions.tables import is_table
from ..core.expressions.values import operand_of
from ..core.hybrid.branches import with_fixed_branches
from ..core.hybrid.event_formulas import EventAction, KeyedProgram, with_parameters
from .equations import Equations
from .names import labels
from .proofs import unproved
from .terms import Terms, by_zeros
from .tolerances import (
    BATCHES_BEFORE_COMPILING,
    CALLS_BEFORE_COMPILING,
    MOST_LISTS_OF_EVENTS,
    MOST_OPERATIONS_COMPILED,
    TERMS_OF_FULL_FIELD,
)

_ONE = np.arange(1)
_WITH_BRANCHES = {"select", "max", "min", "fabs", "floor", *OF_TRUTH_VALUES}

# Parameters with respect to which motions are differentiated, in addition to their initial states;
# None for motions without derivatives.
Names = tuple[str, ...] | None
Actions = tuple[EventAction, ...]


class OfMembers(NamedTuple):
    """The right-hand side of some members of a family, or of a single field."""

    members: NDArray[np.int64]  # numbers of the members (K,)
    f: Any  # a `RightHandSide`
    table: FloatArray  # values (K, n) of `f` that depend on parameters alone


@lru_cache(64)
def _with_constants(
    equations: Equations, wrt: Names, actions: Actions
) -> tuple[RightHandSide, tuple[float, ...]]:
    """Return the right-hand side, and values of its added parameters, which replace constants."""
    first, tested = len(equations.all_names), unproved(equations)
    equations, constants = _without_constants(equations)
    actions, of_actions = with_parameters(actions, first, len(constants))
    f = _of_list(equations, wrt, actions, len(of_actions), tested)
    return f, constants + of_actions


@lru_cache(64)
def _of_list(
    equations: Equations, wrt: Names, actions: Actions, constants: int, tested: tuple[int, ...]
) -> RightHandSide:
    """Return the right-hand side; `constants` is how many constants of `actions` are parameters."""
    kept = equations.invariants
    with_sums = wrt is not None and _has_branches_of_products(equations.products[0])
    with_sums = with_sums or bool(kept.operands)
    program = (equations.values, equations.results) if with_sums else equations.products
    values, results = in_order(program[0], [*program[1], *kept.operands], constants)
    D = len(equations.names)
    results, kept = results[:D], kept._replace(operands=results[D:], tested=tested)
    by = [len(equations.names) + equations.parameters.index(name) for name in wrt or ()]
    P = len(equations.parameters) + constants
    return with_fixed_branches(values, results, P, by, wrt is not None, actions, kept)


def _has_branches_of_products(values: Any) -> bool:
    """Return True if branches depend on products of dense matrices: derivatives need sums then."""
    operations = values.operations
    of = depending(operations, [number for name, number, _ in operations if name == ENTRY])
    return any(
        (name in _WITH_BRANCHES or is_table(name))
        and not of.isdisjoint(a for a in operands if type(a) is int)
        for name, _, operands in operations
        if name != "select"
    )


def _without_constants(equations: Equations) -> tuple[Equations, tuple[float, ...]]:
    """Return equations in which constants are parameters, and these constants.

    So functions that differ only in numbers, as in a loop or a sweep, share machine code.
    """
    names = {name for name, _, _ in equations.products[0].operations}
    if any(is_table(name) or is_matrix(name) for name in names):
        return equations, ()
    count = len(equations.names) + len(equations.parameters)
    invariants, constraints, positions, _ = equations.invariants
    program = KeyedProgram.of(equations.values, [*equations.results, *invariants])
    (form,), constants = with_parameters([EventAction(None, program, 0, 1)], count)
    values = Expressions(
        count + len(constants), range(len(equations.names), count + len(constants))
    )
    parameters = [*equations.parameters, *map(str, range(len(constants)))]
    rows = emitted(values, form.to, new := {a: a for a in range(count)})
    shift = len(constants)
    old = equations.values
    numbers = [*range(count), *(number for _, number, _ in old.operations)]
    values.take_written(old, {a: new.get(a if a < count else a + shift) for a in numbers})
    D = len(equations.names)
    kept = {"residuals": rows[D : D + constraints], "conserved": rows[D + constraints :]}
    kept = kept if invariants else {}
    about: Any = {"quantities": kept, "positions": positions}
    equations = Equations(equations.names, parameters, values, rows[:D], **about)
    return equations, constants


def of_equations(
    equations: Equations, parameters: FloatArray, wrt: Names, actions: Actions
) -> list[OfMembers]:
    """Return the right-hand side of all members, with branches that are fixed within a step."""
    f, given = _with_inputs(equations, parameters, wrt, actions)
    if given.ndim == 1:
        return [OfMembers(_ONE, f, _table_of_one(f, given)[np.newaxis])]
    count = math.prod(parameters.shape[1:])
    table = f.table_of(given).reshape(len(f.table), count)
    return [OfMembers(np.arange(count), f, np.ascontiguousarray(table.T))]


def _table_of_one(f: RightHandSide, given: FloatArray) -> FloatArray:
    """Return the table (n,) of f for parameters (P,); after many calls by machine code."""
    if not f.fixed:
        return given[[number - f.D for number in f.table]]
    table = by_code_if_often(f, "table", given)
    return f.table_of(given) if table is None else table


def by_code_if_often(f: Any, name: str, *given: FloatArray) -> FloatArray | None:
    """Return the results of a program of f by machine code, see `by_code`; None in first calls."""
    calls = vars(f).setdefault("calls", {})  # by name, of one state or not: number, later `by_code`
    key = name, given[0].ndim == 1
    if isinstance(function := calls.get(key, 0), int):
        calls[key] = function + 1
        if (
            function < (CALLS_BEFORE_COMPILING if key[1] else BATCHES_BEFORE_COMPILING)
            or f.is_dense
            or (name != "table" and f.cost > MOST_OPERATIONS_COMPILED)
        ):
            return None
        from ..core.flow.program_code import by_code  # here, because importing Numba takes time

        calls[key] = function = by_code
    return function(f, name, *given)


def of_one(field: Any, wrt: Names, actions: Actions) -> tuple[Any, FloatArray]:
    """Return the right-hand side of a single field, and its parameters (P,); see `of_equations`."""
    full = None
    if field._equations is None and wrt is None and not actions:
        full = full_quadratic(field._own_terms.floats, field.dimension)
    return full or _with_inputs(field._program, field._inputs, wrt, actions)


def _with_inputs(
    equations: Equations, parameters: FloatArray, wrt: Names, actions: Actions
) -> tuple[RightHandSide, FloatArray]:
    """Return the right-hand side of all members, and its parameters (P, ...)."""
    f, constants = _with_constants(equations, wrt, actions)
    if (P := len(parameters)) == f.P:
        return f, parameters
    # Constants follow, then start values of clocks and branches, which steps set for each state.
    given = np.zeros((f.P, *parameters.shape[1:]))
    given[:P] = parameters
    if constants:
        given.T[..., P : P + len(constants)] = constants
    return f, given


def of_terms(terms: Terms, D: int, wrt: Names, actions: Actions) -> list[OfMembers]:
    """Return the right-hand sides of a family of terms: one for all members with the same zeros."""
    (indices, values), groups = terms.floats, []
    rows = values.reshape(math.prod(values.shape[:-1]), values.shape[-1])
    exists = rows != 0.0
    same = [(pattern, np.arange(len(rows))) for pattern in exists[:1]]
    alike = same if exists.all() else by_zeros(exists)
    for pattern, members in alike:  # terms that exist decide what steps test: `of_one_sign`
        places, inputs = indices[:, pattern], rows[np.ix_(members, pattern)]
        full = full_quadratic(Terms(places, inputs), D) if wrt is None and not actions else None
        if full:
            groups.append(OfMembers(members, full[0], np.ascontiguousarray(full[1].T)))
        else:
            [each] = of_equations(equations_of(places.tobytes(), D), inputs.T, wrt, actions)
            groups.append(each._replace(members=members))
    return groups


def full_quadratic(terms: Terms, D: int) -> tuple[DenseRightHandSide, FloatArray] | None:
    """Return f, which loops evaluate, and its table (P, ...); None if there are few terms."""
    if not TERMS_OF_FULL_FIELD < terms.indices.shape[1] > D**3 / 4:
        return None
    f = _full(D)
    return f, f.table_of(dense_parameters(*terms, D))


_full = lru_cache(16)(DenseRightHandSide)


@lru_cache(256)
def equations_of(places: bytes, D: int) -> Equations:
    """Return the equations of terms with indices (3, T); the coefficients are parameters."""
    indices = np.frombuffer(places, np.int64).reshape(3, -1).T.tolist()
    values = Expressions(D + len(indices), range(D, D + len(indices)))
    rows: list[Any] = [0.0] * D
    for c, (i, *factors) in enumerate(indices, D):
        product = values.number(1.0)
        for a in (*(k for k in factors if k < D), c):
            product = product * values.number(a)
        rows[i] = product if isinstance(rows[i], float) else rows[i] + product
    names = [*map(str, range(len(indices)))]
    return Equations(labels(D), names, values, [*map(operand_of, rows)])


def with_events(field: Any, actions: Actions, wrt: Names = None) -> list[OfMembers]:
    """Return the right-hand sides of a field with events, which the field keeps."""
    key, known = (wrt, actions), vars(field).setdefault("_with_events", {})
    if key not in known:
        if len(known) >= MOST_LISTS_OF_EVENTS:
            known.clear()
        known[key] = field._motion_lists(wrt, actions)
    return known[key]
