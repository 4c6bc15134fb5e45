"""The `progress` argument of long computations."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

Progress = bool | None | Callable[[int, int], object]


def check_progress(progress: Progress) -> None:
    """Check the argument, and that tqdm is installed if a bar is requested."""
    if progress is True:
        _tqdm()
    elif not (progress is None or progress is False or callable(progress)):
        raise TypeError(
            "progress: expected True, False, None or a callable (done, total), "
            f"got {type(progress).__name__}"
        )


@contextmanager
def reporter(progress: Progress, total: int) -> Iterator[Callable[[int], object]]:
    """Yield a function that takes the number of steps done so far, and shows any progress."""
    shown = 0

    def report(done: int) -> None:
        nonlocal shown
        if min(done, total) > shown:
            before, shown = shown, min(done, total)
            show(before, shown)

    if progress is True:
        with _tqdm()(total=total, unit="step", unit_scale=True) as bar:
            show = lambda before, now: bar.update(now - before)  # noqa: E731
            yield report
    else:
        show = lambda before, now: progress(now, total) if callable(progress) else None  # noqa: E731
        yield report


def _tqdm() -> Any:
    try:
        from tqdm.auto import tqdm  # a notebook bar in a notebook
    except ImportError as error:
        raise ImportError(
            "progress=True needs tqdm: pip install 'suslov_fast[progress]', or pass a callable"
        ) from error
    return tqdm
