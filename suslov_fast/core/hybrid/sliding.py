"""Right-hand sides that slide: f with a mode for each surface at which it jumps.

On a surface s = 0 to which f leads back from both sides, Filippov's solution slides: its rate is
f_below + w (f_above - f_below) with the w at which ds/dt = 0, until w leaves [0, 1]. Here each
surface has a mode, a further component of the state: 1 above, -1 below, 0 while the solution
slides. Comparisons at the surface become truth values of the mode, and an event sets the mode. So
steps, events and derivatives are the same as for any other f. If solutions slide along several
surfaces at once, each surface has its own w, and every ds/dt is 0. This extension is unique if the
jump at each surface does not depend on the sides of other surfaces.
"""

from functools import reduce
from itertools import combinations, compress, product
from math import inf

import numpy as np

from ..expressions.function_records import same
from ..expressions.numpy_evaluation import results_at
from ..expressions.programs import dot, emitted, folded, is_zero, program_of, renamed
from ..expressions.projection import NOTHING
from ..expressions.tolerances import TINY
from ..expressions.values import Number, joined, operand_of
from .constraint_forces import Constraint, ExtendedState
from .contacts import Contact, Contacts, may_be_contact
from .event_formulas import WITH_GAPS, EventAction, KeyedProgram, Mark
from .tolerances import (
    END_OF_REST,
    MOST_MODES,
    MOST_PAIRS_OF_MODES,
    NEAR_SURFACE,
    ON_SURFACE,
    SHORT_BOUNCE,
    ZERO_BESIDE,
)

_COMPARISONS = "olt", "ogt", "oge", "oeq"
_KINKS = "fabs", "max", "min"


class _Rates:
    """The rates of a `Program` f (D) with a mode for each surface, then for each contact.

    pairs        the two compared operands of each surface
    twins        {number of a surface: [(number of an earlier one, its sign, truth value that the
                 parameters make both the same plane, s of one a multiple of the other's)]}
    flats        {number of a surface: truth value that s has the same value in all states}
    comparisons  the operations that compare them; both are results of `_comparisons_in`
    values       the `ExtendedState` of f, its modes and its parameters
    surfaces     the operand of s for each surface
    touching     {number of an event: `Contact`}, at first {number of an event: `EventAction`}
    constraints  {mode: `Constraint`}
    """

    def __init__(self, f, comparisons, pairs, touching, D, P, levels):
        self.f, self.D = f, D
        self.comparisons, self.pairs = comparisons, pairs
        self.count = count = len(pairs)
        # |s| becomes mode * s, < 0 just beyond s = 0; max(mode * s, 0) if f has roots, logs, ...
        self.has_gaps = not {name for name, *_ in f.operations}.isdisjoint(WITH_GAPS[1:])
        self.has_clock = bool(touching) or count > 1
        self.size = count + len(touching) + 2 * self.has_clock
        self.values = values = ExtendedState(D, self.size, P)
        modes = [values.number(D + g) for g in range(count)]
        self.above = [(mode > 0.5).number for mode in modes]
        self.twins, self.flats = {}, {}
        self._find_planes()
        new = self._evaluated({})
        self.surfaces = [values.difference(*renamed(pair, new)) for pair in pairs.values()]
        truths = [(g, truth) for g, twins in self.twins.items() for *_, truth in twins]
        for g, truth in [*truths, *self.flats.items()]:  # such a surface is never reached
            self.surfaces[g] = folded(values.emit, "select", (truth, 1.0, self.surfaces[g]))
        self.slopes = values.slopes(self.surfaces)
        self.slides = [mode * mode < 0.5 for mode in modes]
        self.touching = {}
        free = self.with_sides({})[0] if touching else None
        if touching:
            values.project(emitted(values, levels[1], dict(values.inputs)), levels[0])
        self.touching = {
            k: Contact(values, action, mode, free)
            for mode, (k, action) in enumerate(touching.items(), D + count)
        }
        self.constraints = self._constraints({})

    def _find_planes(self):
        """Find `twins` and `flats` among surfaces that are planes."""
        values, emit = self.values, self.values.emit
        program = program_of(self.f.operations, [a for pair in self.pairs.values() for a in pair])
        operands = emitted(values, program, dict(values.inputs))
        surfaces = [*map(values.difference, operands[::2], operands[1::2])]
        at_0 = values.at([0.0] * (self.D + self.size), surfaces)[0]
        slopes = values.slopes(surfaces)
        is_plane = [all(map(values.is_fixed, row.values())) for row in slopes]

        def are_true(name, pairs):
            truth = True
            for pair in pairs:
                truth = folded(emit, "and", (truth, folded(emit, name, pair)))
                if truth is False:
                    break
            return truth

        for g in compress(range(self.count), is_plane):
            if (truth := are_true("oeq", ((a, 0.0) for a in slopes[g].values()))) is not False:
                self.flats[g] = truth
        for g, h in combinations(compress(range(self.count), is_plane), 2):
            pairs = [(slopes[g].get(i, 0.0), slopes[h].get(i, 0.0)) for i in range(self.D)]
            pairs = [pair for pair in pairs if not all(map(is_zero, pair))]
            pairs.append((at_0[g].number, at_0[h].number))
            minors = [
                (emit("fmul", a, d), emit("fmul", b, c))
                for (a, b), (c, d) in combinations(pairs, 2)
            ]
            are_parallel, product = are_true("oeq", minors), dot(emit, pairs, 0.0)
            for sign in (1.0, -1.0):
                is_same = folded(emit, "ogt", (emit("fmul", sign, product), 0.0))
                if (truth := folded(emit, "and", (are_parallel, is_same))) is not False:
                    self.twins.setdefault(h, []).append((g, sign, truth))

    def by_first_twins(self):
        """Return the comparisons, with the first one of planes that are equal whatever numbers."""
        keys, first = [*self.pairs], {}
        for h, twins in self.twins.items():
            g, sign, truth = twins[0]
            if truth is True:
                first[keys[h]] = keys[g], sign
        found = {}
        for number, (key, kind, sign, *factors) in self.comparisons.items():
            key, own = first.get(key, (key, 1.0))
            found[number] = key, kind, own * sign, *factors
        return found

    def _is_above(self, g, sides):
        """Return the truth value that f is f above surface g; a twin has the side of its twin."""
        emit, is_above = self.values.emit, sides.get(g, self.above[g])
        for h, sign, truth in reversed(self.twins.get(g, ())):
            of_twin = folded(emit, "xor", (sign < 0.0, sides.get(h, self.above[h])))
            differs = folded(emit, "and", (truth, folded(emit, "xor", (is_above, of_twin))))
            is_above = folded(emit, "xor", (is_above, differs))
        return is_above

    def _constraints(self, sides):
        """Return {mode: `Constraint`} of contacts, and of surfaces that are not in `sides`."""
        of_surfaces = {
            self.D + g: Constraint(self.slides[g], self.slopes[g], self._jumps(g, sides))
            for g in range(self.count)
            if g not in sides
        }
        return of_surfaces | {c.mode: c.constraint for c in self.touching.values()}

    def changes(self, a, b):
        """Return True if the force of the constraint of mode b changes the rate of mode a."""
        gradient, direction = self.constraints[a].gradient, self.constraints[b].direction
        return not same(self.values.dot(gradient, direction).number, 0.0)

    def lets_pass(self, contact):
        """Return True if an action slows bodies and turns none back; random states are tried."""
        program = program_of(self.values.operations, [contact.passed.number])
        x = np.random.default_rng(0).uniform(-1.5, 1.5, (self.values.parameters.stop, 32))
        with np.errstate(all="ignore"):
            return bool((results_at(program, dict(enumerate(x)), (32,))[0] > 1e-9).all())

    def with_sides(self, sides):
        """Return the rates (D), the factors of forces, and the matrix of the equations for them.

        They are results of `with_forces`. At surfaces in `sides`, {number of a surface: True
        above}, f is f of this side, and there is no force. At all other surfaces, and at contacts,
        the mode decides whether the solution slides or rests there, by a force.
        """
        f, constraints = self._f(sides), self._constraints(sides)
        changes = {a: -self.values.dot(c.gradient, f) for a, c in constraints.items()}
        return self.values.with_forces(f, constraints, changes)

    def depends(self, g, h):
        """Return True if the jump of f at surface g depends on the side of surface h."""
        results = [a for is_above in (True, False) for a in self._jumps(g, {h: is_above})]
        program = program_of(self.values.operations, results)
        x = np.random.default_rng(0).uniform(0.5, 1.5, (self.values.parameters.stop, 16))
        above, below = np.split(results_at(program, dict(enumerate(x)), (16,)), 2)
        return bool((abs(above - below) > 1e-9 * (abs(above) + abs(below))).any())

    def _f(self, sides):
        return renamed(self.f.results, self._evaluated(sides))

    def _jumps(self, g, sides):
        """Return f above surface g minus f below it, as D operands."""
        above, below = (self._f(sides | {g: is_above}) for is_above in (True, False))
        return [*map(self.values.difference, above, below)]

    def _evaluated(self, sides):
        """Return {operand of f: operand in `values`}, where `sides` replace some modes."""
        new, emit = dict(self.values.inputs), self.values.emit
        for name, number, operands in self.f.operations:
            of = renamed(operands, new)
            key, kind, sign, *factors = self.comparisons.get(number, (None, "", 1.0))
            if key not in self.pairs:
                new[number] = folded(emit, name, of)
                continue
            g = [*self.pairs].index(key)
            is_above = self._is_above(g, sides)
            if kind == "fdiv":
                [c] = renamed(factors, new)
                new[number] = emit("fmul", c, folded(emit, "select", (is_above, sign, -sign)))
            elif kind == "fabs":  # |s| is the mode times s, so 0 on the surface
                modulus = emit("fmul", sign, emit("fmul", self.D + g, of[0]))
                if g in self.twins:
                    c = emit("fmul", sign, of[0])
                    modulus = folded(emit, "select", (is_above, c, emit("fmul", -1.0, c)))
                modulus = emit("max", modulus, 0.0) if self.has_gaps else modulus
                new[number] = 0.0 if g in sides else modulus
            elif kind in _KINKS:
                new[number] = folded(emit, "select", (is_above, *of[:: int(sign)]))
            elif kind == "oeq":
                new[number] = False
            else:
                new[number] = is_above if sign > 0 else folded(emit, "xor", (True, is_above))
            if g in self.flats and name in _COMPARISONS:  # if s is not flat, this is constant
                flat, of = self.flats[g], zip(of, (1.0, 0.0), strict=True)
                own = folded(emit, name, [folded(emit, "select", (flat, *each)) for each in of])
                differs = folded(emit, "and", (flat, folded(emit, "xor", (own, new[number]))))
                new[number] = folded(emit, "xor", (new[number], differs))
        return new


class SlidingEquations(_Rates):
    """Equations with modes; `actions` are the `EventAction`s of events, events on surfaces first.

    Steps are projected to `invariants`.

    The first mode is infinite if no combination of modes is consistent, or if several are. `sign`
    is the sign of the time.

    size      the number of new components; 0 if no solution slides or rests, or if surfaces or
              pairs of them that depend on one another are too many (`MOST_MODES`, then
              `MOST_PAIRS_OF_MODES`)
    count     the number of surfaces. Their modes are components D, D + 1, ...; then come modes of
              contacts. If there are contacts or several surfaces (`has_clock`), two more
              components follow: T / (1 + T), where T is the last requested time, and the time
    results   the operands of all rates in `values`
    contacts  {number of an event that is a contact: the component that is its mode}
    actions   `EventAction`s in this order: of each event on a surface, of the mode of each surface
              (not of contacts), of all modes at time 0, of each other event, of `_search`
    surfaces_of_events  the number of events on surfaces
    recorders  {number of an event that only records crossings: the number of its surface, along
               which solutions slide}
    """

    def __init__(self, values, results, D, P, actions=(), sign=1, invariants=NOTHING):
        f, self.size = program_of(values.operations, results), 0
        levels = invariants.constraints, program_of(values.operations, invariants.operands)
        self.sign = float(sign)
        comparisons, pairs = _comparisons_in(values, f)
        touching = {k: a for k, a in enumerate(actions) if may_be_contact(a, D, P)}
        if len(pairs) + len(touching) > MOST_MODES:
            return
        # A surface has a mode if ds/dt jumps across it. A contact has a mode if its force changes
        # d2s/dt2, and if f neither jumps nor has a kink at its surface.
        trial = _Rates(f, comparisons, pairs, touching, D, P, levels)
        has_mode = [trial.changes(D + g, D + g) for g in range(len(pairs))]
        comparisons = trial.by_first_twins()
        pairs = dict(compress(pairs.items(), has_mode))
        for k, contact in trial.touching.items():
            is_of_f = any(same(contact.s.number, s) for s in trial.surfaces)
            holds = not is_of_f and trial.changes(contact.mode, contact.mode)
            if not holds or trial.lets_pass(contact):
                del touching[k]
        super().__init__(f, comparisons, pairs, touching, D, P, levels)
        changes = sum(self.changes(a, b) for a, b in product(self.constraints, repeat=2))
        if not 0 < changes * len(self.constraints) <= MOST_PAIRS_OF_MODES:
            self.size = 0
            return
        self._find_rates()
        self._find_surfaces()
        self._find_actions(actions)

    def _find_rates(self):
        """Find rates along modes, and what contacts need."""
        self.contacts = {k: contact.mode for k, contact in self.touching.items()}
        f, self.factors, matrix = self.with_sides({})
        rates_of_modes = [0.0] * self.size
        if self.has_clock:
            rates_of_modes[-1] = self.sign
        if self.contacts:
            self.resting = Contacts(self.values, self.touching, self.factors, matrix, self.sign)
            f = self.resting.with_pull(f)
        self.results = f + rates_of_modes

    def _find_surfaces(self):
        """Find rates of surfaces, and which of their modes depend on one another."""
        D = self.D
        of_modes = enumerate(self.surfaces, D)
        changes = {mode: -self.values.number(s) for mode, s in of_modes}
        constraints = {mode: self.constraints[mode] for mode in changes}
        # The state on all surfaces along which it slides, and ds/dt of all surfaces without forces.
        self.landed = self.values.with_forces(range(D), constraints, changes)[0]
        self.free = [self.values.dot(slope, self._f({})) for slope in self.slopes]
        all_pairs = combinations(range(self.count), 2)
        self.dependent = [pair for pair in all_pairs if self.depends(*pair)]
        # Other surfaces on whose modes the mode of each surface depends, or that depend on it.
        self.linked = [
            [h for h in range(self.count) if h != g and self._are_linked(D + g, D + h)]
            for g in range(self.count)
        ]
        self.toward = [self._toward(g) for g in range(self.count)]

    def _find_actions(self, given):
        """Find the actions of all events, from those `given`, and of modes."""
        modes = [self._action_of_mode(g) for g in range(self.count)]
        start = KeyedProgram.of(self.values, self._with_modes(range(self.D + self.size)))
        self.recorders = {}
        events = [self._event(k, action) for k, action in enumerate(given)]
        n = self.surfaces_of_events = sum(action.surface is not None for action in events)
        start = EventAction(None, start, 0, inf)
        self.actions = (*events[:n], *modes, start, *events[n:], *self._search())

    def _are_linked(self, a, b):
        return self.changes(a, b) or self.changes(b, a)

    def _toward(self, g):
        """Return ds/dt below and above surface g, while the solution slides along the others."""
        rates = (self.with_sides({g: is_above})[0] for is_above in (False, True))
        return [self.sign * self.values.dot(self.slopes[g], f) for f in rates]

    def _event(self, k, action):
        """Return the `EventAction` `action` of event k, with the modes after the event."""
        values = self.values
        if k in self.contacts:  # event k also begins and ends a rest
            s, x = self.resting.action_of(k)
            surface, to = [s], self._with_modes(x, leaving=k)
            # ds/dt of a body that leaves its rest is rounding. So if the event acts downwards,
            # `holds` = 1 says, in place of ds/dt, that the body is above the surface.
            holds = int(action.direction < 0)
            action = action._replace(most=inf, holds=holds, rests=True)
        else:
            surface, x = (of and emitted(values, of, dict(values.inputs)) for of in action[:2])
            for g, (s, slides) in enumerate(zip(self.surfaces, self.slides, strict=True)):
                if surface and same(surface[0], s):  # while the solution slides, s is rounding
                    if action.to is None and action.most == inf:
                        self.recorders[k] = g
                    surface = [slides.select(0.0, values.number(s)).number]
                    action = action._replace(slides=True)
            to = x and self._with_modes([*x, *values.modes])
        surface, to = (of and KeyedProgram.of(values, of) for of in (surface, to))
        return action._replace(surface=surface, to=to, push=None)

    def _action_of_mode(self, g):
        """Return the `EventAction` that acts where the mode of surface g ends."""
        number, place = self.values.number, self.D + g
        s, mode, slides = number(self.surfaces[g]), number(place), self.slides[g]
        w = self.factors[place]
        surface = slides.select(w * (1.0 - w), mode * s)
        x = [*range(self.D + self.size)]
        x[place] = slides.select((w > 0.5).select(1.0, -1.0), mode).number
        # Modes of surfaces whose ds/dt depends on mode g may end with it: they are decided, too.
        others = [h for h in range(self.count) if h != g and self.changes(self.D + h, place)]
        x = self._decided(x, [g, *others, g] if others else [g], at=g)
        # A state that begins to slide is moved onto its surfaces, else s drifts at each slide.
        lands = number(x[place]).equals(0.0) & ~slides
        for i, a in enumerate(self.values.at(x, self.landed)[0]):
            if not same(self.landed[i], i):
                x[i] = lands.select(a, number(i)).number
        s, to = (KeyedProgram.of(self.values, a) for a in ([surface.number], x))
        return EventAction(s, to, -1, inf, 2)

    def _search(self):
        """Return the `EventAction` of `mode_search`, if the modes of any surfaces are linked."""
        if not any(self.linked):
            return []
        D, n, number = self.D, self.count, self.values.number
        results = []
        for g, (below, above) in enumerate(self.toward):
            mode, w = number(D + g), self.factors[D + g]
            truths = [_leads_to(mode, below, above, part) for part in (ZERO_BESIDE, -ZERO_BESIDE)]
            truths.append(~self.slides[g] | ((w >= 0.0) & (w <= 1.0)))
            results += [truth.select(1.0, 0.0).number for truth in truths]
        unclear = [self.slides[g] & self.slides[h] for g, h in self.dependent]
        unclear = reduce(Number.__or__, unclear, ~self.values.true)
        results.append(unclear.select(1.0, 0.0).number)
        to = KeyedProgram.of(self.values, [*self.landed, *range(D, D + self.size), *results])
        return [EventAction(None, to, 0, inf, modes=(D, n))]

    def _with_modes(self, x, leaving=None):
        """Return the state x (operands) with modes of contacts (`Contacts.decided`) and surfaces.

        The mode of a surface is the side of x, 1 or -1; on the surface, `_decided` finds the mode.
        At event `leaving`, the body that rests at this contact is set free.
        """
        x = self.resting.decided(x, leaving) if self.contacts else [*x]
        for g, s in enumerate(self.values.at(x, self.surfaces)[0]):
            x[self.D + g] = (s > 0.0).select(1.0, -1.0).number
        return self._decided(x, range(self.count))

    def _decided(self, x, surfaces, at=None):
        """Return the state x (operands) with new modes of the `surfaces` that it is on.

        The new mode is the side to which f leads from the surface, or 0 if f leads back from both
        sides. But a present mode stays if f leads away on its side. The modes, found one by one,
        are then made consistent (`_together`). The state counts as on surface `at`, where the
        solution arrives or stops sliding.
        """
        number, D = self.values.number, self.D
        for g in surfaces:
            wanted = self.surfaces[g], *self.toward[g]
            (s, below, above), (size, *_) = self.values.at(x, wanted)
            mode = number(x[D + g])
            is_on = mode.equals(0.0) | (abs(s) <= ON_SURFACE * size + TINY)
            part = -ZERO_BESIDE
            if g == at:  # a solution that arrives stays on its side only if f leads away there
                part, is_on = self.slides[g].select(part, 0.0), self.values.true
            stays = ~mode.equals(0.0) & _leads_to(mode, below, above, part)
            slides = (below > 0.0) & (above < 0.0)
            new = slides.select(0.0, (below + above >= 0.0).select(1.0, -1.0))
            x[D + g] = (is_on & ~stays).select(new, mode).number
        return self._together(x, surfaces, at) if len(surfaces) > 1 else x

    def _together(self, x, surfaces, at):
        """Return the state x (operands) with consistent modes of several `surfaces`.

        If solutions can slide along all surfaces near x, their modes become 0. So a solution that
        winds into the point where the surfaces meet goes on. Modes are consistent if f, with these
        modes, leads to the side of each mode, or back to the surface if the mode is 0. The first
        mode becomes infinite, a mark of failure, if the modes found are not consistent, if x is on
        the other side of a surface than its mode says, or if both modes of two surfaces with
        dependent jumps are 0. If x is on several surfaces whose modes depend on one another, or
        near them, these modes get a mark (`Mark`): `mode_search` tries all others, too.
        """
        D, n = self.D, self.count
        values, number = self.values, self.values.number
        modes = [number(a) for a in x[D : D + n]]
        s, sizes = values.at(x, self.surfaces)
        rates, time = values.at(x, self.free)[1], number(values.modes[-1])

        def within(part, soon=0.0):
            both = zip(s, sizes, rates, modes, strict=True)
            near = [
                mode.equals(0.0) | (abs(a) <= part * size + soon * rate + TINY)
                for a, size, rate, mode in both
            ]
            return [values.true if g == at else a for g, a in enumerate(near)]

        def with_modes(modes):
            return [*x[:D], *map(operand_of, modes), *x[D + n :]]

        near, on = within(NEAR_SURFACE, SHORT_BOUNCE * time), within(ON_SURFACE)
        sliding = [a.select(0.0, mode) for a, mode in zip(near, modes, strict=True)]
        jumps = [values.dot(c.gradient, c.direction) for c in [*self.constraints.values()][:n]]
        factors = [self.factors[D + g] for g in range(n)]
        results = values.at(with_modes(sliding), [*factors, *jumps])[0]
        arrives = ~values.true if at is None else ~self.slides[at]
        can_slide, is_inside = values.true if at is None else arrives, arrives
        for a, w, jump in zip(near, results[:n], results[n:], strict=True):
            is_between = ~a | ((w >= 0.0) & (w <= 1.0))
            can_slide, is_inside = can_slide & is_between, is_inside & is_between
            can_slide = can_slide & (~a | (jump < 0.0))
        modes = [can_slide.select(a, b) for a, b in zip(sliding, modes, strict=True)]
        meets, winds = self._linked_among(on), self._linked_among(near)
        is_near = reduce(Number.__or__, [a & ~b for a, b in zip(winds, meets, strict=True)])
        is_near = is_near & is_inside & ~can_slide
        meets, winds = [a & ~is_near for a in meets], [a & is_near for a in winds]
        # Other surfaces do not depend on the new modes; events of their own change their modes.
        new = [
            a & ~b if g in surfaces else ~values.true
            for g, (a, b) in enumerate(zip(on, meets, strict=True))
        ]
        is_right = self._are_consistent(with_modes(modes), new, -ZERO_BESIDE)
        far = END_OF_REST * joined("fadd", [abs(number(a)) for a in x[:D]])
        wrong = [mode * a < -far for mode, a in zip(modes, s, strict=True)]
        for g, h in self.dependent:
            wrong.append(modes[g].equals(0.0) & modes[h].equals(0.0) & ~(meets[g] & meets[h]))
        mark = Mark.BEGINS if at is None else arrives.select(Mark.ARRIVES, Mark.LEAVES)
        both = zip(meets, winds, strict=True)
        marks = [a.select(mark, b.select(Mark.IS_NEAR, 0.0)) for a, b in both]
        modes = [mode + mark for mode, mark in zip(modes, marks, strict=True)]
        modes[0] = reduce(Number.__or__, wrong, ~is_right).select(inf, modes[0])
        return with_modes(modes)

    def _linked_among(self, truths):
        """Return truth values that surfaces, with their `truths`, have a linked one with this."""
        none = ~self.values.true
        return [
            truths[g] & reduce(Number.__or__, [truths[h] for h in linked], none)
            for g, linked in enumerate(self.linked)
        ]

    def _are_consistent(self, x, on, part):
        """Return the truth value that f leads to the modes of x at all surfaces with truth `on`."""
        rates = self.values.at(x, [rate for pair in self.toward for rate in pair])[0]
        modes = map(self.values.number, x[self.D : self.D + self.count])
        truth = self.values.true
        for is_on, mode, *pair in zip(on, modes, rates[::2], rates[1::2], strict=True):
            truth = truth & (~is_on | _leads_to(mode, *pair, part))
        return truth


def _leads_to(mode, below, above, part):
    """Return the truth value that f leads from a surface to the side `mode`, 1 above or -1 below.

    If the mode is 0, return that f leads back to the surface from both sides. `below` and `above`
    are ds/dt on both sides. A rate that leads to a side must be at least `part` times the modulus
    of the other rate; a negative `part` admits rounding errors.
    """

    def leads(rate, other):
        return rate >= part * (abs(other) + TINY)

    up, down = leads(above, below), leads(-below, above)
    returns = leads(below, above) & leads(-above, below)
    return ((mode > 0.5) & up) | ((mode < -0.5) & down) | (mode.equals(0.0) & returns)


def _comparisons_in(values, program):
    """Return {number of a comparison or kink: (key, instruction, sign)}, and {key: (a, b)}.

    a and b are the compared operands. The sign is 1.0 if, where a > b, the comparison is true or
    the kink (such as max) has the value of its first operand; else -1.0. A quotient c x / |x| is
    listed, too, as (key, "fdiv", sign of x where a > b, c).
    """
    comparisons, pairs = {}, {}
    for name, number, operands in program.operations:
        if name == "fdiv" and not isinstance(operands[1], float):
            key, kind, *sign = comparisons.get(operands[1], ("", ""))
            if kind == "fabs":
                inner, factors = values.parts_of(operands[0])
                [x] = values.parts_of(operands[1])[1]
                products = [(1.0, operands[0]), *([factors] if inner == "fmul" else [])]
                for a, b in products:
                    if same(a, x) or same(b, x):
                        comparisons[number] = key, "fdiv", *sign, a if same(b, x) else b
        if name not in (*_COMPARISONS, *_KINKS) or all(map(values.is_fixed, operands)):
            continue
        a, b = operands if name != "fabs" else (operands[0], 0.0)
        if same(a, b):
            continue
        sign = -1.0 if name in ("olt", "min") else 1.0
        for difference, other, turn in ((a, b, 1.0), (b, a, -1.0)):
            inner, of = values.parts_of(difference)
            if same(other, 0.0) and inner == "fsub":
                (a, b), sign = of, sign * turn
                break
        if isinstance(a, float) or (not isinstance(b, float) and b < a):
            a, b, sign = b, a, -sign
        key = repr((a, b))  # a text, because the constant 1.0 would equal the number 1 of a value
        comparisons[number], pairs[key] = (key, name, sign), (a, b)
    return comparisons, pairs
