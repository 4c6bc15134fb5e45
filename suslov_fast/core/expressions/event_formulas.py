"""Events and their actions as expression programs of a state and parameters.

An event happens on a surface, where a function s of the state is 0, or at given times. Its action
may set a new state to(x), and may end the trajectory.

A solution that starts dx away reaches the surface a time tau dx earlier. A column v, the derivative
of the state by a parameter p or by the initial state, becomes

to' v + dto/dp + (f_after - to' f_before) tau,     tau = (grad s . v + ds/dp) / (grad s . f_before).

At given times tau is 0. An action that another action has caused at the same instant has its tau.
"""

from math import inf
from typing import NamedTuple

from ..cached import cached_property
from .derivative import gradients
from .double_crossings import sizes_of
from .programs import Expressions, Program, dot, emitted, needed_for, renumbered
from .tables import is_table
from .values import operand_of

# Of a surface: its value, its rate, the sums of moduli of the terms of both, and of the slopes.
OF_SURFACE = 5
_BRANCHES = "select", "max", "min", "fabs", "floor"  # like tables, may be 0 all around a state
# Operations without a value everywhere; the row `side` (`flow.memory`) of a surface without one.
_LOGARITHMS = "log", "log2", "log10", "log1p"
WITH_GAPS = "fdiv", "sqrt", "pow", *_LOGARITHMS, "asin", "acos", "acosh", "atanh"
GAP = 0.75
# Parts of the terms of a surface: their rounding, and rounding errors of the state after a step.
ROUNDING, NOISE = 2.0**-50, 2.0**-47
# Operations whose constants `with_parameters` takes; lists are shorter with some numbers.
_OF_PARAMETERS = "fadd", "fsub", "fmul", "fdiv", "max", "min", "olt", "ogt", "oge", "select"
_PLAIN = 0.0, 1.0, -1.0


class KeyedProgram(Program):
    """A `Program` that can be a key of caches: programs with the same text are equal.

    Its operations cannot be the key: 1 is the number of a value and 1.0 a constant, but 1 == 1.0;
    and 0.0 == -0.0.
    """

    @cached_property
    def _text(self):
        return repr((self.operations, self.results))

    def __eq__(self, other):
        return self._text == other._text

    def __hash__(self):
        return hash(self._text)


class EventAction(NamedTuple):
    """An event and its action; the programs read the state (D), then the parameters (P).

    surface    `KeyedProgram` of the function that is 0 at the event, or None if it has times
    to         `KeyedProgram` of the new state, or None if the state stays
    direction  1: acts where the function rises along the motion, -1: where it falls, 0: both
    most       how many actions it takes to end the trajectory, infinity if none ends it
    holds      1: its own action leaves a state on the surface above it, whatever the rate is; 2: so
               does any other action; 0: the rate decides
    """

    surface: Program | None
    to: Program | None
    direction: int
    most: float
    holds: int = 0

    def read(self):
        """Return the numbers of all values that `surface` and `to` read, among them components."""
        found = set() if self.surface is None else read_by(self.surface, self.surface.results)
        if self.to is not None:
            new = (a for i, a in enumerate(self.to.results) if type(a) is not int or a != i)
            found |= read_by(self.to, new)
        return found

    @staticmethod
    def list_of(values, results):
        """Return the `KeyedProgram` of the operands `results` in the `Expressions` `values`."""
        return KeyedProgram(tuple(needed_for(values.operations, results)), tuple(results))


def with_parameters(actions, first):
    """Return the `EventAction`s `actions` with parameters for constants, and these constants.

    The parameters have numbers from `first` on. So events that differ only by constants share code.
    """
    lists = [program for action in actions for program in action[:2] if program is not None]
    found = [a for program in lists for a in _constants(program) if a == a and a not in _PLAIN]
    constants = {a: first + k for k, a in enumerate(dict.fromkeys(found))}

    def new(operands, are_parameters=True):
        known = constants if are_parameters else {}
        later = (a if type(a) is float or a < first else a + len(constants) for a in operands)
        return tuple(known.get(a, a) if type(a) is float else a for a in later)

    def of(program):
        operations = (
            (name, *new([number]), new(operands, name in _OF_PARAMETERS))
            for name, number, operands in program.operations
        )
        return KeyedProgram(tuple(operations), new(program.results))

    own = [[program and of(program) for program in action[:2]] for action in actions]
    actions = tuple(
        EventAction(*pair, *action[2:]) for action, pair in zip(actions, own, strict=True)
    )
    return actions, tuple(constants)


def _constants(program):
    """Return the constants in a program that may become parameters: operands and results."""
    of = [a for name, _, operands in program.operations if name in _OF_PARAMETERS for a in operands]
    return [a for a in (*of, *program.results) if type(a) is float]


def read_by(program, results):
    """Return the set of numbers of values that a `Program` reads or that are in `results`."""
    read = [a for each in program.operations for a in each[2]]
    return {a for a in (*read, *results) if type(a) is int}


class EventProgram(NamedTuple):
    """A `Program` of events. Its inputs are numbers of rows, then parameters, then scales.

    `rows` is how many rows it reads, such as the state and f there. Scales belong to columns of
    derivatives by parameters (`Variational`).
    """

    program: Program
    rows: int


class EventSet(NamedTuple):
    """Events as code takes them: first events on surfaces, then events at times.

    directions   `EventAction.direction` of the events on surfaces
    gaps, flats  for each of these, whether its function may have no value, or may be 0 all around
                 a state
    most         `EventAction.most` of all events
    parts        `EventProgram`s by name, see below
    components   for each event the numbers of the components that it may set
    P            number of parameters
    holds        `EventAction.holds` of the events on surfaces

    The part `to{k}` reads the state, and returns the components that event k sets. `toward` reads
    the state and f there, and returns `OF_SURFACE` numbers of each surface. `tau{k}` reads the
    state, a column v of derivatives and f before the event. It returns tau: a solution that starts
    dx away reaches the surface a time tau dx earlier. `column{k}` reads also f after the event and
    tau, and returns the new column. `tau{k}_{q}` and `column{k}_{q}`, for a column by parameter q,
    also read its scale. Without columns, parts for columns are missing.
    """

    directions: tuple
    gaps: tuple
    flats: tuple
    most: tuple
    parts: dict
    components: tuple
    P: int
    holds: tuple

    surfaces = property(lambda self: len(self.directions))
    count = property(lambda self: len(self.most))
    at_times = property(lambda self: self.count - self.surfaces)

    def only_records(self, k):
        """Return True if event k leaves the state as it is, and never ends the trajectory."""
        return not self.components[k] and self.most[k] == inf


def in_order_of_code(actions):
    """Return places in `actions` in the order of `EventSet`: on surfaces first, then at times."""
    return sorted(range(len(actions)), key=lambda k: actions[k].surface is None)


def components_of(action):
    """Return the numbers of the components of the state that an `EventAction` may set."""
    results = () if action.to is None else action.to.results
    return tuple(i for i, a in enumerate(results) if not (type(a) is int and a == i))


def event_set_of(actions, D, P, by=(), with_columns=False):
    """Return the `EventSet` of `EventAction`s, for D components and P parameters.

    If `with_columns`, it has parts that change columns of derivatives by the initial state, and by
    the parameters with the numbers `by`.
    """
    parts, components = {}, []
    for k, action in enumerate(actions):
        own = components_of(action)
        components.append(own)
        if own:
            results = [action.to.results[i] for i in own]
            own = Program(needed_for(action.to.operations, results), results)
            parts[f"to{k}"] = EventProgram(own, D)
        if with_columns:
            for q in (None, *range(len(by))):
                parts |= _of_columns(k, action, D, P, by, q)
    on_surfaces = [action for action in actions if action.surface is not None]
    if on_surfaces:
        parts["toward"] = _toward(on_surfaces, D, P)
    directions = tuple(action.direction for action in on_surfaces)
    most = tuple(action.most for action in actions)
    names = [{name for name, *_ in action.surface.operations} for action in on_surfaces]
    gaps, flats = (
        tuple(not each.isdisjoint(kind) for each in names)
        for kind in (WITH_GAPS, {*_BRANCHES, *filter(is_table, set().union(*names))})
    )
    holds = tuple(action.holds for action in on_surfaces)
    return EventSet(directions, gaps, flats, most, parts, tuple(components), P, holds)


def _toward(actions, D, P):
    """Return the `EventProgram` `toward`, which finds s, ds/dt and three sizes of each surface s.

    `actions` are the `EventAction`s on surfaces. The sizes are sums of moduli: of the terms of s,
    of the terms of ds/dt, and of the slopes ds/dx_j.
    """
    values = Expressions(D + P, range(D, D + P))
    known = [{i: i for i in range(D + P)} for _ in actions]
    of_surfaces = [
        a
        for action, own in zip(actions, known, strict=True)
        for a in emitted(values, action.surface, own)
    ]
    slopes = gradients(values, [*values.operations], of_surfaces, D)
    rates, results = [values.given() for _ in range(D)], []
    moduli = {j: operand_of(abs(values.number(a))) for j, a in enumerate(rates)}
    for action, own, a, row in zip(actions, known, of_surfaces, slopes, strict=True):
        [s] = action.surface.results
        size = sizes_of(values, action.surface.operations, own)[s]
        steep = {j: operand_of(abs(values.number(slope))) for j, slope in row.items()}
        results += [a, _product(values.emit, row, dict(enumerate(rates)))]
        results += [operand_of(size), _product(values.emit, steep, moduli)]
        results.append(_product(values.emit, steep, dict.fromkeys(steep, 1.0)))
    given = {D + p: 2 * D + p for p in range(P)} | {i: i for i in range(D)}
    given |= {a: D + j for j, a in enumerate(rates)}
    found = Program(needed_for(values.operations, results), results)
    return EventProgram(renumbered(found, given), 2 * D)


def _of_columns(k, action, D, P, by, q):
    """Return {name: `EventProgram`}: the parts `tau` and `column` of `EventSet` for event k.

    They change a column v, the derivative of the state by the initial state if q is None, else by
    parameter by[q]. `tau`, for events on surfaces, finds minus the derivative of the event's time.
    `column` finds v after the event. `action` is the `EventAction` of event k.
    """
    values = Expressions(D + P, range(D, D + P))
    results = [*range(D)] if action.to is None else emitted(values, action.to)
    results += [] if action.surface is None else emitted(values, action.surface)
    rows = gradients(values, [*values.operations], results, D, by)
    v, before, after = ([values.given() for _ in range(D)] for _ in range(3))
    tau, scale, emit = values.given(), values.given(), values.emit
    place = {D + p: 4 * D + 1 + p for p in range(P)} | {i: i for i in range(D)}
    place |= {a: D + j for j, a in enumerate([*v, *before, *after, tau])}
    place[scale] = 4 * D + 1 + P + (q or 0)
    directions = dict(enumerate(v)) | ({} if q is None else {by[q]: scale})
    end, found = "" if q is None else f"_{q}", {}

    def add(name, results):
        own = Program(needed_for(values.operations, results), results)
        found[f"{name}{k}{end}"] = EventProgram(renumbered(own, place), 4 * D + 1)

    if action.surface is not None:
        reach = _product(emit, rows[D], directions)
        add("tau", [emit("fdiv", reach, _product(emit, rows[D], dict(enumerate(before))))])
    columns = []
    for row, rate in zip(rows[:D], after, strict=True):
        jump = emit("fsub", rate, _product(emit, row, dict(enumerate(before))))
        columns.append(emit("fadd", _product(emit, row, directions), emit("fmul", jump, tau)))
    add("column", columns)
    return found


def _product(emit, row, vector):
    """Emit the scalar product of two dicts {component: operand}; return its operand, or 0.0."""
    total = dot(emit, [(slope, vector[j]) for j, slope in row.items() if j in vector])
    return 0.0 if total is None else total
