"""The task of one call of a kernel of steps, and the arrays to which it writes.

B trajectories have states 0, 1, 2, ... of D components.
"""

from typing import Any, NamedTuple


class Span(NamedTuple):
    """The trajectories and states of a call: `begin` to end - 1, from `start` to `stop`."""

    begin: int
    end: int
    start: int
    stop: int
    every: int  # states with numbers that are multiples of `every` are saved; none if it is 0
    row: int  # row of `saved` for the first state that the call saves


class Output(NamedTuple):
    """The arrays to which a kernel writes."""

    saved: Any  # (rows, B, D), states with numbers that are multiples of `every`
    final: Any  # (B, D), states number `stop`; most kernels begin with them if start > 0
    carry: Any  # (carried, B), other numbers from which the next call continues
    status: Any  # (B,), OK at first, changed at the first failure
    failed_at: Any  # (B,), -1 at first, then the number of the first missing state

    def of(self, trajectories):
        """Return views of the arrays for some trajectories, a slice."""
        pairs = zip(self, AXES, strict=True)
        return Output(*(a[:, trajectories] if axis else a[trajectories] for a, axis in pairs))


AXES = Output(saved=1, final=0, carry=1, status=0, failed_at=0)  # each array's trajectory axis
