"""Subsystems: the equations of some variables, whose rates do not depend on the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..core.expressions.numpy_evaluation import evaluate
from ..core.expressions.programs import program_of
from .equations import Equations
from .layout import Layout
from .tracer import Tracer

_SAMPLES = 24  # random states at which dependence is tested


def subsystem(
    field: Any, names: Sequence[str], held: Mapping[str, float]
) -> tuple[Layout, Equations]:
    """Return the equations of the variables `names`; raise if their rates depend on others."""
    old, D = field._equations, field._layout.D
    layout, kept = field._layout.only(names)
    names = layout.components
    dropped = [i for i in range(D) if i not in kept]
    rows = {"": [old.results[i] for i in kept]}
    if "energy" in old.sizes:
        rows["energy"] = old.quantities["energy"]
    conserved = old.quantities.get("conserved", [])
    rows |= {f"conserved {k}": [a] for k, a in enumerate(conserved)}
    rng = np.random.default_rng(2)
    at = {old.names.index(name): float(value) for name, value in held.items()}
    x = rng.normal(size=(D, _SAMPLES))
    for i, value in at.items():
        x[i] = value
    given = [np.full(_SAMPLES, np.ravel(a)[0]) for a in field._inputs]
    found = {}
    for name, operands in rows.items():
        operations = program_of(old.values.operations, operands).operations
        numbers = []
        for _ in range(2):
            values: dict[int, Any] = dict(enumerate([*x, *given]))
            with np.errstate(all="ignore"):
                evaluate(operations, values)
            numbers.append(values)
            x = x.copy()
            free = [i for i in dropped if i not in at]
            x[free] = rng.normal(size=(len(free), _SAMPLES))
        first, second = numbers
        sizes = [
            abs(np.nan_to_num(np.asarray(values[n], float)))
            for values in numbers
            for _, n, _ in operations
        ]
        size = np.maximum.reduce([*sizes, np.full(_SAMPLES, 1e-300)])
        for operand, label in zip(operands, names if not name else [name], strict=True):
            if isinstance(operand, float):
                continue
            change = abs(np.asarray(first[operand] - second[operand]) / size)
            if not (change[np.isfinite(change)] < 1e-13).all():
                if name:
                    break
                raise ValueError(f"names: the rate of {label} depends on other variables")
        else:
            found[name] = operands, operations
    tracer = Tracer(layout, [*old.parameters])
    result = {}
    for name, (operands, operations) in found.items():
        new: dict[Any, Any] = dict.fromkeys(dropped, 0.0) | at | {i: k for k, i in enumerate(kept)}
        new |= {D + k: len(kept) + k for k in range(len(old.parameters))}
        for instruction, number, of in operations:
            new[number] = _simple(
                tracer.values, instruction, [a if isinstance(a, float) else new[a] for a in of]
            )
        result[name] = [a if isinstance(a, float) else new[a] for a in operands]
    main = result.pop("")
    integrals = [result.pop(f"conserved {k}", []) for k in range(len(conserved))]
    if any(integrals):
        result["conserved"] = [a for of in integrals for a in of if type(a) is int]
    if not all(np.isfinite(a) for a in main if isinstance(a, float)):
        raise ValueError("names: the rates have no value where the other variables are 0")
    return layout, Equations(
        names, old.parameters, tracer.values, main, ratios=old.ratios, quantities=result
    )


def _simple(values: Any, instruction: str, of: list[Any]) -> Any:
    """Emit an operation, without products and sums of 0."""
    zeros = [isinstance(a, float) and a == 0.0 for a in of]
    if (instruction == "fmul" and any(zeros)) or (instruction == "fdiv" and zeros[0]):
        return 0.0
    if instruction in ("fadd", "fsub") and zeros[1]:
        return of[0]
    if instruction == "fadd" and zeros[0]:
        return of[1]
    if instruction == "fsub" and zeros[0]:
        return values.emit("fmul", -1.0, of[1])
    return values.emit(instruction, *of)
