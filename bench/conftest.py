"""How a benchmark is measured, and what is written beside its time."""

import time
from functools import cache
from statistics import median

import limits
import numba
import pytest
from machine import describe
from results import Limit, Whose

import suslov_fast

WRONG = 1e-9  # far above what rounding and the tolerances of integrators leave
# How often stores and what they limit take turns.
TURNS = 9


def pytest_configure(config):
    config.addinivalue_line("markers", "once: takes long; measured in the first pass alone")
    config.addinivalue_line("markers", "other: does not depend on this package")


def pytest_report_header():
    return f"suslov_fast {suslov_fast.__version__} from {suslov_fast.__path__[0]}"


def pytest_benchmark_generate_machine_info():
    return describe()


@cache
def _stored_to():
    """Memory that streaming stores fill, or None where there are none."""
    to = limits.aligned((limits.LARGE,))
    try:
        limits.store(to, 1, streaming=True)
    except ImportError:
        return None
    return to


class Measure:
    """Times a call, or runs it once on a small problem where benchmarks are disabled."""

    def __init__(self, benchmark):
        self._benchmark = benchmark
        self.full = not benchmark.disabled

    def size(self, full, small):
        """The size of a problem: the second where it is only a test."""
        return full if self.full else min(full, small)

    def __call__(self, call, *, rounds=None, prepare=None, whose=Whose.OURS, **row):
        """Time `call`; `row` are fields of `results.Row`.

        `rounds` are as many as said, not as pytest-benchmark wants. `prepare` is called before each
        of them, and nothing is called to warm up then. What stores limit takes turns with them:
        the memory of a shared machine is fast and slow for seconds at a time.
        """
        # Who computes something else, and faster, is no peer.
        assert (row.get("error") or 0.0) < WRONG
        self._benchmark.extra_info.update(whose=whose, **row)
        if prepare:
            self._benchmark.pedantic(call, setup=prepare, rounds=rounds)
            return
        call()  # compiles, wakes threads, touches memory
        what, count = row.get("limit") or (None, 0)
        if self.full and what is Limit.STREAMING and _stored_to() is not None:
            self._in_turns(call, row["work"] * count, row["threads"])
        elif rounds:
            self._benchmark.pedantic(call, rounds=rounds)
        else:
            self._benchmark(call)

    def _in_turns(self, call, nbytes, threads):
        """Time `call`, which stores so much, and streaming stores; keep its median share."""
        to, rates = _stored_to(), []

        def store():
            begin = time.perf_counter()
            limits.store(to, threads, streaming=True)
            rates.append(to.nbytes / (time.perf_counter() - begin))

        self._benchmark.pedantic(call, setup=store, rounds=TURNS)
        times = self._benchmark.stats.stats.data
        shares = [nbytes / each / rate for each, rate in zip(times, rates, strict=True)]
        self._benchmark.extra_info["share"] = median(shares)


@pytest.fixture
def measure(benchmark):
    return Measure(benchmark)


@pytest.fixture
def all_threads():
    return int(numba.config.NUMBA_NUM_THREADS)


@pytest.fixture
def set_threads():
    """Sets the threads of functions that take no `threads`, until the end of the benchmark."""
    before = numba.get_num_threads()
    yield numba.set_num_threads
    numba.set_num_threads(before)


def pytest_generate_tests(metafunc):
    """`threads`: one, and all; or 1, 2, 4, ... and all for a benchmark of scaling."""
    if "threads" in metafunc.fixturenames:
        most = int(numba.config.NUMBA_NUM_THREADS)
        counts = {1, most}
        if metafunc.module.__name__.endswith("bench_scaling"):
            counts |= {2**k for k in range(most.bit_length()) if 2**k <= most}
        metafunc.parametrize("threads", sorted(counts))
