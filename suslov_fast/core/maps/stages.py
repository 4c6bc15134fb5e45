"""A step of a method as stages, which are steps of Kahan's map by fractions of eps."""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np


class Stages(NamedTuple):
    """The stages of a step, one after the other: steps of Kahan's map by fractions of eps."""

    fractions: tuple[float, ...]  # fractions of eps, one for each stage

    def multiply(self, z):
        """Return x_next / x for a step of x' = mu x; `z` are numbers eps mu / 2; inf at poles."""
        parts = [fraction * z for fraction in self.fractions]
        factors = np.prod([(1.0 + y) / (1.0 - y) for y in parts], axis=0)
        return np.where(np.any([y == 1.0 for y in parts], axis=0), np.inf, factors)


class Scheme(NamedTuple):
    """A step of a method: the program `step` of each stage, and `stages`, fractions of eps."""

    step: Any  # `kahan_step.Step`
    stages: Stages


@lru_cache
def distinct(fractions):
    """Return the distinct `fractions` of stages, and for each stage the index of its fraction."""
    return np.unique(fractions, return_inverse=True)


WHOLE = Stages((1.0,))  # stages of Kahan's map itself
