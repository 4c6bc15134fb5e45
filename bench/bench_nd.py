"""The map in n dimensions, against the number of components, n - 1."""

import peers
import pytest
from problem import CHECKED_ND, EPS, STEPS_ND, isotropic, orbit_nd, problem_nd, relative_error
from results import Limit, Table
from revision import iterate, saved_memory

COMPONENTS = [2, 4, 8, 16, 32, 64, 128]
BATCH = 512
BYTES_SAVED = 2**26


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
        table=Table.ND,
        key=method,
        label=f'`method="{method}"`',
        unit="steps",
        work=len(omega0) * steps,
        threads=threads,
        error=relative_error(checked, orbit_nd(components)),
        x=components,
    )


@pytest.mark.other
@pytest.mark.parametrize("key", peers.ND)
@pytest.mark.parametrize("components", COMPONENTS)
def bench_nd_peer(measure, components, key):
    skip_large(measure, components)
    peer = peers.ND[key]
    function = peer.load()
    body, omega0, steps = problem(measure, components, peer.cubic)
    if peer.whose is peers.NUMPY:  # too slow for all of it
        steps = min(steps, max(1, 64 // components))
        omega0 = omega0[: 4096 // components] if peer.cubic else omega0
    checked = function(body, problem_nd(components, CHECKED_ND)[1], EPS / 2, STEPS_ND)
    measure(
        lambda: function(body, omega0, EPS / 2, steps),
        **peer.row(key),
        table=Table.ND,
        unit="steps",
        work=len(omega0) * steps,
        error=relative_error(checked, orbit_nd(components)),
        x=components,
    )


@pytest.mark.parametrize(
    ("key", "make", "method"),
    [
        ("any", problem_nd, "auto"),
        ("integrable", isotropic, "auto"),
        ("integrable-rank2", isotropic, "rank2"),
    ],
)
@pytest.mark.parametrize("components", [3, 8, 32])
def bench_saved_states(measure, components, key, make, method, all_threads):
    """Into memory that is used again; an integrable body has a closed form."""
    body, omega0 = make(components, measure.size(4096, 16))
    saved = measure.size(BYTES_SAVED // omega0.nbytes, 4)
    options = {"out": saved_memory(saved, *omega0.shape), "threads": all_threads}
    options["method"] = method
    measure(
        lambda: iterate(body, omega0, EPS / 2, saved - 1, **options),
        rounds=3,
        table=Table.ND_SAVED,
        key=key,
        label=f"`iterate`, {'any' if make is problem_nd else 'an integrable'} body"
        + (", every step" if method == "rank2" else ""),
        unit="states",
        work=len(omega0) * saved,
        threads=all_threads,
        limit=(Limit.STREAMING, 8 * components),
        x=components,
    )
