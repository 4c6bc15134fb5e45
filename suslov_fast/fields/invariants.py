"""First integrals that steps of motions keep, see `core.expressions.projection`.

A function I is a first integral if dI/dt = I' f is 0. Where I and f are quotients of polynomials in
variables, parameters and values of other functions, this may be proved; then it holds for all
values of parameters. Numbers at states never prove it, but they refuse: at random states, for all
members, also of fields with other parameters, and along each motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from ..checks import FloatArray, first_index, spell
from ..core.expressions.derivative import gradients
from ..core.expressions.numpy_evaluation import results_at
from ..core.expressions.programs import Program, dot, in_order, program_of
from ..core.expressions.rounding import sizes_of
from ..core.expressions.values import operand_of
from .equations import Equations
from .identities import is_zero
from .layout import Layout
from .mechanics import Mechanics
from .tracer import Tracer
from .user_function import UserFunction

_SAMPLES, _MOST = 24, 2**18  # random states for each member, and of all members
# The largest change of an integral, as a part of the moduli of its terms; smaller than _ROUNDING of
# their sizes before cancellation it is rounding.
_LARGEST, _ROUNDING = 1e-11, 2.0**-40


def conserving(field: Any, given: Sequence[Callable[..., Any]]) -> tuple[Layout, Equations]:
    """Return the equations of a field with first integrals, by default the energy; see `check`.

    Integrals that the field keeps already stay. Equal formulas count once. If an integral reads the
    time, and f does not, the layout has a hidden time.
    """
    functions = [UserFunction("integrals", f, field.parameters) for f in given]
    if field._timed is not field and any(f.has_time for f in functions):
        equations = _conserving(field._timed, functions)
        if equations.read_last:
            return field._timed._layout, equations
    return field._layout, _conserving(field, functions)


def _conserving(field: Any, functions: Sequence[Any]) -> Equations:
    old, D = field._equations, field._layout.D
    quantities = {name: of for name, of in old.quantities.items() if name != "conserved"}
    others = [a for of in quantities.values() for a in of]
    first = [old.H] if old.H is not None else quantities.get("energy", [])
    before = old.quantities.get("conserved", [])
    values, operands = in_order(old.values, [*old.results, *others, *first, *before])
    tracer = Tracer(field._layout, [*old.parameters])
    tracer.values = values
    place = len(operands) - len(before)
    integrals, before = operands[D + len(others) : place], operands[place:]
    if functions:
        integrals = []
        for f in functions:
            integrals += f.formulas(tracer)
    elif not integrals:
        raise TypeError("integrals: pass functions of the state: this field has no energy")
    rest = iter(operands[D:])
    kept = {name: [next(rest) for _ in of] for name, of in quantities.items()}
    H = None if old.H is None else operands[D + len(others)]
    of_all = kept | {"conserved": [*dict.fromkeys([*before, *integrals])]}
    return Equations(old.names, old.parameters, values, operands[:D], H, old.K, old.ratios, of_all)


class Changes:
    """The changes dI/dt of those integrals of equations that are not proved to be constant.

    The energy of a system with constraints changes by the power of reactions, lambda . phi, which
    is 0 on the constraints.

    which   the numbers of these integrals
    """

    def __init__(self, equations: Equations) -> None:
        D, quantities = len(equations.names), equations.quantities
        multipliers = quantities.get("multipliers", [])
        phi = quantities.get("residuals", [])[: len(multipliers)]
        H = [equations.H] if equations.H is not None else []
        integrals, energy = (quantities.get(name, []) for name in ("conserved", "energy"))
        parts = [equations.results, integrals, H, energy, multipliers, phi]
        values, operands = in_order(equations.values, [a for part in parts for a in part])
        rest = iter(operands)
        rates, integrals, H, energy, multipliers, phi = ([next(rest) for _ in of] for of in parts)
        emit, self.which = values.emit, []
        power = dot(emit, zip(multipliers, phi, strict=True)) or 0.0
        changes, terms = [], []
        for k, row in enumerate(gradients(values, [*values.operations], integrals, D)):
            change = dot(emit, [(a, rates[j]) for j, a in row.items()]) or 0.0
            is_energy = integrals[k] in H  # K is antisymmetric
            other = emit("fsub", change, power) if integrals[k] in energy else change
            if is_energy or is_zero(values.operations, other, equations.ratios):
                continue
            self.which.append(k)
            changes.append(change)
            parts = [emit("fabs", emit("fmul", a, rates[j])) for j, a in row.items()]
            terms.append(dot(emit, [(1.0, a) for a in parts]) or 0.0)
        self._changes = program_of(values.operations, [*changes, *terms])
        operations = [*self._changes.operations]
        sizes = sizes_of(values, operations, {a: a for a in range(values.count)})
        of_changes = [0.0 if isinstance(a, float) else operand_of(sizes[a]) for a in changes]
        self._sizes: Program = program_of(values.operations, of_changes)

    def are_wrong(self, x: FloatArray, parameters: FloatArray) -> Any:
        """Return where integrals change, beyond rounding, (k, ...) at states x (D, ...)."""
        shape = np.broadcast_shapes(x.shape[1:], parameters.shape[1:])
        given = dict(enumerate([*x, *parameters]))
        found = abs(results_at(self._changes, given, shape))
        changes, terms = found[: len(self.which)], found[len(self.which) :]
        is_wrong = changes > _LARGEST * terms
        if is_wrong.any():
            is_wrong &= changes > _ROUNDING * results_at(self._sizes, given, shape)
        return is_wrong


_changes_of = lru_cache(64)(Changes)


def changes_of(field: Any) -> Changes | None:
    """Return the `Changes` of integrals that a field keeps without a proof; None if it has none."""
    if "conserved" not in field._quantities:
        return None
    changes = _changes_of(field._equations)
    return changes if changes.which else None


def check(field: Any) -> None:
    """Raise ValueError if an integral of a field changes along f of a member at a random state."""
    changes, D, shape = changes_of(field), field._layout.D, field.shape
    members = int(np.prod(shape))
    if changes is None or not members:
        return
    count = max(4, min(_SAMPLES, _MOST // members))
    x = np.random.default_rng(3).normal(size=(count, *(1,) * len(shape), D))
    x *= 10.0 ** np.linspace(-1.0, 0.3, count).reshape(count, *(1,) * (len(shape) + 1))
    if "residuals" in field._quantities:
        x = Mechanics(field).near(np.broadcast_to(x, (count, *shape, D)))
    given = field._inputs
    is_wrong = changes.are_wrong(np.moveaxis(x, -1, 0), given.reshape(len(given), 1, *shape))
    if is_wrong.any():
        k, n, *index = first_index(is_wrong)
        member = field._of_member(index[0] if len(index) == 1 else tuple(index))
        state = np.broadcast_to(x, (count, *shape, D))[(n, *index)]
        at = spell(state.round(3).tolist()) if D < 9 else "a random state"
        of = f"function {changes.which[k]} changes along the motion{member}, as at {at}"
        raise ValueError(f"integrals: {of}")
