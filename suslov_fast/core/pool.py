"""Threads of Python for machine code that is called through ctypes, which lets others run."""

import os
from collections import deque
from concurrent.futures import wait
from contextlib import suppress

_pools = {}  # by their numbers of threads


def in_parts(parts, work, abandoned):
    """Call work(part) for all parts, here and in other threads at once.

    Where no thread can be started, as at the end of the process, all is done here. If something
    raises, as at Ctrl-C, something is put into `abandoned`, which tells the others.
    """
    left, others, raised = deque(range(parts)), [], []

    def next_part():
        with suppress(IndexError):  # there is none left
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
        while not all(each.done() for each in others):
            try:
                wait(others)
            except BaseException as error:  # Ctrl-C: others still write, and are waited for
                abandoned.append(True)
                raised.append(error)
    for error in raised:
        raise error
    for each in others:
        each.result()


def _pool_of(threads):
    from concurrent.futures import ThreadPoolExecutor  # not at the end of the process

    if threads not in _pools:
        _pools[threads] = ThreadPoolExecutor(threads, "suslov_fast")
    return _pools[threads]


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pools.clear)  # a child has none of these threads
