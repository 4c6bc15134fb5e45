"""Body, step size, initial states and orientation from the options."""

from __future__ import annotations

import argparse
import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np

from .._bodies.body_3d import Suslov3D
from .._bodies.body_nd import SuslovND
from .._bodies.paper import PICTURES
from .._checks import FloatArray, inertia_matrix, wrong
from .._engine.random_starts import RandomStarts
from .._ensemble.starts import open_npy
from .._maps import body_from_dict, map_of
from .flags import DEFAULT_PICTURE, ENTRIES, EXTENT, TRAJECTORIES, UsageError, body_classes, flag
from .terminal import about


def body_and_step_of(options: argparse.Namespace) -> tuple[Any, float, FloatArray | None]:
    """Return the body, with the first values of sweeps, the step size, and a tensor's rotation."""
    names = {name for kind in body_classes() for name in kind._names()}
    given = {name: value for name in sorted(names) if (value := getattr(options, name)) is not None}
    swept = {name: low for name, low, *_ in getattr(options, "sweep", [])}
    if len(swept) < len(getattr(options, "sweep", [])):
        raise UsageError("argument --sweep: expected each name once, got one twice")
    if twice := swept.keys() & {*given, *(["eps"] if options.eps is not None else [])}:
        raise UsageError(f"argument --sweep: expected {twice.pop()} given once, got it twice")
    if options.axis is not None and not (options.inertia or options.mass_tensor):
        raise UsageError("expected --axis only with --inertia or --mass-tensor, got it alone")
    body, rotation, eps = None, None, options.eps if options.eps is not None else swept.get("eps")
    if options.body:
        body = read_body(options.body)
    elif options.inertia or options.mass_tensor:
        body, rotation = _of_tensor(options)
    elif options.picture or not given:
        picture = PICTURES[int(options.picture or DEFAULT_PICTURE)]
        body, eps = picture.body, picture.eps if eps is None else eps
    names -= body._coordinates.keys() if body is not None else set()
    given |= {name: low for name, low in swept.items() if name in names}
    if given:
        body = _with_parameters(body, given)
    if eps is None:
        expected = "expected a step size with a body of your own"
        raise UsageError(f"{expected}, got none; write --eps 0.1, for example")
    return body, eps, rotation


def read_body(path: Path) -> Any:
    """Return the body or field in a file of JSON."""
    with about(path):
        try:
            return body_from_dict(json.loads(_text_in(path)))
        except json.JSONDecodeError as error:
            received = f"an error in line {error.lineno}, column {error.colno}"
            expected = "expected JSON, as json.dumps(body.to_dict())"
            raise ValueError(f"{expected}, got {received}") from error


def _text_in(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")  # spreadsheets write a byte order mark
    except UnicodeDecodeError as error:
        raise ValueError(f"expected text in UTF-8, got another byte at {error.start}") from error


def _with_parameters(base: Any, given: dict[str, Any]) -> Any:
    """Return the first body that has the given parameters and those of a base, if any."""
    if base is not None and type(base) not in body_classes():
        words = " ".join(map(flag, given))
        raise UsageError(f"argument {words}: expected none beside a {type(base).__name__}")
    values: dict[str, Any] = (base._values if base is not None else {}) | given
    having = [kind for kind in body_classes() if values.keys() <= {*kind._names()}]
    if not having:
        known = " or ".join(" ".join(map(flag, kind._required())) for kind in body_classes())
        received = " ".join(map(flag, values))
        raise UsageError(f"expected the parameters of one body, {known}, got {received}")
    # A picture with --k is a gyrostat.
    complete = [kind for kind in having if {*kind._required()} <= values.keys()]
    if not complete:
        missing = [flag(name) for name in having[0]._required() if name not in values]
        hint = f"those of {having[0].__name__}, missing: {' '.join(missing)}"
        if not having[0]._vector_axes:
            words = " ".join(f"{flag(name)} {value:g}" for name, value in given.items())
            hint += f"; or change a picture: --picture {DEFAULT_PICTURE} {words}"
        raise UsageError(f"expected all parameters of a body, {hint}")
    with about("body"):
        return complete[0](**values)


def _of_tensor(options: argparse.Namespace) -> tuple[Any, FloatArray | None]:
    source = options.inertia or options.mass_tensor
    build: Any = Suslov3D.from_inertia if options.inertia else SuslovND.from_mass_tensor
    name = "argument --inertia" if options.inertia else "argument --mass-tensor"
    with about(source if isinstance(source, Path) else name):
        tensor = read_table(source) if isinstance(source, Path) else _matrix_of_entries(source)
        tensor = inertia_matrix("I", tensor)  # a single one
        if options.axis and (len(options.axis) != len(tensor) or not any(options.axis)):
            expected = f"expected {len(tensor)} numbers other than 0,...,0"
            raise UsageError(f"argument --axis: {expected}, got {options.axis}")
        body, rotation = build(tensor, options.axis or np.eye(len(tensor))[-1])
    return body, None if (rotation == np.eye(len(rotation))).all() else rotation


def _matrix_of_entries(entries: list[float]) -> FloatArray:
    if len(entries) != 6:
        expected = f"six entries {ENTRIES} or the name of a .npy or .csv file"
        raise ValueError(f"expected {expected}, got {len(entries)} numbers")
    xx, yy, zz, xy, xz, yz = entries
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def starts_of(options: argparse.Namespace, body: Any) -> Any:
    """Return the initial states: lists, an array, memory-mapped from a .npy, or `RandomStarts`."""
    sources = ("omega0", "initial", "trajectories", "seed", "extent")
    used = [name for name in sources if getattr(options, name) is not None]
    if len(used) > 1 and used[0] in ("omega0", "initial"):
        raise UsageError(f"expected either {flag(used[0])} or {flag(used[1])}, got both")
    components = map_of(body).components(body)
    for state in options.omega0 or ():
        if len(state) != len(components):
            expected = f"expected the {len(components)} numbers {','.join(components)}"
            raise UsageError(f"argument --omega0: {expected}, got {len(state)}")
    if options.omega0 is not None:
        return options.omega0
    if options.initial is not None:
        return read_table(options.initial, components)
    count, extent = options.trajectories or TRAJECTORIES, options.extent
    return RandomStarts(count, EXTENT if extent is None else extent, options.seed or 0)


def orientation_of(options: argparse.Namespace) -> FloatArray | None:
    source = options.orientation
    if source is None:
        return None
    if isinstance(source, Path):
        return read_table(source)
    from scipy.spatial.transform import Rotation

    if len(source) != 3:
        raise UsageError(f"argument --orientation: expected three numbers, got {len(source)}")
    matrix: FloatArray = Rotation.from_rotvec(source, degrees=True).as_matrix()
    return matrix


def read_table(path: Path, components: tuple[str, ...] = ()) -> FloatArray:
    """Return the numbers in a .npy, memory-mapped, or a .csv; a header must be `components`."""
    with about(path):
        if path.suffix.lower() == ".npy":
            array: FloatArray = np.atleast_2d(open_npy(path))
            if array.dtype.kind not in "iuf":
                raise ValueError(f"expected real numbers, got an array of {array.dtype}")
            if components and array.shape[-1] != len(components):
                columns = f"the {len(components)} columns {','.join(components)}"
                raise ValueError(f"expected {columns}, got an array of shape {array.shape}")
            return array
        lines = [*enumerate(_text_in(path).splitlines(), start=1)]
        lines = [(number, line) for number, line in lines if line.strip()]
        expected, first = ",".join(components).lower(), lines[0][1] if lines else ""
        header = re.sub(r"[#\s]", "", first).lower()  # NumPy writes names after a #
        if components and sorted(header.split(",")) == sorted(expected.split(",")):
            if header != expected:
                raise wrong("header", f"{','.join(components)} or none", first)
            del lines[0]
        rows = [(number, line) for number, line in lines if not line.lstrip().startswith("#")]
        if not rows:
            raise ValueError("expected at least one row of numbers, got none")
        width = len(components) or rows[0][1].count(",") + 1
        return np.array([_numbers_in(line, number, width) for number, line in rows])


def _numbers_in(line: str, number: int, width: int) -> list[float]:
    """Return the numbers in a line of a .csv; ValueError if there are others than `width`."""
    try:
        row = [*map(float, line.partition("#")[0].split(","))]
    except ValueError:
        row = []
    if len(row) == width and all(map(math.isfinite, row)):
        return row
    kind = f"{width} finite numbers separated by commas" if width > 1 else "a finite number"
    comma = " without a comma" if width > 1 and "," not in line else ""
    raise ValueError(f"line {number}: expected {kind}, got {line.strip()!r:.60}{comma}")
