"""Small calls, and processes that compile or do not."""

import re
from pathlib import Path

import numpy as np
import problem
import work
from formulas import EPS
from problem import BODY
from work import NUMPY, OTHERS, OURS, Work

import suslov_fast as sf
from suslov_fast import iterate

BODY_ND, STATE_ND = sf.SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5]), [1.0, 0.5, 0.2]
LORENZ, POINT = problem.sparse_field(3), [-8.0, 8.0, 27.0]
STATE, SYSTEM = [1.0, 0.5], np.random.default_rng(4).normal(size=(4, 4))
BODY_3D, FIELD = "s.Suslov3D(4, 1, -.5, -.3)", "s.Field.from_terms(np.ones((2, 2, 2)))"
N_D = "s.SuslovND(J=[1.3, 2, 3], I=[.4, -.7, .5])"
README = Path(__file__).parents[1] / "README.md"
BLOCKS = re.findall(r"^```python\n(.*?)^```", README.read_text(encoding="utf-8"), re.M | re.S)


def add_cases(add):
    """Add calls of microseconds, and processes."""
    for key, whose, label, call in (
        ("iterate", OURS, "`iterate`, one orbit, 10 steps", lambda: iterate(BODY, STATE, EPS, 10)),
        ("iterate-nd", OURS, "`iterate`, n = 4", lambda: iterate(BODY_ND, STATE_ND, EPS, 10)),
        ("step", OURS, "`step`, one state", lambda: sf.step(BODY, STATE, EPS)),
        ("step-nd", OURS, "`step`, n = 4", lambda: sf.step(BODY_ND, STATE_ND, EPS)),
        ("exact", OURS, "`exact`, one state", lambda: BODY.exact(STATE, EPS, 10)),
        ("first_integral", OURS, "`first_integral`", lambda: BODY.first_integral(STATE, EPS)),
        ("step-field", OURS, "`step`, Lorenz", lambda: sf.step(LORENZ, POINT, EPS)),
        ("flow", OURS, "`flow`, Lorenz, to time 1", lambda: sf.flow(LORENZ, POINT, time=1.0)),
        ("solve", NUMPY, "`numpy.linalg.solve`, 4 x 4", lambda: np.linalg.solve(SYSTEM, SYSTEM[0])),
    ):
        add("calls", key, whose, label, lambda call, size: Work(call), call, one_thread=True)
    for key, label, code in (
        ("exact", "`exact`", f"{BODY_3D}.exact([1, 0.5], 0.2, 25)"),
        ("iterate", "`iterate`", f"s.iterate({BODY_3D}, np.ones((10_000, 2)), 0.2, 20)"),
        ("gyrostat", "gyrostat", "s.iterate(s.Suslov3D(4, 1, -.5, -.3, .7), [1, 0.5], 0.2, 20)"),
        ("nd", "n = 4", f"s.iterate({N_D}, [1, .5, .2], 0.1, 20)"),
        ("field", "a field", f"s.iterate({FIELD}, [0.1, 0.1], 0.1, 20)"),
    ):
        for when, said in (("again", "compiled before"), ("first", "nothing compiled")):
            codes = [f"import numpy as np, suslov_fast as s; {code}"]
            arguments = work.processes, codes, when == "first"
            add("processes", f"{key}-{when}", OURS, f"{label}, {said}", *arguments, one_thread=True)
    label = f"the {len(BLOCKS)} Python blocks of README, nothing compiled"
    add("processes", "readme-first", OURS, label, work.processes, BLOCKS, True, one_thread=True)
    for name, whose in (("suslov_fast", OURS), ("numba", OTHERS)):
        arguments = work.processes, [f"import {name}"], False
        add("processes", f"import-{name}", whose, f"`import {name}`", *arguments, one_thread=True)
