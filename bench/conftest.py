"""Measurement of a case, and the data stored with its time."""

import os

# Peers that solve linear equations by NumPy use one thread, as the rows beside them do.
os.environ |= {"OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}

import numba
import pytest
import results
from problem import relative_error

import suslov_fast

WRONG = 1e-9  # far above rounding errors and the tolerances of integrators


def pytest_configure(config):
    """Run benchmarks once, without timing, unless an option of pytest-benchmark is given."""
    given = [*config.invocation_params.args, *os.environ.get("PYTEST_ADDOPTS", "").split()]
    if not any(str(option).startswith("--benchmark") for option in given):
        config.option.benchmark_disable = True


def pytest_report_header():
    return f"suslov_fast {suslov_fast.__version__} from {suslov_fast.__path__[0]}"


def pytest_benchmark_update_machine_info(machine_info):
    machine_info["ours"] = results.machine(machine_info)


@pytest.fixture
def measure(benchmark):
    """Time a case with a number of threads, or run it once on a small problem."""

    def run(case, threads):
        full = not benchmark.disabled
        numba.set_num_threads(threads)
        try:
            work = case.make(lambda large, small: large if full else min(large, small), threads)
            if not (full and case.slow):
                work.call()  # compiles, wakes threads, touches memory
        except ImportError as error:
            pytest.skip(str(error))
        error = None
        if work.check and (full or (case.x or 0) <= 1000):
            error = relative_error(*work.check())
            assert error < WRONG, "a wrong result disqualifies a case"
        names = ("table", "key", "label", "x", "limit", "whose")
        row = {name: getattr(case, name) for name in names}
        benchmark.extra_info.update(row, work=work.work, error=error, threads=threads)
        benchmark.group = case.group
        if case.once or case.slow:
            benchmark.pedantic(work.call)
        else:
            benchmark(work.call)

    before = numba.get_num_threads()
    yield run
    numba.set_num_threads(before)
