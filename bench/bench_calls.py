"""What a call costs beyond its arithmetic."""

import pytest
from problem import BODY, EPS
from results import Table

from suslov_fast import SuslovND, exact, first_integral, iterate, step

BODY_ND, STATE_ND = SuslovND([1.3, 2.1, 3.7], [0.4, -0.7, 0.5]), [1.0, 0.5, 0.2]
CALLS = {
    "iterate": ("`iterate`, one orbit, 10 steps", lambda: iterate(BODY, [1.0, 0.5], EPS, 10)),
    "iterate-nd": (
        "`iterate`, one orbit, 10 steps, n = 4",
        lambda: iterate(BODY_ND, STATE_ND, EPS, 10),
    ),
    "step": ("`step`, one state", lambda: step(BODY, [1.0, 0.5], EPS)),
    "step-nd": ("`step`, one state, n = 4", lambda: step(BODY_ND, STATE_ND, EPS)),
    "exact": ("`exact`, one state", lambda: exact(BODY, [1.0, 0.5], EPS, 10)),
    "first_integral": (
        "`first_integral`, one state",
        lambda: first_integral(BODY, [1.0, 0.5], EPS),
    ),
}


@pytest.mark.parametrize("name", CALLS)
def bench_call(measure, name):
    label, call = CALLS[name]
    measure(call, table=Table.CALLS, key=name, label=label, unit="calls", work=1)
