"""Locks that a fork waits for, because its child lacks the threads that hold them.

The child would wait for such a lock forever, or find code that is half compiled.
"""

import _thread
import concurrent.futures.thread  # noqa: F401  (see below)
import logging  # noqa: F401
import os
import signal
import sys
import threading
import time

# The first two are imported for their own hooks: if they came while a fork waits, Python would call
# the second half of them alone, and print an error.

# Seconds to wait for a lock, which is more than compiling takes. A thread that holds it may itself
# wait for the thread that forks, for example for a module that this thread is importing.
LONGEST = 60.0
_interrupts = []  # a Ctrl-C while a fork waited


def _interrupt():
    """Send Ctrl-C to this process, when all hooks have returned."""
    time.sleep(0.02)
    os.kill(os.getpid(), signal.SIGINT)


def wait_at_forks(owner, name):
    """Let forks wait for the reentrant lock `owner.name`.

    Where they wait in vain, a child gets a new lock. Python prints an exception of a hook, and
    forks; so Ctrl-C ends the wait, and is raised after the fork.
    """

    def wait():
        try:
            getattr(owner, name).acquire(timeout=0.0 if _interrupts else LONGEST)
        except KeyboardInterrupt:
            _interrupts.append(True)

    def go_on():
        if _interrupts:
            _interrupts.clear()
            _thread.start_new_thread(_interrupt, ())
        if is_held := getattr(owner, name)._is_owned():
            getattr(owner, name).release()
        return is_held

    def go_on_in_child():
        if not go_on():
            setattr(owner, name, threading.RLock())

    if hasattr(os, "register_at_fork"):
        os.register_at_fork(before=wait, after_in_parent=go_on, after_in_child=go_on_in_child)


importing = threading.RLock()  # while a module of the package is imported
wait_at_forks(sys.modules[__name__], "importing")
