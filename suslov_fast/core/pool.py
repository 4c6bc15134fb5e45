"""Threads of Python for machine code that is called through ctypes, which lets others run."""

import os
from concurrent.futures import ThreadPoolExecutor, wait

_pools = {}  # by their numbers of threads


def in_parts(parts, work, abandoned):
    """Call work(part) for all parts at once: the last one here, the others in threads.

    If that raises, as at Ctrl-C, something is put into `abandoned`, which tells the others.
    """
    if parts not in _pools:
        # One thread if parts is 1, as after `numba.set_num_threads(1)`; it is never started.
        _pools[parts] = ThreadPoolExecutor(max(parts - 1, 1), "suslov_fast")
    others = [_pools[parts].submit(work, part) for part in range(parts - 1)]
    try:
        work(parts - 1)
    except BaseException:
        abandoned.append(True)
        raise
    finally:
        wait(others)  # before anybody uses what they write to
    for each in others:
        each.result()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pools.clear)  # a child has none of these threads
