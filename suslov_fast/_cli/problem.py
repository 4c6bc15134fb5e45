"""Body, step size, initial states and orientation from the options."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from .._bodies.body_3d import Suslov3D
from .._bodies.body_nd import SuslovND
from .._bodies.paper import PICTURES
from .._checks import FloatArray, inertia_matrix, rotations, vectors, wrong
from .._maps.registry import body_from_dict, map_of
from .flags import DEFAULT_PICTURE, ENTRIES, EXTENT, TRAJECTORIES, UsageError, body_classes, flag
from .terminal import about, require_file


def problem_of(
    options: argparse.Namespace, eps_of_pictures: float | None = None
) -> tuple[Any, float, FloatArray | None]:
    """Return the body, the step size, and the rotation to the adapted basis of a tensor.

    The default step size is that of the picture, or `eps_of_pictures`; other bodies have none.
    """
    names = {name for kind in body_classes() for name in kind._names()}
    given = {name: value for name in names if (value := getattr(options, name)) is not None}
    kinds_of_source = "body", "inertia", "mass_tensor", "picture"
    sources = [name for name in kinds_of_source if getattr(options, name)]
    if len(sources) > 1:
        raise UsageError(f"expected one body, got {flag(sources[0])} and {flag(sources[1])}")
    if options.axis is not None and sources not in (["inertia"], ["mass_tensor"]):
        raise UsageError("expected --axis only with --inertia or --mass-tensor, got it alone")
    body, rotation, eps = None, None, options.eps
    if sources == ["body"]:
        body = _of_file(options.body)
    elif sources == ["picture"] or not (sources or given):
        picture = PICTURES[int(options.picture or DEFAULT_PICTURE)]
        body, eps = picture.body, eps if eps is not None else eps_of_pictures or picture.eps
    elif sources:
        body, rotation = _of_tensor(options)
    if given:
        body = _with_parameters(body, given)
    if eps is None:
        expected = "expected a step size with a body of your own"
        raise UsageError(f"{expected}, got none; write --eps 0.1, for example")
    return body, eps, rotation


def _of_file(path: Path) -> Any:
    """Return the body whose dictionary is in a JSON file."""
    require_file(path)
    with about(path):
        try:
            described = json.loads(path.read_text(encoding="utf-8-sig"))
        except (json.JSONDecodeError, RecursionError) as error:
            raise ValueError(
                f"expected JSON, as body.to_dict() describes a body: {error}"
            ) from error
        return body_from_dict(described)


def _with_parameters(base: Any, given: dict[str, list[float]]) -> Any:
    """Return the first body that has the given parameters; the others are those of a base."""
    # A picture with --k is a gyrostat: the base provides its other required parameters.
    needed, values = {*given}, dict.fromkeys(given)
    if base is not None:
        needed, values = needed | _required(type(base)), base._values | values
    kinds = [kind for kind in body_classes() if needed <= set(kind._names())]
    if not kinds:
        received = " ".join(flag(name) for name in sorted(needed))
        raise UsageError(f"expected the parameters of one body, got {received}")
    for kind in kinds:
        if _required(kind) <= values.keys():
            numbers = {name: _as_parameter(kind, name, each) for name, each in given.items()}
            values = {name: value for name, value in values.items() if name in kind._names()}
            with about("body"):
                return kind(**(values | numbers))
    for name, value in given.items():  # a wrong value first: it stays wrong with the others
        if name not in kinds[0]._couplings and not min(value) > 0:
            expected = f"expected a positive {kinds[0]._meanings[name]}"
            raise UsageError(f"body: {name}: {expected}, got {min(value)}")
    wanted = [name for name in kinds[0]._names() if name in _required(kinds[0])]
    missing = " ".join(flag(name) for name in wanted if name not in values)
    hint = "; --picture N takes them from a picture" if kinds[0] is Suslov3D else ""
    raise UsageError(f"expected all of {' '.join(map(flag, wanted))}, got no {missing}{hint}")


def _as_parameter(kind: Any, name: str, value: list[float]) -> float | list[float]:
    """Return one number, or a list if the parameter of this body is a vector."""
    if kind._axes(name):
        return value
    if len(value) > 1:
        raise UsageError(f"argument {flag(name)}: expected one number, got {len(value)}")
    return value[0]


def _required(kind: Any) -> set[str]:
    return set(kind._names()) - set(kind._optional())


def _of_tensor(options: argparse.Namespace) -> tuple[Any, FloatArray | None]:
    source = options.inertia or options.mass_tensor
    in_file = isinstance(source, Path)
    build: Any = SuslovND.from_mass_tensor if options.mass_tensor else Suslov3D.from_inertia
    with about(source if in_file else "argument --inertia"):
        tensor = read_table(source) if in_file else _symmetric(source)
        tensor = inertia_matrix("I", tensor)  # a single one
        body, rotation = build(tensor, None if options.mass_tensor else [0.0, 0.0, 1.0])
    if options.axis is not None:
        with about("argument --axis"):
            body, rotation = build(tensor, options.axis)
    return body, None if (rotation == np.eye(len(rotation))).all() else rotation


def _symmetric(entries: list[float]) -> FloatArray:
    if len(entries) != 6:
        expected = f"six entries {ENTRIES} or the name of a .npy or .csv file"
        raise ValueError(f"expected {expected}, got {len(entries)} numbers")
    xx, yy, zz, xy, xz, yz = entries
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def starts_of(options: argparse.Namespace, body: Any, in_store: bool) -> Any:
    """Return the initial states: an array, memory-mapped for a store, or `RandomStarts`."""
    dimension, components = body.dimension, map_of(body).components(body)
    sources = ("omega0", "initial", "trajectories", "seed", "extent")
    used = [name for name in sources if getattr(options, name) is not None]
    if len(used) > 1 and used[0] in ("omega0", "initial"):
        raise UsageError(f"expected either {flag(used[0])} or {flag(used[1])}, got both")
    if options.omega0 is not None:
        return np.array([start_of(row, dimension) for row in options.omega0])
    if options.initial is not None:
        with about(options.initial):
            table = np.atleast_2d(read_table(options.initial, components))
            return table if in_store else vectors("states", table, dimension, allow_nan=True)
    from .._ensemble.starts import RandomStarts

    count, extent = options.trajectories or TRAJECTORIES, options.extent
    with about("argument --extent"):
        return RandomStarts(count, EXTENT if extent is None else extent, options.seed or 0)


def start_of(row: list[float], dimension: int) -> list[float]:
    """Return an initial state with the number of components of the body."""
    if len(row) != dimension:
        raise UsageError(f"argument --omega0: expected {dimension} numbers, got {len(row)}")
    return row


def orientation_of(options: argparse.Namespace, n: int) -> FloatArray | None:
    """Return the initial orientation, if one is given."""
    source = options.orientation
    if source is None:
        return None
    if isinstance(source, Path):
        with about(source):
            return rotations("orientation", read_table(source), n)
    from scipy.spatial.transform import Rotation

    with about("argument --orientation"):
        vector = vectors("rotation vector", source, 3)
        return rotations("orientation", Rotation.from_rotvec(vector, degrees=True).as_matrix(), n)


def read_table(path: Path, components: tuple[str, ...] = ()) -> FloatArray:
    """Return the numbers in a .npy file, memory-mapped, or in a .csv file.

    With `components`, the names of columns must be these.
    """
    require_file(path)
    if path.suffix.lower() == ".npy":
        array: FloatArray = np.load(path, mmap_mode="r", allow_pickle=False)
        return array
    # Spreadsheets begin files with a byte order mark, and columns with a name.
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    rows = {k + 1: line for k, line in enumerate(lines) if line.strip()}
    first = min(rows, default=0)
    header = rows.get(first, "")
    if "," in header:
        header = header.removeprefix("#")  # which NumPy writes
    if all(map(_is_name, header.split(","))):
        rows.pop(first, None)
        expected = ",".join(components)
        if components and "".join(header.split()).lower() != expected.lower():
            raise wrong("header", f"{expected} or none", header.strip())
    rows = {number: line for number, line in rows.items() if not line.lstrip().startswith("#")}
    if not rows:
        raise ValueError("expected at least one row of numbers, got none")
    try:
        table = np.loadtxt([*rows.values()], delimiter=",", ndmin=2)
    except ValueError:
        table = np.array([[np.inf]])
    return table if not np.isinf(table).any() else _row_by_row(rows)


def _row_by_row(rows: dict[int, str]) -> FloatArray:
    """Return the numbers of a table; ValueError with the number of the line that is wrong."""
    table: list[list[float]] = []
    for number, line in rows.items():
        cells = line.partition("#")[0].split(",")
        try:
            table.append([float(cell) for cell in cells])
        except ValueError:
            raise wrong(f"line {number}", "numbers separated by commas", repr(line)) from None
        if len(cells) != len(table[0]):
            raise wrong(f"line {number}", f"{len(table[0])} numbers as above", len(cells))
        if np.isinf(table[-1]).any():
            raise wrong(f"line {number}", "finite numbers", repr(line))
    return np.array(table)


def _is_name(cell: str) -> bool:
    """Return True for the head of a column; "nan" and "inf" are numbers, which raise errors."""
    name = cell.strip().replace(" ", "_")
    return name.isidentifier() and name.lower() not in ("nan", "inf", "infinity")
