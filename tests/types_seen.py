"""What type checkers see of the names that users write, in strict mode: `tox -e types` reads it."""

from typing import assert_type

import numpy as np
from numpy.typing import NDArray

from suslov_fast import (
    Events,
    Field,
    Map,
    Motion,
    SingularStepError,
    Suslov3D,
    SuslovND,
    Trajectories,
    crossings,
    flow,
    iterate,
)
from suslov_fast.results.result import States

Floats = NDArray[np.float64]
run = iterate(Field.from_terms([[[1.0]]]), [1.0], 0.1, 5)
assert_type(run, Trajectories)
assert_type(run.states, Floats)
assert_type(run.valid, NDArray[np.bool_])
try:
    points = crossings(run.body, [1.0], lambda x: x[0], time=0.5)
    assert_type(points, Events)
    assert_type(points.states, Floats)
    assert_type(points.before, Floats)
    assert_type(points.time, Floats)
    assert_type(points.which, NDArray[np.int64])
except SingularStepError as error:
    assert_type(error.trajectories, States)
    assert_type(error.trajectories.states, Floats)
assert_type(run.first_pole, NDArray[np.int64])
assert_type(run.failed_at, NDArray[np.int64])
assert_type(run.final, Floats)
assert_type(run.time, Floats)
assert_type(run.ok, NDArray[np.bool_])
assert_type(flow(Field.from_terms([[[1.0]]]), [1.0], time=0.5), Motion)
any_field = Field(lambda x: (x[1], -np.sin(x[0])), 2)
assert_type(any_field.dimension, int)
any_map = Map(lambda x: (x[1], -x[0]), "x y")
assert_type(any_map.dimension, int)
assert_type(any_map.with_parameters(), Map)
assert_type(iterate(any_map, [1.0, 0.0], steps=5), Trajectories)
assert_type(SuslovND(J=[1.0, 2.0], I=[0.1, 0.2]).dimension, int)
assert_type(Suslov3D(4.0, 1.0, 0.1, 0.1).field(), Field)
assert_type(Suslov3D.from_dict({}), Suslov3D)
assert_type(Suslov3D.from_inertia([[1.0]]), Suslov3D)
print(run.no_such_name)  # type: ignore[attr-defined]
iterate(run.body, [1.0], "0.1", 5)  # type: ignore[arg-type]
iterate(run.body, [1.0], [0.1, 0.2], 5)
iterate(run.body, [1.0], np.linspace(0.1, 0.2, 3), 5, method="rk4")  # type: ignore[arg-type]
flow(any_field, [1.0, 0.0], time="5")  # type: ignore[arg-type]
