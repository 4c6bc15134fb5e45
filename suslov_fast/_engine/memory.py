"""Test of available memory before a computation.

Linux overcommits memory, and kills a process that uses too much. The available memory is the least
of what the machine and the control groups of this process leave.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path, PurePosixPath

# Requests up to this many bytes are not tested, for speed; as many bytes are kept free.
SMALL = 2**26
_GROUPS = "/sys/fs/cgroup"


def require(nbytes: int, what_to_do: str, *values: object) -> None:
    """Raise MemoryError if `nbytes` are not available; `what_to_do` is a format string."""
    if nbytes <= SMALL:
        return
    free = available()
    if free is not None and nbytes > free - SMALL:
        raise MemoryError(
            f"expected arrays that fit in memory, of which {free:,} bytes are available, "
            f"got {nbytes:,} bytes; {what_to_do.format(*values)}"
        )


def available() -> int | None:
    """Return the number of bytes that this process can still use; None if unknown."""
    found = list(_free())
    return max(min(found), 0) if found else None


def _free() -> Iterator[int]:
    """Yield the free bytes of the machine and of each control group (version 2) of this process."""
    with suppress(OSError, KeyError):
        yield int(_table("/proc/meminfo")["MemAvailable:"]) * 1024
    with suppress(OSError, KeyError):
        path = PurePosixPath(_GROUPS + _table("/proc/self/cgroup", "::")["0"])
        # In a container the path may be that outside: then only the root exists.
        while path.is_relative_to(_GROUPS):
            with suppress(OSError, KeyError, ValueError):  # no such folder, or no limit: "max"
                cached = int(_table(f"{path}/memory.stat")["inactive_file"])
                used = int(_content(f"{path}/memory.current")) - cached
                yield int(_content(f"{path}/memory.max")) - used
            path = path.parent


def _content(path: str) -> str:
    return Path(path).read_text("ascii", "replace")


def _table(path: str, separator: str | None = None) -> dict[str, str]:
    """Return the second word of each line of a file by the first."""
    rows = (line.split(separator) for line in _content(path).splitlines())
    return {row[0]: row[1] for row in rows if len(row) > 1}
