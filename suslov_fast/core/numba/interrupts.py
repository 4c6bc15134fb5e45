"""Blocks that Ctrl-C must not leave half done."""

import signal
from contextlib import contextmanager


@contextmanager
def uninterrupted():
    """Delay Ctrl-C to the end of a block that must not be left half done, such as an import."""
    handler, pending = signal.getsignal(signal.SIGINT), []  # None if C code set it: not restorable
    try:
        if handler is not None:
            signal.signal(signal.SIGINT, lambda *event: pending.append(event))
    except ValueError:  # not the main thread, the only one that Ctrl-C interrupts
        handler = None
    try:
        yield
    finally:
        if handler is not None:
            signal.signal(signal.SIGINT, handler)
        if pending:
            signal.raise_signal(signal.SIGINT)
