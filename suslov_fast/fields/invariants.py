"""First integrals that steps of motions keep, see `core.expressions.projection`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..checks import spell
from ..core.expressions.derivative import gradients
from ..core.expressions.numpy_evaluation import evaluate
from ..core.expressions.programs import in_order, program_of
from .equations import Equations
from .layout import Layout
from .mechanics import Mechanics
from .tracer import Tracer
from .user_function import UserFunction

_SAMPLES, _LEAST = 24, 1e-9  # random states; the largest dI/dt of first integrals, of its terms


def conserving(field: Any, given: Sequence[Callable[..., Any]]) -> tuple[Layout, Equations]:
    """Return the equations of a field with first integrals, by default the energy.

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
    _check(field, values, operands[:D], integrals)
    rest = iter(operands[D:])
    kept = {name: [next(rest) for _ in of] for name, of in quantities.items()}
    H = None if old.H is None else operands[D + len(others)]
    of_all = kept | {"conserved": [*dict.fromkeys([*before, *integrals])]}
    return Equations(old.names, old.parameters, values, operands[:D], H, old.K, old.ratios, of_all)


def _check(field: Any, values: Any, rates: Sequence[Any], integrals: Sequence[Any]) -> None:
    """Raise ValueError if the derivative of an integral along f is not 0 at random states."""
    D = field._layout.D
    operations = program_of(values.operations, integrals).operations
    slopes = gradients(values, operations, integrals, D)
    x = np.random.default_rng(3).normal(size=(_SAMPLES, D))
    x *= 10.0 ** np.linspace(-1.0, 0.3, _SAMPLES)[:, None]
    with np.errstate(all="ignore"):
        given = [np.resize(np.ravel(a), _SAMPLES) for a in field._inputs]
        if "residuals" in field._equations.sizes:
            single = field._with_parts(
                field._parts | {n: float(np.ravel(a)[0]) for n, a in field.parameters.items()}
            )
            x = Mechanics(single).near(x)
        x = x.T
        numbers: dict[Any, Any] = dict(enumerate([*x, *given]))
        evaluate(values.operations, numbers)
        for k, row in enumerate(slopes):
            terms = [_value(a, numbers) * _value(rates[j], numbers) for j, a in row.items()]
            change, size = abs(sum(terms)), sum(map(abs, terms))
            found = np.broadcast_to(change / np.where(size > 0.0, size, 1.0), _SAMPLES)
            found = found[np.isfinite(found)]
            if np.median(found) > _LEAST or (found > 1e3 * _LEAST).any():
                at = spell(x[:, 0].round(3).tolist()) if D < 9 else "a random state"
                raise ValueError(f"integrals: function {k} changes along the motion, as at {at}")


def _value(operand: Any, numbers: Any) -> Any:
    return operand if isinstance(operand, float) else numbers[operand]
