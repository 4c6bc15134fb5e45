"""How a benchmark is measured, and what is written beside its time."""

import numba
import pytest
from machine import describe
from results import Whose

import suslov_fast

WRONG = 1e-9  # far above what rounding and the tolerances of integrators leave


def pytest_configure(config):
    config.addinivalue_line("markers", "once: takes long; measured in the first pass alone")
    config.addinivalue_line("markers", "other: does not depend on this package")


def pytest_report_header():
    return f"suslov_fast {suslov_fast.__version__} from {suslov_fast.__path__[0]}"


def pytest_benchmark_generate_machine_info():
    return describe()


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
        of them, and nothing is called to warm up then.
        """
        # Who computes something else, and faster, is no peer.
        assert (row.get("error") or 0.0) < WRONG
        self._benchmark.extra_info.update(whose=whose, **row)
        if prepare:
            self._benchmark.pedantic(call, setup=prepare, rounds=rounds)
            return
        call()  # compiles, wakes threads, touches memory
        if rounds:
            self._benchmark.pedantic(call, rounds=rounds)
        else:
            self._benchmark(call)


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
