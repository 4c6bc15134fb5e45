"""Work of a command: progress on a terminal, errors with the name of a file."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

from .options import FAILURE, USAGE, CommandError

# Bytes of a file whose size is said before it is written; seconds from one bar to the next; its
# characters.
_LARGE, _INTERVAL, _WIDTH = 10**8, 0.1, 30

_received: list[int] = []


def interrupt(number: int, frame: FrameType | None) -> NoReturn:
    """Note a signal and raise KeyboardInterrupt, which callbacks of the compiler may drop."""
    _received.append(number)
    raise KeyboardInterrupt


class Work:
    """Phases of a command: a bar on a terminal, and a message if one is interrupted."""

    def __init__(self, output: Path | None = None) -> None:
        self.output, self.written = output, False
        self._phase, self._begin, self._shown = "starting", 0.0, 0.0
        _received.clear()

    def phase(self, name: str) -> Callable[[int, int], None]:
        """Begin a phase, and return a function that takes how much of it is done and its total."""
        self._stop_if_asked()
        self._phase, self._begin = name, time.monotonic()
        _show(name)
        return self._report

    def _stop_if_asked(self) -> None:
        if _received:
            raise KeyboardInterrupt

    def _report(self, done: int, total: int) -> None:
        self._stop_if_asked()
        now = time.monotonic()
        if now > self._shown + _INTERVAL and 0 < done <= total:
            self._shown = now
            bar = ("#" * (done * _WIDTH // total)).ljust(_WIDTH)
            left = (now - self._begin) * (total / done - 1)
            _show(f"{self._phase} [{bar}] {done / total:4.0%}, {left:.0f} s left")

    def __enter__(self) -> Work:
        return self

    def __exit__(self, kind: Any, error: BaseException | None, traceback: Any) -> None:
        _show("")
        if isinstance(error, KeyboardInterrupt) and not error.args:
            message = f"interrupted while {self._phase}"
            if self.output is not None:
                message += f"; {self.output} was {'' if self.written else 'not '}written"
            raise KeyboardInterrupt(message) from error


def _show(text: str) -> None:
    """Replace the line on the terminal, if there is one."""
    if sys.stderr.isatty():
        sys.stderr.write(f"\r\x1b[K{text and f'suslov-fast: {text}'}")
        sys.stderr.flush()


def require_new(path: Path, force: bool) -> None:
    """Refuse to replace a file, unless it was asked for."""
    if not force and path.is_file():
        raise CommandError(f"{path}: expected a new name, got one that exists; --force replaces it")


def announce(path: Path, nbytes: int) -> None:
    """Say the size of a large file before it is written."""
    if nbytes > _LARGE:
        print(f"suslov-fast: {path} will take {nbytes / 1e9:,.1f} GB", file=sys.stderr, flush=True)


@contextmanager
def explained(what: object, expected: str = "", status: int = FAILURE) -> Iterator[None]:
    """Turn errors into messages that begin with a name."""
    try:
        yield
    except OSError as error:
        if not expected:
            raise
        reason = error.strerror or str(error)
        if not reason.startswith(("expected", "could not")):
            reason = f"{expected}: {reason}"
        raise CommandError(f"{what}: {reason}") from error
    except (ValueError, TypeError, EOFError) as error:
        text = str(error)
        known = text.startswith((f"{what}:", "store:")) or not what
        raise CommandError(text if known else f"{what}: {text}", status) from error


def writing(path: Path) -> Any:
    """Explain errors of writing a file."""
    return explained(path, "could not be written")


def reading(path: Path) -> Any:
    """Explain errors of reading a file."""
    return explained(path, "expected a readable file, got")


def checking(what: str = "") -> Any:
    """Explain errors of arguments."""
    return explained(what, status=USAGE)
