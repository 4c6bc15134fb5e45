"""Reading and writing the files of the command line."""

from __future__ import annotations

import argparse
import os
import re
import stat
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np

from .._checks import FloatArray, vectors
from .._runs.files import engine_of, place_for, suffix_of
from .._runs.replacing import kind_of, replacing
from .._runs.schema import entries_of
from .._runs.trajectories import Trajectories
from .errors import UserError

# What the head of a column may be; "nan" and "inf" are numbers, and rejected as such.
_NAME = r"(?!(nan|inf|infinity)$)[A-Za-zΩ_][\wΩ ]*"


def result_file(text: str) -> Path:
    """Read the name of a file that holds a run."""
    try:
        engine_of(suffix_of(text))
    except ValueError as error:
        raise argparse.ArgumentTypeError(
            f"expected the name of a .npz, .nc or .zarr file, got {text!r}"
        ) from error
    except ImportError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return Path(text)


@contextmanager
def place(path: Path | None) -> Iterator[Callable[[Trajectories], None]]:
    """A function that saves a run, whole or not at all; without a path it does nothing."""
    if path is None:
        yield lambda trajectories: None
        return
    with _writing(path), place_for(path) as put:
        yield lambda trajectories: put(entries_of(vars(trajectories)))


@contextmanager
def written_whole(path: Path) -> Iterator[BinaryIO]:
    """A file that appears under its name once it is complete, and not at all otherwise."""
    with _writing(path), replacing(path) as new, open(new, "wb") as file:
        yield file


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        if not reason.startswith(("expected", "could not")):
            reason = f"could not be written: {reason}"
        raise UserError(f"{path}: {reason}") from error


def load(path: Path) -> Trajectories:
    """The run in a file."""
    try:
        return Trajectories.load(path)
    except ValueError as error:
        raise UserError(str(error)) from error
    except OSError as error:
        reason = error.strerror or str(error)
        raise UserError(f"{path}: expected a readable file, got: {reason}") from error


def read_states(path: Path, dimension: int) -> FloatArray:
    """Angular velocities from a .npy or .csv file, a column for each component."""
    table = _read_table(path)
    with named(path):
        if not table.size:
            raise ValueError("expected at least one state, got none")
        if table.ndim != 2:
            raise ValueError(f"expected {dimension} columns, got an array of shape {table.shape}")
        return vectors("states", table, dimension)


def read_matrix(path: Path) -> FloatArray:
    """A square matrix from a .npy or .csv file."""
    table = _read_table(path)
    with named(path):
        if table.ndim != 2 or table.shape[0] != table.shape[1]:
            raise ValueError(f"expected an n x n matrix, got an array of shape {table.shape}")
    return table


@contextmanager
def named(path: Path) -> Iterator[None]:
    """Errors of what a file holds, with its name."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise UserError(f"{path}: expected a readable file, got: {reason}") from error
    except (ValueError, TypeError, EOFError) as error:
        raise UserError(f"{path}: {error}") from error


def _read_table(path: Path) -> FloatArray:
    readers = {".npy": _read_npy, ".csv": _read_csv}
    if path.suffix.lower() not in readers:
        raise UserError(f"{path}: expected a .npy or .csv file, got {path.suffix or 'no suffix'!r}")
    with named(path):
        mode = os.stat(path).st_mode
        if not stat.S_ISREG(mode):
            raise ValueError(f"expected a readable file, got {kind_of(mode)}")
        return readers[path.suffix.lower()](path)


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
