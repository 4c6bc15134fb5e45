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
from math import inf

import numpy as np

from .derivative import gradients
from .double_crossings import sizes_of
from .event_formulas import EventAction
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
LEAST = 2.0**-1000
MOST = 6  # surfaces of one f: its length grows with their cube


class SlidingEquations:
    """Equations with modes, for D components and P parameters; `values` are `Expressions`.

    `actions` are the `EventAction`s of events, those on surfaces first. An event that has a new
    state, at a surface whose second derivative by the time depends on that state, is a contact. Its
    mode is 1, or 0 while the body rests above the surface, -1 below. Then f has a further term, the
    direction in which the action moves a state, with the factor at which d2s/dt2 = 0.

    count     the number of surfaces; modes are components D, D + 1, ...; then those of contacts,
              and, if there are any, T / (1 + T), with the last time T, and the time
    results   operands of all rates
    contacts  {number of an event that is a contact: component that is its mode}
    actions   `EventAction`s: of the events on surfaces, of modes, of all modes at time 0, others
    """

    def __init__(self, values, results, D, P, actions=(), sign=1):
        self.old, self.D, self.P = Program(needed_for(values.operations, results), results), D, P
        self.of_f, self.sign = _surfaces_of(values, self.old), float(sign)
        pairs = [*dict.fromkeys(pair for pair, _ in self.of_f.values())]
        touching = [
            k
            for k, a in enumerate(actions)
            if a.surface and a.to and a.most == inf and _stays(a, D, P)
        ]
        self.size = 0
        if len(pairs) + len(touching) > MOST:
            return
        self._begin(pairs, actions, touching)
        self._begin(  # only with surfaces at which f jumps across, and contacts with a force
            [pair for g, pair in enumerate(pairs) if self._jump(g, g) is not None],
            actions,
            [k for k in touching if self._has_force(k)],
        )
        self.size = self.count + len(self.contacts) + 2 * bool(self.contacts)
        if not self.size:
            return
        f = self._rates({})
        self.own = [self.values.number(w) for w in self.weights]
        f = self._press(f) if self.contacts else f
        clock = [self.sign] * bool(self.contacts)
        self.results = f + [0.0] * (self.size - len(clock)) + clock
        state = [*range(D + self.size)]
        modes = [self._event(g, state) for g in range(self.count)]
        begins = EventAction(None, self._list(self._with_modes(state)), 0, inf)
        own = [
            self._contact(k, a) if k in self.contacts else self._action(a)
            for k, a in enumerate(actions)
        ]
        self.surfaces_of_events = sum(a.surface is not None for a in own)
        n = self.surfaces_of_events
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
        self.slides = [a * a < 0.5 for a in mode]
        new = self._evaluated({})
        self.surfaces = [self._difference(pair, new) for pair in pairs]
        self.gradients = self._slopes(self.surfaces)
        f = [a if isinstance(a, float) else new[a] for a in self.old.results]
        if contacts and pairs:
            f = self._rates({})
        self.touched = {}
        for k in contacts:
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
            self.touched[k] = s, rate, normal, moves, to, actions[k].direction

    def _slopes(self, results):
        operations = needed_for(self.values.operations, results)
        return gradients(self.values, operations, results, self.D)

    def _has_force(self, k):
        _, _, normal, moves, *_ = self.touched[k]
        return _dot(self.values, normal, moves) is not None

    def _factors(self, right):
        """Return factors {k: `Number`} of the moves of contacts that rest, with the sum `right`.

        `right` is {k: `Number`} of the sums along the normals of the contacts.
        """
        number, matrix, own = self.values.number, {}, {}
        rests = {k: number(place) < 0.5 for k, place in self.contacts.items()}
        for k, a in right.items():
            own[k] = rests[k].select(a, 0.0)
            for h in right:
                a = _dot(self.values, self.touched[k][2], self.touched[h][3])
                if h == k:
                    matrix[k, k] = rests[k].select(_or_0(number, a), 1.0)
                elif a is not None:
                    matrix[k, h] = (rests[k] & rests[h]).select(number(a), 0.0)
        self.own_matrix = matrix
        return _solved(matrix, own, [*right])

    def _moved(self, f, factors):
        """Return f (D), moved by the factors of contacts that rest."""
        number, f = self.values.number, [*f]
        for k, factor in factors.items():
            rests = number(self.contacts[k]) < 0.5
            for i, a in enumerate(self.touched[k][3]):
                if a is not None:
                    f[i] = (number(f[i]) + rests.select(factor * number(a), 0.0)).number
        return f

    def _press(self, f):
        """Return the rates f (D) with forces of contacts that rest; set what contacts need.

        A reaction is minus d2s/dt2 without the own force. `stops` is the state with ds/dt = 0 at
        all of them. What rounding leaves of d2s/dt2 is removed by a second, smaller force. It also
        pulls s and ds/dt to 0, because their errors would grow with the time and its square.
        """
        number = self.values.number
        self.bends = {
            k: _or_0(number, _dot(self.values, own[2], f)) for k, own in self.touched.items()
        }
        self.forces = {}
        for k, (_, _, normal, *_) in self.touched.items():
            products = (number(a) * number(f[i]) for i, a in normal.items())
            self.forces[k] = joined("fadd", (a * a for a in products))  # squares have no kinks
        factors = self._factors({k: -bend for k, bend in self.bends.items()})
        self.reactions = {k: factors[k] * self.own_matrix[k, k] for k in factors}
        stops = self._factors({k: -number(own[1]) for k, own in self.touched.items()})
        self.stops = self._moved([*range(self.D)], stops)
        f, of_last = self._moved(f, factors), number(self.D + self.size - 2)
        k, pulls = PULL * self.sign * (1.0 - of_last) / of_last, {}
        for h, (s, rate, normal, *_) in self.touched.items():
            bend = _or_0(number, _dot(self.values, normal, f))
            pulls[h] = -(bend + (2.0 * k) * number(rate) + (k * k) * number(s))
        return self._moved(f, self._factors(pulls))

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
        s, rate, *_, to, direction = self.touched[k]
        rests, stays = number(self.contacts[k]) < 0.5, number(self.contacts[k]) < 0.5
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
        return EventAction(
            self._list([surface.number]), self._list(x), action.direction, action.most
        )

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
            own = self.of_f.get(number)
            if own is not None and own[0] in self.pairs:
                g, (kind, sign) = self.pairs.index(own[0]), own[1]
                truth = sides.get(g, self.above[g])
                if kind == "fabs":  # 0 on the surface
                    of_mode = (
                        emit("fmul", self.D + g, of[0])
                        if sign > 0
                        else emit("fmul", -1.0, emit("fmul", self.D + g, of[0]))
                    )
                    new[number] = 0.0 if g in sides else emit("max", of_mode, 0.0)
                    continue
                if kind in _KINKS:
                    new[number] = _folded(emit, "select", (truth, *of[::sign]))
                    continue
                if kind == "oeq":
                    truth = False
                elif sign < 0:
                    is_known = isinstance(truth, bool)
                    truth = not truth if is_known else (~self.values.number(truth)).number
                new[number] = truth
                continue
            new[number] = _folded(emit, name, of)
        return new

    def _f(self, sides):
        new = self._evaluated(sides)
        return [a if isinstance(a, float) else new[a] for a in self.old.results]

    def _jumps(self, g, sides):
        """Return the differences of f (D) on both sides of surface g; None where it is 0."""
        pairs = zip(self._f(sides | {g: True}), self._f(sides | {g: False}), strict=True)
        return [None if same(a, b) else self.values.emit("fsub", a, b) for a, b in pairs]

    def _along(self, g, f):
        """Return the operand of grad s_g . f; None for 0."""
        return _dot(self.values, self.gradients[g], f)

    def _jump(self, g, h):
        return self._along(g, self._jumps(h, {}))

    def _rates(self, sides):
        """Return the rates (D) with the given `sides` of some surfaces; it slides along others."""
        number = self.values.number
        others = [g for g in range(len(self.pairs)) if g not in sides]
        f = self._f(sides)
        jumps = {h: self._jumps(h, sides) for h in others}
        matrix, right = {}, {}
        for g in others:
            right[g] = self.slides[g].select(number(-1.0) * _or_0(number, self._along(g, f)), 0.0)
            for h in others:
                a = self._along(g, jumps[h])
                if g == h:
                    a = _or_0(number, a)
                    matrix[g, g] = (self.slides[g] & ~a.equals(0.0)).select(a, 1.0)
                elif a is not None:
                    matrix[g, h] = (self.slides[g] & self.slides[h]).select(number(a), 0.0)
        weights = _solved(matrix, right, others)
        self.weights = [weights[g].number if g in weights else None for g in range(len(self.pairs))]
        for h in others:
            for i, a in enumerate(jumps[h]):
                if a is not None:
                    part = self.slides[h].select(weights[h] * number(a), 0.0)
                    f[i] = (number(f[i]) + part).number
        return f

    def _toward(self, g, is_above):
        """Return ds/dt of surface g (a `Number`) on one side, sliding along the others."""
        return self.sign * _or_0(self.values.number, self._along(g, self._rates({g: is_above})))

    def _event(self, g, state):
        """Return the `EventAction` that acts where the mode of surface g ends."""
        number, s, w = self.values.number, self.values.number(self.surfaces[g]), self.own[g]
        mode, slides = number(self.D + g), self.slides[g]
        surface = slides.select(w * (1.0 - w), mode * s)
        below, above = self._toward(g, False), self._toward(g, True)
        rises, falls = (above >= 0.0).select(1.0, 0.0), (below <= 0.0).select(-1.0, 0.0)
        crossed = (mode > 0.0).select(falls, rises)
        new = [*state]
        new[self.D + g] = slides.select((w > 0.5).select(1.0, -1.0), crossed).number
        others = [h for h in range(self.count) if h != g]
        for h in (*others, g) if others else ():  # other modes may end with this one
            new[self.D + h] = self._decided(h, new)
        return EventAction(self._list([surface.number]), self._list(new), -1, inf, True)

    def _decided(self, g, x):
        """Return the operand of the mode of surface g at the state x: by its rates if it is on."""
        wanted = self.surfaces[g], *(self._toward(g, side) for side in (False, True))
        (s, below, above), sizes = self._at(x, wanted)
        slides = (below > 0.0) & (above < 0.0)
        on = slides.select(0.0, (below + above >= 0.0).select(1.0, -1.0))
        mode = self.values.number(x[self.D + g])
        # A mode that has just ended stays so where the rate beyond is 0 but for rounding.
        stays = (mode * above >= -(BARELY * abs(below))) & (mode > 0.5)
        stays = stays | ((mode * below >= -(BARELY * abs(above))) & (mode < -0.5))
        on = stays.select(mode, on)
        return (abs(s) <= ON * sizes[0] + LEAST).select(on, mode).number

    def _with_modes(self, x, of=None):
        """Return operands of a new state, with modes by the side or, on surfaces, by the rates."""
        D, n, x = self.D, self.count, [*x]
        if self.contacts:
            x = self._with_contacts(x, of)
        for stage in (0, 1) if n else ():
            wanted = [*self.surfaces]
            if stage:
                wanted += [self._toward(g, side) for g in range(n) for side in (False, True)]
            found, sizes = self._at(x, wanted)
            for g in range(n):
                s, side = found[g], (found[g] > 0.0).select(1.0, -1.0)
                if not stage:
                    x[D + g] = side.number
                    continue
                below, above = found[n + 2 * g : n + 2 * g + 2]
                slides = (below > 0.0) & (above < 0.0)
                on = slides.select(0.0, (below + above >= 0.0).select(1.0, -1.0))
                x[D + g] = (abs(s) <= ON * sizes[g] + LEAST).select(on, side).number
        return x

    def surfaces_at(self, x, table):
        """Return the values (n, ...) of the surfaces at states x, with parameters `table`."""
        known = dict(enumerate([*x, *table]))
        with np.errstate(all="ignore"):
            evaluate(needed_for(self.values.operations, self.surfaces), known)
        return [a if isinstance(a, float) else known[a] for a in self.surfaces]

    def _list(self, results):
        return EventAction.list_of(self.values, results)

    def _action(self, of):
        """Return the `EventAction` `of` of the equations without modes; it sets the modes, too."""
        surface, to = of.surface, of.to
        if surface is not None:
            surface = self._list(emitted(self.values, surface, dict(self.given)))
        if to is not None:
            x = emitted(self.values, to, dict(self.given))
            to = self._list(self._with_modes([*x, *range(self.D, self.D + self.size)]))
        return of._replace(surface=surface, to=to)


def _stays(action, D, P):
    """Return True if an action leaves states on its surface there, as bounces do.

    Then its function has the same modulus before and after, or is 0 after. Some states are tried.
    """
    x = np.random.default_rng(0).uniform(0.5, 1.5, (D + P, 16))

    def at(program, x):
        known = dict(enumerate(x))
        evaluate(program.operations, known)
        return [a if isinstance(a, float) else known[a] for a in program.results]

    with np.errstate(all="ignore"):
        [before], new = at(action.surface, x), at(action.to, x)
        [after] = at(action.surface, [*new, *x[D:]])
        before, after = np.abs(before), np.abs(after)
        is_so = np.minimum(after, abs(after - before)) <= 1e-9 * (1.0 + before)
        return bool((is_so | ~np.isfinite(after)).all())


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


def _or_0(number, a):
    return number(0.0 if a is None else a)


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
            inner, of = values._parts_of(difference)
            if same(other, 0.0) and inner == "fsub":
                (a, b), sign = of, sign * turn
                break
        if isinstance(a, float) or (not isinstance(b, float) and b < a):
            a, b, sign = b, a, -sign
        found[number] = (a, b), (name, sign)
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
