"""A step of a method as stages, which are steps of Kahan's map by fractions of eps.

A composition takes its stages one after the other. An extrapolated step has columns: n steps of
eps / n, each column from the state x before the step. Kahan's map is symmetric, so the error of the
end x_n of a column has even powers of eps / n alone, and k columns make a step of order 2 k,

x_next = x + sum_n w_n (x_n - x),    w_n = prod_m n**2 / (n**2 - m**2),    sum_n w_n = 1,

where m runs over the other columns (Aitken and Neville). Without the shortest column the order is
2 k - 2, so the difference of the two estimates the error. All columns are even, because then
R(z) = sum_n w_n ((1 + z / (2 n)) / (1 - z / (2 n)))**n, the factor of a decaying mode, stays
between -1 and 1 for all z < 0. The change x_n - x is the sum of the increments of a column, because
weights would multiply the rounding errors of states, which are the same at all steps near rest.
"""

from functools import lru_cache
from math import prod
from typing import Any, NamedTuple

import numpy as np


class Stages(NamedTuple):
    """The stages of a step."""

    fractions: tuple[float, ...]  # of eps
    columns: tuple[int, ...] = ()  # lengths of columns, ascending; none for a composition

    def multiply(self, z):
        """Return the factors by which a step multiplies modes with eps mu / 2 = z, inf at poles."""
        parts = [fraction * z for fraction in self.fractions]
        of_stages = [(1.0 + y) / (1.0 - y) for y in parts]
        if self.columns:
            factors, weights = 1.0, weights_of(self)[:, 0]
            for n, end in zip(self.columns, np.flatnonzero(weights) + 1, strict=True):
                of_column = np.prod(of_stages[end - n : end], axis=0)
                factors = factors + weights[end - 1] * (of_column - 1.0)
        else:
            factors = np.prod(of_stages, axis=0)
        return np.where(np.any([y == 1.0 for y in parts], axis=0), np.inf, factors)


def extrapolation(*columns):
    """Return the stages of a step with these columns."""
    return Stages(tuple(1.0 / n for n in columns for _ in range(n)), columns)


@lru_cache
def weights_of(stages):
    """Return the weights of x_n - x at the ends of columns, 0 at other stages (stages, 2).

    The first is that in x_next, the second that without the shortest column.
    """
    weights, columns = np.zeros((len(stages.fractions), 2)), stages.columns
    for n, end in zip(columns, np.cumsum(columns, dtype=int) - 1, strict=True):
        weights[end] = _weight(n, columns), n > columns[0] and _weight(n, columns[1:])
    return weights


def _weight(n, columns):
    others = [m for m in columns if m != n]
    return n ** (2 * len(others)) / prod(n * n - m * m for m in others)  # rounded once


class Scheme(NamedTuple):
    """A list of operations for a stage, and the stages of one step."""

    step: Any  # `operations.Step`
    stages: Stages

    @property
    def sums_increments(self):
        """True if changes of columns are sums of the increments of their stages.

        Differences of states would contain the rounding errors of all stages. But the code of long
        lists, and that of fields without a plan, returns states alone.
        """
        return bool(self.stages.columns and self.step.usual and not self.step.is_long)


@lru_cache
def distinct(fractions):
    """Return the distinct fractions, and for each stage the place of its own among them."""
    values = [*dict.fromkeys(fractions)]
    return np.array(values), np.array([values.index(fraction) for fraction in fractions])


WHOLE = Stages((1.0,))  # of Kahan's map itself
