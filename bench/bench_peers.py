"""The same work by other means, each as far as it is installed."""

import limits
import peers
import pytest
from problem import CHECKED, EPS, STEPS, motion, orbit, relative_error, starts

pytestmark = pytest.mark.filterwarnings("ignore")  # their own


@pytest.fixture
def threads_of(all_threads):
    return lambda peer: all_threads if peer.threads else 1


@pytest.mark.parametrize("name", peers.FINAL)
def bench_last_states(measure, name, threads_of):
    peer = peers.FINAL[name]
    function, threads = peer.load(), threads_of(peer)
    omega0 = starts(measure.size(peer.batch, 64))
    steps, checked = measure.size(peer.steps, 20), measure.size(STEPS, 20)
    computed = function(starts(CHECKED), checked, threads)
    measure(
        lambda: function(omega0, steps, threads),
        table="last states",
        row=name,
        unit="steps",
        work=len(omega0) * steps,
        threads=threads,
        error=relative_error(computed, orbit(CHECKED, checked)[:, -1]),
        limit=("divisions", peer.divisions) if peer.divisions else None,
    )


@pytest.mark.parametrize("name", peers.MOTION)
def bench_motion(measure, name, threads_of):
    peer = peers.MOTION[name]
    function, threads = peer.load(), threads_of(peer)
    omega0 = starts(measure.size(peer.batch, 2))
    steps = measure.size(peer.steps, 20)
    few = min(CHECKED, measure.size(peer.batch, 2))
    computed = function(starts(few), steps, threads)
    measure(
        lambda: function(omega0, steps, threads),
        table="motion",
        row=name,
        unit="trajectories",
        work=len(omega0),
        threads=threads,
        error=relative_error(computed, motion(few, steps * EPS)),
    )


@pytest.mark.parametrize("name", peers.STORED)
def bench_all_states(measure, name, threads_of):
    peer = peers.STORED[name]
    function, threads = peer.load(), threads_of(peer)
    omega0, steps = starts(measure.size(peer.batch, 64)), measure.size(peer.steps, 20)
    out = limits.aligned((2, steps + 1, len(omega0)))
    few = limits.aligned((2, steps + 1, CHECKED))
    computed = function(starts(CHECKED), steps, threads, few).T
    measure(
        lambda: function(omega0, steps, threads, out),
        table="all states",
        row=name,
        unit="states",
        work=computed.shape[1] * len(omega0),
        threads=threads,
        # Those that leave out state 0 begin with state 1.
        error=relative_error(computed, orbit(CHECKED, steps)[:, -computed.shape[1] :]),
        limit=("bytes, streaming stores", 16),
    )


@pytest.mark.parametrize("name", peers.JUMP)
def bench_jump(measure, name, threads_of):
    peer = peers.JUMP[name]
    function, threads = peer.load(), threads_of(peer)
    omega0 = starts(measure.size(peer.batch, 64))
    computed = function(starts(CHECKED), STEPS, threads)
    measure(
        lambda: function(omega0, peer.steps, threads),
        table="jumps",
        row=name,
        unit="jumps",
        work=len(omega0),
        threads=threads,
        error=relative_error(computed, orbit(CHECKED, STEPS)[:, -1]),
    )
