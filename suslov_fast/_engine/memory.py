"""Refuse, before any work, what does not fit in the memory that is available.

Linux grants more memory than there is, and ends a process that uses it. What is available is the
least of what the machine and the control groups around this process leave.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path, PurePosixPath

# Needs up to this many bytes are not looked at, so that small calls cost nothing; as much is left.
SMALL = 2**26
_GROUPS = "/sys/fs/cgroup"

# A file's text; OSError where there is none.
Reader = Callable[[str], str]


def require(nbytes: int, what_to_do: str, *shown: object) -> None:
    """Raise a MemoryError if so many bytes are not available; `what_to_do` is a format."""
    if nbytes <= SMALL:
        return
    room = available()
    if room is not None and nbytes > room - SMALL:
        raise MemoryError(
            f"expected arrays that fit in memory, of which {room:,} bytes are available, "
            f"got {nbytes:,} bytes; {what_to_do.format(*shown)}"
        )


def available(read: Reader | None = None) -> int | None:
    """Return the bytes that this process can still use; None where the system does not tell."""
    found = list(_left(read or (lambda path: Path(path).read_text("ascii", "replace"))))
    return max(min(found), 0) if found else None


def _left(read: Reader) -> Iterator[int]:
    """Yield what the machine leaves, and each control group (version 2) of this process."""
    with suppress(OSError, KeyError):
        yield int(_table(read("/proc/meminfo"))["MemAvailable:"]) * 1024
    with suppress(OSError, KeyError):
        path = PurePosixPath(_GROUPS + _table(read("/proc/self/cgroup"), "::")["0"])
        # In a container the path may be that outside of it: then only the root is there.
        while path.is_relative_to(_GROUPS):
            with suppress(OSError, KeyError, ValueError):  # no such folder, or no limit: "max"
                cached = int(_table(read(f"{path}/memory.stat"))["inactive_file"])
                used = int(read(f"{path}/memory.current")) - cached
                yield int(read(f"{path}/memory.max")) - used
            path = path.parent


def _table(text: str, separator: str | None = None) -> dict[str, str]:
    """Return the second word of each line by the first."""
    rows = (line.split(separator) for line in text.splitlines())
    return {row[0]: row[1] for row in rows if len(row) > 1}
