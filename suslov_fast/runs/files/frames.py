"""Results as tables of pandas: a row for each state."""

from typing import Any

import numpy as np

from ...checks import FloatArray, extra
from .datasets import varying_numbers


def table(result: Any) -> Any:
    """Return a result as a table; see `Result.to_dataframe`."""
    parameters = varying_numbers(result)
    if hasattr(result, "coordinates"):
        columns = {name: getattr(result, name) for name in result.coordinates}
        columns |= {name: result._at_crossings(values) for name, values in parameters.items()}
        states = result.states
    else:
        columns, states = _of_runs(result)
    for name, column in zip(result.body.labels, states.T, strict=True):
        columns[f"{name}_" if name in columns else name] = column
    return extra("pandas", "xarray").DataFrame(columns)


def _of_runs(run: Any) -> tuple[dict[str, Any], FloatArray]:
    """Return the columns of a run or a motion, and its states, trajectory by trajectory."""
    N, batch = len(run), run.status.shape
    columns: dict[str, Any] = {}
    if batch:
        columns["trajectory"] = np.repeat(np.arange(run.status.size), N)
    if hasattr(type(run), "n"):
        columns["n"] = np.tile(run.n, run.status.size)
    time = run.time.reshape((N, *(1,) * (1 + len(batch) - run.time.ndim), *run.time.shape[1:]))
    columns["time"] = np.moveaxis(np.broadcast_to(time, (N, *batch)), 0, -1).ravel()
    for name, values in varying_numbers(run).items():
        columns[name] = np.repeat(np.broadcast_to(values, batch).ravel(), N)
    states = np.moveaxis(run.states, 0, -2).reshape(-1, len(run.body.labels))
    return columns, states
