"""Work of a command: its progress on a terminal, and the files that it writes."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType

from .options import CommandError, usage_error

# Bytes of a file whose size is said before it is written, and seconds from one bar to the next.
_LARGE, _INTERVAL = 10**8, 0.1
_WIDTH = 30


class Work:
    """Phases of a command: a bar on a terminal, and a message if one is interrupted."""

    def __init__(self, output: Path | None = None) -> None:
        self.output = output
        self.written = False
        self._phase = "starting"
        self._begin = self._shown = 0.0
        self._on_terminal = sys.stderr.isatty()

    def phase(self, name: str) -> Callable[[int, int], None]:
        """Begin a phase, and return a function that takes how much of it is done and its total."""
        self._phase = name
        self._begin = time.monotonic()
        self._show(name)
        return self._report

    def _report(self, done: int, total: int) -> None:
        now = time.monotonic()
        if not self._on_terminal or now < self._shown + _INTERVAL or not 0 < done <= total:
            return
        self._shown = now
        part = done / total
        left = (now - self._begin) * (1 / part - 1)
        bar = ("#" * round(part * _WIDTH)).ljust(_WIDTH)
        self._show(f"{self._phase} [{bar}] {part:4.0%}, {left:.0f} s left")

    def _show(self, text: str) -> None:
        """Replace the line on the terminal."""
        if self._on_terminal:
            sys.stderr.write(f"\r\x1b[K{text and f'suslov-fast: {text}'}")
            sys.stderr.flush()

    def __enter__(self) -> Work:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._show("")
        if isinstance(error, KeyboardInterrupt) and not error.args:
            message = f"interrupted while {self._phase}"
            if self.output is not None:
                message += f"; {self.output} was {'' if self.written else 'not '}written"
            raise KeyboardInterrupt(message) from error


def require_new(path: Path, force: bool) -> None:
    """Refuse to replace a file, unless it was asked for."""
    try:
        exists = path.exists() and not (path.is_dir() and not any(path.iterdir()))
    except OSError:
        return  # writing explains it
    if exists and not force:
        raise CommandError(f"{path}: expected a new name, got one that exists; --force replaces it")


def announce(path: Path, nbytes: int) -> None:
    """Say the size of a large file before it is written."""
    if nbytes < _LARGE:
        return
    free = ""
    for folder in path.absolute().parents:
        if folder.exists():
            free = f" of {shutil.disk_usage(folder).free / 1e9:,.1f} GB that are free"
            break
    message = f"suslov-fast: {path} takes {nbytes / 1e9:,.1f} GB{free}"
    print(message, file=sys.stderr, flush=True)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn errors of writing a file into messages with its name."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        if not reason.startswith(("expected", "could not")):
            reason = f"could not be written: {reason}"
        raise CommandError(f"{path}: {reason}") from error


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn errors of reading a file into messages with its name."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise CommandError(f"{path}: expected a readable file, got: {reason}") from error
    except (ValueError, TypeError, EOFError) as error:
        text = str(error)
        raise CommandError(text if text.startswith(f"{path}") else f"{path}: {text}") from error


@contextmanager
def checking(what: str = "") -> Iterator[None]:
    """Turn errors of arguments into errors of usage."""
    try:
        yield
    except (ValueError, TypeError) as error:
        raise usage_error(what + str(error)) from error
