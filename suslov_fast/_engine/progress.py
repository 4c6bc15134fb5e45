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
    """Yield a function that takes the number of steps done so far."""
    if progress is True:
        with _tqdm()(total=total, unit="step", unit_scale=True) as bar:
            yield lambda done: bar.update(done - bar.n)
    else:
        yield lambda done: progress(done, total) if callable(progress) else None


def _tqdm() -> Any:
    try:
        from tqdm.auto import tqdm  # a notebook bar in a notebook
    except ImportError as error:
        raise ImportError(
            "progress=True needs tqdm: pip install 'suslov_fast[progress]', or pass a callable"
        ) from error
    return tqdm
