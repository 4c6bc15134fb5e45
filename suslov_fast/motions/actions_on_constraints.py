"""Actions of events on systems with constraints of mechanics.

An action may change velocities by an impulse. Then constraints react at the same instant, by
impulses of their own: the new velocities are those on the constraints that are nearest in the
metric of the masses. A bounce from a surface s = 0, an action that turns or stops ds/dt, states the
new ds/dt. So then velocities move on, to this ds/dt, in the direction in which the action, followed
by reactions, moves a velocity along the normal of the surface. Positions do not jump in mechanics:
new positions must be on the constraints, else the state after the action has no value.

If constraints are not linear in velocities, Newton's steps, each of them least in the metric of the
masses, repeat both moves. If they find no velocity on the constraints with the new ds/dt, the state
after the action has no value.
"""

from __future__ import annotations

from functools import lru_cache, reduce
from math import nan
from typing import Any

import numpy as np

from ..core.cached import cached_property
from ..core.expressions.derivative import gradients
from ..core.expressions.function_records import same
from ..core.expressions.numpy_evaluation import results_at
from ..core.expressions.programs import (
    Expressions,
    Program,
    depending,
    dot,
    emitted,
    in_order,
    program_of,
)
from ..core.expressions.tolerances import OFF_CONSTRAINTS, ROUNDING_OF_RESIDUALS
from ..core.expressions.values import larger
from ..core.hybrid.constraint_forces import ExtendedState
from ..core.hybrid.event_formulas import EventAction, KeyedProgram, components_of
from ..fields.constraints import constraints_of
from ..fields.equations import Equations
from .event import Event, traced
from .tolerances import LEAST_BOUNCE, NEWTON_STEPS_TO_CONSTRAINTS_OF_ACTIONS, SAMPLES_OF_ACTION


def action_of(event: Event, field: Any) -> EventAction:
    """Return the action of an event on a field: with constraints, its new states satisfy them."""
    action: EventAction = traced(event, field).action
    if action.to is None or constraints_of(field) is None:
        return action
    return _on_constraints(field._equations, action)


@lru_cache(64)
def _on_constraints(equations: Equations, action: EventAction) -> EventAction:
    """Return the action followed by reactions of the constraints."""
    return _Reactions(equations, action).action if components_of(action) else action


class _Reactions:
    """Formulas of the state after an action, in `values`, from the state before it.

    x        operands (D) of the state after the action alone
    action   the `EventAction` with reactions

    `velocities` and `parameters` are the numbers of these values.
    """

    def __init__(self, equations: Equations, action: EventAction) -> None:
        self.equations, sizes = equations, equations.sizes
        self.D, P = len(equations.names), len(equations.parameters)
        self.velocities = range(sizes["corrections"] - sizes["momenta"], sizes["corrections"])
        self.parameters = range(self.D, self.D + P)
        values: Any = ExtendedState(self.D, 0, P)
        self.values = values
        assert action.to is not None
        self.x = emitted(values, action.to, {i: i for i in range(self.D + P)})
        changed = {*components_of(action)}
        moves = not changed <= {*self.velocities}
        self.is_linear = self._is_linear()
        reacted = self.projected([self.x[i] for i in self.velocities])
        if rate := self._rate_of_bounce(action):
            moved = self._moved_by(rate)
            reacted, push = self._with_rate(rate, reacted, moved)
            for _ in range(0 if self.is_linear else NEWTON_STEPS_TO_CONSTRAINTS_OF_ACTIONS):
                reacted, push = self._with_rate(rate, self._corrected(reacted), moved)
            of_state = [0.0] * self.velocities.start + push
            of_state += [0.0] * (self.D - len(of_state))
            action = action._replace(push=KeyedProgram.of(values, of_state))
        is_on = values.number(0.0).equals(0.0)
        if moves or not self.is_linear:
            is_on = self._is_on(reacted, sizes["multipliers"] if self.is_linear else 0)
        x = [*self.x]
        for i, a in zip(self.velocities, reacted, strict=True):
            if not same(a, x[i]) or moves:
                x[i] = is_on.select(values.number(a), nan).number
        self.action = action._replace(to=KeyedProgram.of(values, x))

    def at(self, program: Program, velocities: Any = None) -> list[Any]:
        """Return results of a program at the new positions, with `velocities`, by default new."""
        known = dict(enumerate(self.x)) | {p: p for p in self.parameters}
        if velocities is not None:
            known |= dict(zip(self.velocities, velocities, strict=True))
        return emitted(self.values, program, known)

    def _program(self, name: str) -> Program:
        return program_of(self.equations.values.operations, self.equations.quantities[name])

    def projected(self, velocities: Any) -> list[Any]:
        """Return operands of velocities on the constraints at the new positions."""
        for _ in range(1 if self.is_linear else NEWTON_STEPS_TO_CONSTRAINTS_OF_ACTIONS):
            velocities = self._corrected(velocities)
        return [*velocities]

    def _corrected(self, velocities: Any) -> list[Any]:
        """Return operands of velocities after one of Newton's steps to the constraints."""
        number = self.values.number
        changes = self.at(self._program("corrections"), velocities)[self.velocities.start :]
        pairs = zip(velocities, changes, strict=True)
        return [a if same(c, 0.0) else (number(a) + number(c)).number for a, c in pairs]

    def _is_linear(self) -> bool:
        """Return True if the derivatives of constraints by velocities do not depend on these."""
        program, v = self._program("matrix"), {*self.velocities}
        return depending(program.operations, v).isdisjoint(
            a for a in program.results if type(a) is int
        )

    def _is_on(self, velocities: Any, k: int) -> Any:
        """Return the truth value that residuals from number k on are 0, as those of x0 must be."""
        number = self.values.number
        terms = [*map(number, self.at(self._program("sizes"), velocities))]
        residuals = self.at(self._program("residuals"), velocities)
        largest, is_on = reduce(larger, terms), number(0.0).equals(0.0)
        for g, size in zip(residuals[k:], terms[k:], strict=True):
            most = larger(OFF_CONSTRAINTS * size, ROUNDING_OF_RESIDUALS * largest)
            is_on = is_on & (abs(number(g)) <= most)
        return is_on

    def _rate_of_bounce(self, action: EventAction) -> Program | None:
        """Return ds/dt, and its slopes by velocities, if the action is a bounce, else None."""
        if action.surface is None:
            return None
        values, of_velocities = Expressions(self.parameters.stop, self.parameters), self.velocities
        [s] = emitted(values, action.surface)
        [slopes] = gradients(values, [*values.operations], [s], self.D)
        if not slopes or any(j in slopes for j in of_velocities):
            return None
        equations = self.equations
        rates = emitted(values, program_of(equations.values.operations, equations.results))
        rate = dot(values.emit, [(a, rates[j]) for j, a in slopes.items()])
        [normal] = gradients(values, [*values.operations], [rate], self.D)
        program = program_of(values.operations, [rate, *_row(normal, of_velocities)])
        both = emitted(self.values, program)[:1] + self.at(program)[:1]
        x = np.random.default_rng(0).normal(size=(self.parameters.stop, SAMPLES_OF_ACTION))
        x[self.D :] = abs(x[self.D :])
        values_of = program_of(self.values.operations, both)
        before, after = results_at(values_of, dict(enumerate(x)), (SAMPLES_OF_ACTION,))
        return program if (before * after <= 0.0).all() else None

    def _moved_by(self, program: Program) -> list[Any]:
        """Return by how much the action moves a velocity along the normal of the surface."""
        values, D = self.values, self.D
        tangent = self._tangent(self.at(program)[1:], [*self.velocities])
        new = [self.x[i] for i in self.velocities]
        rows = gradients(values, [*values.operations], new, D)
        rows = [_row(row, self.velocities) for row in rows]
        return [*map(values.difference, (self._dot(row, tangent) for row in rows), tangent)]

    def _with_rate(self, program: Program, v: Any, moved: Any) -> tuple[list[Any], list[Any]]:
        """Return velocities v, moved to the wanted ds/dt, and the direction of the move."""
        number = self.values.number
        [wanted, *normal], [after, *_] = self.at(program), self.at(program, v)
        direction = self._tangent(moved, v)
        share, whole = (number(self._dot(normal, w)) for w in (direction, moved))
        part = (number(wanted) - number(after)) / share
        part = (abs(share) > LEAST_BOUNCE * abs(whole)).select(part, 0.0)
        pairs = zip(v, direction, strict=True)
        return [(number(a) + part * number(b)).number for a, b in pairs], direction

    def _tangent(self, change: Any, v: Any) -> list[Any]:
        """Return a change of velocities v without the part that constraints do not allow."""
        if self.is_linear:
            moved, fixed = self._corrected(change), self._corrected([0.0] * len(change))
            return [*map(self.values.difference, moved, fixed)]
        places, program = self._slopes
        rows: list[dict[int, Any]] = [{} for _ in change]
        for (i, j), a in zip(places, self.at(program, v), strict=True):
            rows[i][j] = a
        taken = (self._dot(_row(row, self.velocities), change) for row in rows)
        number = self.values.number
        return [(number(a) + number(b)).number for a, b in zip(change, taken, strict=True)]

    @cached_property
    def _slopes(self) -> Any:
        """The places (i, j) and the `Program` of derivatives of corrections by velocities j."""
        values, corrections = in_order(
            self.equations.values, self.equations.quantities["corrections"]
        )
        rows = gradients(values, [*values.operations], corrections, self.D)
        rows = rows[self.velocities.start :]
        places = [(i, j) for i, row in enumerate(rows) for j in row if j in self.velocities]
        return places, program_of(values.operations, [rows[i][j] for i, j in places])

    def _dot(self, a: Any, b: Any) -> Any:
        pairs = [each for each in zip(a, b, strict=True) if not any(same(k, 0.0) for k in each)]
        return dot(self.values.emit, pairs) if pairs else 0.0


def _row(slopes: Any, places: Any) -> list[Any]:
    return [slopes.get(j, 0.0) for j in places]
