"""Right-hand sides that slide: f with a mode for each surface at which it jumps.

On a surface s = 0 to which f leads back from both sides, Filippov's solution slides: its rate is
f_below + w (f_above - f_below) with the w at which ds/dt = 0, until w leaves [0, 1]. Here the side
of each surface is a further component, its mode: 1 above, -1 below, 0 while the solution slides.
Comparisons of the surface are truth values of the mode, and an event for each surface sets it. So
steps, events, derivatives and implicit steps are those of any other f. Where solutions slide along
several surfaces at once, each has its own w, and every ds/dt is 0: the extension that is unique if
the jumps at the surfaces add up.
"""

from functools import reduce
from itertools import chain, combinations, product
from math import inf

import numpy as np

from .derivative import gradients
from .double_crossings import sizes_of
from .event_formulas import WITH_GAPS, EventAction
from .function_records import same
from .numpy_evaluation import OF_TRUTH_VALUES, evaluate
from .programs import Expressions, Program, dot, emitted, needed_for
from .values import Number, joined, larger

_COMPARISONS = "olt", "ogt", "oge", "oeq"
_KINKS = "fabs", "max", "min"
SOON, LOW = 2.0**-35, 2.0**-42  # parts of the time, and of terms: bounces below these are rest
ON = 2.0**-44  # part of the terms of a surface, within which a state is on it
BARELY = 2.0**-24  # part of the rate on the other side of a surface
FAR = 2.0**-16  # part of the way of a free body, beyond which a body no longer rests
PULL = 64.0  # rate, times the time, with which a body that rests is pulled back to its surface
NEAR = 2.0**-32  # part of the terms of surfaces, within which they slide together
LEAST = 2.0**-1000
# Modes of one f; and modes times pairs of them that change each other's rates, to which the time
# to compile is proportional: five of which each changes all others, or a chain of twelve.
MOST, MOST_PAIRS = 24, 150


class SlidingEquations:
    """Equations with modes, for D components and P parameters; `values` are `Expressions`.

    `actions` are the `EventAction`s of events, those on surfaces first. An event that has a new
    state, at a surface whose second derivative by the time depends on that state, is a contact. Its
    mode is 1, or 0 while the body rests above the surface, -1 below. Then f has a further term, the
    direction in which the action moves a state, with the factor at which d2s/dt2 = 0. A mode is
    infinite where several are consistent, or none.

    count     the number of surfaces; modes are components D, D + 1, ...; then those of contacts,
              and, if there are any, T / (1 + T), with the last time T, and the time
    results   operands of all rates
    contacts  {number of an event that is a contact: component that is its mode}
    actions   `EventAction`s: of the events on surfaces, of modes, of all modes at time 0, others
    """

    def __init__(self, values, results, D, P, actions=(), sign=1):
        self.old, self.D, self.P = Program(needed_for(values.operations, results), results), D, P
        self.of_f, self.sign = _surfaces_of(values, self.old), float(sign)
        # If f has no value beyond a surface, |s| is at least 0 there.
        self.has_gaps = not {name for name, *_ in self.old.operations}.isdisjoint(WITH_GAPS[1:])
        pairs = self._moving([*dict.fromkeys(pair for pair, _ in self.of_f.values())])
        touching = [
            k
            for k, a in enumerate(actions)
            if a.surface and a.to and a.most > 1 and _stays(a, D, P)
        ]
        self.size = 0
        if len(pairs) + len(touching) > MOST:
            return
        self._begin(pairs, actions, touching)
        self._begin(  # only with surfaces at which f jumps across, and contacts with a force
            [pair for g, pair in enumerate(pairs) if self._reach(D + g, D + g) is not None],
            actions,
            [
                k
                for k, place in self.contacts.items()
                if self._reach(place, place) is not None
                and not any(same(self.touched[k][0], s) for s in self.surfaces)
            ],
        )
        pairs = sum(self._reach(a, b) is not None for a in self.held for b in self.held)
        if not 0 < pairs * len(self.held) <= MOST_PAIRS:
            return
        self.size = len(self.held) + 2 * bool(self.contacts)
        f, self.factors, matrix = self._rates({})
        self.diagonal = [self.values.number(self._reach(D + g, D + g)) for g in range(self.count)]
        self.joined = [
            pair for pair in combinations(range(self.count), 2) if self._is_joined(*pair)
        ]
        clock = []
        if self.contacts:
            f, clock = self._pressed(f, matrix), [self.sign]
        self.results = f + [0.0] * (self.size - len(clock)) + clock
        modes = [self._event(g) for g in range(self.count)]
        begins = EventAction(None, self._list(self._with_modes([*range(D + self.size)])), 0, inf)
        own = [
            self._contact(k, a) if k in self.contacts else self._action(a)
            for k, a in enumerate(actions)
        ]
        n = self.surfaces_of_events = sum(a.surface is not None for a in own)
        self.actions = (*own[:n], *modes, begins, *own[n:])

    def _begin(self, pairs, actions, contacts):
        """Begin the expressions, with modes for `pairs` of compared numbers, and for contacts."""
        D, self.pairs, self.count = self.D, pairs, len(pairs)
        first = D + len(pairs) + len(contacts) + 2 * bool(contacts)
        values = self.values = Expressions(first + self.P, range(first, first + self.P))
        self.given = {i: i for i in range(D)} | {D + p: first + p for p in range(self.P)}
        self.contacts = {k: D + len(pairs) + c for c, k in enumerate(contacts)}
        mode = [values.number(D + g) for g in range(len(pairs))]
        self.above = [(a > 0.5).number for a in mode]
        new = self._evaluated({})
        self.surfaces = [self._difference(pair, new) for pair in pairs]
        self.gradients = self._slopes(self.surfaces)
        # Of each mode: where it holds, the gradient of its rate, and the direction of its force.
        self.held = {
            D + g: (mode[g] * mode[g] < 0.5, self.gradients[g], self._jumps(g, {}))
            for g in range(len(pairs))
        }
        self.touched, of_contacts = {}, {}
        self.free = f = self._rates({})[0] if contacts else None
        for k, place in self.contacts.items():
            [s] = emitted(values, actions[k].surface, dict(self.given))
            [row] = self._slopes([s])
            rate = _dot(values, row, f)
            rate = 0.0 if rate is None else rate
            [normal] = self._slopes([rate])
            to = emitted(values, actions[k].to, dict(self.given))
            moves = []
            for i, own in enumerate(self._slopes(to)):
                a = _dot(values, own, normal)
                moves.append(_minus(values, normal.get(i), a))
            self.touched[k] = s, rate, to, actions[k].direction
            of_contacts[place] = values.number(place) < 0.5, normal, moves
        self.held |= of_contacts

    def _moving(self, pairs):
        """Return the `pairs` of compared numbers whose difference changes with the state."""
        values = Expressions(self.D + self.P, range(self.D, self.D + self.P))
        new = {i: i for i in range(self.D + self.P)}
        emitted(values, self.old, new)
        results = [
            values.emit("fsub", *(a if isinstance(a, float) else new[a] for a in pair))
            for pair in pairs
        ]
        rows = gradients(values, [*values.operations], results, self.D)
        return [pair for pair, row in zip(pairs, rows, strict=True) if row]

    def _slopes(self, results):
        operations = needed_for(self.values.operations, results)
        return gradients(self.values, operations, results, self.D)

    def _reach(self, a, b, force=None):
        """Return the operand of what the `force` of mode b does to the rate of mode a; or None."""
        return _dot(self.values, self.held[a][1], self.held[b][2] if force is None else force)

    def _is_joined(self, g, h):
        """Return True if the jump of f at surface g depends on the side of surface h."""
        above, below = (self._jumps(g, {h: side}) for side in (True, False))
        pairs = [[0.0 if a is None else a for a in both] for both in zip(above, below, strict=True)]
        results = [*chain.from_iterable(pairs)]
        program = Program(needed_for(self.values.operations, results), results)
        found = _values_at(
            program, np.random.default_rng(0).uniform(0.5, 1.5, (self.D + self.size + self.P, 16))
        )
        pairs = zip(found[::2], found[1::2], strict=True)
        return any(np.any(abs(a - b) > 1e-9 * (abs(a) + abs(b))) for a, b in pairs)

    def _moved(self, y, places, right, forces=None):
        """Return y (D), moved by the forces of modes that hold, their factors, and the matrix.

        The move changes the rate of the mode at `place` by right[place] (a `Number`).
        """
        number, matrix, own, y = self.values.number, {}, {}, [*y]
        held = {a: self.held[a] for a in places}
        for a, (truth, *_) in held.items():
            own[a] = truth.select(right[a], 0.0)
            for b, (other, *_) in held.items():
                reach = self._reach(a, b, (forces or {}).get(b))
                if a == b:
                    reach = number(_or_0(reach))
                    matrix[a, a] = (truth & ~reach.equals(0.0)).select(reach, 1.0)
                elif reach is not None:
                    matrix[a, b] = (truth & other).select(number(reach), 0.0)
        factors = _solved(matrix, own, [*held])
        for b, (truth, _, force) in held.items():
            for i, a in enumerate((forces or {}).get(b) or force):
                if a is not None:
                    y[i] = (number(y[i]) + truth.select(factors[b] * number(a), 0.0)).number
        return y, factors, matrix

    def _rates(self, sides):
        """Return the rates (D) with the given `sides` of some surfaces, and as `_moved` does.

        The solution slides along others, and rests at contacts.
        """
        f, D = self._f(sides), self.D
        places = [a for a in self.held if a - D not in sides]
        forces = {a: self._jumps(a - D, sides) for a in places if a < D + self.count}
        right = {a: -self._along(a, f) for a in places}
        return self._moved(f, places, right, forces)

    def _along(self, place, f):
        """Return the `Number` of the rate of a mode, with the right-hand side f."""
        return self.values.number(_or_0(_dot(self.values, self.held[place][1], f)))

    def _pressed(self, f, matrix):
        """Return the rates f (D) of bodies that rest; set what contacts need.

        A reaction is minus d2s/dt2 without the own force. `stops` is the state with ds/dt = 0 at
        all of them. What rounding leaves of d2s/dt2 is removed by a second, smaller force. It also
        pulls s and ds/dt to 0, because their errors would grow with the time and its square.
        """
        number, places = self.values.number, [*self.contacts.values()]
        right, rates = {}, {}
        of_last = number(self.D + self.size - 2)
        k = PULL * self.sign * (1.0 - of_last) / of_last
        self.reactions, self.forces = {}, {}
        for h, place in self.contacts.items():
            s, rate, *_ = self.touched[h]
            products = (number(a) * number(self.free[i]) for i, a in self.held[place][1].items())
            self.forces[h] = joined("fadd", (a * a for a in products))  # squares have no kinks
            self.reactions[h] = self.factors[place] * matrix[place, place]
            rates[place] = -number(rate)
            right[place] = -(self._along(place, f) + 2.0 * k * number(rate) + k * k * number(s))
        self.bends = {h: self._along(place, self.free) for h, place in self.contacts.items()}
        self.stops = self._moved([*range(self.D)], places, rates)[0]
        return self._moved(f, places, right)[0]

    def _at(self, x, wanted):
        """Return operands `wanted` at another state x, and sizes of the terms of the first ones."""
        D, values = self.D, self.values
        wanted = [a.number if isinstance(a, Number) else a for a in wanted]
        copy = dict(enumerate(x)) | {D + self.size + p: D + self.size + p for p in range(self.P)}
        own = Program(needed_for(values.operations, wanted), wanted)
        found = emitted(values, own, copy)
        sizes = sizes_of(values, own.operations, copy)
        for a in wanted:
            sizes.setdefault(a, values.number(abs(a)) if isinstance(a, float) else None)
        return [values.number(a) for a in found], [sizes[a] for a in wanted]

    def _contact(self, k, action):
        """Return the `EventAction` of event k, which also begins and ends the rest there."""
        number = self.values.number
        s, rate, to, direction = self.touched[k]
        rests = stays = self.held[self.contacts[k]][0]
        if direction:  # a body that leaves its rest may lie beyond the surface by rounding
            stays = rests | (number(self.sign * direction) * number(rate) < 0.0)
        time, s = number(self.D + self.size - 1), number(s)
        far = FAR * (time * time)
        is_on = s * s <= far * far * self.forces[k] + LEAST
        beyond = is_on.select(self.reactions[k], -self.reactions[k])  # the surface itself jumps
        surface = rests.select(beyond, s)
        x = [
            a if same(a, i) else stays.select(number(i), number(a)).number for i, a in enumerate(to)
        ]
        x = self._with_modes([*x, *range(self.D, self.D + self.size)], of=k)
        holds = int(direction < 0)  # a body that leaves its rest has no rate
        return EventAction(self._list([surface.number]), self._list(x), direction, inf, holds)

    def _with_contacts(self, x, of):
        """Return operands of the state x, in which bodies rest that would leave surfaces by little.

        The body leaves the contact `of`, if it rests there.
        """
        number, x = self.values.number, [*x]
        time = number(self.D + self.size - 1)
        sums = [a for s, rate, *_ in self.touched.values() for a in (s, rate)]
        sizes = self._at(x, sums)[1]
        lows = [LOW * (a + b * time) for a, b in zip(sizes[::2], sizes[1::2], strict=True)]
        low = reduce(larger, lows)
        for k, place in self.contacts.items():
            s, rate, *_, direction = self.touched[k]
            before, rests = (abs(number(s)), abs(number(rate))), number(place) < 0.5
            (s, rate, bend, force), _ = self._at(x, (s, rate, self.bends[k], self.forces[k]))
            s, rate, force, away = abs(s), abs(rate), force.sqrt(), 2.0 * abs(rate)
            of_step = LOW * (before[1] * time) + force * (SOON * time) * (SOON * time)
            is_on = s <= low + of_step + LEAST
            is_low = away <= force * (SOON * time)
            is_low = is_low | (0.25 * (rate * away) <= force * low)
            is_on = is_on | (rests & (s <= 2.0 * before[0]))
            is_low = is_low | (rests & (rate <= 2.0 * before[1]))
            lands = is_on & is_low
            lands = lands & ~rests if k == of else lands
            own = (
                (bend > 0.0).select(-1.0, 0.0) if not direction else number(-0.5 * (direction + 1))
            )
            own = rests.select(number(place), own)
            x[place] = lands.select(own, 1.0).number
        found = self._at(x, [self.reactions[k] for k in self.contacts])[0]
        for place, reaction in zip(self.contacts.values(), found, strict=True):
            leaves = (number(x[place]) < -0.5).select(-reaction, reaction) <= 0.0
            x[place] = leaves.select(1.0, number(x[place])).number
        stops = self._at(x, self.stops)[0]
        return [
            x[i] if same(a, i) else b.number
            for i, (a, b) in enumerate(zip(self.stops, stops, strict=True))
        ] + x[self.D :]

    def _difference(self, pair, new):
        a, b = (p if isinstance(p, float) else new[p] for p in pair)
        return a if same(b, 0.0) else self.values.emit("fsub", a, b)

    def _evaluated(self, sides):
        """Return {old operand: its operand here}; `sides` has the side (bool) of some surfaces."""
        new, emit = dict(self.given), self.values.emit
        for name, number, operands in self.old.operations:
            of = [a if isinstance(a, float) else new[a] for a in operands]
            pair, about = self.of_f.get(number, (None, None))
            if pair not in self.pairs:
                new[number] = _folded(emit, name, of)
                continue
            g, (kind, sign, *factors) = self.pairs.index(pair), about
            truth = sides.get(g, self.above[g])
            if kind == "fdiv":
                a = factors[0] if isinstance(factors[0], float) else new[factors[0]]
                new[number] = emit("fmul", a, _folded(emit, "select", (truth, sign, -sign)))
            elif kind == "fabs":  # 0 on the surface
                of_mode = emit("fmul", float(sign), emit("fmul", self.D + g, of[0]))
                of_mode = emit("max", of_mode, 0.0) if self.has_gaps else of_mode
                new[number] = 0.0 if g in sides else of_mode
            elif kind in _KINKS:
                new[number] = _folded(emit, "select", (truth, *of[::sign]))
            elif kind == "oeq":
                new[number] = False
            elif sign > 0:
                new[number] = truth
            else:
                is_known = isinstance(truth, bool)
                new[number] = not truth if is_known else (~self.values.number(truth)).number
        return new

    def _f(self, sides):
        new = self._evaluated(sides)
        return [a if isinstance(a, float) else new[a] for a in self.old.results]

    def _jumps(self, g, sides):
        """Return the differences of f (D) on both sides of surface g; None where it is 0."""
        pairs = zip(self._f(sides | {g: True}), self._f(sides | {g: False}), strict=True)
        return [None if same(a, b) else self.values.emit("fsub", a, b) for a, b in pairs]

    def _toward(self, g, is_above):
        """Return ds/dt of surface g (a `Number`) on one side, sliding along the others."""
        return self.sign * self._along(self.D + g, self._rates({g: is_above})[0])

    def _event(self, g):
        """Return the `EventAction` that acts where the mode of surface g ends."""
        number, s, w = self.values.number, self.values.number(self.surfaces[g]), self.factors
        mode, w, (slides, *_) = number(self.D + g), w[self.D + g], self.held[self.D + g]
        surface = slides.select(w * (1.0 - w), mode * s)
        below, above = self._toward(g, False), self._toward(g, True)
        rises, falls = (above >= 0.0).select(1.0, 0.0), (below <= 0.0).select(-1.0, 0.0)
        crossed = (mode > 0.0).select(falls, rises)
        own = (mode > 0.0).select(above, -below)
        leads_away = (own > 0.0) | (below.equals(0.0) & above.equals(0.0))  # s is rounding
        crossed = leads_away.select(mode, crossed)
        new = [*range(self.D + self.size)]
        new[self.D + g] = slides.select((w > 0.5).select(1.0, -1.0), crossed).number
        # Other modes may end with this one.
        others = [
            h
            for h in range(self.count)
            if h != g and self._reach(self.D + h, self.D + g) is not None
        ]
        for h in (*others, g) if others else ():
            new[self.D + h] = self._decided(h, new)
        if others:
            new = self._together(new, g)
        # On the surface without errors, which else would grow from phase to phase.
        lands, factor = number(new[self.D + g]).equals(0.0) & ~slides, s / self.diagonal[g]
        for i, jump in enumerate(self.held[self.D + g][2]):
            if jump is not None:
                new[i] = lands.select(number(i) - factor * number(jump), number(i)).number
        return EventAction(self._list([surface.number]), self._list(new), -1, inf, 2)

    def _stays(self, mode, below, above):
        """Return the truth value that f does not lead back from a side, except by rounding."""
        is_above = (mode > 0.5) & (above >= -(BARELY * abs(below)))
        return is_above | ((mode < -0.5) & (below <= BARELY * abs(above)))

    def _decided(self, g, x):
        """Return the operand of the mode of surface g at the state x: by its rates if it is on."""
        wanted = self.surfaces[g], *(self._toward(g, side) for side in (False, True))
        (s, below, above), sizes = self._at(x, wanted)
        slides = (below > 0.0) & (above < 0.0)
        on = slides.select(0.0, (below + above >= 0.0).select(1.0, -1.0))
        mode = self.values.number(x[self.D + g])
        on = self._stays(mode, below, above).select(mode, on)
        return (abs(s) <= ON * sizes[0] + LEAST).select(on, mode).number

    def _together(self, x, g=None):
        """Return operands of the state x with joint modes of several surfaces near it.

        All of them slide if they can do so together, so that solutions go on that wind into the
        point where they meet. Otherwise modes are as in x, or those of two surfaces that alone are
        consistent. The first mode is infinite if there are none or several, if a state lies beyond
        its mode, or where solutions slide along two surfaces of which one has jumps that depend on
        the side of the other. `g` is the surface at which the solution arrives, if any.
        """
        D, number, n = self.D, self.values.number, self.count
        found, sizes = self._at(x, self.surfaces)
        slides = [number(a).equals(0.0) for a in x[D : D + n]]
        near, on = (
            [
                abs(s) <= part * size + LEAST if h != g else number(0.0).equals(0.0)
                for h, (s, size) in enumerate(zip(found, sizes, strict=True))
            ]
            for part in (NEAR, ON)
        )
        near, on = ([a | b for a, b in zip(own, slides, strict=True)] for own in (near, on))

        def with_modes(modes):
            return [*x[:D], *(a if isinstance(a, float) else a.number for a in modes), *x[D + n :]]

        modes = [number(a) for a in x[D : D + n]]
        trial = with_modes([a.select(0.0, mode) for a, mode in zip(near, modes, strict=True)])
        factors = [self.factors[D + h] for h in range(n)]
        all_, _ = self._at(trial, [*factors, *self.diagonal])
        can = number(0.0).equals(0.0) if g is None else ~self.held[D + g][0]
        for a, w, own in zip(near, all_[:n], all_[n:], strict=True):
            can = can & (~a | ((w >= 0.0) & (w <= 1.0) & (own <= 0.0)))
        modes = [can.select(number(a), b) for a, b in zip(trial[D:], modes, strict=False)]
        is_right = self._are_consistent(with_modes(modes), on, -BARELY)
        if n == 2:
            count, best, both = number(0.0), modes, on[0] & on[1]
            for own in product((1.0, -1.0, 0.0), repeat=n):
                truth = both & self._are_consistent(with_modes(own), on, BARELY)
                count = count + truth.select(1.0, 0.0)
                best = [truth.select(a, b) for a, b in zip(own, best, strict=True)]
            is_one = count.equals(1.0)
            modes = [is_one.select(a, b) for a, b in zip(best, modes, strict=True)]
            is_right = is_one | (is_right & (count < 1.5))
        far = FAR * joined("fadd", [abs(number(a)) for a in x[:D]])
        wrong = [mode * s < -far for mode, s in zip(modes, found, strict=True)]
        wrong += [modes[h].equals(0.0) & modes[k].equals(0.0) for h, k in self.joined]
        modes[0] = reduce(Number.__or__, wrong, ~is_right).select(inf, modes[0])
        return with_modes(modes)

    def _are_consistent(self, x, on, part):
        """Return the truth value that f leads to the modes of the state x from where it is `on`.

        Rates of less than `part` of the rate on the other side do not count.
        """
        wanted = [self._toward(g, side) for g in range(self.count) for side in (False, True)]
        found, truth = self._at(x, wanted)[0], self.values.number(0.0).equals(0.0)

        def leads(rate, other):
            return rate > part * (abs(other) + LEAST)

        for is_on, mode, below, above in zip(
            on, x[self.D :], found[::2], found[1::2], strict=False
        ):
            mode = self.values.number(mode)
            up, down = leads(above, below), leads(-below, above)
            rises, falls = leads(below, above), leads(-above, below)
            own = ((mode > 0.5) & up) | ((mode < -0.5) & down)
            truth = truth & (~is_on | own | (mode.equals(0.0) & rises & falls))
        return truth

    def _with_modes(self, x, of=None):
        """Return operands of a new state, with modes by the side or, on surfaces, by the rates."""
        x = self._with_contacts(x, of) if self.contacts else [*x]
        for g, s in enumerate(self._at(x, self.surfaces)[0]):
            x[self.D + g] = (s > 0.0).select(1.0, -1.0).number
        for g in range(self.count):
            x[self.D + g] = self._decided(g, x)
        return self._together(x) if self.count > 1 else x

    def _list(self, results):
        return EventAction.list_of(self.values, results)

    def _action(self, of):
        """Return the `EventAction` `of` of the equations without modes; it sets the modes, too."""
        surface, to = of.surface, of.to
        if surface is not None:
            [s] = emitted(self.values, surface, dict(self.given))
            for g, own in enumerate(self.surfaces):
                if same(s, own):  # along it s is rounding
                    s = self.held[self.D + g][0].select(0.0, self.values.number(s)).number
            surface = self._list([s])
        if to is not None:
            x = emitted(self.values, to, dict(self.given))
            to = self._list(self._with_modes([*x, *range(self.D, self.D + self.size)]))
        return of._replace(surface=surface, to=to)


def _stays(action, D, P):
    """Return True if an action leaves states on its surface there, as bounces do.

    Then its function has the same modulus before and after, or is 0 after. Some states are tried.
    """
    x = np.random.default_rng(0).uniform(0.5, 1.5, (D + P, 16))
    [before], new = _values_at(action.surface, x), _values_at(action.to, x)
    [after] = _values_at(action.surface, [*new, *x[D:]])
    before, after = np.abs(before), np.abs(after)
    with np.errstate(all="ignore"):
        is_so = np.minimum(after, abs(after - before)) <= 1e-9 * (1.0 + before)
        return bool((is_so | ~np.isfinite(after)).all())


def _values_at(program, x):
    """Return the values of the results of a `Program` with inputs x."""
    known = dict(enumerate(x))
    with np.errstate(all="ignore"):
        evaluate(program.operations, known)
    return [a if isinstance(a, float) else known[a] for a in program.results]


def _dot(values, row, f):
    """Return the operand of the product of a dict {component: operand} and f; None for 0."""
    items = f.items() if isinstance(f, dict) else enumerate(f)
    pairs = [(row[i], a) for i, a in items if i in row and not (a is None or same(a, 0.0))]
    return dot(values.emit, pairs)


def _minus(values, a, b):
    """Return the operand of a - b, of operands or None for 0; None if they are the same."""
    if b is None:
        return a
    if a is not None and same(a, b):
        return None
    return values.emit("fmul", -1.0, b) if a is None else values.emit("fsub", a, b)


def _or_0(a):
    return 0.0 if a is None else a


def _surfaces_of(values, program):
    """Return {number of a comparison: (pair of compared operands, (kind, sign))}."""
    found = {}
    for name, number, operands in program.operations:
        if name not in (*_COMPARISONS, *_KINKS) or all(map(values.is_fixed, operands)):
            continue
        a, b = operands if name != "fabs" else (operands[0], 0.0)
        if same(a, b):
            continue
        sign = -1 if name in ("olt", "min") else 1
        for difference, other, turn in ((a, b, 1), (b, a, -1)):
            inner, of = values.parts_of(difference)
            if same(other, 0.0) and inner == "fsub":
                (a, b), sign = of, sign * turn
                break
        if isinstance(a, float) or (not isinstance(b, float) and b < a):
            a, b, sign = b, a, -sign
        found[number] = (a, b), (name, sign)
    for name, number, operands in program.operations:  # c x / |x| is c or -c
        own, of = found.get(operands[-1]), values.parts_of(operands[-1])[1]
        if name == "fdiv" and own is not None and own[1][0] == "fabs":
            _, factors = values.parts_of(operands[0])
            if same(operands[0], of[0]):
                found[number] = own[0], ("fdiv", float(own[1][1]), 1.0)
            elif len(factors) == 2 and any(same(a, of[0]) for a in factors):
                factor = factors[0] if same(factors[1], of[0]) else factors[1]
                found[number] = own[0], ("fdiv", float(own[1][1]), factor)
    return found


def _folded(emit, name, of):
    """Emit an operation; truth values among its operands may be True or False."""
    if name == "select" and isinstance(of[0], bool):
        return of[1] if of[0] else of[2]
    if name in ("and", "or", "xor"):
        a, b = of
        if isinstance(b, bool):
            a, b = b, a
        if isinstance(a, bool):
            if name == "and":
                return b if a else False
            if name == "or":
                return True if a else b
            if isinstance(b, bool):
                return a != b
            return emit("xor", b, emit("oeq", 0.0, 0.0)) if a else b
    if name in OF_TRUTH_VALUES and all(isinstance(a, float) for a in of):
        return {"olt": of[0] < of[1], "ogt": of[0] > of[1], "oge": of[0] >= of[1]}.get(
            name, of[0] == of[1]
        )
    return emit(name, *of)


def _solved(matrix, right, places):
    """Return the solution {g: `Number`} of linear equations, by elimination without exchanges."""
    matrix, right = dict(matrix), dict(right)
    for n, g in enumerate(places):
        for h in places[n + 1 :]:
            if (h, g) not in matrix:
                continue
            factor = matrix[h, g] / matrix[g, g]
            right[h] = right[h] - factor * right[g]
            for k in places[n + 1 :]:
                if (g, k) in matrix:
                    product = factor * matrix[g, k]
                    matrix[h, k] = matrix[h, k] - product if (h, k) in matrix else -product
    found = {}
    for n, g in reversed([*enumerate(places)]):
        total = right[g]
        for h in places[n + 1 :]:
            if (g, h) in matrix:
                total = total - matrix[g, h] * found[h]
        found[g] = total / matrix[g, g]
    return found
