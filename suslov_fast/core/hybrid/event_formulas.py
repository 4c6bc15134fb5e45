"""Events and their actions as expression programs of a state and parameters.

An event happens on a surface, where a function s of the state is 0, or at given times. Its action
may set a new state to(x), and may end the trajectory.

A column v is the derivative of the state with respect to a parameter p or to the initial state. A
change dp of the parameter moves the event by the time -tau dp. So at the event the column becomes

to' v + dto/dp + (f_after - to' f_before) tau,     tau = (grad s . v + ds/dp) / (grad s . f_before).

At given times tau is 0. If an action causes another one at the same instant, both have one tau.
"""

from itertools import chain
from math import inf
from typing import NamedTuple

from ..cached import cached_property
from ..expressions.derivative import gradients
from ..expressions.function_records import same
from ..expressions.programs import Expressions, Program, dot, emitted, needed_for, program_of
from ..expressions.rounding import moved_by_projection, sizes_of, with_phases
from ..expressions.tables import is_table
from ..expressions.tolerances import SMALLEST
from ..expressions.values import operand_of

# How many numbers `_toward` finds for each surface.
OF_SURFACE = 5
_BRANCHES = "select", "max", "min", "fabs", "floor"  # with these, s may be 0 in a neighbourhood
# Operations that have no value for some operands.
_LOGARITHMS = "log", "log2", "log10", "log1p"
_WITH_POLES = "fdiv", "tan", "pow", *_LOGARITHMS
WITH_GAPS = "fdiv", "sqrt", "pow", *_LOGARITHMS, "asin", "acos", "acosh", "atanh"
GAP = 0.75  # the number in the row `side` (`flow.memory`) where s has no value
# Constants of these operations become parameters, except the _PLAIN ones, which shorten programs.
_OF_PARAMETERS = "fadd", "fsub", "fmul", "fdiv", "max", "min", "olt", "ogt", "oge", "select"
_PLAIN = 0.0, 1.0, -1.0, SMALLEST


class Mark:
    """Numbers added to modes (1, -1, 0) of surfaces that meet, for which others are sought."""

    STEP = 4.0
    LEAVES = 1 * STEP  # the solution slides along one of the surfaces, and leaves it
    BEGINS = 2 * STEP  # the solution begins where the surfaces meet
    ARRIVES = 3 * STEP  # the solution arrives where the surfaces meet
    IS_NEAR = 4 * STEP  # the solution is close to such a point, and may wind into it


class KeyedProgram(Program):
    """A `Program` that can be a key of caches: programs with the same text are equal.

    Its operations cannot be the key: 1 is the number of a value, and 1.0 a constant, but 1 == 1.0.
    """

    @staticmethod
    def of(values, results):
        """Return the `KeyedProgram` of the operands `results` in the `Expressions` `values`."""
        return KeyedProgram(tuple(needed_for(values.operations, results)), tuple(results))

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
    most       the action of this number ends the trajectory; infinity if none ends it
    holds      the actions after which a state on the surface is taken to be above it, even if its
               rate leads below: 0: none, 1: those of this event, 2: those of any event
    rests      True if the action itself decides whether a body that bounces comes to rest
    push       `KeyedProgram` of the direction (D) of the force on a body at rest on the surface, or
               None if it is that in which `to` moves states
    slides     True if the surface is replaced by 0 while the solution slides along it
    modes      (first, count) of components that are modes of surfaces, if the action serves the
               search for modes (`flow.events.mode_search`), which reads further results of `to`
    """

    surface: Program | None
    to: Program | None
    direction: int
    most: float
    holds: int = 0
    rests: bool = False
    push: Program | None = None
    slides: bool = False
    modes: tuple = ()

    def read(self):
        """Return the numbers of all values that `surface` and `to` read, such as components."""
        numbers = set() if self.surface is None else read_by(self.surface, self.surface.results)
        if self.to is not None:
            numbers |= read_by(self.to, [self.to.results[i] for i in components_of(self)])
        return numbers


def with_parameters(actions, first, others=0):
    """Return `EventAction`s with parameters in place of constants, and a tuple of the constants.

    So events that differ by constants alone share code. Values from `first` on, results of
    operations, get other numbers: those of `others` parameters come first, then these parameters.
    """
    constants = {}
    for program in (each for action in actions for each in action[:2] if each is not None):
        lists = [of for name, _, of in program.operations if name in _OF_PARAMETERS]
        operands = chain(*lists, program.results)
        constants |= dict.fromkeys(a for a in operands if type(a) is float)
    constants = [a for a in constants if a == a and a not in _PLAIN]
    parameters = {a: first + others + k for k, a in enumerate(constants)}

    def new(a, is_parameter=True):
        if type(a) is float:
            return parameters.get(a, a) if is_parameter else a
        return a if a < first else a + others + len(constants)

    def of(program):
        operations = (
            (name, new(number), tuple(new(a, name in _OF_PARAMETERS) for a in operands))
            for name, number, operands in program.operations
        )
        return KeyedProgram(tuple(operations), tuple(map(new, program.results)))

    pairs = ([program and of(program) for program in action[:2]] for action in actions)
    both = zip(actions, pairs, strict=True)
    actions = (a._replace(surface=s, to=to, push=None) for a, (s, to) in both)
    return tuple(actions), tuple(constants)


def read_by(program, results):
    """Return the numbers of all values that a `Program` reads, or that are in `results`."""
    read = [a for each in program.operations for a in each[2]]
    return {a for a in (*read, *results) if type(a) is int}


class EventProgram(NamedTuple):
    """A `Program` that reads `rows` numbers, such as x and f, then parameters, then scales."""

    program: Program
    rows: int


class EventSet(NamedTuple):
    """Events in the order of the code: first events on surfaces, then events at times.

    directions   `EventAction.direction` of the events on surfaces
    gaps         for each of them, True if its function may have no value
    flats        for each of them, True if its function may be 0 all around a state
    poles        for each of them, True if its function may have poles
    most         `EventAction.most` of all events
    parts        {name: `EventProgram`}, see below
    components   for each event the numbers of the components that it may set
    P            number of parameters
    holds        `EventAction.holds` of the events on surfaces
    rests        `EventAction.rests` of the events on surfaces
    slides       `EventAction.slides` of the events on surfaces
    search       the number of the event with `EventAction.modes`, or None
    modes        its `EventAction.modes`, or ()

    The part `toward` serves all surfaces. The others belong to event k; the head has tau and v:

    toward     reads the state and f; its results are `OF_SURFACE` numbers of each surface
    to{k}      reads the state; its results are the components that the event sets
    search     reads the state; its results tell if its modes are consistent (`SlidingEquations`)
    tau{k}     reads the state, v, and f before the event; its result is tau
    column{k}  reads the state, v, f before and after the event, and tau; its results are the new v

    The parts `tau` and `column` exist if motions have columns. Variants with "_{q}" at the end of
    their names are for the column of parameter q; they also read its scale (`variational`).
    """

    directions: tuple
    gaps: tuple
    flats: tuple
    poles: tuple
    most: tuple
    parts: dict
    components: tuple
    P: int
    holds: tuple
    rests: tuple
    slides: tuple
    search: int | None
    modes: tuple

    surface_count = property(lambda self: len(self.directions))
    count = property(lambda self: len(self.most))
    at_times = property(lambda self: self.count - self.surface_count)
    # Numbers of the surfaces of users' events at which no body rests.
    plain = property(
        lambda self: [k for k in range(self.surface_count) if not (self.holds[k] or self.rests[k])]
    )

    def only_records(self, k):
        """Return True if event k leaves the state as it is, and never ends the trajectory."""
        return not self.components[k] and self.most[k] == inf


def in_order_of_code(actions):
    """Return places in `actions` in the order of `EventSet`: on surfaces first, then at times."""
    return sorted(range(len(actions)), key=lambda k: actions[k].surface is None)


def components_of(action, D=None):
    """Return the numbers of the components (D) of the state that an `EventAction` may set."""
    results = () if action.to is None else action.to.results[:D]
    return tuple(i for i, a in enumerate(results) if not same(a, i))


def event_set_of(actions, D, P, by=(), with_columns=False, invariants=None):
    """Return the `EventSet` of `actions`; if `with_columns`, also the parts `tau` and `column`.

    `invariants` is the `Program` of functions to whose values steps are projected.
    """
    parts, components = {}, tuple(components_of(action, D) for action in actions)
    for k, (action, of) in enumerate(zip(actions, components, strict=True)):
        if of:
            to = program_of(action.to.operations, [action.to.results[i] for i in of])
            parts[f"to{k}"] = EventProgram(to, D)
        if action.modes:
            parts["search"] = EventProgram(
                program_of(action.to.operations, action.to.results[D:]), D
            )
        for q in (None, *range(len(by))) if with_columns else ():
            parts |= _of_columns(k, action, D, P, by, q)
    on_surfaces = [action for action in actions if action.surface is not None]
    if on_surfaces:
        parts["toward"] = _toward(on_surfaces, D, P, invariants)
    names = [{name for name, *_ in action.surface.operations} for action in on_surfaces]
    return EventSet(
        directions=tuple(action.direction for action in on_surfaces),
        gaps=tuple(not each.isdisjoint(WITH_GAPS) for each in names),
        flats=tuple(any(name in _BRANCHES or is_table(name) for name in each) for each in names),
        poles=tuple(not each.isdisjoint(_WITH_POLES) for each in names),
        most=tuple(action.most for action in actions),
        parts=parts,
        components=components,
        P=P,
        holds=tuple(action.holds for action in on_surfaces),
        rests=tuple(action.rests for action in on_surfaces),
        slides=tuple(action.slides for action in on_surfaces),
        search=next((k for k, action in enumerate(actions) if action.modes), None),
        modes=next((action.modes for action in actions if action.modes), ()),
    )


def _toward(actions, D, P, invariants):
    """Return the `EventProgram` `toward`, which finds s and ds/dt for all events on surfaces.

    Its results for each surface are s, ds/dt, and sums of moduli: of the terms of s, of the terms
    of ds/dt, and of the slopes ds/dx_j. Terms of s contain those of which a projection to
    `invariants` leaves the rounding errors in s.
    """
    first = 2 * D
    values = Expressions(first + P, range(first, first + P))
    inputs = {i: i for i in range(D)} | {D + p: first + p for p in range(P)}
    copies = [dict(inputs) for _ in actions]
    surfaces = [emitted(values, a.surface, new)[0] for a, new in zip(actions, copies, strict=True)]
    slopes = gradients(values, [*values.operations], surfaces, D)
    f, results = {j: D + j for j in range(D)}, []
    levels = emitted(values, invariants, dict(inputs)) if invariants else []
    moved = moved_by_projection(values, gradients(values, [*values.operations], levels, D))
    moduli = {j: operand_of(abs(values.number(a))) for j, a in f.items()}
    for action, new, s, row in zip(actions, copies, surfaces, slopes, strict=True):
        sizes = sizes_of(values, action.surface.operations, new)
        if action.holds < 2:
            sizes = with_phases(values, action.surface.operations, new, sizes)
        steep = {j: operand_of(abs(values.number(slope))) for j, slope in row.items()}
        size = sizes[action.surface.results[0]]
        for j in sorted(steep.keys() & moved.keys()):
            size = size + values.number(steep[j]) * moved[j]
        results += [
            s,
            _product(values.emit, row, f),
            operand_of(size),
            _product(values.emit, steep, moduli),
            _product(values.emit, steep, dict.fromkeys(steep, 1.0)),
        ]
    return EventProgram(program_of(values.operations, results), first)


def _of_columns(k, action, D, P, by, q):
    """Return {name: `EventProgram`} of `column` and, if event k is on a surface, of `tau`.

    Both formulas are in the head. The column is with respect to parameter by[q], or x0 if q is
    None.
    """
    tau = 4 * D
    first, scales = tau + 1, tau + 1 + P
    values = Expressions(scales + len(by), range(first, scales))
    inputs = {i: i for i in range(D)} | {D + p: first + p for p in range(P)}
    results = [*range(D)] if action.to is None else emitted(values, action.to, dict(inputs))[:D]
    results += [] if action.surface is None else emitted(values, action.surface, dict(inputs))
    rows = gradients(values, [*values.operations], results, D, [inputs[p] for p in by])
    v, before = ({j: k * D + j for j in range(D)} for k in (1, 2))
    v |= {} if q is None else {inputs[by[q]]: scales + q}
    results, columns, emit = {}, [], values.emit
    if action.surface is not None:
        of_v, of_f = (_product(emit, rows[D], each) for each in (v, before))
        results["tau"] = [emit("fdiv", of_v, of_f)]
    for after, row in enumerate(rows[:D], 3 * D):
        jump = emit("fsub", after, _product(emit, row, before))
        columns.append(emit("fadd", _product(emit, row, v), emit("fmul", jump, tau)))
    results["column"] = columns
    of = k if q is None else f"{k}_{q}"
    programs = {name: program_of(values.operations, each) for name, each in results.items()}
    return {f"{name}{of}": EventProgram(program, first) for name, program in programs.items()}


def _product(emit, row, vector):
    """Emit the scalar product of two dicts {component: operand}; return its operand, or 0.0."""
    total = dot(emit, [(slope, vector[j]) for j, slope in row.items() if j in vector])
    return 0.0 if total is None else total
