"""How far a stored run is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from .._engine.progress import Progress, _tqdm

# Called with steps of one trajectory made, and bytes written, since the last call.
Report = Callable[[int, int], object]


@contextmanager
def meter(progress: Progress, total: int, done: int) -> Iterator[Report]:
    """A function that reports what is done; all and what was done before are in steps."""
    if progress is True:
        with _tqdm()(total=total, initial=done, unit="step", unit_scale=True) as bar:
            yield _Bar(bar)
    elif callable(progress):
        progress(done, total)
        yield _Call(progress, total, done)
    else:
        yield lambda steps, nbytes: None


class _Bar:
    def __init__(self, bar: Any) -> None:
        self.bar, self.nbytes = bar, 0

    def __call__(self, steps: int, nbytes: int) -> None:
        self.nbytes += nbytes
        self.bar.set_postfix_str(f"{self.nbytes / 1e9:.3g} GB written", refresh=False)
        self.bar.update(steps)


class _Call:
    def __init__(self, progress: Callable[[int, int], object], total: int, done: int) -> None:
        self.progress, self.total, self.done = progress, total, done

    def __call__(self, steps: int, nbytes: int) -> None:
        self.done += steps
        self.progress(self.done, self.total)
