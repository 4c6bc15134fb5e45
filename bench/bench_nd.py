"""The map in n dimensions: nanoseconds per step against the number of components, n - 1."""

import peers
import pytest
from problem import CHECKED_ND, EPS, STEPS_ND, orbit_nd, problem_nd, relative_error

from suslov_fast import iterate

COMPONENTS = [2, 4, 8, 16, 32, 64, 128]
BATCH = 512


def problem(measure, components, cubic):
    """A body, starts, and steps that take some milliseconds."""
    body, omega0 = problem_nd(components, measure.size(BATCH, 16))
    steps = max(3, 4000 // components**2 if cubic else 4000 // components)
    return body, omega0, measure.size(steps, 3)


def skip_large(measure, components):
    if not measure.full and components > 16:
        pytest.skip("large matrices are for measuring")


@pytest.mark.parametrize("method", ["rank2", "gauss"])
@pytest.mark.parametrize("components", COMPONENTS)
def bench_nd(measure, components, method, threads):
    skip_large(measure, components)
    body, omega0, steps = problem(measure, components, cubic=method == "gauss")
    options = {"save_every": None, "method": method, "threads": threads}
    few = problem_nd(components, CHECKED_ND)[1]
    checked = iterate(body, few, EPS / 2, STEPS_ND, **options).final
    measure(
        lambda: iterate(body, omega0, EPS / 2, steps, **options),
        table="nd",
        row=f'**suslov_fast**, `method="{method}"`',
        unit="steps",
        work=len(omega0) * steps,
        threads=threads,
        error=relative_error(checked, orbit_nd(components)),
        components=components,
    )


@pytest.mark.parametrize("name", peers.ND)
@pytest.mark.parametrize("components", COMPONENTS)
def bench_nd_peer(measure, components, name):
    skip_large(measure, components)
    function = peers.ND[name].load()
    cubic = "rank two" not in name
    body, omega0, steps = problem(measure, components, cubic)
    if "NumPy" in name:  # too slow for all of it
        steps = min(steps, max(1, 64 // components))
    if "NumPy" in name and cubic:
        omega0 = omega0[: 4096 // components]
    checked = function(body, problem_nd(components, CHECKED_ND)[1], EPS / 2, STEPS_ND)
    measure(
        lambda: function(body, omega0, EPS / 2, steps),
        table="nd",
        row=name,
        unit="steps",
        work=len(omega0) * steps,
        threads=1,
        error=relative_error(checked, orbit_nd(components)),
        components=components,
    )
