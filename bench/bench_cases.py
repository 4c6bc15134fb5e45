"""Benchmarks of this package, of the limits of the machine, and of other implementations."""

import cases
import numba
import pytest
from problem import relative_error

WRONG = 1e-9  # far above rounding errors and the tolerances of integrators
STORED = ("table", "key", "whose", "label", "x", "limit")


def parameter(case):
    marks = [pytest.mark.benchmark(timer=case.clock)] + [pytest.mark.slow] * case.is_slow
    return pytest.param(case, id=case.name, marks=marks)


@pytest.fixture
def threads(case):
    """The number of threads of a case, which Numba uses meanwhile."""
    before = numba.get_num_threads()
    numba.set_num_threads(1 if case.one_thread else int(numba.config.NUMBA_NUM_THREADS))
    yield numba.get_num_threads()
    numba.set_num_threads(before)


@pytest.mark.sampled(1)  # when they run with the tests, once and untimed; none in C
@pytest.mark.parametrize("case", [parameter(case) for case in cases.every()])
@pytest.mark.filterwarnings("ignore")  # warnings of the peers
def bench_case(benchmark, case, threads):
    """Time a case, or run it once on a small problem."""
    try:
        run_case(benchmark, case, threads)
    except ImportError as error:
        pytest.skip(str(error))


def run_case(benchmark, case, threads):
    full = not benchmark.disabled
    work = case.make(lambda large, small: large if full else min(large, small))
    if full and not case.is_slow:
        work.call()  # compiles, wakes threads, touches memory
    error = None
    is_small = isinstance(case.x, str) or (case.x or 0) <= 1000
    if work.check and (full or is_small):
        error = relative_error(*work.check())
        assert error < WRONG, "a wrong result disqualifies a case"
    benchmark.extra_info.update({name: getattr(case, name) for name in STORED})
    benchmark.extra_info.update(units=work.units, threads=threads, error=error)
    # The times of one group are compared: its members do the same number of the same thing.
    table = case.table if case.x is None else f"{case.table}, {case.x}"
    benchmark.group = f"{table}; each call: {work.units:,} x {work.unit}"
    if case.table == "processes":
        benchmark.pedantic(work.call, rounds=1 if case.is_slow else 3)
    else:
        benchmark(work.call)
    if full:
        rate = work.units / benchmark.stats.stats.min
        benchmark.extra_info |= {"unit": work.unit, "units_per_second": rate}
