"""Warnings of first integrals that change along motions, see `fields.invariants`."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..checks import FloatArray, first_index, spell, warn
from ..fields.invariants import Changes

_MOST = 24  # the most saved states of each trajectory that are tested


def warn_of_changes(
    changes: Changes,
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
    if not len(starts):
        return
    kept = np.arange(len(times))
    if len(times) > _MOST:
        kept = np.linspace(0, len(times) - 1, _MOST).astype(int)
    x = np.concatenate([starts[np.newaxis], states[kept]]).transpose(2, 0, 1)
    shape = len(kept) + 1, *batch
    is_wrong = changes.are_wrong(x.reshape(-1, *shape), _parameters(field, len(batch)))
    if not is_wrong.any():
        return
    k, n, *index = first_index(is_wrong)
    count = np.count_nonzero(is_wrong.any(axis=(0, 1)))
    start = np.broadcast_to(since, len(starts)).reshape(batch)[tuple(index)]
    t = start + [0.0, *times[kept]][n]
    where = f"first: trajectory {spell(tuple(index))} at t = {t:g}"
    warn(
        f"integrals: function {changes.which[k]} changes along f in {count} of {len(starts)} "
        f"solutions ({where}), "
        "which keep it all the same: leave it out of field.conserving(...)"
    )


def _parameters(field: Any, axes: int) -> FloatArray:
    """Return the parameters (P, 1, ...) of a field for a batch of so many axes."""
    given: FloatArray = field._inputs
    return given.reshape(len(given), *(1,) * (axes - given.ndim + 2), *given.shape[1:])
