"""Files that are on the disk itself, and not only in the memory of the system."""

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
