"""Right-hand sides with branches: the same f with branches that are fixed within a step.

A comparison of numbers, at which f may jump, becomes the comparison of a parameter with 1/2, and
`floor` becomes a parameter. So f is smooth within a step, even beyond the surface on which the
branch changes. On the surface the difference of the compared numbers is 0, or the argument of
`floor` an integer. The kinks of `abs`, `minimum` and `maximum` are branches, too; f does not jump
there, so that steps choose these by themselves. The branch of a table is an interval between knots,
whose ends, height and slope become parameters: f has the straight line through this interval, and
two surfaces.
"""

import functools
import itertools
import operator

from .double_crossings import double_crossings_of
from .event_formulas import GAP, event_set_of
from .explicit_time import ElapsedTime
from .function_records import same
from .programs import Expressions, Program, Values, depending, emitted, needed_for, renamed
from .right_hand_side import RightHandSide
from .step_to_surface import aim_of
from .tables import LARGEST, Table, is_table
from .values import larger, operand_of, smaller

# Comparisons of a and b, and their truth where a > b, and where a < b.
_COMPARISONS = {"olt": (0.0, 1.0), "ogt": (1.0, 0.0), "oge": (1.0, 0.0), "oeq": (0.0, 0.0)}
_EXTREMES = {"max": "ogt", "min": "olt"}


class Branches:
    """The surfaces on which branches of f change, and the parameters of f that hold the branches.

    kinds          the condition of each surface: a comparison, "floor" or a `Table`; surfaces
                   where f jumps come first, then kinks, where f only bends
    jumps, kinks   how many parameters hold the branches at jumps of f, and at kinks
    P              how many other parameters f has; they come before the branches
    shifts         places in `kinds` of tables at arguments p + q, with q constant along a step
    joins          True if several comparisons have the same two numbers (`_joined_truths`)
    """

    def __init__(self, kinds, jumps, P, shifts, joins):
        """Set attributes; f has P other parameters, and jumps at the first `jumps` of `kinds`."""
        self.P, self.kinds, self.kinds_of_kinks, self.shifts = P, kinds, kinds[jumps:], shifts
        self.joins = joins
        self.jumps, self.kinks = (
            sum(map(branch_count, of)) for of in (kinds[:jumps], self.kinds_of_kinks)
        )


def branch_count(kind):
    """Return how many parameters hold the branch of a condition `kind`: 4 for a `Table`, else 1."""
    return Table.ROWS if is_table(kind) else 1


def watch_of(f, kinds, jumps):
    """Return the `Program` that finds the first surface on the line from a state x to a state y.

    `kinds` are the conditions of the surfaces of f (`Branches.kinds`); f jumps at the first `jumps`
    of them. The program reads the values of all surfaces at x and at y; for surfaces of events the
    side of x, and the level at which they act (row `side` of `flow.memory`); and the table of f.
    The first result is the fraction of the line before the first crossing, or 1 without a crossing.
    The second is 1 if a surface is crossed, else 0. The third is 1 if f jumps at a crossed surface,
    else 0. The others are, for each kink, the branch at y, 1 or 0; for a table, its argument.
    """
    choice_number, count = f.D + f.P - sum(map(branch_count, kinds)), len(f.watched.results)
    side, of_changes = 2 * count, f.events.surfaces if f.events else 0
    first = side + 2 * of_changes
    of_table = {number: first + place for number, place in f.places.items()}
    values = Values(first + len(f.table), ())
    ends = [[values.number(begin + k) for k in range(count)] for begin in (0, count)]
    changes, now, part, gaps = [], [], 1.0, [*f.events.gaps] if f.events else []
    for kind, a, b in zip([*kinds, *["side"] * of_changes], *ends, strict=True):
        if kind == "side":
            above, level = (values.number(side + k) for k in (0, 1))
            a, b, side = a - level, b - level, side + 2
            change = (b >= 0.0) ^ (above > 0.5)
            own = larger(smaller(a / (a - b), 1.0), 0.0)
            if gaps.pop(0):
                was_known, is_known = ~above.equals(GAP), b.equals(b)
                change = (change & was_known & is_known) | (was_known ^ is_known)
                own = (was_known & is_known).select(own, 0.5)
            part = smaller(change.select(own, 1.0), part)
            changes.append(change)
            continue
        choice = values.number(of_table[choice_number])
        if is_table(kind):
            low, high = choice, values.number(of_table[choice_number + 1])
            is_above = b >= high
            change = (b < low) | is_above
            now.append(b.number)
            level = is_above.select(high, low)
            a, b = a - level, b - level
        elif kind == "floor":
            change = ~b.then("floor").equals(choice)
            level = choice + (b >= choice + 1.0).select(1.0, 0.0)
            a, b = a - level, b - level
        else:
            truth = b >= 0.0 if kind == "oge" else b.equals(0.0) if kind == "oeq" else b > 0.0
            change = truth ^ (choice > 0.5)
            now.append(truth.select(1.0, 0.0).number)
        own = larger(smaller(a / (a - b), 1.0), 0.0)
        part = smaller(change.select(own, 1.0), part)
        changes.append(change)
        choice_number += branch_count(kind)

    def some(truths):
        if not truths:
            return 0.0
        return functools.reduce(lambda a, b: a | b, truths).select(1.0, 0.0).number

    of_kinks = now[len(now) - (len(kinds) - jumps) :]
    results = [operand_of(part), some(changes), some(changes[:jumps]), *of_kinks]
    return Program(needed_for(values.operations, results), results)


def with_fixed_branches(values, results, P, by=(), twice=False, actions=()):
    """Return the `RightHandSide` f with the rates `results`, in which branches are parameters.

    `results` are operands in the `Expressions` `values`, functions of the state and of P
    parameters. Starts of clocks and branches are further parameters. `f.branches` is None if f has
    no branches. `by` are the numbers of parameters to differentiate f by. `twice` is True if
    columns of derivatives are added to f later (`variational`). `actions` are the `EventAction`s of
    events: events on surfaces first, then events at times.
    """
    elapsed, D = ElapsedTime(values, results, P, actions), len(results)
    values, results, actions, P = elapsed.values, elapsed.results, elapsed.actions, elapsed.P
    offsets, own = elapsed.offsets, elapsed.shifts.items()
    # A shift stays in the argument if it depends on a branch, as in t - 24 floor(t / 24), or has a
    # derivative.
    rigid = values.fixed - depending(values.operations, by)
    shifted = {a: (p, q) for a, (p, q) in own if q in rigid}
    changes = event_set_of(actions, D, P, by, twice) if actions else None
    on_surfaces = [action for action in actions if action.surface is not None]
    on_surfaces = [emitted(values, action.surface)[0] for action in on_surfaces]
    operations = needed_for(values.operations, [*results, *on_surfaces])
    of_clocks = set() if twice or by else _of_clocks(operations, values.fixed, offsets)
    moving = depending(operations, [i for i, rate in enumerate(results) if not same(rate, 0.0)])
    jumps, kinks = _choosing(values, operations, of_clocks, moving)
    kinds = jumps | kinks
    if not kinds:
        kept = range(D, D + P) if actions or offsets else ()
        f = RightHandSide(values, results, P, by, on_surfaces, kept=kept)
        f.events, f.offsets = changes, offsets
        if on_surfaces:
            _watch(f, [], 0, [])
        return f
    first = D + P
    counts = [branch_count(kind) for kind in kinds.values()]
    places = [first, *(first + count for count in itertools.accumulate(counts))]
    choices, given = dict(zip(kinds, places, strict=False)), places[-1]
    counts_of_jumps = places[len(jumps)] - first
    fixed = Expressions(given, range(D, first + counts_of_jumps))
    tests = Expressions(given, values.fixed)  # the branches themselves
    groups = _joined(operations, jumps)
    new, surfaces, truths, shifts = _with_choices(
        operations, fixed, tests, first, (kinds, kinks, choices), shifted, groups
    )
    fixed.take_written(values, new)
    surfaces = [*surfaces, *(new[a] for a in on_surfaces), *shifts.values()]
    given_to = {"surfaces": surfaces, "jumps": len(jumps), "kept": range(D, given)}
    f = RightHandSide(fixed, renamed(results, new), given - D, by, **given_to)
    plain = RightHandSide(values, results, P)  # a rate that is constant along a step may change
    f.steady, f.clocks = plain.steady, plain.clocks
    places, found = [k for k, number in enumerate(kinds) if number in shifts], [*kinds.values()]
    f.events, f.offsets = changes, offsets
    _watch(f, found, len(jumps), [*choices.values()])
    f.branch_program = _choices(tests, found, len(jumps), truths, first)
    f.derived = _derived(f, range(first, first + counts_of_jumps))
    f.branches = Branches(found, len(jumps), P, places, bool(groups))
    return f


def _joined(operations, jumps):
    """Return {number of a comparison: the group of all that compare the same two numbers a, b}.

    A group is a dict {number: its truth, 1 or 0, where a > b, and where a < b}; `jumps` has the
    comparisons. Comparisons without others of their numbers are left out.
    """
    groups = {}
    for name, number, operands in operations:
        if number in jumps and name in _COMPARISONS:
            pair = repr(operands[0]), repr(operands[1])
            turn = -1 if pair[::-1] in groups else 1
            groups.setdefault(pair[::turn], {})[number] = _COMPARISONS[name][::turn]
    return {number: group for group in groups.values() if len(group) > 1 for number in group}


def _passed(tests, number, group, choices, truth, a, b):
    """Return the operand of a comparison of a and b, by its `truth` at a state and by old branches.

    All comparisons of a `group` (`_joined`) change at once: a motion that meets a = b, which the
    step rounds, is beyond it, as with a single comparison. `np.sign` would be 0 there, and f jump
    twice. After an action and at the start old branches, `choices`, are NaN; then `truth` holds.
    """
    meets, result = tests.emit("oeq", a, b), tests.number(truth).select(1.0, 0.0)
    for k in (0, 1):
        own = [tests.number(choices[c]).equals(truths[k]) for c, truths in group.items()]
        passes = functools.reduce(operator.and_, own, tests.number(meets))
        result = passes.select(group[number][1 - k], result)
    return (result > 0.5).number


def _with_choices(operations, fixed, tests, first, chosen, shifted, groups):
    """Add operations to `fixed` with branches in place of conditions, and unchanged to `tests`.

    Both are `Expressions`. Values below number `first` are the state and the other parameters.
    `chosen` has three dicts {number of a condition: ...}: kinds of all conditions, kinds of kinks,
    and numbers of the first parameters that hold their branches. `shifted` is {number of a table's
    value: (p, q)}: the argument of the table is p + q, where q is constant along a step. `groups`
    has comparisons that change at once (`_joined`). The first result is {old operand: its operand
    in `fixed`}. The second has for each condition an operand in `fixed`: the difference of the
    compared numbers, or the argument of `floor` or of a table (p for p + q). The third has for each
    condition the operand in `tests` of its branch at a state. The fourth is {number of a table's
    value: operand of q in `fixed`}.
    """
    (kinds, kinks, choices), surfaces, truths, shifts = chosen, {}, {}, {}
    new, old = {a: a for a in range(first)}, {a: a for a in range(first)}
    for name, number, operands in operations:
        of, others = renamed(operands, new), renamed(operands, old)
        old[number] = tests.emit(name, *others)
        if number in groups:
            own = groups[number]
            old[number] = _passed(tests, number, own, choices, old[number], *others)
        if number not in kinds:
            new[number] = fixed.emit(name, *of)
            continue
        kind, choice = kinds[number], choices[number]
        if is_table(kind):
            if number in shifted:  # rows `low` and `high` of its branch are less by q
                p, q = shifted[number]
                of, others = [new.get(p, p)], [old.get(p, p)]
                shifts[number] = new.get(q, q)
            surfaces[number] = a = _finite(fixed, *of)
            truths[number] = _finite(tests, *others)
            low, _, height, slope = range(choice, choice + Table.ROWS)
            rise = fixed.emit("fmul", slope, fixed.emit("fsub", a, low))
            new[number] = fixed.emit("fadd", rise, height)
            continue
        a, b = of if len(of) > 1 else (of[0], 0.0)
        surfaces[number] = fixed.emit("fsub", *((b, a) if kind == "olt" else (a, b)))
        truths[number] = old[number]
        if number in kinks:
            truths[number] = tests.emit(kind, *(others if len(of) > 1 else (others[0], 0.0)))
        if kind == "floor":
            surfaces[number], new[number] = a, choice
            continue
        truth = fixed.emit("ogt", choice, 0.5)
        new[number] = truth
        if number in kinks:
            b = fixed.emit("fmul", -1.0, a) if name == "fabs" else b
            new[number] = fixed.emit("select", truth, a, b)
    return new, [surfaces[a] for a in kinds], [truths[a] for a in kinds], shifts


def _choosing(values, operations, of_clocks, moving):
    """Return two dicts {number of a value: kind}: where f may jump, and where f bends (kinks).

    A kind is a comparison, "floor" or a `Table`, as in `Branches.kinds`. `operations` are all that
    f needs of the `Expressions` `values`. `of_clocks` are the values that depend on clocks alone. A
    table of these that jumps counts as a kink, because no motion slides along its knots. Other
    values than `moving` ones change only by events, as modes do: f decides them each time.
    """
    varying = [
        each
        for each in operations
        if is_table(each[0]) or any(type(a) is int and a in moving for a in each[2])
    ]
    varying = [
        each for each in varying if any(type(a) is int and a not in values.fixed for a in each[2])
    ]
    tables = {number: name for name, number, _ in varying if is_table(name)}
    steady = {a for a, name in tables.items() if name.is_continuous or a in of_clocks}
    jumps = {
        number: name
        for name, number, operands in varying
        if name == "floor"
        or (name in _COMPARISONS and not same(*operands))  # whether it is NaN
        or (is_table(name) and number not in steady)
    }
    kinks = {
        number: name if is_table(name) else _EXTREMES.get(name, "ogt")
        for name, number, operands in varying
        if name in _EXTREMES
        or (name == "fabs" and not _is_0_times(values, *operands))
        or number in steady
    }
    return jumps, kinks


def _watch(f, kinds, jumps, choices):
    """Set the programs of f that find crossings: watched, watch, double_crossings and aim.

    `kinds` are the conditions of the surfaces of f (`Branches.kinds`); f jumps at the first `jumps`
    of them. `choices` are the numbers of the parameters that hold their branches.
    """
    results = f.surfaces.results[: len(kinds) + (f.events.surfaces if f.events else 0)]
    f.watched = Program(needed_for(f.surfaces.operations, results), results)
    f.watch = watch_of(f, kinds, jumps)
    f.double_crossings = double_crossings_of(f, kinds, jumps, choices)
    f.aim = tuple(aim_of(f, kinds, choices, is_implicit) for is_implicit in (False, True))


def _derived(f, choices):
    """Return the `Program` of the entries of f's table that are functions of branches.

    f's table has functions of parameters alone; `choices` are the parameters that hold branches.
    """
    of = depending(f.fixed, choices).difference(choices)
    results = [a for a in f.table if a in of]
    return Program(needed_for(f.fixed, results), results)


def _choices(tests, kinds, jumps, branches, first):
    """Return the `Program` that finds the branches at a state, and whether they have changed.

    `kinds` are the conditions of the surfaces of f (`Branches.kinds`); f jumps at the first `jumps`
    of them. Parameters from number `first` on hold the old branches. `branches` are the branches at
    the state, operands in the `Expressions` `tests`. The first result is the place of the first
    jump of f with a new branch, else -1. The second is 1 if any branch is new, else 0. The others
    are the branches at the state: 1 or 0, the value of `floor`, or the argument of a table.
    """
    results, surface, some = [], -1.0, 0.0
    places = [first, *(first + n for n in itertools.accumulate(map(branch_count, kinds)))]
    for k, kind in reversed([*enumerate(kinds)]):
        now, a = tests.number(places[k]), branches[k]
        if is_table(kind):
            x, high = tests.number(a), tests.number(places[k] + 1)
            differs = (x < now) | (x >= high)
        else:
            a = a if kind == "floor" else tests.emit("select", a, 1.0, 0.0)
            differs = tests.number(a).equals(now) ^ now.equals(now)
        results.append(a)
        some = differs.select(1.0, some)
        if k < jumps:
            surface = differs.select(float(k), surface)
    results = [operand_of(surface), operand_of(some), *reversed(results)]
    return Program(needed_for(tests.operations, results), results)


def _finite(values, argument):
    """Add to `values` a table's `argument`, clipped to finite numbers; return it. NaN stays."""
    return values.emit("max", -LARGEST, values.emit("min", LARGEST, argument))


def _of_clocks(operations, of_parameters, clocks):
    """Return the numbers of values that depend on the values `clocks` and `of_parameters` alone."""
    found = {*clocks, *of_parameters}
    for _, number, operands in operations:
        if all(isinstance(a, float) or a in found for a in operands):
            found.add(number)
    return found


def _is_0_times(values, operand):
    """Return True if `operand` in `values` is a product with the constant 0: it is 0 or NaN."""
    name, of = values.of.get(operand, ("", ()))
    return name == "fmul" and isinstance(of[0], float) and of[0] == 0.0
