"""The search of a report, in this process or in one that a time limit ends."""

import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

from .search import Search

_START = "import sys; sys.path[:] = {}; import suslov_fast.integrability.process as p; p.serve()"


def search(found: Any, seed: int) -> Iterator[tuple[Any, int, int]]:
    """Fill a `Report`; yield it after each task, with the numbers of tasks done and known."""
    facts = Search(found.map, found.degree, seed)
    queue = facts.queue
    for _ in queue:
        facts.fill(found)
        if found.map.has_letter:
            formulas = [*found.integrals, *found.measures, *found.polynomials]
            special = {eps for f in formulas for eps in f.special}
            found.special_eps = tuple(sorted(special.union(found.map.degenerate_eps)))
        yield found, queue.done, queue.done + len(queue)
    found.finished = True
    known = queue.done + len(queue)
    yield found, known, known


def search_until(deadline: float, found: Any, seed: int) -> Iterator[tuple[Any, int, int]]:
    """Yield what `search` yields, until `time.monotonic()` reaches the deadline.

    It runs in another process, since python-flint cannot be interrupted.
    """
    pipe, command = subprocess.PIPE, [sys.executable, "-c", _START.format(sys.path)]
    process: Any = subprocess.Popen(command, stdin=pipe, stdout=pipe)
    left = min(deadline - time.monotonic(), threading.TIMEOUT_MAX)
    timer = threading.Timer(left, process.kill)
    with process:
        try:
            timer.start()
            with process.stdin:
                pickle.dump((found, seed), process.stdin)
            while not found.finished:
                result = pickle.load(process.stdout)
                if isinstance(result, Exception):
                    raise result
                found = result[0]
                yield result
        except (EOFError, BrokenPipeError, pickle.UnpicklingError):
            if time.monotonic() < deadline:
                raise RuntimeError("the process of the search ended") from None
        finally:
            timer.cancel()
            process.kill()


def serve() -> None:
    """Run the search with arguments from stdin, and write what it yields to stdout.

    It ends with the process that waits for it, if this is killed.
    """
    parent = os.getppid()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that waits
    out = sys.stdout.buffer
    last = b""
    try:
        for result in search(*pickle.load(sys.stdin.buffer)):
            report, _, _ = result
            if os.getppid() != parent:
                return
            if (now := pickle.dumps(report)) != last or report.finished:
                last = now
                pickle.dump(result, out)
                out.flush()
    except Exception as error:
        pickle.dump(error, out)
