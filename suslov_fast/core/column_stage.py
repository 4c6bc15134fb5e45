"""A stage of an extrapolated step (`stages`) as a list of operations."""

import functools

import numpy as np

from .operations import Step


class ColumnStage(Step):
    """The operations of a stage of an extrapolated step.

    They do not test that increments keep the digits of small components: the changes of columns are
    added to the state before the step, which loses them. Nor do they test that states are finite,
    which the end of a step does.
    """

    def _add_tests(self, halves):
        emit, joined = self.values.emit, self.values.joined
        self.good = joined("and", self._good_pivots())
        first_rare = len(self.values.operations)
        self.after_rare = [*self.after]
        self.accurate = joined("and", self._accurate_pivots())
        negative = [emit("olt", pivot, 0.0) for pivot in self.factors.pivot.values()]
        self.negative = joined("xor", negative or [emit("olt", 1.0, 0.0)])
        self.rare = self.values.operations[first_rare:]

    def _results(self):
        return [*super()._results(), *self.increments.values()]


@functools.lru_cache(32)
def column_stage_of(places, D):
    """Return the `ColumnStage` of fields with terms at these indices, given by their bytes."""
    return ColumnStage(np.frombuffer(places, np.int64).reshape(3, -1), D)
