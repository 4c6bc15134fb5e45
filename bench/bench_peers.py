"""The same work by other means, each as far as it is installed."""

import limits
import peers
import pytest
from problem import CHECKED, EPS, STEPS, motion, orbit, relative_error, starts
from results import Limit, Table

pytestmark = [
    pytest.mark.filterwarnings("ignore"),  # their own
    pytest.mark.other,
]


@pytest.fixture
def threads_of(all_threads):
    return lambda peer: all_threads if peer.threads else 1


@pytest.mark.parametrize("key", peers.FINAL)
def bench_last_states(measure, key, threads_of):
    peer = peers.FINAL[key]
    function, threads = peer.load(), threads_of(peer)
    omega0 = starts(measure.size(peer.batch, 64))
    steps, checked = measure.size(peer.steps, 20), measure.size(STEPS, 20)
    computed = function(starts(CHECKED), checked, threads)
    measure(
        lambda: function(omega0, steps, threads),
        **peer.row(key),
        table=Table.LAST,
        unit="steps",
        work=len(omega0) * steps,
        threads=threads,
        error=relative_error(computed, orbit(CHECKED, checked)[-1]),
        limit=(Limit.DIVISIONS, peer.divisions) if peer.divisions else None,
    )


@pytest.mark.parametrize("key", peers.MOTION)
def bench_motion(measure, key, threads_of):
    peer = peers.MOTION[key]
    function, threads = peer.load(), threads_of(peer)
    omega0 = starts(measure.size(peer.batch, 2))
    steps = measure.size(peer.steps, 20)
    few = min(CHECKED, measure.size(peer.batch, 2))
    computed = function(starts(few), steps, threads)
    measure(
        lambda: function(omega0, steps, threads),
        **peer.row(key),
        table=Table.MOTION,
        unit="trajectories",
        work=len(omega0),
        threads=threads,
        error=relative_error(computed, motion(few, steps * EPS)),
    )


@pytest.mark.parametrize("key", peers.STORED)
def bench_saved_states(measure, key, threads_of):
    peer = peers.STORED[key]
    function, threads = peer.load(), threads_of(peer)
    omega0, steps = starts(measure.size(peer.batch, 64)), measure.size(peer.steps, 20)
    out = limits.aligned((steps + 1, len(omega0), 2))
    few = limits.aligned((steps + 1, CHECKED, 2))
    computed = function(starts(CHECKED), steps, threads, few)
    measure(
        lambda: function(omega0, steps, threads, out),
        **peer.row(key),
        table=Table.SAVED,
        unit="states",
        work=len(computed) * len(omega0),
        threads=threads,
        # Those that leave out state 0 begin with state 1.
        error=relative_error(computed, orbit(CHECKED, steps)[-len(computed) :]),
        limit=(Limit.STREAMING, 16),
        x=1,
    )


@pytest.mark.parametrize("key", peers.JUMP)
def bench_jump(measure, key, threads_of):
    peer = peers.JUMP[key]
    function, threads = peer.load(), threads_of(peer)
    omega0 = starts(measure.size(peer.batch, 64))
    computed = function(starts(CHECKED), STEPS, threads)
    measure(
        lambda: function(omega0, peer.steps, threads),
        **peer.row(key),
        table=Table.JUMPS,
        unit="states",
        work=len(omega0),
        threads=threads,
        error=relative_error(computed, orbit(CHECKED, STEPS)[-1]),
    )
