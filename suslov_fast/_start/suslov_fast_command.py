"""The entry point of the command `suslov-fast`, outside the package.

Importing the package takes longer than many a run, and a Ctrl-C meanwhile deserves no traceback.
"""

import os
import signal
import sys
from types import FrameType
from typing import NoReturn


def main() -> NoReturn:
    """Import the command and run it."""
    before = signal.signal(signal.SIGINT, _stop)
    from suslov_fast._cli import main as command

    signal.signal(signal.SIGINT, before)
    command()


def _stop(number: int, frame: FrameType | None) -> NoReturn:
    """End at once: an exception could be dropped in a callback of what is being imported."""
    sys.stderr.write("suslov-fast: interrupted\n")
    sys.stderr.flush()
    os._exit(130)
