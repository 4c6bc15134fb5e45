"""Steps of one state of a map x -> f(x), for compiled loops of users (`compiled.step_system`)."""

from typing import Any, NamedTuple

import numpy as np

from ..llvm.compiler import code_of
from ..numba.decorators import function
from ..numba.intrinsics import call_code, with_address
from ..numba.status import NONFINITE, OK
from .stage_code import text_of_map

_steps = {}  # by the addresses of their codes, which last


@with_address
class MapSystem(NamedTuple):
    """A map with its parameters. Unpickling it finds the address in that process."""

    address: int  # of the code of `stage_code.text_of_map`
    table: Any  # (n,), see `Step.table`
    dimension: int

    def __reduce__(self):
        return _with_table, (_steps[self.address], self.table)


def map_system_of(step, parameters):
    """Return the system of a `MapStep` with these parameters (P,)."""
    return _with_table(step, np.ascontiguousarray(step.table_of(parameters)))


def _with_table(step, table):
    # The code lasts, because users may store the system anywhere.
    address = int(code_of(text_of_map, step, lasts=True))
    _steps[address] = step
    return MapSystem(address, table, step.D)


@function
def map_memory(system):
    """The memory of `map_step_of_one`."""
    return np.empty((system.dimension,))


@function
def map_step_of_one(system, state, out, x):
    """Write the state that follows `state` to `out`; return its status. For `compiled`."""
    total = 0.0  # NaN if a number is infinite or NaN
    for i in range(len(x)):
        x[i] = state[i]
        total += 0.0 * x[i]
    call_code(system.address, (x.ctypes.data, system.table.ctypes.data))
    for i in range(len(x)):
        total += 0.0 * x[i]
    for i in range(len(x)):
        out[i] = x[i] if total == 0.0 else np.nan
    return OK if total == 0.0 else NONFINITE


# What `compiled` calls for a system of this kind.
MapSystem.memory, MapSystem.one_step = map_memory, map_step_of_one
