"""The search of a report, in this process or, with a time limit, in another one.

python-flint holds the interpreter for as long as an operation takes, so that no time limit could
end it in this process.
"""

import multiprocessing
import signal
import time
from collections.abc import Iterator
from typing import Any, NamedTuple

from .search import Search

_PAUSE = 0.2  # seconds after which Ctrl-C is handled at the latest, also on Windows


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
        yield Part(report, tasks.done, tasks.done + len(tasks.waiting))
    report.finished = True
    known = tasks.done + len(tasks.waiting)
    yield Part(report, known, known)


def search_until(deadline: float, report: Any) -> Iterator[Part]:
    """Yield what `search` yields in another process, until `time.monotonic()` is the deadline."""
    context = multiprocessing.get_context("spawn")
    answers, sender = context.Pipe(duplex=False)
    process = context.Process(target=serve, args=(sender, report), daemon=True)
    process.start()
    sender.close()
    try:
        while not report.finished and (left := deadline - time.monotonic()) > 0.0:
            if not answers.poll(min(left, _PAUSE)):
                continue
            try:
                result = answers.recv()
            except EOFError:
                how = 'call report in a script below if __name__ == "__main__":'
                raise RuntimeError(f"the process of the search ended: {how}") from None
            if isinstance(result, Exception):
                raise result
            report = result.report
            yield result
    finally:
        process.kill()
        process.join()
        answers.close()


def serve(answers: Any, report: Any) -> None:
    """Run a search, and send what it yields, or an error."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that waits
    try:
        for part in search(report):
            answers.send(part)
    except Exception as error:  # of any class: who waits for the answers raises it
        answers.send(error)
