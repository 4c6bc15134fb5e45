"""The body, the step size, the starts and the orientation that options describe."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .._bodies.nd import SuslovND
from .._bodies.paper import PICTURES
from .._bodies.three import Suslov3D
from .._checks import FloatArray, rotations, vectors
from .._maps.registry import map_of
from .options import DEFAULT_PICTURE, EXTENT, TRAJECTORIES, UsageError, body_classes, flag
from .work import about


class Problem(NamedTuple):
    """A body, a step size, and the rotation to the adapted basis if a tensor was given."""

    body: Any
    eps: float
    rotation: FloatArray | None


def problem_of(options: argparse.Namespace, eps_of_pictures: float | None = None) -> Problem:
    """Return the problem that options describe.

    The step size is that of the picture, or `eps_of_pictures`, unless the body is the user's own.
    """
    parameters = {
        name: getattr(options, name)
        for kind in body_classes()
        for name in kind._names()
        if getattr(options, name) is not None
    }
    sources = [name for name in ("inertia", "mass_tensor", "picture") if getattr(options, name)]
    if len(sources) > 1:
        raise UsageError(f"expected one body, got {flag(sources[0])} and {flag(sources[1])}")
    if options.axis is not None and sources not in (["inertia"], ["mass_tensor"]):
        raise UsageError("expected --axis only with --inertia or --mass-tensor, got it alone")
    base, rotation, eps = None, None, options.eps
    if sources == ["picture"] or not (sources or parameters):
        picture = PICTURES[options.picture or DEFAULT_PICTURE]
        base, eps = picture.body, eps if eps is not None else eps_of_pictures or picture.eps
    elif sources:
        base, rotation = _of_tensor(options, sources[0])
    body = _with_parameters(base, parameters)
    if eps is None:
        raise UsageError(
            "expected a step size with a body of your own, got none; write --eps 0.1, for example"
        )
    return Problem(body, eps, rotation)


def _with_parameters(base: Any, own: dict[str, Any]) -> Any:
    """Return the first body that has the user's own parameters, others being those of a base."""
    if not own:
        return base
    # A picture with --k is a gyrostat: it has all parameters of the base that may not be left out.
    needed = own.keys() | (set() if base is None else _required(type(base)))
    values = {**({} if base is None else base._values), **own}
    kinds = [kind for kind in body_classes() if needed <= set(kind._names())]
    if not kinds:
        received = " ".join(flag(name) for name in sorted(needed))
        raise UsageError(f"expected the parameters of one body, got {received}")
    for kind in kinds:
        if _required(kind) <= values.keys():
            with about("body", UsageError):
                return kind(**{name: values[name] for name in kind._names() if name in values})
    wanted = [flag(name) for name in kinds[0]._names() if name in _required(kinds[0])]
    missing = [name for name in wanted if name.lstrip("-") not in values]
    hint = "; --picture N takes them from a picture" if kinds[0] is Suslov3D else ""
    raise UsageError(f"expected all of {' '.join(wanted)}, got no {' '.join(missing)}{hint}")


def _required(kind: Any) -> set[str]:
    return set(kind._names()) - set(kind._optional())


def _of_tensor(options: argparse.Namespace, name: str) -> tuple[Any, FloatArray | None]:
    source = getattr(options, name)
    if isinstance(source, Path):
        matrix, errors = _read_matrix(source), about(source)
    elif len(source) == 6:
        xx, yy, zz, xy, xz, yz = source
        matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        errors = about("argument --inertia", UsageError)
    else:
        raise UsageError(
            "argument --inertia: expected six entries Ixx,Iyy,Izz,Ixy,Ixz,Iyz or the name of a "
            f".npy or .csv file, got {len(source)} numbers"
        )
    body: Any
    with errors:
        if name == "mass_tensor":
            body, rotation = SuslovND.from_mass_tensor(matrix, options.axis)
        else:
            body, rotation = Suslov3D.from_inertia(matrix, options.axis or [0.0, 0.0, 1.0])
    return body, None if (rotation == np.eye(len(rotation))).all() else rotation


def starts_of(options: argparse.Namespace, body: Any) -> Any:
    """Return the starts: an array, `RandomStarts`, or the name of a file."""
    sources = ("omega0", "initial", "trajectories", "seed", "extent")
    used = [name for name in sources if getattr(options, name) is not None]
    if len(used) > 1 and used[0] in ("omega0", "initial"):
        raise UsageError(f"expected either {flag(used[0])} or {flag(used[1])}, got both")
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
        raise UsageError(
            f"argument --omega0: expected {len(names)} numbers, {', '.join(names)}, got {len(row)}"
        )
    return row


def orientation_of(options: argparse.Namespace, n: int) -> FloatArray | None:
    """Return the orientation at the start, if one is given."""
    source = options.orientation
    if source is None:
        return None
    if isinstance(source, Path):
        with about(source):
            return rotations("orientation", _read_matrix(source), n)
    if len(source) != 3 or n != 3:
        raise UsageError(
            "argument --orientation: expected a rotation vector of three numbers for a "
            f"three-dimensional body, or the name of a .npy or .csv file, got {len(source)} "
            f"numbers for n = {n}"
        )
    from scipy.spatial.transform import Rotation

    matrix: FloatArray = Rotation.from_rotvec(source, degrees=True).as_matrix()
    return matrix


def read_starts(path: Path, dimension: int) -> FloatArray:
    """Read angular velocities from a .npy or .csv file, a column for each component."""
    with about(path):
        table = vectors("states", np.atleast_2d(_read_table(path)), dimension)
        if not table.size:
            raise ValueError("expected at least one state, got none")
        return table.reshape(-1, dimension)


def _read_matrix(path: Path) -> FloatArray:
    with about(path):
        table = _read_table(path)
        if table.ndim != 2 or table.shape[0] != table.shape[1]:
            raise ValueError(f"expected an n x n matrix, got an array of shape {table.shape}")
        return table


def _read_table(path: Path) -> FloatArray:
    if path.suffix.lower() == ".npy":
        with open(path, "rb") as file:
            array: FloatArray = np.lib.format.read_array(file, allow_pickle=False)
            return array
    # Spreadsheets begin files with a mark.
    rows = [row for row in path.read_text(encoding="utf-8-sig").splitlines() if row.strip()]
    if rows and all(map(_is_name, rows[0].split(","))):
        del rows[0]
    if not rows:
        raise ValueError("expected at least one row of numbers, got none")
    return np.loadtxt(rows, delimiter=",", ndmin=2)


def _is_name(cell: str) -> bool:
    """Return True for the head of a column; "nan" and "inf" are numbers, which are refused."""
    name = cell.strip().replace(" ", "_")
    return name.isidentifier() and name.lower() not in ("nan", "inf", "infinity")
