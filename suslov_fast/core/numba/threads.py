"""Python threads that call machine code in parallel: ctypes releases the GIL during a call.

A call starts its threads and waits for them. None of them outlives it, and no lock is shared with
other calls, so that Ctrl-C at any moment, and a fork, leave nothing behind.
"""

from _thread import allocate_lock, start_new_thread
from collections import deque
from contextlib import suppress


def in_parts(parts, work, abandoned, threads):
    """Call work(part) for part = 0 to parts - 1, on up to `threads` threads, this one included.

    If no other thread can start, as at the end of the process, this one takes all parts. After an
    exception, such as Ctrl-C, the list `abandoned` is not empty, so that `work` can end early.
    """
    left, raised = deque(range(parts)), []
    started, is_over = [], []

    def next_part():
        with suppress(IndexError):  # no part is left
            return left.popleft()

    def take_parts():
        for part in iter(next_part, None):
            work(part)

    def thread():
        lock, has_ended = allocate_lock(), []
        lock.acquire()
        started.append((lock, has_ended))
        try:
            if not is_over:  # else the call waits for no more threads
                take_parts()
        except BaseException as error:
            raised.append(error)
        finally:
            has_ended.append(True)
            lock.release()

    try:
        with suppress(RuntimeError):
            for _ in range(min(parts, threads) - 1):
                start_new_thread(thread, ())
        take_parts()
    except BaseException:
        abandoned.append(True)
        raise
    finally:
        while True:
            try:
                is_over.append(True)
                for lock, has_ended in started:
                    # No `with`: from Python 3.14 on, Ctrl-C can leave its lock acquired.
                    if not has_ended:
                        lock.acquire()
                break
            except BaseException as error:  # as by Ctrl-C; wait again, as threads still write
                abandoned.append(True)
                raised.append(error)
    for error in raised:
        raise error
