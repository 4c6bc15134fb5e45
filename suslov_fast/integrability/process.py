"""The search of a report, in this process or, with a time limit, in another one.

python-flint holds the interpreter for as long as an operation takes, so that no time limit could
end it in this process.
"""

import contextlib
import pickle
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any, NamedTuple

from .search import Search

# Ctrl-C is for the process that waits.
_START = """
import signal, sys
signal.signal(signal.SIGINT, signal.SIG_IGN)
sys.path[:] = {}
import suslov_fast.integrability.process as process
process.serve()
"""
_PAUSE = 0.2  # seconds after which Ctrl-C is handled at the latest


class Part(NamedTuple):
    """A report on the way, and the numbers of tasks that are done and known."""

    report: Any
    done: int
    known: int


def search(report: Any) -> Iterator[Part]:
    """Fill a `Report`, and yield it after each task."""
    facts = Search(report.map, report.degree)
    tasks = facts.queue
    for _ in tasks:
        facts.fill(report)
        yield Part(report, tasks.done, tasks.done + len(tasks))
    report.finished = True
    known = tasks.done + len(tasks)
    yield Part(report, known, known)


def search_until(deadline: float, report: Any) -> Iterator[Part]:
    """Yield what `search` yields in another process, until `time.monotonic()` is the deadline."""
    pipe, command = subprocess.PIPE, [sys.executable, "-c", _START.format(sys.path)]
    process: Any = subprocess.Popen(command, stdin=pipe, stdout=pipe)
    answers: Any = queue.SimpleQueue()
    exchange = threading.Thread(target=_exchange, args=(process, report, answers))
    with process:
        try:
            exchange.start()
            while not report.finished and (left := deadline - time.monotonic()) > 0.0:
                try:
                    result = answers.get(timeout=min(left, _PAUSE))
                except queue.Empty:
                    continue
                if isinstance(result, Exception):
                    raise result
                report = result.report
                yield result
        finally:
            process.kill()
            exchange.join()


def _exchange(process: Any, request: Any, answers: Any) -> None:
    """Write a request to a process, and put what it answers, or an error, into a queue.

    It runs in a thread: on Windows a read from a pipe cannot be interrupted, not even by Ctrl-C.
    """
    try:
        with process.stdin:
            pickle.dump(request, process.stdin)
        while True:
            answers.put(pickle.load(process.stdout))
    # Windows has no BrokenPipeError for a process that ended, but EINVAL.
    except (EOFError, OSError, pickle.UnpicklingError):
        answers.put(RuntimeError("the process of the search ended"))
    except Exception as error:  # of any class: who waits for the answers raises it
        answers.put(error)


def serve() -> None:
    """Run the search with arguments from stdin, and write what it yields to stdout."""
    out, written = sys.stdout.buffer, b""
    try:
        for result in search(pickle.load(sys.stdin.buffer)):
            if (pickled := pickle.dumps(result.report)) != written or result.report.finished:
                written = pickled
                pickle.dump(result, out)
                out.flush()
    except Exception as error:
        with contextlib.suppress(OSError):  # the process that waits may have ended
            pickle.dump(error, out)
