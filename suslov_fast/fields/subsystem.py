"""Subsystems: the equations of some variables, whose rates do not depend on the others."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ..checks import one_number, warn, wrong
from ..core.expressions.programs import emitted_with_zeros, folded, is_zero, program_of
from .equations import Equations, depends
from .identities import is_independent
from .layout import Layout
from .tracer import Tracer


def subsystem(
    field: Any, names: Sequence[str], held: Mapping[str, float]
) -> tuple[Layout, Equations]:
    """Return the equations of the variables `names`; ValueError if their rates depend on others.

    That is asked of the formulas, with the numbers `held` in place of some of the others. What they
    read may still cancel; that is proved, or refused. Integrals and the energy that depend on these
    variables alone stay.
    """
    old, D = field._program, field._layout.D
    layout, kept = field._layout.only(names)
    others, count = [i for i in range(D) if i not in kept], D + len(old.parameters)
    at = {}
    for name, value in held.items():
        place = old.names.index(name) if name in old.names else D
        if place not in others:
            known = ", ".join(old.names[i] for i in others) or "none"
            raise wrong("subsystem", f"given values of other variables, {known}", name)
        at[place] = one_number(name, value)
    free = [i for i in others if i not in at]
    energy = [old.H] if old.H is not None else old.quantities.get("energy", [])
    integrals, residuals = (old.quantities.get(a, []) for a in ("conserved", "residuals"))
    rows = [*(old.results[i] for i in kept), *energy, *integrals, *residuals]
    whole = Tracer(field._layout, [*old.parameters]).values
    rows = _emitted(whole, old.values.operations, rows, {i: i for i in range(count)} | at)
    operations = whole.operations
    is_own = [is_independent(operations, a, old.ratios, free) for a in rows]
    for name, a, is_known in zip(layout.components, rows, is_own, strict=False):
        if not is_known:
            read = ", ".join(old.names[i] for i in free if depends(operations, a, i))
            raise ValueError(f"names: the rate of {name} depends on other variables: {read}")
    part = Tracer(layout, [*old.parameters]).values
    new = dict.fromkeys(free, 0.0) | {i: k for k, i in enumerate(kept)}
    new |= {D + p: len(kept) + p for p in range(len(old.parameters))}
    own = [a if is_known else 0.0 for a, is_known in zip(rows, is_own, strict=True)]
    rest = iter(_emitted(part, operations, own, new))
    rates, energy, integrals, residuals = (
        [next(rest) for _ in of] for of in (kept, energy, integrals, residuals)
    )
    if any(type(a) is int for a in residuals):
        warn("subsystem: it has no constraints, so steps do not keep those of its variables")
    found = {"energy": energy if all(is_own[len(kept) :][: len(energy)]) else []}
    found["conserved"] = [a for a in integrals if type(a) is int]
    quantities = {name: of for name, of in found.items() if of}
    about: Any = {"ratios": old.ratios, "quantities": quantities}
    return layout, Equations(layout.components, old.parameters, part, rates, **about)


def _emitted(values: Any, operations: Any, operands: Any, new: dict[Any, Any]) -> list[Any]:
    """Add the operations of operands to `values`, without products and sums of 0."""
    for name, number, of in program_of(operations, operands).operations:
        new[number] = _simple(values, name, [a if isinstance(a, float) else new[a] for a in of])
    return [a if isinstance(a, float) else new[a] for a in operands]


def _simple(values: Any, name: str, of: list[Any]) -> Any:
    """Emit an operation, without products and sums of 0."""
    if name == "fdiv" and is_zero(of[1]):
        raise ValueError("names: the rates have no value where the other variables are 0")
    if name == "fdiv" and is_zero(of[0]):
        return 0.0
    result = emitted_with_zeros(lambda name, *of: folded(values.emit, name, of), name, of)
    if isinstance(result, float) and not math.isfinite(result):
        raise ValueError("names: the rates have no value where the other variables are 0")
    return result
