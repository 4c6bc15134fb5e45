"""Files that are on the disk itself, and not only in the memory of the system.

To wait for the disk at every chunk would take longer than to compute it. So a process that computes
by itself notes in the store since which start of its machine it wrote. Who finds the note of
another start reads all that is marked, once, and what a power cut took is computed again. What
replaces a chunk waits, for the old one is whole too; and so do workers, whose machines are unknown.
"""

from __future__ import annotations

import os
from pathlib import Path


def settle(path: Path) -> None:
    """See to it that a file, or the names in a folder, outlive a power cut."""
    if os.name != "posix" and path.is_dir():
        return  # no folder can be opened
    file = os.open(path, os.O_RDONLY if os.name == "posix" else os.O_RDWR)
    try:
        os.fsync(file)
    finally:
        os.close(file)


def settle_folders(folder: Path, root: Path) -> None:
    """The same for the names in a folder, and in those that it is in, up to a root."""
    settle(folder)
    while folder != root:
        folder = folder.parent
        settle(folder)


def settle_all(folder: Path) -> None:
    """The same for all that is in a folder."""
    for path in folder.rglob("*"):
        settle(path)
    settle(folder)


def boot() -> str | None:
    """A name for the time since this machine was started; None where the system has none."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
    except OSError:
        return None
