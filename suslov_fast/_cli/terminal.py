"""Common parts of commands: a progress bar, one-line errors, names of new files."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from .flags import CommandError, UsageError

# Seconds between updates of the bar.
_INTERVAL = 0.1


@contextmanager
def progress_bar(title: str) -> Iterator[Callable[[int, int], None]]:
    """Yield a function of (done, total) that draws a bar if stderr is a terminal."""
    begin = drawn = time.monotonic()

    def show(text: str) -> None:
        if sys.stderr is not None and sys.stderr.isatty():
            print(f"\r\x1b[K{text}", end="", file=sys.stderr, flush=True)

    def progress(done: int, total: int) -> None:
        nonlocal drawn
        now = time.monotonic()
        if now > drawn + _INTERVAL and 0 < done <= total:
            drawn, part = now, done / total
            left = (now - begin) * (1 / part - 1)
            show(f"{title} [{'#' * int(30 * part):30}] {part:4.0%}, {left:.0f} s left")

    show(f"{title} ...")
    try:
        yield progress
    finally:
        show("")


@contextmanager
def about(what: Path | str | None) -> Iterator[None]:
    """Convert errors to messages that begin with the name of a file or an argument."""
    try:
        yield
    except OSError as error:
        name = what if error.filename is None else error.filename
        raise CommandError(f"{name}: {error.strerror or error}") from error
    except (ValueError, TypeError, ArithmeticError, EOFError, RecursionError) as error:
        text = str(error)
        kind = UsageError if isinstance(what, str) else CommandError
        raise kind(text if text.startswith(f"{what}:") else f"{what}: {text}") from error


def require_new(path: Path, force: bool) -> None:
    """Raise CommandError if a file exists, unless it may be replaced."""
    if not force and path.is_file():
        raise CommandError(f"{path}: expected a new name, got one that exists; --force replaces it")
