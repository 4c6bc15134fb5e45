"""Columns of results: a table for each class, from which datasets and files are made."""

from __future__ import annotations

from typing import Any, NamedTuple

from ..core.flow.batch_solver import Settings

FORMAT = 18  # version of files: it increases when columns differ from the last release


class Column(NamedTuple):
    """An array of a result."""

    name: str  # name of the attribute; "a.b" is the attribute b of the attribute a
    type: str
    axes: str  # names of axes, where "batch" stands for all axes of the batch
    meaning: str = ""  # long name in datasets
    when: str = ""  # the attribute or option without which a result has no such column

    @property
    def short(self) -> str:
        """The name in datasets and stores."""
        return self.name.rpartition(".")[2]


RUN = (
    Column("states", "float64", "n batch component"),
    Column("attitude", "float64", "n batch space body", "rotation", when="turns"),
    Column("final", "float64", "batch component", "state after the last step"),
    Column("failed_at", "int64", "batch", "first state missing or beyond a pole, or -1"),
    Column("first_pole", "int64", "batch", "first state beyond a pole, or -1"),
    Column("status", "int8", "batch"),
    Column("_t0", "float64", "batch"),
)
OF_EVENTS = (
    Column("trajectory", "int64", "event"),
    Column("which", "int64", "event"),
    Column("time", "float64", "event"),
    Column("before", "float64", "event component", "state before"),
    Column("states", "float64", "event component", "state after"),
    Column("_time_by", "float64", "event direction", when="_by"),
    Column("_before_by", "float64", "event component direction", when="_by"),
    Column("_states_by", "float64", "event component direction", when="_by"),
)
EVENTS = (
    *OF_EVENTS,
    Column("count", "int64", "batch kind"),
    Column("status", "int8", "batch"),
    Column("end", "float64", "batch"),
    Column("final", "float64", "batch component"),
)
MOTION = (
    Column("time", "float64", "time", "time"),
    Column("states", "float64", "time batch component"),
    Column("end", "float64", "batch", "time at which a solution ends"),
    Column("steps", "int64", "batch", "number of steps"),
    Column("status", "int8", "batch"),
    Column("_again", "int8", "batch"),
    Column("_start", "float64", "batch variable"),
    Column("_t0", "float64", "batch"),
    Column("_derivatives", "float64", "time batch component direction", when="_by"),
    Column("_phases", "float64", "event phase", when="_surfaces"),
    *(column._replace(name=f"events.{column.name}", when="events") for column in OF_EVENTS),
    Column("events.count", "int64", "batch kind", "number of events", "events"),
)
OF_KIND = {"Trajectories": RUN, "Events": EVENTS, "Motion": MOTION}
# Attributes that are no arrays, such as arguments of the call: JSON values, or tuples of them.
ARGUMENTS: dict[str, tuple[str, ...]] = {
    "Trajectories": ("method", "steps", "save_every"),
    "Events": ("_by",),
    "Motion": (*Settings._fields, "_by", "_surfaces"),
}


def in_datasets(kind: str) -> list[Column]:
    """Return the columns of a class that datasets contain: no private ones, no tables of events."""
    return [c for c in OF_KIND[kind] if not c.name.startswith("_") and "event" not in c.axes]


def value_of(result: Any, name: str) -> Any:
    """Return the array of the column with this name; None if the result has none."""
    for part in name.split("."):
        result = getattr(result, part, None)
    return result


def dims_of(column: Column, batch: tuple[str, ...]) -> tuple[str, ...]:
    """Return the dimensions of a column in a dataset; `batch` are the dimensions of the batch."""
    return sum((batch if axis == "batch" else (axis,) for axis in column.axes.split()), ())
