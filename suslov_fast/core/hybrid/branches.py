"""Right-hand sides with branches: the same f with branches that are fixed within a step.

A comparison of numbers, at which f may jump, becomes the comparison of a parameter with 1/2, and
`floor` becomes a parameter. So f is smooth within a step, even beyond the surface on which the
branch changes. On this surface the compared numbers are equal, or the argument of `floor` is an
integer. The kinks of `abs`, `minimum` and `maximum` are branches, too. A step ends just beyond a
kink, too, but only the branch changes there, because f does not jump. The branch of a table is an
interval between knots. Its ends, height and slope become parameters: within a step the table is the
straight line of this interval, with a surface at each end.
"""

import functools
import operator
from typing import NamedTuple

from ..expressions.function_records import same
from ..expressions.hybrid import Hybrid
from ..expressions.programs import (
    Expressions,
    Values,
    depending,
    emitted,
    needed_for,
    program_of,
    renamed,
)
from ..expressions.projection import NOTHING
from ..expressions.right_hand_side import RightHandSide
from ..expressions.tables import LARGEST, Table, is_table
from ..expressions.values import larger, operand_of, smaller
from .double_crossings import double_crossings_of
from .event_formulas import GAP, event_set_of
from .explicit_time import ElapsedTime
from .step_to_surface import aim_of

# Comparisons of a and b, and their truth where a > b, and where a < b.
_COMPARISONS = {"olt": (0.0, 1.0), "ogt": (1.0, 0.0), "oge": (1.0, 0.0), "oeq": (0.0, 0.0)}
_EXTREMES = {"max": "ogt", "min": "olt"}


class Surface(NamedTuple):
    """A surface at which steps end: there a result of `Hybrid.surfaces` is 0.

    kind    "event", or the instruction that has another branch beyond the surface
    number  the number of the event, or of the first parameter that holds the branch
    jumps   True if f jumps there; False for events and kinks, where f only bends
    """

    kind: str
    number: int
    jumps: bool = False

    @property
    def parameters(self):
        """The number of parameters that hold the branch: 4 for a `Table`, else 1."""
        return Table.ROWS if is_table(self.kind) else 1

    def interval(self, number, places):
        """Return ends (low, high) between which a "floor" or table keeps its branch; else None."""
        if self.kind != "floor" and not is_table(self.kind):
            return None
        low = number(places[self.number])
        return low, number(places[self.number + 1]) if is_table(self.kind) else low + 1.0


class Branches(NamedTuple):
    """The branches of f, which the last parameters of f hold.

    conditions  the `Surface`s at which branches change: first those where f jumps, then kinks
    P           how many other parameters f has
    shifts      indices in `conditions` of tables with an argument p + q; q is constant along a step
    joins       True if several comparisons have the same two numbers (`_groups_of`)
    jumps       the number of parameters that hold branches at which f jumps
    """

    conditions: list
    P: int
    shifts: list
    joins: bool

    kinds = property(lambda self: [surface.kind for surface in self.conditions])
    jumps = property(lambda self: sum(each.parameters for each in self.conditions if each.jumps))


def _part_before_0(a, b):
    """Return the part of a line before 0, from the values a and b at its ends."""
    return larger(smaller(a / (a - b), 1.0), 0.0)


def _crossed_by_event(a, b, above, level, may_have_gap):
    """Return whether a line from a to b crosses the surface of an event, and its part before that.

    `above` and `level` are about the begin of the line, see the rows `side` of `flow.memory`.
    """
    a, b = a - level, b - level
    change, crossing = (b >= 0.0) ^ (above > 0.5), _part_before_0(a, b)
    if may_have_gap:
        was_known, is_known = ~above.equals(GAP), b.equals(b)
        change = (change & was_known & is_known) | (was_known ^ is_known)
        crossing = (was_known & is_known).select(crossing, 0.5)
    return change, crossing


def _crossed(surface, b, number, of_table):
    """Return whether the value b has another branch, this branch, and the level of the surface.

    The branch is None for "floor", and the level is None if it is 0. number(k) is a value of f's
    table at a place in `of_table`.
    """
    kind = surface.kind
    if is_table(kind):
        low, high = surface.interval(number, of_table)
        is_above = b >= high
        return (b < low) | is_above, b, is_above.select(high, low)
    if kind == "floor":
        choice = number(of_table[surface.number])
        change = ~b.then("floor").equals(choice)
        return change, None, choice + (b >= choice + 1.0).select(1.0, 0.0)
    truth = b >= 0.0 if kind == "oge" else b.equals(0.0) if kind == "oeq" else b > 0.0
    change = truth ^ (number(of_table[surface.number]) > 0.5)
    return change, truth.select(1.0, 0.0), None


def watch_of(f, events, surfaces):
    """Return the `Program` that finds the first surface on the line from a state x to a state y.

    The program reads the values of all `surfaces` at x, then at y; for each surface of an event the
    side of x and the level, the value of s that counts as 0 (both in rows `side` of `flow.memory`);
    and `f.table`. Its results:

    1. the fraction of the line before the first crossing, or 1 without a crossing,
    2. 1 if a surface is crossed, else 0,
    3. 1 if f jumps at a crossed surface, else 0,
    4. for each kink, the branch at y: 1 or 0, or the argument of a table.
    """
    count = len(surfaces)
    first = 2 * count + 2 * (events.surface_count if events else 0)
    of_table = {number: first + place for number, place in f.places.items()}
    values = Values(first + len(f.table), ())
    part, changes, of_kinks = 1.0, [], []
    for k, surface in enumerate(surfaces):
        a, b = values.number(k), values.number(count + k)
        if surface.kind == "event":
            of_side = (values.number(2 * (count + surface.number) + n) for n in (0, 1))
            change, crossing = _crossed_by_event(a, b, *of_side, events.gaps[surface.number])
        else:
            change, branch, level = _crossed(surface, b, values.number, of_table)
            a, b = (a, b) if level is None else (a - level, b - level)
            crossing = _part_before_0(a, b)
            of_kinks += [] if surface.jumps else [branch.number]
        part = smaller(change.select(crossing, 1.0), part)
        changes.append(change)

    def some(truths):
        if not truths:
            return 0.0
        return functools.reduce(operator.or_, truths).select(1.0, 0.0).number

    at_jumps = [change for change, surface in zip(changes, surfaces, strict=True) if surface.jumps]
    results = [operand_of(part), some(changes), some(at_jumps), *of_kinks]
    return program_of(values.operations, results)


def with_fixed_branches(values, results, P, by=(), twice=False, actions=(), invariants=NOTHING):
    """Return the `RightHandSide` f with the rates `results`, in which branches are parameters.

    `results` are operands in `values`, functions of the state and P parameters. The branches, and
    the start values of clocks, become further parameters of f. `by` are the parameters with respect
    to which f is differentiated, too. `twice` is True if columns of derivatives join the state
    later (`variational`). `actions` are `EventAction`s: first those of events on surfaces, then
    those of events at times.
    """
    elapsed, D = ElapsedTime(values, results, P, actions, invariants.operands), len(results)
    values, results, actions, P = elapsed.values, elapsed.results, elapsed.actions, elapsed.P
    offsets, invariants = elapsed.offsets, invariants._replace(operands=elapsed.invariants)
    # An argument of a table is p + q, with q constant along a step (`explicit_time`). In `shifted`
    # q depends on parameters alone, but not on those in `by`, and shifts the knots. Any other q
    # stays in the argument, as -24 floor(t / 24) in t - 24 floor(t / 24).
    rigid = values.fixed - depending(values.operations, by)
    shifted = {a: (p, q) for a, (p, q) in elapsed.shifts.items() if q in rigid}
    levels = program_of(values.operations, invariants.operands)
    events = event_set_of(actions, D, P, by, twice, levels) if actions else None
    of_events = [action.surface for action in actions if action.surface is not None]
    of_events = [emitted(values, surface)[0] for surface in of_events]
    events_on_surfaces = [Surface("event", k) for k in range(len(of_events))]
    operations = needed_for(values.operations, [*results, *of_events, *invariants.operands])
    clocks = () if twice or by else offsets
    of_states = depending(operations, {*range(D)}.difference(clocks))
    moving = depending(operations, [i for i, rate in enumerate(results) if not same(rate, 0.0)])
    jumps, kinks = _choosing(values, operations, of_states, moving)
    first = D + P
    conditions = _conditions(jumps, kinks, first)
    if not conditions:
        return HybridRightHandSide(
            values, results, P, by, hybrid=Hybrid(events, offsets=offsets),
            surfaces=events_on_surfaces, surface_values=of_events, invariants=invariants,
            table=range(D, first) if actions or offsets else (),
        )  # fmt: skip
    groups, in_order = _groups_of(operations, jumps), [*conditions.values()]
    places = [k for k, number in enumerate(conditions) if number in shifted]
    branches = Branches(in_order, P, places, bool(groups))
    count = first + sum(each.parameters for each in in_order)
    fixed = Expressions(count, range(D, first + branches.jumps))
    tests = Expressions(count, values.fixed)  # tests of the conditions
    new, of_branches, truths, shifts = _with_choices(
        operations, fixed, tests, first, conditions, shifted, groups
    )
    fixed.take_written(values, new)
    chosen = _choices(tests, in_order, truths)
    return HybridRightHandSide(
        fixed, renamed(results, new), count - D, by,
        hybrid=Hybrid(events, branches, chosen, offsets=offsets),
        surfaces=[*in_order, *events_on_surfaces], plain=RightHandSide(values, results, P),
        surface_values=[*of_branches, *(new[a] for a in of_events), *shifts], jumps=len(jumps),
        invariants=invariants._replace(operands=renamed(invariants.operands, new)),
        table=range(D, count),
    )  # fmt: skip


class HybridRightHandSide(RightHandSide):
    """The right-hand side of a motion with events, branches, or clocks that begin at 0.

    `hybrid` lacks the programs that follow from f and its `surfaces`. If f has branches, `plain` is
    f before its branches became parameters: a rate that depends on branches is constant along a
    step of f, but not along the motion. So steady components are those of `plain`.
    """

    def __init__(self, *given, hybrid, surfaces, plain=None, **others):
        super().__init__(*given, **others)
        if hybrid.chooses:
            self.steady, self.clocks = plain.steady, plain.clocks
            first = self.D + plain.P
            of_jumps = range(first, first + hybrid.branches.jumps)
            changing = depending(self.fixed, of_jumps).difference(of_jumps)
            derived = program_of(self.fixed, [a for a in self.table if a in changing])
            hybrid = hybrid._replace(derived=derived)
        self.hybrid = _watching(self, hybrid, surfaces) if surfaces else hybrid


def _conditions(jumps, kinks, first):
    """Return {number of a value: `Surface`}; branches are the parameters from `first` on."""
    conditions = {}
    for number, kind in (jumps | kinks).items():
        conditions[number] = Surface(kind, first, number in jumps)
        first += conditions[number].parameters
    return conditions


def _groups_of(operations, jumps):
    """Return {number: group} of the comparisons in `jumps` that have both operands in common.

    A group is the dict {number: (truth where a > b, truth where a < b)} of all comparisons of the
    same a and b, with 1.0 for true. `jumps` has the numbers of values at which f jumps.
    """
    groups = {}
    for name, number, operands in operations:
        if number in jumps and name in _COMPARISONS:
            pair = repr(operands[0]), repr(operands[1])
            turn = -1 if pair[::-1] in groups else 1
            groups.setdefault(pair[::turn], {})[number] = _COMPARISONS[name][::turn]
    return {number: group for group in groups.values() if len(group) > 1 for number in group}


def _passed(tests, number, group, choices, truth, a, b):
    """Return the operand of the new branch, a truth value, of comparison `number` of a and b.

    Usually the new branch is `truth`. But if a motion meets a = b, all comparisons of the `group`
    change at once, as if the motion were already beyond the surface. Otherwise f would jump twice,
    because np.sign is 0 on the surface. `choices` is {number of a comparison: parameter of its old
    branch}; old branches are NaN at first and after an action.
    """
    meets, result = tests.emit("oeq", a, b), tests.number(truth).select(1.0, 0.0)
    for k in (0, 1):
        agrees = [tests.number(choices[c]).equals(truths[k]) for c, truths in group.items()]
        passes = functools.reduce(operator.and_, agrees, tests.number(meets))
        result = passes.select(group[number][1 - k], result)
    return (result > 0.5).number


def _with_choices(operations, fixed, tests, first, conditions, shifted, groups):
    """Add operations to `fixed` with branches in place of conditions, and unchanged to `tests`.

    Values below number `first` are the state and the other parameters. `conditions` is {number of
    a value: `Surface`}, and `groups` are those of `_groups_of`. `shifted` is {number of a table's
    value: (p, q)}: the argument of the table is p + q, where q is constant along a step. Return
    {old operand: operand in `fixed`}, and three lists of operands: the functions of all surfaces in
    `fixed`, with p in place of p + q; the branches of all surfaces in `tests`; and each q in
    `fixed`.
    """
    functions, branches, shifts = {}, {}, {}
    choices = {number: surface.number for number, surface in conditions.items()}
    new, old = {a: a for a in range(first)}, {a: a for a in range(first)}
    for name, number, operands in operations:
        of, others = renamed(operands, new), renamed(operands, old)
        old[number] = tests.emit(name, *others)
        if number in groups:
            old[number] = _passed(tests, number, groups[number], choices, old[number], *others)
        if number not in conditions:
            new[number] = fixed.emit(name, *of)
            continue
        kind, choice, jumps = conditions[number]
        if is_table(kind):
            if number in shifted:  # its branch is an interval of p: from low - q to high - q
                p, q = shifted[number]
                of, others = [new.get(p, p)], [old.get(p, p)]
                shifts[number] = new.get(q, q)
            functions[number] = a = _finite(fixed, *of)
            branches[number] = _finite(tests, *others)
            low, _, height, slope = range(choice, choice + Table.ROWS)
            rise = fixed.emit("fmul", slope, fixed.emit("fsub", a, low))
            new[number] = fixed.emit("fadd", rise, height)
        elif kind == "floor":
            functions[number], new[number], branches[number] = of[0], choice, old[number]
        else:
            (a, b), others = ([*each, 0.0][:2] for each in (of, others))
            functions[number] = fixed.emit("fsub", *((b, a) if kind == "olt" else (a, b)))
            branches[number] = old[number] if jumps else tests.emit(kind, *others)
            new[number] = truth = fixed.emit("ogt", choice, 0.5)
            if not jumps:
                b = fixed.emit("fmul", -1.0, a) if name == "fabs" else b
                new[number] = fixed.emit("select", truth, a, b)
    found = [[of[a] for a in conditions if a in of] for of in (functions, branches, shifts)]
    return new, *found


def _choosing(values, operations, of_states, moving):
    """Return two dicts {number of a value: `Surface.kind`}: where f jumps, and where f bends.

    The values `of_states` depend on more than clocks. A table of clocks alone counts as a kink even
    if it jumps, because no motion slides along its knots. Values that are not `moving` change at
    events alone, as modes do, and need no surface.
    """
    jumps, kinks = {}, {}
    for name, number, operands in operations:
        of = {a for a in operands if type(a) is int}
        if of <= values.fixed or not (is_table(name) or of & moving):
            continue
        if is_table(name):
            is_kink = name.is_continuous or number not in of_states
            (kinks if is_kink else jumps)[number] = name
        elif name == "floor" or (name in _COMPARISONS and not same(*operands)):
            jumps[number] = name  # but not a == a, which asks for NaN
        elif name in _EXTREMES or (name == "fabs" and not _is_0_times(values, *operands)):
            kinks[number] = _EXTREMES.get(name, "ogt")
    return jumps, kinks


def _watching(f, hybrid, surfaces):
    """Return the `Hybrid` of f with the programs that find crossings of `surfaces`."""
    of_f, events = f.surface_values, hybrid.events
    functions = program_of(of_f.operations, of_f.results[: len(surfaces)])
    return hybrid._replace(
        surfaces=functions,
        watch=watch_of(f, events, surfaces),
        double_crossings=double_crossings_of(f, functions, surfaces),
        aim=tuple(aim_of(f, functions, events, surfaces, each) for each in (False, True)),
    )


def _choices(tests, surfaces, branches):
    """Return the `Program` that finds the branches at a state, and whether they have changed.

    It also reads the old branches. `branches` are the new ones, operands in `tests`. Its results:

    1. the index in `surfaces` of the first jump of f with a new branch, else -1,
    2. 1 if any branch is new, else 0,
    3. the branches: 1 or 0, the value of `floor`, or the argument of a table.
    """
    results, place, some = [], -1.0, 0.0
    for k, (surface, a) in reversed([*enumerate(zip(surfaces, branches, strict=True))]):
        now = tests.number(surface.number)
        if is_table(surface.kind):
            x, high = tests.number(a), tests.number(surface.number + 1)
            differs = (x < now) | (x >= high)
        else:
            a = a if surface.kind == "floor" else tests.emit("select", a, 1.0, 0.0)
            differs = tests.number(a).equals(now) ^ now.equals(now)
        results.append(a)
        some = differs.select(1.0, some)
        place = differs.select(float(k), place) if surface.jumps else place
    results = [operand_of(place), operand_of(some), *reversed(results)]
    return program_of(tests.operations, results)


def _finite(values, argument):
    """Add a table's `argument`, clipped to finite numbers, to `values`; return it. NaN stays."""
    return values.emit("max", -LARGEST, values.emit("min", LARGEST, argument))


def _is_0_times(values, operand):
    """Return True if `operand` in `values` is a product with the constant 0: it is 0 or NaN."""
    name, of = values.parts_of(operand)
    return name == "fmul" and same(of[0], 0.0)
