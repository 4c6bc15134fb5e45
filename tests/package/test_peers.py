"""The page of calls of other packages: each row gives what SciPy or a number says."""

import re
from pathlib import Path

import numpy as np
import pytest

PAGE = (Path(__file__).parents[2] / "docs" / "howto" / "peers.md").read_text("utf-8")
ROWS = re.findall(r"^\| (?:(.*) \| )?(.*) \| `(.*)` \|$", PAGE, re.MULTILINE)
LORENZ = [0.906, 0, -14.572]
# A ball at time 2, after three bounces.
SPEED = 0.9**3 * (2 * 9.81) ** 0.5
AGO = 2 - (2 / 9.81) ** 0.5 * (1 + 2 * (0.9 + 0.9**2))
BALL = [SPEED * AGO - 9.81 * AGO**2 / 2, SPEED - 9.81 * AGO]
# What no row of SciPy computes, and the largest error: a number, or an expression of SciPy.
OTHERS = {
    'crossings(field, x0, time=T, surface=top, direction="up").states': (
        "solve_ivp(g, (0, T), x0, events=rises, **tight).y_events[0]",
        1e-6,
    ),
    'crossings(field, x0, time=5, surface=top, most=5, direction="up").states': (
        "solve_ivp(g, (0, 5), x0, events=rises, **tight).y_events[0][:5]",
        1e-5,
    ),
    "crossings(field, x0, time=5, surface=lambda x: 8 / 3 * x[..., 2] - x[..., 0] * x[..., 1], "
    'most=5, direction="up").states': (
        "solve_ivp(g, (0, 5), x0, events=peaks, **tight).y_events[0][:5]",
        1e-5,
    ),
    "lyapunov_exponents(field, x0, time=400, transient=20, rtol=1e-6)": (LORENZ, 0.05),
    "lyapunov_exponents(quadratic, x0, 1 / 128, 50_000, transient=2000)": (LORENZ, 0.1),
    'flow(field, x0, time=T, derivatives="rho").derivatives["rho"][0]': (
        "(odeint(lambda x, t: f(x, 28.001), x0, [0, T], **tight)[1] "
        "- odeint(lambda x, t: f(x, 27.999), x0, [0, T], **tight)[1]) / 0.002",
        1e-4,
    ),
    "equilibria(quadratic, near=[9, 9, 27]).states": ([72**0.5] * 2 + [27], 1e-12),
    'iterate(quadratic, x0, eps=1 / 64, steps=128, method="order8").final': (
        "solve_ivp(g, (0, T), x0, **tight).y[:, -1]",
        1e-6,
    ),
    "crossings(field, x0, time=T, surface=top).time": (
        "solve_ivp(g, (0, T), x0, events=hit, **tight).t_events[0]",
        1e-6,
    ),
    'crossings(field, x0, time=T, surface=top, direction="down", most=1).states[0]': (
        "solve_ivp(g, (0, T), x0, events=down, **tight).y_events[0][0]",
        1e-6,
    ),
    'flow(ball, [1, 0], time=T, events=Event("h", direction="down", terminal=True)).end': (
        "solve_ivp(fall, (0, T), [1, 0], events=ground, **tight).t_events[0][0]",
        1e-6,
    ),
    "flow(ball, [1, 0], time=T, events=bounce).states[0]": (BALL, 1e-9),
    "flow(drug, [0], time=T, events=dose).states[0]": ([100 * (1 + np.exp(-1) + np.exp(-2))], 1e-9),
    # 1, and exp of the integral of 1 - q**2 over the period, by DOP853
    "periodic_orbit(van_der_pol, [2, 0], 6.6).multipliers": ([1, 0.0008597], 5e-8),
}


@pytest.fixture(scope="module")
def names():
    """What the page defines, and events of SciPy."""
    names = {}
    for code in re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL):
        exec(code, names)
    names["rises"] = lambda t, x: names["hit"](t, x)
    names["peaks"] = lambda t, x: 8 / 3 * x[2] - x[0] * x[1]
    names["rises"].direction = names["peaks"].direction = 1
    return names


@pytest.mark.compiled
@pytest.mark.parametrize("here", sorted({here for *_, here in ROWS}))
def test_a_row_gives_what_scipy_gives(here, names):
    scipy = [there.strip("`") for package, there, row in ROWS if (package, row) == ("SciPy", here)]
    expected, error = OTHERS[here] if here in OTHERS else (scipy[0], 1e-6)
    for reference in [expected, *scipy]:
        wanted = eval(reference, names) if isinstance(reference, str) else reference
        found = np.asarray(eval(here, names))
        assert found.shape == np.shape(wanted)
        assert abs(found - wanted).max() <= error * max(1, abs(np.asarray(wanted)).max())
