"""The body, the step size, the starts and the orientation that options describe."""

from __future__ import annotations

import argparse
import re
import stat
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .._bodies.nd import SuslovND
from .._bodies.paper import PICTURES
from .._bodies.three import Suslov3D
from .._checks import FloatArray, rotations, vectors
from .._maps.registry import map_of
from .._runs.replacing import kind_of
from .options import DEFAULT_PICTURE, EXTENT, TRAJECTORIES, body_classes, flag, usage_error
from .work import checking, reading

# The head of a column in a .csv file; "nan" and "inf" are numbers, which are refused as such.
_HEAD = r"(?!(nan|inf|infinity)$)[A-Za-zΩ_][\wΩ ]*"


class Problem(NamedTuple):
    """A body, a step size, and the rotation to the adapted basis if a tensor was given."""

    body: Any
    eps: float
    rotation: FloatArray | None


def problem_of(options: argparse.Namespace, eps_of_pictures: float | None = None) -> Problem:
    """Return the problem that options describe.

    The step size is that of the picture, or `eps_of_pictures`, unless the body is the user's own.
    """
    given = {
        name: getattr(options, name)
        for kind in body_classes()
        for name in kind._names()
        if getattr(options, name) is not None
    }
    tensors = [name for name in ("inertia", "mass_tensor") if getattr(options, name) is not None]
    sources = [*tensors, *(["picture"] if options.picture else [])]
    if len(sources) > 1:
        raise usage_error(f"expected one body, got {flag(sources[0])} and {flag(sources[1])}")
    if options.axis is not None and not tensors:
        raise usage_error("expected --axis only with --inertia or --mass-tensor, got it alone")
    base, rotation = None, None
    if tensors:
        base, rotation = _of_tensor(options, tensors[0])
    elif sources or not given:
        picture = PICTURES[options.picture or DEFAULT_PICTURE]
        base = picture.body
        if options.eps is None:
            options.eps = eps_of_pictures or picture.eps
    body = _of_parameters(base, given)
    if options.eps is None:
        raise usage_error(
            "expected a step size with a body of your own, got none; write --eps 0.1, for example"
        )
    return Problem(body, options.eps, rotation)


def _of_parameters(base: Any, given: dict[str, Any]) -> Any:
    """Return the first body that has the parameters that are given, others being those of a base.

    It has all parameters of the base, but for those that may be left out.
    """
    if not given:
        return base
    needed = given.keys() | (set() if base is None else _required(type(base)))
    values = {**({} if base is None else base._values), **given}
    kinds = [kind for kind in body_classes() if needed <= set(kind._names())]
    if not kinds:
        received = " ".join(flag(name) for name in sorted(needed))
        raise usage_error(f"expected the parameters of one body, got {received}")
    for kind in kinds:
        if _required(kind) <= values.keys():
            own = {name: values[name] for name in kind._names() if name in values}
            with checking("parameters of the body"):
                return kind(**own)
    names = [name for name in kinds[0]._names() if name in _required(kinds[0])]
    wanted = " ".join(map(flag, names))
    missing = " ".join(flag(name) for name in names if name not in values)
    hint = "; --picture N takes them from a picture" if kinds[0] is Suslov3D else ""
    raise usage_error(f"expected all of {wanted}, got no {missing}{hint}")


def _required(kind: Any) -> set[str]:
    return set(kind._names()) - set(kind._optional())


def _of_tensor(options: argparse.Namespace, name: str) -> tuple[Any, FloatArray | None]:
    source = getattr(options, name)
    if isinstance(source, list):
        if len(source) != 6:
            raise usage_error(
                "argument --inertia: expected six entries Ixx,Iyy,Izz,Ixy,Ixz,Iyz or the name of a "
                f".npy or .csv file, got {len(source)} numbers"
            )
        xx, yy, zz, xy, xz, yz = source
        matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        errors = checking("argument --inertia")
    else:
        matrix, errors = read_matrix(source), reading(source)
    with errors:
        if name == "mass_tensor":
            body, rotation = SuslovND.from_mass_tensor(matrix, options.axis)
        else:
            axis = [0.0, 0.0, 1.0] if options.axis is None else options.axis
            body, rotation = Suslov3D.from_inertia(matrix, axis)  # type: ignore[assignment]
    identity = (rotation == np.eye(len(rotation))).all()
    return body, None if identity else rotation


def starts_of(options: argparse.Namespace, body: Any) -> Any:
    """Return the starts: an array, `RandomStarts`, or the name of a .npy file to read in parts."""
    random = [
        name for name in ("trajectories", "seed", "extent") if getattr(options, name) is not None
    ]
    sources = [name for name in ("omega0", "initial") if getattr(options, name) is not None]
    if len(sources + random[:1]) > 1:
        first, second = (sources + random)[:2]
        raise usage_error(f"expected either {flag(first)} or {flag(second)}, got both")
    if options.omega0 is not None:
        return np.array([start_of(row, body) for row in options.omega0])
    if options.initial is not None:
        return options.initial
    from .._ensemble.starts import RandomStarts

    count = options.trajectories or TRAJECTORIES
    return RandomStarts(count, options.extent or EXTENT, options.seed or 0)


def start_of(row: list[float], body: Any) -> list[float]:
    """Return a start with as many components as the body has."""
    names = map_of(body).components(body)
    if len(row) != len(names):
        raise usage_error(
            f"argument --omega0: expected {len(names)} numbers, {', '.join(names)}, got {len(row)}"
        )
    return row


def orientation_of(options: argparse.Namespace, n: int) -> FloatArray | None:
    """Return the orientation at the start, if one is given."""
    source = options.orientation
    if not isinstance(source, list):
        if source is None:
            return None
        with reading(source):
            return rotations("orientation", read_matrix(source), n)
    if len(source) != 3 or n != 3:
        raise usage_error(
            "argument --orientation: expected a rotation vector of three numbers for a "
            f"three-dimensional body, or the name of a .npy or .csv file, got {len(source)} "
            f"numbers for n = {n}"
        )
    from scipy.spatial.transform import Rotation

    matrix: FloatArray = Rotation.from_rotvec(source, degrees=True).as_matrix()
    return matrix


def read_states(path: Path, dimension: int) -> FloatArray:
    """Read angular velocities from a .npy or .csv file, a column for each component."""
    with reading(path):
        table = _read_table(path)
        if not table.size:
            raise ValueError("expected at least one state, got none")
        if table.ndim != 2:
            raise ValueError(f"expected {dimension} columns, got an array of shape {table.shape}")
        return vectors("states", table, dimension)


def read_matrix(path: Path) -> FloatArray:
    """Read a square matrix from a .npy or .csv file."""
    with reading(path):
        table = _read_table(path)
        if table.ndim != 2 or table.shape[0] != table.shape[1]:
            raise ValueError(f"expected an n x n matrix, got an array of shape {table.shape}")
    return table


def _read_table(path: Path) -> FloatArray:
    suffix = path.suffix.lower()
    if suffix not in (".npy", ".csv"):
        raise ValueError(f"expected a .npy or .csv file, got {suffix or 'no suffix'!r}")
    mode = path.stat().st_mode
    if not stat.S_ISREG(mode):
        raise ValueError(f"expected a readable file, got {kind_of(mode)}")
    if suffix == ".npy":
        try:
            table: FloatArray = np.load(path, allow_pickle=False)
            return table
        except OSError:
            raise
        except Exception as error:  # depends on how the file is damaged
            raise ValueError(f"expected a .npy file that numpy.save wrote, got: {error}") from error
    with open(path, encoding="utf-8-sig") as file:  # spreadsheets begin files with a mark
        header = [cell.strip() for cell in file.readline().split(",")]
        if not all(re.fullmatch(_HEAD, cell) for cell in header) or len(header) < 2:
            file.seek(0)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*input contained no data")
            return np.loadtxt(file, delimiter=",", ndmin=2)
