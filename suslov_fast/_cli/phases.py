"""What the command is doing: said on a terminal, and when it is interrupted."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from types import TracebackType


class Phases:
    """The phase that a run is in, and what an interruption in it means for the output file."""

    def __init__(self, output: Path | None) -> None:
        self._output = output
        self._phase = "starting"
        self._before = self._identity()

    def enter(self, phase: str) -> None:
        """Begin a phase; on a terminal, say so."""
        self._phase = phase
        if sys.stderr.isatty():
            print(f"suslov-fast: {phase}", file=sys.stderr, flush=True)

    def __enter__(self) -> None:
        pass

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if kind is not None and issubclass(kind, KeyboardInterrupt):
            raise KeyboardInterrupt(self._interrupted()) from error

    def _interrupted(self) -> str:
        message = f"interrupted while {self._phase}"
        if self._output is None:
            return message
        written = self._identity() != self._before
        return f"{message}; {self._output} was {'written before' if written else 'not written'}"

    def _identity(self) -> tuple[int, int] | None:
        """What tells the file that is there from one that takes its place."""
        if self._output is None:
            return None
        try:
            status = os.stat(self._output)
        except OSError:
            return None
        return status.st_ino, status.st_mtime_ns
