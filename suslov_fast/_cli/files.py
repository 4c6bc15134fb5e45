"""Reading and writing the files of the command line."""

from __future__ import annotations

import argparse
import os
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np

from .._bodies.nd import SuslovND
from .._checks import FloatArray, vectors
from .errors import UserError

# What the head of a column may be; "nan" and "inf" are numbers, and rejected as such.
_NAME = r"(?!(nan|inf|infinity)$)[A-Za-zΩ_][\wΩ ]*"


def output_file(text: str) -> Path:
    """Read the name of a .npz file."""
    if not text.endswith(".npz"):
        raise argparse.ArgumentTypeError(f"expected the name of a .npz file, got {text!r}")
    return Path(text)


@contextmanager
def written_whole(path: Path) -> Iterator[BinaryIO]:
    """A file that appears under its name once it is complete, and not at all otherwise.

    It is opened, beside its place, before any work is done: a path that cannot be written to is
    found out at once.
    """
    if path.exists() and not path.is_file():
        raise UserError(f"{path}: expected the name of a file to write, got something else")
    path = path.resolve()  # a link stays, and what it points to is replaced
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        file = open(beside, "xb")  # noqa: SIM115
    except OSError as error:
        raise UserError(
            f"{path}: expected a name in a folder that can be written to, got: {error.strerror}"
        ) from error
    try:
        with file:
            yield file
        os.replace(beside, path)
    except OSError as error:
        raise UserError(f"{path}: could not be written: {error.strerror or error}") from error
    finally:
        beside.unlink(missing_ok=True)


def read_states(path: Path, dimension: int) -> FloatArray:
    """Angular velocities from a .npy or .csv file, a column for each component."""
    table = _read_table(path)
    with _named(path):
        if not table.size:
            raise ValueError("expected at least one state, got none")
        if table.ndim != 2:
            raise ValueError(f"expected {dimension} columns, got an array of shape {table.shape}")
        return vectors("states", table, dimension)


def read_body(path: Path) -> SuslovND:
    """The body with an inertia matrix from a .npy or .csv file."""
    table = _read_table(path)
    with _named(path):
        return SuslovND.from_mass_tensor(table)[0]


def _read_table(path: Path) -> FloatArray:
    readers = {".npy": _read_npy, ".csv": _read_csv}
    if path.suffix.lower() not in readers:
        raise UserError(f"{path}: expected a .npy or .csv file, got {path.suffix or 'no suffix'!r}")
    with _named(path):
        return readers[path.suffix.lower()](path)


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Errors of a file, with its name."""
    try:
        yield
    except OSError as error:
        raise UserError(f"{path}: expected a readable file, got: {error.strerror}") from error
    except (ValueError, TypeError, EOFError) as error:
        raise UserError(f"{path}: {error}") from error


def _read_npy(path: Path) -> FloatArray:
    with open(path, "rb") as file:
        if file.read(6) != b"\x93NUMPY":
            raise ValueError("expected a .npy file as numpy.save writes it, got something else")
    try:
        table: FloatArray = np.load(path, allow_pickle=False)
    except OSError:
        raise
    except Exception as error:  # NumPy's reader raises what a damaged header makes it
        raise ValueError(f"expected a .npy file as numpy.save writes it, got: {error}") from error
    return table


def _read_csv(path: Path) -> FloatArray:
    with open(path, encoding="utf-8-sig") as file:  # spreadsheets begin files with a mark
        header = [cell.strip() for cell in file.readline().split(",")]
        if not all(re.fullmatch(_NAME, cell) for cell in header) or len(header) < 2:
            file.seek(0)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*input contained no data")
            return np.loadtxt(file, delimiter=",", ndmin=2)
