"""The `progress` argument of a report."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from ..checks import wrong


def check_progress(progress: Any) -> None:
    """Check the argument, and that tqdm is installed if a bar is requested."""
    if progress is True:
        _tqdm()
    elif not (progress is None or progress is False or callable(progress)):
        expected = "True, False, None or a callable (done, parts)"
        raise wrong("progress", expected, type(progress).__name__, TypeError)


@contextmanager
def shown(progress: Any, parts: int) -> Iterator[Callable[[int], object]]:
    """Yield a function that takes the number of parts done so far, and shows it."""
    if progress is True:
        with _tqdm()(total=parts, unit="part") as bar:
            yield lambda done: bar.update(min(done, parts) - bar.n)
            bar.update(parts - bar.n)
    elif callable(progress):
        yield lambda done: progress(min(done, parts), parts)
    else:
        yield lambda done: None


def _tqdm() -> Any:
    try:
        from tqdm.auto import tqdm
    except ImportError as error:
        raise ImportError("progress=True needs tqdm; or pass a callable") from error
    return tqdm
