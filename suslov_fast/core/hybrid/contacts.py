"""Contacts: bodies that bounce from a surface, come to rest on it, and leave it again.

An event is a contact if its action leaves states on its surface s = 0, but changes ds/dt. Each
contact has a mode, a further component of the state: 1 for a free body, 0 for a body at rest above
the surface, -1 for a body at rest below. At rest a reaction acts in the direction in which the
action moves a state, and makes d2s/dt2 = 0. The body leaves the surface when the reaction would
pull. With constraints of mechanics the direction is that in which the action moves a change of the
state that is tangent to them, or `EventAction.push`.
"""

import numpy as np

from ..expressions.function_records import same
from ..expressions.numpy_evaluation import results_at
from ..expressions.programs import emitted
from ..expressions.tolerances import TINY
from ..expressions.values import joined, larger
from .constraint_forces import Constraint
from .tolerances import END_OF_REST, LOW_BOUNCE, PULL_TO_REST, SHORT_BOUNCE


def may_be_contact(action, D, P):
    """Return True if an action keeps |s| or makes s 0, as bounces do; random states are tried."""
    if action.surface is None or action.to is None or action.most <= 1:
        return False
    x = dict(enumerate(np.random.default_rng(0).uniform(0.5, 1.5, (D + P, 16))))
    new = x | dict(enumerate(results_at(action.to, x, (16,))))
    before, after = (abs(results_at(action.surface, at, (16,))[0]) for at in (x, new))
    with np.errstate(all="ignore"):
        stays = np.minimum(after, abs(after - before)) <= 1e-9 * (1.0 + before)
    return bool((stays | ~np.isfinite(after)).all())


class Contact:
    """Formulas of a contact in the `ExtendedState` `values`; f (D) are the rates of the free body.

    mode          the component that is the mode of the contact
    s, rate       `Number`s: the function s of the surface, and ds/dt
    to            operands (D) of the state after the action
    direction     `EventAction.direction`
    constraint    the `Constraint` of a body at rest: d2s/dt2 = 0
    landing       the `Constraint` that moves a body that comes to rest onto s = 0, along the
                  gradient of s without clocks; sub-steps lose a pull back by a few last digits
    passed        how fast ds/dt after the action grows with ds/dt before it
    bend, square  d2s/dt2 of the free body, and the sum of the squares of the terms of d2s/dt2
    rounding      the sum of the squares of ds/dx_i x_i: relative errors of x_i change s by a part
                  of its root
    moved         how far projections change s per unit of relative rounding
    """

    def __init__(self, values, action, mode, f):
        self.mode, self.direction = mode, action.direction
        [s], self.to = (emitted(values, program, dict(values.inputs)) for program in action[:2])
        [gradient] = values.slopes([s])
        self.s, self.rate = values.number(s), values.dot(gradient, f)
        [normal, *rows] = values.slopes([self.rate.number, *self.to])
        n = values.tangent([normal.get(i, 0.0) for i in range(values.D)])
        moved = [values.dot(row, n).number for row in rows]
        self.passed = values.dot(normal, moved)
        direction = [*map(values.difference, n, moved)]
        if action.push:
            direction = emitted(values, action.push, dict(values.inputs))
        self.constraint = Constraint(values.number(mode) < 0.5, normal, direction)
        way = [gradient.get(i, 0.0) if not values.is_fixed(a) else 0.0 for i, a in enumerate(f)]
        self.landing = Constraint(self.constraint.holds, gradient, values.tangent(way))
        self.bend = values.dot(normal, f)
        terms = [values.number(a) * values.number(f[i]) for i, a in normal.items()]
        self.square = joined("fadd", [a * a for a in terms] or [values.number(0.0)])
        terms = [values.number(a) * values.number(i) for i, a in gradient.items()]
        self.rounding = joined("fadd", [a * a for a in terms] or [values.number(0.0)])
        self.moved = values.number(0.0)
        for j in sorted(gradient.keys() & values.moved.keys()):
            self.moved = self.moved + abs(values.number(gradient[j])) * values.moved[j]


class Contacts:
    """The contacts of bodies that may rest, {number of an event: `Contact`}, of `SlidingEquations`.

    After the modes, the state has T / (1 + T), where T is the last requested time, and the time.

    reactions  {number of an event: minus d2s/dt2 if this contact had no reaction}
    landed     operands (D) of the state, with s = 0 where a body rests
    stopped    operands (D) of the state, with ds/dt = 0 where a body rests
    """

    def __init__(self, values, contacts, factors, matrix, sign):
        """Add formulas of reactions, from `factors` and `matrix` of `with_forces`, to `values`.

        `sign` is the sign of the last time T.
        """
        self.values, self.contacts, self.sign = values, contacts, sign
        self.time = values.number(values.modes[-1])
        self.constraints = {c.mode: c.constraint for c in contacts.values()}
        self.reactions = {k: factors[c.mode] * matrix[c.mode, c.mode] for k, c in contacts.items()}
        changes = {c.mode: -c.rate for c in contacts.values()}
        self.stopped = values.with_forces(range(values.D), self.constraints, changes)[0]
        landings = {c.mode: c.landing for c in contacts.values()}
        changes = {c.mode: -c.s for c in contacts.values()}
        self.landed = values.with_forces(range(values.D), landings, changes)[0]

    def with_pull(self, f):
        """Return rates f (D) with a pull back to s = 0 at rest, because errors of s would grow."""
        part, changes = self.values.number(self.values.modes[-2]), {}
        k = PULL_TO_REST * self.sign * (1.0 - part) / part
        for c in self.contacts.values():
            bend = self.values.dot(c.constraint.gradient, f)
            changes[c.mode] = -(bend + 2.0 * k * c.rate + k * k * c.s)
        return self.values.with_forces(f, self.constraints, changes)[0]

    def _beyond(self, s, square, rounding):
        """Return a `Number` that is positive if |s| is too large for a body at a contact.

        So it is if the surface jumps away. `square` and `rounding` are those of the `Contact`. They
        have no kinks, as moduli would.
        """
        way = END_OF_REST * (self.time * self.time)
        return s * s - (way * way * square + LOW_BOUNCE * LOW_BOUNCE * rounding + TINY)

    def action_of(self, k):
        """Return operands: the surface where event k acts or rest ends, and the new state."""
        contact, number = self.contacts[k], self.values.number
        s, rests = contact.s, contact.constraint.holds
        # A surface that jumps away from a body at rest also ends the rest. The compared numbers do
        # not change along flights, where they would end steps, or make them shorter.
        is_on = rests.select(self._beyond(s, contact.square, contact.rounding), -1.0) <= 0.0
        surface = rests.select(is_on.select(self.reactions[k], -self.reactions[k]), s)
        stays = rests
        if contact.direction:  # a body that leaves its rest, beyond s by rounding, must not bounce
            stays = rests | (number(self.sign * contact.direction) * contact.rate < 0.0)
        to = enumerate(contact.to)
        x = [a if same(a, i) else stays.select(number(i), number(a)).number for i, a in to]
        return surface.number, [*x, *self.values.modes]

    def decided(self, x, leaving=None):
        """Return the state x (operands) with modes of contacts; bodies at rest are on s = 0.

        They have no speed.

        A body on its surface rests if its next bounce is below rounding errors, and if its reaction
        does not pull. At event `leaving`, the body that rests there is set free.
        """
        values, number, time = self.values, self.values.number, self.time
        x = [*x]
        found, touched = [], number(0.0)
        for c in self.contacts.values():
            wanted = c.s, c.rate, c.bend, c.square, c.rounding, c.moved
            (s, rate, bend, square, rounding, moved), sizes = values.at(x, wanted)
            s, rate, force = abs(s), abs(rate), square.sqrt()
            [size] = values.at(x, (c.s,), phases=True)[1]
            if not same(c.moved.number, 0.0):
                size = size + moved
            low = LOW_BOUNCE * (size + sizes[1] * time)  # smaller values of s are rounding
            of_step = LOW_BOUNCE * (abs(c.rate) * time)
            of_step = of_step + force * (SHORT_BOUNCE * time) * (SHORT_BOUNCE * time) + TINY
            # By the rounding of a surface that a body touches it may push other bodies.
            touched = larger(touched, (s <= low + of_step).select(low, 0.0))
            found.append((s, rate, bend, square, rounding, low, of_step))
        for (k, c), numbers in zip(self.contacts.items(), found, strict=True):
            s, rate, bend, square, rounding, low, of_step = numbers
            force = square.sqrt()
            low, rests = larger(low, touched), c.constraint.holds
            is_on = (s <= low + of_step) | (rests & (s <= 2.0 * abs(c.s)))
            if k == leaving:  # the event of this contact has led the body to its surface
                is_on = is_on | (self._beyond(s, square, rounding) <= 0.0)
            # The duration of the next bounce, or its height, is below rounding errors.
            is_slow = 2.0 * rate <= force * (SHORT_BOUNCE * time)
            is_slow = is_slow | (0.5 * (rate * rate) <= force * low)
            lands = is_on & (is_slow | (rests & (rate <= 2.0 * abs(c.rate))))
            lands = lands & ~rests if k == leaving else lands
            side = -0.5 * (c.direction + 1) if c.direction else (bend > 0.0).select(-1.0, 0.0)
            x[c.mode] = lands.select(rests.select(number(c.mode), side), 1.0).number
        reactions = values.at(x, self.reactions.values())[0]
        for c, reaction in zip(self.contacts.values(), reactions, strict=True):
            mode = number(x[c.mode])
            leaves = (mode < -0.5).select(-reaction, reaction) <= 0.0
            x[c.mode] = leaves.select(1.0, mode).number
        for wanted in (self.landed, self.stopped):
            found = values.at(x, wanted)[0]
            x[: values.D] = [x[i] if same(a, i) else found[i].number for i, a in enumerate(wanted)]
        return x
