"""Tables as instructions of expression programs: piecewise linear functions of one number.

Between knots t_p-1 <= x < t_p the value is height_p + slope_p (x - t_p-1), as of `np.interp`. A
right-hand side with fixed branches contains the numbers of one interval in place of the table, so
the cost of a step does not depend on the number of knots.
"""

import hashlib

import numpy as np

from ..cached import cached_property

# The modulus in place of infinity: beyond all knots the slope may be 0, and 0 * infinity is NaN.
LARGEST = float(np.finfo(float).max)


class Table(str):
    """A piecewise linear function of one number; as a text it is its name in expression programs.

    rows           (4, N + 1): low end, high end, height at the low end, and slope of each interval
    is_continuous  True if its values do not jump at knots
    """

    ROWS = 4

    def __new__(cls, knots, heights, slopes, is_continuous):
        """Make a table from N knots, and heights (at low ends) and slopes of N + 1 intervals."""
        low, high = np.append(-LARGEST, knots), np.append(knots, np.inf)
        rows = np.array([low, high, heights, slopes])
        digest = hashlib.blake2b(rows.tobytes(), digest_size=16).hexdigest()
        table = super().__new__(cls, f"table {digest} {is_continuous:d}")
        table.rows, table.is_continuous = rows, is_continuous
        return table

    def __reduce__(self):
        low, _, heights, slopes = self.rows
        return Table, (low[1:], heights, slopes, self.is_continuous)

    def __call__(self, x):
        """Return the values of the table at arguments x (...)."""
        x = np.clip(x, -LARGEST, LARGEST)
        low, _, height, slope = self.rows[:, np.searchsorted(self.rows[0, 1:], x, "right")]
        return slope * (x - low) + height

    @cached_property
    def derivative(self):
        """The derivative, a `Table` of slopes; at a knot, the slope to the right."""
        low, _, _, slopes = self.rows
        return Table(low[1:], slopes, np.zeros(len(slopes)), False)


def is_table(instruction):
    """Return True if an instruction, or the condition of a branch, is a `Table`."""
    return isinstance(instruction, Table)


def of_line(knots, heights):
    """Return the table of lines between points; at equal knots it jumps to the last height."""
    knots, heights = np.array(knots), np.array(heights)
    is_last = np.append(knots[1:] > knots[:-1], True)
    is_first = np.append(True, is_last[:-1])
    knots, before, after = knots[is_last], heights[is_first], heights[is_last]
    slopes = np.concatenate([[0.0], (before[1:] - after[:-1]) / np.diff(knots), [0.0]])
    jumps = before != after
    bends = (slopes[:-1] != 0.0) | (slopes[1:] != 0.0) | jumps
    is_kept = np.append(True, bends)
    starts = np.append(before[0], after)
    return Table(knots[bends], starts[is_kept], slopes[is_kept], not jumps.any())
