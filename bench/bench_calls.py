"""What a call costs beyond its arithmetic: small calls, and the first ones of a process."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from problem import BODY, EPS

import suslov_fast
from suslov_fast import exact, iterate, step

BODY_3D = "suslov_fast.Suslov3D(4, 1, -0.5, -0.3)"
BODY_ND = "suslov_fast.SuslovND([1.3, 2.1, 3.7], [0.4, -0.7, 0.5])"
STARTS = {
    "Python alone": "pass",
    "`import numba`": "import numba",
    "`import suslov_fast`": "import suslov_fast",
    "first result in 3D": f"import suslov_fast; suslov_fast.iterate({BODY_3D}, [1, 0.5], 0.2, 10)",
    "first result in nD": (
        f"import suslov_fast; suslov_fast.iterate({BODY_ND}, [1, 0.5, 0.2], 0.1, 10)"
    ),
    "first result of the closed form": (
        f"import suslov_fast; suslov_fast.exact({BODY_3D}, [1, 0.5], 0.2, 10)"
    ),
}
CALLS = {
    "one trajectory, 10 steps": lambda: iterate(BODY, [1.0, 0.5], EPS, 10),
    "one trajectory, one step": lambda: step(BODY, [1.0, 0.5], EPS),
    "one state by the closed form": lambda: exact(BODY, [1.0, 0.5], EPS, 10),
}


@pytest.mark.parametrize("name", CALLS)
def bench_call(measure, name):
    measure(CALLS[name], table="calls", row=name, unit="calls", work=1)


@pytest.mark.parametrize("name", STARTS)
def bench_start(measure, name):
    """A process from its start to its end; the call that warms up has filled the caches."""
    if not measure.full and "first" not in name:
        pytest.skip("takes a process, and tests nothing")
    # The package that is measured, wherever this process found it.
    folder = str(Path(suslov_fast.__path__[0]).parent)
    environment = os.environ | {"PYTHONPATH": folder}
    command = [sys.executable, "-c", STARTS[name]]
    measure(
        lambda: subprocess.run(command, env=environment, check=True),
        table="starts",
        row=name,
        unit="processes",
        work=1,
        rounds=2,
        baseline="suslov_fast" not in STARTS[name],
    )
