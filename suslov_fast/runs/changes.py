"""Changes of the state along motions: `Change`, which `flow` takes, and what `Changes` did."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies.fields.calls import operands_of_function
from ..checks import FloatArray, short, wrong
from ..core.lists.changes import Act, in_order_of_code
from ..core.motion.engine import Stops
from ..engine.motions import Records


class Change:
    """A change of the state, where the motion meets a surface or at given times.

    Parameters
    ----------
    surface : str or callable, optional
        The name of a component, or a function of the state, which is traced as those of
        ``Field.from_function``; it may take parameters of the field by name. The change acts where
        it is 0.
    to : callable, optional
        Takes the state, and parameters of the field by name, and returns the new state. Without
        it the state stays as it is.
    direction : int
        1 or -1 if the change acts only where the surface increases or decreases along the motion.
    times : array_like(float, shape=(k,) or (..., k)), optional
        Times at which it acts, for all trajectories or for each; NaN for none.
    ends : bool
        Whether it ends the trajectory.
    most : int, optional
        How often it acts; after that it ends the trajectory.
    """

    def __init__(
        self,
        surface: str | Callable[..., Any] | None = None,
        *,
        to: Callable[..., Any] | None = None,
        direction: int = 0,
        times: ArrayLike | None = None,
        ends: bool = False,
        most: int | None = None,
    ) -> None:
        if (surface is None) == (times is None):
            raise wrong("surface, times", "one of them", "both" if times is not None else "none")
        self.surface, self.to, self.direction = surface, to, direction
        self.times = None if times is None else np.array(times, np.float64)
        self.ends, self.most = ends, most

    def act(self, names: Sequence[str], parameters: Sequence[str]) -> Act:
        """Return what the engine takes, for a field with these variables and parameters."""
        surface = to = None
        if isinstance(self.surface, str):
            place = [*names].index(self.surface)
            surface = _traced("surface", lambda x: x[place], names, parameters)
        elif self.surface is not None:
            surface = _traced("surface", self.surface, names, parameters)
        if self.to is not None:
            to = _traced("to", self.to, names, parameters)
        most = math.inf if self.most is None else float(self.most)
        return Act(surface, to, self.direction, 1.0 if self.ends else most)


@dataclass(frozen=True, eq=False)
class Changes:
    """What changes did along motions, K times, ordered by trajectory, then along the motion.

    trajectory, which  (K,), the number of the trajectory, and of the change in the list
    time               (K,)
    before, states     (K, D), states before and after
    count              (..., C), how often each of C changes acted on each trajectory
    """

    trajectory: NDArray[np.int64]
    which: NDArray[np.int64]
    time: FloatArray
    before: FloatArray
    states: FloatArray
    count: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.trajectory)


def checked_changes(changes: Any) -> tuple[Change, ...]:
    """Return changes as a tuple."""
    changes = (changes,) if isinstance(changes, Change) else changes
    if not isinstance(changes, (tuple, list)) or not all(isinstance(c, Change) for c in changes):
        raise wrong("changes", "a Change, or a list of them", short(changes), TypeError)
    return tuple(changes)


def acts_of(field: Any, changes: tuple[Change, ...]) -> tuple[Act, ...]:
    """Return the acts of changes, in the order of code."""
    parameters = [*field.arrays]
    acts = [change.act(field.names, parameters) for change in changes]
    return tuple(acts[k] for k in in_order_of_code(acts))


def stops_of(changes: tuple[Change, ...], sign: int, batch: tuple[int, ...]) -> Stops:
    """Return the times of changes."""
    later = [change for change in changes if change.times is not None]
    first = len(changes) - len(later)  # the number of the first one of these
    shapes = [change.times.shape[:-1] for change in later]
    is_shared = all(math.prod(shape) == 1 for shape in shapes)
    times, which = [np.empty((1 if is_shared else math.prod(batch), 0))], []
    for k, change in enumerate(later, first):
        array = change.times
        if not is_shared:
            array = np.broadcast_to(array, (*batch, array.shape[-1]))
        moduli = sign * array.reshape(len(times[0]), -1)
        times.append(np.where(moduli >= 0.0, moduli, np.inf))
        which += [float(k)] * moduli.shape[1]
    both = np.concatenate(times, axis=1)
    order = np.argsort(both, axis=1, kind="stable")
    return Stops(np.take_along_axis(both, order, 1), np.array(which)[order])


def changes_of_records(
    records: Records, changes: tuple[Change, ...], batch: tuple[int, ...], D: int
) -> Changes:
    """Return what changes did, with their numbers in the list of the user."""
    numbers = np.array(in_order_of_code(changes), np.int64)
    which, C = numbers[records.which], len(changes)
    count = np.bincount(records.trajectory * C + which, minlength=math.prod(batch) * C)
    states = records.before[:, :D], records.states[:, :D]
    return Changes(records.trajectory, which, records.time, *states, count.reshape(*batch, C))


def _traced(argument: str, f: Any, names: Sequence[str], parameters: Sequence[str]) -> Any:
    """Return the list of a function of the state, and of parameters that it names."""
    if not callable(f):
        raise wrong(argument, "a function of the state", short(f), TypeError)
    own = inspect.signature(f).parameters.values()
    takes_all = any(each.kind == each.VAR_KEYWORD for each in own)
    named = {each.name for each in own}
    known = [name for name in parameters if takes_all or name in named]

    def of_all(x: Any, **values: Any) -> Any:
        return f(x, **{name: values[name] for name in known})

    tracer, operands = operands_of_function(argument, of_all, names, dict.fromkeys(parameters, 0.0))
    return Act.list_of(tracer.values, operands)
