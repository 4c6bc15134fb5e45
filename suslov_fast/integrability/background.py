"""A search in a process of its own, which ends at a time limit whatever it is doing."""

from __future__ import annotations

import contextlib
import pickle
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, BinaryIO

_START = """
import sys
sys.path[:] = {path!r}
from suslov_fast.integrability.background import serve
serve()
"""


def results_until(deadline: float, function: Callable[..., Iterator[Any]], *arguments: Any) -> Any:
    """Yield what a generator of a module yields, until a time of `time.monotonic`.

    The generator runs in another process, since python-flint cannot be interrupted. The values are
    pickled. Its last value is followed by None; at the deadline there is no None.
    """
    command = [sys.executable, "-c", _START.format(path=sys.path)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe) as process:
        arrived: queue.Queue[Any] = queue.Queue()
        threading.Thread(target=_read, args=(process.stdout, arrived), daemon=True).start()
        try:
            with contextlib.suppress(BrokenPipeError), process.stdin as stdin:  # type: ignore[union-attr]
                pickle.dump((function, arguments), stdin)
            while (left := deadline - time.monotonic()) > 0:
                value = arrived.get(timeout=min(left, threading.TIMEOUT_MAX))
                if isinstance(value, BaseException):
                    raise value
                yield value
                if value is None:
                    return
        except queue.Empty:
            return
        finally:
            process.kill()


def _read(stream: BinaryIO, arrived: queue.Queue[Any]) -> None:
    """Put all values of a stream into a queue, and an error if it ends without None."""
    value: Any = 0
    try:
        while value is not None:
            value = pickle.load(stream)
            arrived.put(value)
    except (EOFError, OSError, ValueError, pickle.UnpicklingError):
        arrived.put(RuntimeError("the process of the search ended"))


def serve() -> None:
    """Run the generator that arrives at stdin, and write what it yields to stdout."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that waits
    out = sys.stdout.buffer
    function, arguments = pickle.load(sys.stdin.buffer)
    try:
        for value in function(*arguments):
            pickle.dump(value, out)
            out.flush()
        value = None
    except Exception as error:
        value = error
    pickle.dump(value, out)
    out.flush()
