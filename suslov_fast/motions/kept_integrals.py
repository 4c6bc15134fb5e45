"""Warnings of first integrals that motions do not keep, see `core.flow.projected_states`."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..checks import first_index, spell, warn
from ..status import IntegrationWarning
from .integration import Ends


def warn_of_unkept(ends: Ends, batch: tuple[int, ...], sign: int = 1, since: Any = 0.0) -> None:
    """Warn once of integrals that changed along motions, or whose projections were left out.

    `since` is the time t at the starts, a number or (B,). Near its end no motion keeps integrals,
    so projections that were left out in motions that failed do not count.
    """
    number, changed_at, left_at = ends.unkept.T
    changes = number > 0.0
    is_left = (left_at > 0.0) & (ends.status >= 0) & ~changes
    texts = []
    for marked, at, text, how in (
        (changes, changed_at, "function {} changes along f", "leave it out"),
        (is_left, left_at, "functions could not be kept", "pass a smaller rtol"),
    ):
        if not marked.any():
            continue
        first = int(np.argmax(marked))
        t = np.broadcast_to(since, marked.shape)[first] + sign * at[first]
        index = spell(first_index(marked.reshape(batch)))
        count = f"{np.count_nonzero(marked)} of {marked.size} solutions"
        where = f"(first: trajectory {index} at t = {t:g})"
        texts.append(f"{text.format(int(number[first]) - 1)} in {count} {where}: {how}")
    if texts:
        warn(f"field.conserving: {'; '.join(texts)}", IntegrationWarning)
