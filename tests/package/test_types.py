"""What type checkers see of the names that users write, in strict mode."""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

SEEN = """
import numpy as np
from numpy.typing import NDArray
from typing import Any, assert_type

from suslov_fast import Crossings, Field, Motion, QuadraticField, SuslovND, Trajectories
from suslov_fast import SingularStepError, Suslov3D, SuslovGyrostat
from suslov_fast import body_from_dict, crossings, flow, iterate, periodic_orbit

Floats = NDArray[np.float64]
run = iterate(QuadraticField([[[1.0]]]), [1.0], 0.1, 5)
assert_type(run, Trajectories)
assert_type(run.x, Floats)
assert_type(run.omega, Floats)
assert_type(run.states, Floats)
assert_type(run[0], Floats)
assert_type(run.valid, NDArray[np.bool_])
try:
    points = crossings(run.body, [1.0], 0.1, 5, lambda x: x[..., 0])
    assert_type(points, Crossings)
    assert_type(points.states, Floats)
    assert_type(points.before, Floats)
    assert_type(points.time, Floats)
    assert_type(points.n, NDArray[np.int64])
except SingularStepError as error:
    assert_type(error.trajectories, Trajectories)
    assert_type(error.trajectories.x, Floats)
    assert_type(error.crossings, Crossings)
assert_type(run.first_pole, NDArray[np.int64])
assert_type(run.failed_at, NDArray[np.int64])
assert_type(run.final, Floats)
assert_type(run.time, Floats)
assert_type(run.ok, bool)
assert_type(flow(QuadraticField([[[1.0]]]), [1.0], time=0.5), Motion)
any_field = Field.from_function(lambda x: (x[1], -np.sin(x[0])), 2)
assert_type(any_field.dimension, int)
assert_type(SuslovND([1.0, 2.0], [0.1, 0.2]).dimension, int)
assert_type(Suslov3D(4.0, 1.0, 0.1, 0.1).field(), QuadraticField)
assert_type(QuadraticField([[[1.0]]]).quadratic, NDArray[Any])
body = body_from_dict({})
assert_type(body, Suslov3D | SuslovND | SuslovGyrostat | QuadraticField | Field)
run.no_such_name
iterate(run.body, [1.0], "0.1", 5)
iterate(run.body, [1.0], [0.1, 0.2], 5)
iterate(run.body, [1.0], np.linspace(0.1, 0.2, 3), 5, method="rk4")
flow(any_field, [1.0, 0.0], time="5")
"""


@pytest.mark.skipif(find_spec("mypy") is None, reason="mypy is not installed")
@pytest.mark.slow
def test_types_are_seen(tmp_path):
    path = tmp_path / "seen.py"
    path.write_text(SEEN)
    root = Path(__file__).parents[2]
    words = [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent"]
    words += ["--config-file", str(root / "pyproject.toml"), f"--cache-dir={tmp_path}", str(path)]
    environment = {**os.environ, "MYPYPATH": str(root)}
    told = subprocess.run(words, capture_output=True, text=True, env=environment, cwd=root)
    errors = [line for line in told.stdout.splitlines() if "error" in line and "seen.py" in line]
    named = 'has no attribute "no_such_name"', "Argument 3", '"method"', '"time"'
    assert len(errors) == len(named), told.stdout + told.stderr
    for name, error in zip(named, errors, strict=True):
        assert name in error
