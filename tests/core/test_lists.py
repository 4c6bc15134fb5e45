"""Machine code of random lists of operations carries out what NumPy does, to the bit."""

import weakref

import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast.core.code import runs as listed
from suslov_fast.core.fields import called_stages, steps as steps_field

pytestmark = pytest.mark.compiled


def test_the_arrays_of_a_long_list_live_as_long_as_its_steps():
    """Of threads that begin at once, `programs_of` keeps the arrays of one alone."""
    field = sf.QuadraticField.from_function(
        lambda x: (x[1] * x[2], x[0] - x[1], x[0] ** 2 - x[2]), 3
    )
    indices, values = field.terms
    scheme, x = steps_field.scheme_of(indices, 3), np.full((8, 3), 0.5)
    notes = np.zeros(8, np.int8), np.zeros(8, np.int64), np.zeros(8)
    given = scheme, np.atleast_2d(values), np.array([0.1])
    lines = steps_field._Lines(given, x, notes, 8)
    stage = called_stages.StageByRuns(lines)
    heads = weakref.ref(listed.programs_of(scheme.step, False)[0].runs.heads)
    listed.programs_of.cache_clear()
    assert heads() is not None
    assert stage.programs[0].runs.heads is heads()
