"""Rows of trajectories as lines of lanes, and the tables of numbers that their steps take."""

import functools
import math

import numpy as np

from ..llvm.compiler import address_of
from ..numba.status_codes import NONFINITE, OK
from .stages import distinct
from .tolerances import FIELDS_IN_MEMORY


def zeros(*shape):
    """Return zeros that begin at a cache line."""
    # In some processes NumPy's arrays begin 16 bytes after a cache line. Then SIMD packs straddle
    # cache lines, which costs up to a seventh of the time.
    count = math.prod(shape)
    memory = np.zeros(count + 7)
    first = -address_of(memory) // 8 % 8
    return memory[first : first + count].reshape(shape)


def aligned(array):
    """Return a copy of an array that begins at a cache line."""
    copy = zeros(*array.shape)
    copy[:] = array
    return copy


def in_lines(rows, W):
    """Return rows (B, n) as lines (lines, n, W) of W rows; lanes left over repeat the last row."""
    missing = -len(rows) % W
    padded = np.concatenate([rows, rows[-1:].repeat(missing, axis=0)]) if missing else rows
    return aligned(padded.reshape(len(padded) // W, W, rows.shape[1]).swapaxes(1, 2))


@functools.lru_cache(FIELDS_IN_MEMORY)  # because computing a table takes longer than a few steps
def common_table(step, stages, eps, values):
    """Return eps v / 2 and tables (`tables_of`) of one field, cached by bytes of eps and values."""
    values = np.frombuffer(values)
    fractions, _ = distinct(stages.fractions)
    halves = 0.5 * np.frombuffer(eps) * values
    table = step.table_of(np.outer(halves, fractions))
    tables = np.ascontiguousarray(table.T)[:, np.newaxis, :, np.newaxis]
    return halves[np.newaxis, :, np.newaxis], tables


def plan_of(stages, table):
    """Return an array: for each of `stages` the address of the part of `table` for its fraction."""
    return address_of(table) + table.strides[0] * distinct(stages.fractions)[1]


def tables_of(scheme, values, eps, W):
    """Return eps v / 2 of the terms (lines, T, W), and tables (lines, n, W) for stages.

    There is one for each different fraction of eps. A table has all values that a step needs and
    that depend on parameters alone. For one field and one eps, `lines` and W are 1 in these shapes.
    """
    fractions, _ = distinct(scheme.stages.fractions)
    if len(eps) == len(values) == 1:
        return common_table(*scheme, eps.tobytes(), values.tobytes())
    halves = in_lines(0.5 * eps[:, np.newaxis] * values, W)
    fractions = fractions[:, np.newaxis, np.newaxis]
    of_stages = np.moveaxis(halves, 1, 0)[:, np.newaxis] * fractions
    return halves, aligned(np.moveaxis(scheme.step.table_of(of_stages), 0, 2))


def packed(truths):
    """Return truth values (lines, W) as bits of lanes, one number for each line."""
    return np.packbits(truths, axis=1, bitorder="little")[:, 0]


def note_undefined(states, notes):
    """Note failures of trajectories with NaN in state 0, in `states` (B, D), and no poles."""
    status, failed_at, poles = notes
    poles[status == OK] = 0.0  # other poles are from earlier stages, see `maps.derivatives`
    # A sum takes a tenth of the time of `isnan`; Python adds few numbers faster than NumPy.
    total = sum(states.ravel().tolist()) if states.size <= 64 else states.sum()
    if not math.isfinite(total):
        undefined = np.isnan(states).any(axis=1) & (status >= 0)
        status[undefined], failed_at[undefined] = NONFINITE, 0
