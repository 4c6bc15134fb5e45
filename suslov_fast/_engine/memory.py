"""Refuse, before any work, what does not fit in the memory that is available.

Linux grants more memory than there is, and ends a process that uses it. What is available is
the least of what the machine, each control group above this process, and its own limits leave.
Where none of these is known, an allocation itself must tell.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path, PurePosixPath

# Less is neither looked at, so that small calls cost nothing, nor left to be used up.
SMALL = 2**26

# A file's text; OSError where there is none.
Reader = Callable[[str], str]
# The soft limit of a resource, such as "RLIMIT_AS", in bytes; None where there is none.
Limit = Callable[[str], int | None]


def require(nbytes: int, what_to_do: str, *shown: object) -> None:
    """Raise a MemoryError, which says what to do, if so many bytes more are not available.

    `what_to_do` is a format, of what is `shown`.
    """
    if nbytes <= SMALL:
        return
    room = available()
    if room is not None and nbytes > room - SMALL:
        raise MemoryError(
            f"expected arrays that fit in memory, of which {room:,} bytes are available, "
            f"got {nbytes:,} bytes; {what_to_do.format(*shown)}"
        )


def available(read: Reader | None = None, limit: Limit | None = None) -> int | None:
    """Bytes that this process can still use; None where the system does not tell."""
    read, limit = read or _read, limit or _limit
    found = [*_machine(read), *_control_groups(read), *_own_limits(read, limit)]
    return max(min(found), 0) if found else None


def _machine(read: Reader) -> Iterator[int]:
    with suppress(OSError, KeyError):
        yield _kilobytes(read("/proc/meminfo"), "MemAvailable")


def _own_limits(read: Reader, limit: Limit) -> Iterator[int]:
    """Address space, which counts what is only reserved, and data."""
    for name, used in (("RLIMIT_AS", "VmSize"), ("RLIMIT_DATA", "VmData")):
        bound = limit(name)
        if bound is not None:
            with suppress(OSError, KeyError):
                yield bound - _kilobytes(read("/proc/self/status"), used)


def _control_groups(read: Reader) -> Iterator[int]:
    """What the groups of this process, and those around them, leave, in both versions."""
    try:
        lines = read("/proc/self/cgroup").splitlines()
    except OSError:
        return
    for line in lines:
        _, controllers, group = line.split(":", 2)
        if not controllers:
            root, files = "/sys/fs/cgroup", ("memory.max", "memory.current", "inactive_file")
        elif "memory" in controllers.split(","):
            root = "/sys/fs/cgroup/memory"
            files = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
        else:
            continue
        # In a container the path may be that outside of it: then only the root is there.
        path = PurePosixPath(root + group)
        while path.is_relative_to(root):
            with suppress(OSError, KeyError, ValueError):  # no such folder, or no limit: "max"
                yield _left(read, str(path), *files)
            path = path.parent


def _left(read: Reader, folder: str, limit: str, used: str, cached: str) -> int:
    """What a group may still use; copies of files make room when others need it."""
    bound = int(read(f"{folder}/{limit}"))
    counts = dict(line.split() for line in read(f"{folder}/memory.stat").splitlines())
    return bound - int(read(f"{folder}/{used}")) + int(counts[cached])


def _kilobytes(text: str, key: str) -> int:
    for line in text.splitlines():
        name, _, value = line.partition(":")
        if name == key:
            return int(value.split()[0]) * 1024
    raise KeyError(key)


def _read(path: str) -> str:
    return Path(path).read_text(encoding="ascii", errors="replace")


def _limit(name: str) -> int | None:
    try:
        import resource
    except ImportError:
        return None
    number = getattr(resource, name, None)
    if number is None:
        return None
    soft, _ = resource.getrlimit(number)
    return None if soft == resource.RLIM_INFINITY else soft
