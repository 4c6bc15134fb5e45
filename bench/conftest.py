"""How a benchmark is measured, and what is written beside its time."""

import numba
import pytest
from machine import describe

import suslov_fast


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

    def __call__(
        self,
        call,
        *,
        table,
        row,
        unit,
        work,
        threads=1,
        error=None,
        limit=None,
        rounds=None,
        **more,
    ):
        """Time `call`, which does `work` units; `limit` is (what, how many of it per unit).

        More facts: `x` is where a chart of scaling puts it, `components` is n - 1, and a `baseline`
        is independent of this package. `rounds` are as many as said, not as pytest-benchmark wants.
        """
        call()  # compiles, wakes threads, touches memory
        self._benchmark.extra_info.update(
            table=table, row=row, unit=unit, work=work, threads=threads, error=error, limit=limit
        )
        self._benchmark.extra_info.update(more)
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


def pytest_generate_tests(metafunc):
    """`threads`: one, and all; or 1, 2, 4, ... and all for a benchmark of scaling."""
    if "threads" in metafunc.fixturenames:
        most = int(numba.config.NUMBA_NUM_THREADS)
        counts = {1, most}
        if metafunc.module.__name__.endswith("bench_scaling"):
            counts |= {2**k for k in range(most.bit_length()) if 2**k <= most}
        metafunc.parametrize("threads", sorted(counts))
