"""First integrals that steps of motions keep, see `core.expressions.projection`.

What is not proved (`proofs`) is tested at random states, for all members, also of fields with other
parameters, and at the start of each step of a motion. Tests refuse, they never prove.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..checks import first_index, spell
from ..core.expressions.programs import in_order
from .equations import Equations
from .layout import Layout
from .mechanics import Mechanics
from .proofs import changes_of
from .samples import random_states
from .tolerances import SAMPLES_OF_FAMILY, SAMPLES_OF_MEMBER
from .tracer import Tracer
from .user_function import UserFunction


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


def check(field: Any) -> None:
    """Raise ValueError if an integral of a field changes along f of a member at a random state."""
    changes, D, shape = changes_of(field), field._layout.D, field.shape
    members = int(np.prod(shape))
    if changes is None or not members:
        return
    count = max(4, min(SAMPLES_OF_MEMBER, SAMPLES_OF_FAMILY // members))
    x = random_states(D, count, 0.3).T.reshape(count, *(1,) * len(shape), D)
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
