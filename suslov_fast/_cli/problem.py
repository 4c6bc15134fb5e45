"""The body, the step size and the starts that options describe."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from .._bodies.nd import SuslovND
from .._bodies.paper import PICTURES
from .._bodies.three import Suslov3D
from .._checks import FloatArray
from .._engine.arguments import Body
from .._engine.memory import require
from .._ensemble.starts import RandomStarts
from .errors import UserError
from .files import named, read_matrix, read_states
from .values import integer, number, numbers, positive

TRAJECTORIES = 65_536
_GROUPS = {
    "picture": ("picture",),
    "3D": ("I1", "I2", "I13", "I23"),
    "mass tensor": ("inertia",),
    "inertia tensor": ("inertia_tensor",),
    "nD": ("J", "I"),
}
# Random starts fill the square |Omega1|, |Omega2| <= EXTENT.
EXTENT = 2.0


def add_body_to(parser: argparse.ArgumentParser) -> None:
    """Add the options that describe the body."""
    body = parser.add_argument_group(
        "body (a picture of the paper, or all parameters and a step size)"
    )
    body.add_argument("--picture", metavar="1..4", help="body and step size of a picture (1)")
    body.add_argument("--I1", type=positive, help="moment of inertia")
    body.add_argument("--I2", type=positive, help="moment of inertia")
    body.add_argument("--I13", type=number, help="product of inertia")
    body.add_argument("--I23", type=number, help="product of inertia")
    body.add_argument(
        "--inertia-tensor",
        type=Path,
        metavar="FILE",
        help="in three dimensions: the 3 x 3 inertia tensor in any basis, .npy or .csv",
    )
    body.add_argument("--J", type=numbers, metavar="J1,J2,...", help="in n dimensions: I_ii + I_nn")
    body.add_argument("--I", type=numbers, metavar="I1,I2,...", help="in n dimensions: I_in")
    body.add_argument(
        "--inertia",
        type=Path,
        metavar="FILE",
        help=(
            "in n dimensions: the n x n mass tensor in any basis, the I of M = I Omega + Omega I "
            "with the second moments of mass, .npy or .csv; for n = 3 it is not the inertia tensor "
            "T but trace(T)/2 - T"
        ),
    )
    body.add_argument(
        "--axis",
        type=numbers,
        metavar="A1,A2,...",
        help="with one of the two matrices: the axis of the constraint, in its basis (the last)",
    )
    body.add_argument("--eps", type=number, help="step size (that of the picture)")


def add_batch_to(parser: argparse.ArgumentParser) -> Any:
    """Add the options that describe the batch."""
    batch = parser.add_argument_group("batch")
    batch.add_argument(
        "--trajectories", type=integer(1), metavar="N", help=f"random starts ({TRAJECTORIES})"
    )
    batch.add_argument("--seed", type=integer(0), help="of the random starts (0)")
    batch.add_argument(
        "--initial", type=Path, metavar="FILE", help="starts from a .npy or .csv, a row for each"
    )
    return batch


def problem_of(options: argparse.Namespace) -> tuple[Body, float, FloatArray | None]:
    """The body, the step size, and the rotation to the adapted basis unless it was given so."""
    given = {
        group: [_option(name) for name in names if getattr(options, name) is not None]
        for group, names in _GROUPS.items()
    }
    chosen = [group for group, names in given.items() if names]
    if len(chosen) > 1:
        both = " and ".join(given[group][0] for group in chosen)
        raise UserError(f"expected one body, got {both}")
    if options.axis is not None and not {"mass tensor", "inertia tensor"} & set(chosen):
        raise UserError("expected --axis only with --inertia or --inertia-tensor, got it alone")
    if chosen in ([], ["picture"]):
        choice = options.picture or "1"
        if choice not in map(str, PICTURES):
            raise UserError(f"argument --picture: expected 1, 2, 3 or 4, got {choice!r}")
        picture = PICTURES[int(choice)]
        return picture.body, picture.eps if options.eps is None else options.eps, None
    needed = (*_GROUPS[chosen[0]], "eps")
    missing = [_option(name) for name in needed if getattr(options, name) is None]
    if missing:
        wanted = " ".join(map(_option, needed))
        raise UserError(f"expected all of {wanted} or none, got no {' '.join(missing)}")
    body, rotation = _body(options, chosen[0])
    return body, options.eps, rotation


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _body(options: argparse.Namespace, group: str) -> tuple[Body, FloatArray | None]:
    if group in ("3D", "nD"):
        parameters = [getattr(options, name) for name in _GROUPS[group]]
        try:
            return (Suslov3D if group == "3D" else SuslovND)(*parameters), None
        except ValueError as error:
            raise UserError(f"arguments of the body: {error}") from error
    path = options.inertia or options.inertia_tensor
    matrix = read_matrix(path)
    with named(path):
        if group == "mass tensor":
            return SuslovND.from_mass_tensor(matrix, options.axis)
        axis = [0.0, 0.0, 1.0] if options.axis is None else options.axis
        return Suslov3D.from_inertia(matrix, axis)


def starts_of(options: argparse.Namespace, body: Body) -> FloatArray:
    """The states 0, one for each trajectory."""
    if options.initial is None:
        count = options.trajectories or TRAJECTORIES
        _require_memory(count, body, options)
        return RandomStarts(count, EXTENT, options.seed or 0).states(count, 0, body.dimension)
    for name in ("trajectories", "seed"):
        if getattr(options, name) is not None:
            raise UserError(f"expected either --initial or --{name}, got both")
    states = read_states(options.initial, body.dimension)
    _require_memory(len(states), body, options)
    return states


def _require_memory(count: int, body: Body, options: argparse.Namespace) -> None:
    """Refuse a batch that no memory holds, rather than be killed in the middle."""
    saved = 1 if options.save_every is None else options.steps // options.save_every + 1
    numbers_each = body.dimension + ((body.dimension + 1) ** 2 if options.attitude else 0)
    needed = 8 * numbers_each * count * (saved + 8)
    try:
        require(needed, "raise --save-every or lower --trajectories")
    except MemoryError as error:
        raise UserError(str(error)) from error
