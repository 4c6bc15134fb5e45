"""Python threads that call machine code in parallel: ctypes releases the GIL during a call."""

import os
from collections import deque
from concurrent.futures import wait
from contextlib import suppress

_pools = {}  # by number of threads


def in_parts(parts, work, abandoned):
    """Call work(part) for all parts, in this thread and in others.

    This thread calls it for all parts where no other can start, such as at the end of the process.
    After an exception, such as at Ctrl-C, the list `abandoned` is not empty: the others should end.
    """
    left, others, raised = deque(range(parts)), [], []

    def next_part():
        with suppress(IndexError):  # no part is left
            return left.popleft()

    def take_parts():
        for part in iter(next_part, None):
            work(part)

    try:
        with suppress(RuntimeError):
            for _ in range(parts - 1):
                others.append(_pool_of(parts - 1).submit(take_parts))
        take_parts()
    except BaseException:
        abandoned.append(True)
        raise
    finally:
        while not all(future.done() for future in others):
            try:
                wait(others)
            except BaseException as error:  # Ctrl-C; the others still write to the arrays
                abandoned.append(True)
                raised.append(error)
    for error in raised:
        raise error
    for future in others:
        future.result()


def _pool_of(threads):
    from concurrent.futures import ThreadPoolExecutor  # RuntimeError at the end of the process

    if threads not in _pools:
        _pools[threads] = ThreadPoolExecutor(threads, "suslov_fast")
    return _pools[threads]


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pools.clear)  # a child lacks these threads
