"""A run as named arrays, which is what files and labelled datasets hold.

Both are made from these entries and read back to them, so that what they hold is said once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._bodies.nd import SuslovND
from .._bodies.three import Suslov3D
from .._engine.arguments import Body
from .._engine.run import numbers_of_saved
from .._maps.registry import map_named

Entries = dict[str, NDArray[Any]]

# The number of this arrangement: a file that a later one wrote is refused, not misread.
FORMAT = 2
BODIES: dict[str, type[Suslov3D] | type[SuslovND]] = {"Suslov3D": Suslov3D, "SuslovND": SuslovND}
RESUME = "resume_"
# Entries that are one number or one string.
PLAIN = ("format", "version", "map", "body", "method", "steps", "save_every")
_ALWAYS = ("omega", "n", "eps", "status", "failed_at", "map", "body", "method", "steps")


def parameters_of(kind: str) -> list[str]:
    """The names of the parameters of a body."""
    return [field.name for field in fields(BODIES[kind]) if field.default is MISSING]


def parameters_in(entries: Mapping[str, NDArray[Any]]) -> list[str]:
    """The names of the parameters of the body that entries hold."""
    return [f.name for f in fields(BODIES[str(entries["body"])]) if f.name in entries]


def entries_of(run: Mapping[str, Any]) -> Entries:
    """The entries of a run, given as the attributes of `Trajectories`."""
    from .. import __version__

    body: Body = run["body"]
    kind = type(body).__name__
    entries = {
        "format": FORMAT,
        "version": __version__,
        "map": run["_map"].name,
        "body": kind,
        "method": run["method"],
        "steps": run["steps"],
        "n": numbers_of_saved(run["steps"], run["save_every"]),
        **{name: run[name] for name in ("omega", "eps", "status", "failed_at")},
        **body._values,
        **{RESUME + name: array for name, array in run["_resume"].items()},
    }
    if run["save_every"] is not None:
        entries["save_every"] = run["save_every"]
    if not _is_saved(run):
        entries["final"] = run["final"]
    if run["attitude"] is not None:
        entries["attitude"] = run["attitude"]
    return {name: np.asarray(value) for name, value in entries.items()}


def _is_saved(run: Mapping[str, Any]) -> bool:
    """Whether the last state is the last of the saved ones, bit for bit."""
    omega, final = run["omega"], run["final"]
    if len(omega) == 0 or (run["save_every"] and run["steps"] % run["save_every"]):
        return False
    last = omega[-1]
    if last.ctypes.data == final.ctypes.data and last.strides == final.strides:
        return True
    return bool((_bits(last) == _bits(final)).all())


def _bits(array: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.ascontiguousarray(array).view(np.int64)


def run_of(entries: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """The attributes of `Trajectories`, from the entries of a run.

    Raises ValueError if they are not those of a run.
    """
    missing = [name for name in _ALWAYS if name not in entries]
    if missing:
        raise ValueError(
            "expected a run that Trajectories.save or to_xarray wrote, got something without "
            f"{', '.join(missing)}"
        )
    written = int(entries.get("format", np.array(FORMAT)))
    if written != FORMAT:
        raise ValueError(
            f"expected a run in format {FORMAT}, got format {written}, of suslov_fast "
            f"{entries.get('version', 'unknown')}"
        )
    omega = np.ascontiguousarray(entries["omega"])
    eps = entries["eps"]
    run = {
        "omega": omega,
        "eps": float(eps) if eps.ndim == 0 else eps,
        "body": _body_of(entries),
        "_map": map_named(str(entries["map"])),
        "status": entries["status"],
        "failed_at": entries["failed_at"],
        "final": entries["final"] if "final" in entries else omega[-1:].reshape(omega.shape[1:]),
        "method": str(entries["method"]),
        "steps": int(entries["steps"]),
        "save_every": int(entries["save_every"]) if "save_every" in entries else None,
        "attitude": entries.get("attitude"),
        "_resume": {
            name.removeprefix(RESUME): array
            for name, array in entries.items()
            if name.startswith(RESUME)
        },
    }
    _check(run, entries["n"])
    return run


def _body_of(entries: Mapping[str, NDArray[Any]]) -> Body:
    kind = str(entries["body"])
    if kind not in BODIES:
        raise ValueError(f"body: expected {' or '.join(BODIES)}, got {kind!r}")
    missing = [name for name in parameters_of(kind) if name not in entries]
    if missing:
        raise ValueError(f"expected all parameters of the body, got no {', '.join(missing)}")
    return BODIES[kind](**{name: entries[name] for name in parameters_in(entries)})


def _check(run: Mapping[str, Any], n: NDArray[Any]) -> None:
    """Refuse arrays that do not belong together."""
    body, steps, every = run["body"], run["steps"], run["save_every"]
    first, step, count = (steps, 1, 1) if every is None else (0, every, steps // every + 1)
    # As many as there should be, but not more than would have to be there.
    numbers = first + step * np.arange(min(count, np.size(n) + 1))
    if n.dtype != np.int64 or not np.array_equal(n, numbers):
        raise ValueError(
            f"n: expected the saved steps of a run of {steps} steps with save_every={every}, "
            f"got {_short(n)}"
        )
    batch = run["status"].shape
    D = len(run["_map"].components(body))
    side = D + 1
    expected = {
        "omega": ((n.size, *batch, D), np.float64),
        "status": (batch, np.int8),
        "failed_at": (batch, np.int64),
        "final": ((*batch, D), np.float64),
        "attitude": ((n.size, *batch, side, side), np.float64),
    }
    for name, (shape, dtype) in expected.items():
        array = run[name]
        if array is not None and (array.shape != shape or array.dtype != dtype):
            raise ValueError(
                f"{name}: expected shape {shape} and dtype {np.dtype(dtype)}, "
                f"got {array.shape} and {array.dtype}"
            )
    for name, shape in (("body", body.shape), ("eps", np.shape(run["eps"]))):
        try:
            fits = np.broadcast_shapes(shape, batch) == batch
        except ValueError:
            fits = False
        if not fits:
            raise ValueError(f"{name}: expected a shape that broadcasts to {batch}, got {shape}")


def _short(n: NDArray[Any]) -> str:
    return np.array2string(n, threshold=4, edgeitems=2)
