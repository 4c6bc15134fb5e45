"""A search in a process of its own, which ends at a time limit whatever it is doing."""

from __future__ import annotations

import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

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
        assert process.stdin
        assert process.stdout
        left = min(deadline - time.monotonic(), threading.TIMEOUT_MAX)
        timer = threading.Timer(left, process.kill)
        timer.daemon = True
        timer.start()
        value: Any = 0
        try:
            with process.stdin:
                pickle.dump((function, arguments), process.stdin)
            while value is not None:
                value = pickle.load(process.stdout)
                if isinstance(value, BaseException):
                    raise value
                yield value
        except (EOFError, BrokenPipeError, pickle.UnpicklingError):
            if time.monotonic() < deadline:
                raise RuntimeError("the process of the search ended") from None
        finally:
            timer.cancel()
            process.kill()


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
