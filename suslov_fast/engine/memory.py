"""Test of the free memory of the machine before a computation.

Linux lends more memory than it has, and kills a process that uses too much.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

# Requests up to this many bytes are not tested, for speed; as many bytes are kept free.
SMALL = 2**26


def require(nbytes: int, what_to_do: str) -> None:
    """Raise MemoryError if `nbytes` are not available."""
    if nbytes <= SMALL:
        return
    free = available()
    if free is not None and nbytes > free - SMALL:
        raise MemoryError(
            f"expected arrays that fit in memory, of which {free:,} bytes are available, "
            f"got {nbytes:,} bytes; {what_to_do}"
        )


def available() -> int | None:
    """Return the number of bytes that the machine has available; None if unknown."""
    with suppress(OSError, ValueError):
        for line in Path("/proc/meminfo").read_text("ascii", "replace").splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    return None
