"""The argument `progress` of long computations."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import Any

from ..checks import wrong

Progress = bool | None | Callable[[int, int], object]


def check_progress(progress: Progress) -> None:
    """Check the argument, and that tqdm is installed if a bar is requested."""
    if progress is True:
        _tqdm()
    elif not (progress is None or progress is False or callable(progress)):
        expected = "True, False, None or a callable (done, total)"
        raise wrong("progress", expected, type(progress).__name__, TypeError)


@contextmanager
def reporter(progress: Progress, total: int) -> Iterator[Callable[[int], object]]:
    """Yield a function that takes the number of steps done so far, and shows any progress."""
    shown = -1

    def report(done: int) -> None:
        nonlocal shown
        if min(done, total) > shown:
            shown = min(done, total)
            if callable(progress):
                progress(shown, total)
            elif bar is not None:
                bar.update(shown - bar.n)

    bar = _tqdm()(total=total, unit="step", unit_scale=True) if progress is True else None
    with bar or nullcontext():
        yield report
        report(total)


def _tqdm() -> Any:
    try:
        from tqdm.auto import tqdm  # a notebook bar in a notebook
    except ImportError as error:
        raise ImportError(
            "progress=True needs tqdm: pip install '.[progress]' in a copy of the repository, "
            "or pass a callable"
        ) from error
    return tqdm
