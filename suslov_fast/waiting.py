"""A line at the terminal while a command compiles and computes."""

import sys
import threading
import time
from types import TracebackType
from typing import Any, Self

_FIRST = 1.0  # seconds without a line
_PAUSE = 0.2  # seconds between two lines
_WIDTH = 24  # characters of the bar
_CLEAR = "\r\x1b[K"


class Waiting:
    """A context with a line on stderr, from the second second on, if stderr is a terminal.

    Until the first call of `report` the line says that code is compiled; then it is a bar.
    """

    def __init__(self) -> None:
        self._part: float | None = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._show, daemon=True)
        self._is_shown = sys.stderr.isatty()

    def report(self, done: int, total: int) -> None:
        """Note how far the computation is, as the argument `progress` of calls."""
        self._part = done / total if total else 1.0

    def text(self, seconds: float) -> str:
        """Return the line after these seconds."""
        if self._part is None:
            # The length of a compilation is not known: a mark goes to and fro.
            place = abs(int(seconds / _PAUSE) % (2 * _WIDTH - 2) - _WIDTH + 1)
            bar = "." * place + "#" + "." * (_WIDTH - 1 - place)
            return f"compiling, once  [{bar}] {seconds:.0f} s"
        full = int(_WIDTH * self._part)
        return f"computing        [{'#' * full}{'.' * (_WIDTH - full)}] {100 * self._part:.0f} %"

    def _show(self) -> None:
        begin = time.perf_counter()
        pause = _FIRST
        while not self._over.wait(pause):
            print(
                f"{_CLEAR}{self.text(time.perf_counter() - begin)}",
                end="",
                file=sys.stderr,
                flush=True,
            )
            pause = _PAUSE

    def __enter__(self) -> Self:
        if self._is_shown:
            self._thread.start()
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> Any:
        self._over.set()
        if self._is_shown:
            self._thread.join()
            print(_CLEAR, end="", file=sys.stderr, flush=True)
