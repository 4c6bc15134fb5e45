"""Tests of first integrals that a motion keeps: their derivatives along f at states of the motion.

`Field.conserving` tests random states with the parameters of that time. Other parameters, a force
that acts later, or a branch that no random state reached may change an integral. A motion that
keeps it all the same is wrong.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from ..checks import FloatArray, first_index, spell, warn
from ..core.expressions.derivative import gradients
from ..core.expressions.numpy_evaluation import results_at
from ..core.expressions.programs import Program, dot, in_order, program_of
from ..core.expressions.rounding import sizes_of
from ..core.expressions.values import operand_of
from ..fields.equations import Equations

_MOST = 24  # the most saved states of each trajectory that are tested
# The largest change of an integral, as a part of the moduli of its terms; smaller than _ROUNDING of
# their sizes before cancellation it is rounding.
_LARGEST, _ROUNDING = 1e-11, 2.0**-40


@lru_cache(64)
def _changes_of(equations: Equations) -> tuple[Program, Program]:
    """Return programs of dI/dt and of the moduli of its terms, and of their sizes, for each I."""
    D, conserved = len(equations.names), equations.quantities["conserved"]
    values, operands = in_order(equations.values, [*equations.results, *conserved])
    rates, changes, terms, emit = operands[:D], [], [], values.emit
    for row in gradients(values, [*values.operations], operands[D:], D):
        parts = [emit("fmul", a, rates[j]) for j, a in row.items()]
        changes.append(dot(emit, [(a, rates[j]) for j, a in row.items()]) or 0.0)
        terms.append(dot(emit, [(1.0, emit("fabs", a)) for a in parts]) or 0.0)
    both, operations = program_of(values.operations, [*changes, *terms]), [*values.operations]
    known = {a: a for a in range(values.count)}
    sizes = sizes_of(values, operations, known)
    sizes = [0.0 if isinstance(a, float) else operand_of(sizes[a]) for a in changes]
    return both, program_of(values.operations, sizes)


def has_integrals(system: Any) -> bool:
    """Return True for a field that keeps integrals."""
    equations = getattr(system, "_equations", None)
    return equations is not None and "conserved" in equations.sizes


def warn_of_changes(
    field: Any,
    starts: FloatArray,
    batch: tuple[int, ...],
    states: Any,
    times: FloatArray,
    since: Any = 0.0,
) -> None:
    """Warn once if integrals that a field keeps change at `starts` (B, D) or `states` (n, B, D).

    `since` is the time t at the starts, a number or (B,).
    """
    if not (has_integrals(field) and len(starts)):
        return
    kept = np.arange(len(times))
    if len(times) > _MOST:
        kept = np.linspace(0, len(times) - 1, _MOST).astype(int)
    x = np.concatenate([starts[np.newaxis], states[kept]]).transpose(2, 0, 1)
    shape = len(kept) + 1, *batch
    inputs = dict(enumerate([*x.reshape(-1, *shape), *_parameters(field, len(batch))]))
    changes_and_terms, of_sizes = _changes_of(field._equations)
    changes, terms = abs(results_at(changes_and_terms, inputs, shape)).reshape(2, -1, *shape)
    is_wrong = changes > _LARGEST * terms
    if is_wrong.any():
        is_wrong &= changes > _ROUNDING * results_at(of_sizes, inputs, shape)
    if not is_wrong.any():
        return
    k, n, *index = first_index(is_wrong)
    count = np.count_nonzero(is_wrong.any(axis=(0, 1)))
    start = np.broadcast_to(since, len(starts)).reshape(batch)[tuple(index)]
    t = start + [0.0, *times[kept]][n]
    where = f"first: trajectory {spell(tuple(index))} at t = {t:g}"
    warn(
        f"integrals: function {k} changes along f in {count} of {len(starts)} solutions ({where}), "
        "which keep it all the same: leave it out of field.conserving(...)"
    )


def _parameters(field: Any, axes: int) -> FloatArray:
    """Return the parameters (P, 1, ...) of a field for a batch of so many axes."""
    given: FloatArray = field._inputs
    return given.reshape(len(given), *(1,) * (axes - given.ndim + 2), *given.shape[1:])
