"""How a case is measured, and what is written beside its time."""

import functools
import time
from statistics import median

import limits
import numba
import pytest
import results

import suslov_fast

WRONG = 1e-9  # far above what rounding and the tolerances of integrators leave
TURNS = 9  # of a case and the streaming stores that limit it


def pytest_configure(config):
    config.addinivalue_line("markers", "once: takes long; measured in the first pass alone")


def pytest_report_header():
    return f"suslov_fast {suslov_fast.__version__} from {suslov_fast.__path__[0]}"


def pytest_benchmark_generate_machine_info():
    return results.machine()


def pytest_benchmark_update_json(output_json):
    """Times of single rounds are not kept."""
    for each in output_json["benchmarks"]:
        each["stats"].pop("data", None)


@functools.cache
def _streaming_stores():
    """A call that fills memory with streaming stores, and its bytes; None where there are none."""
    try:
        return limits.stores("streaming", results.machine()["threads"])
    except ImportError:
        return None


@pytest.fixture
def measure(benchmark):
    """Time a case with a number of threads, or run it once on a small problem."""

    def run(case, threads):
        full = not benchmark.disabled
        numba.set_num_threads(threads)
        try:
            work = case.make(lambda large, small: large if full else min(large, small), threads)
        except ImportError as error:
            pytest.skip(str(error))
        error = work.error() if work.error and (full or (case.x or 0) <= 1000) else None
        # A case that computes something else, and faster, is no peer.
        assert (error or 0.0) < WRONG
        row = {name: getattr(case, name) for name in ("table", "key", "label", "unit", "x")}
        row |= {"limit": case.limit, "whose": case.whose, "work": work.work, "error": error}
        benchmark.extra_info.update(row, threads=threads)
        work.call()  # compiles, wakes threads, touches memory
        limit, needed = case.limit or (None, 0)
        stores = _streaming_stores() if full and limit == "streaming" != case.key else None
        if stores:
            benchmark.extra_info["share"] = in_turns(work, needed, *stores)
        benchmark(work.call)

    def in_turns(work, bytes_of_unit, store, nbytes):
        """Median share: the memory of a shared machine is fast and slow for seconds at a time."""
        shares = []
        for _ in range(TURNS):
            begin = time.perf_counter()
            store()
            between = time.perf_counter()
            work.call()
            needed = work.work * bytes_of_unit / (time.perf_counter() - between)
            shares.append(needed / (nbytes / (between - begin)))
        return median(shares)

    before = numba.get_num_threads()
    yield run
    numba.set_num_threads(before)


def pytest_generate_tests(metafunc):
    """Each case of the module, with the numbers of threads that it asks for."""
    if "case" not in metafunc.fixturenames:
        return
    most = int(numba.config.NUMBA_NUM_THREADS)
    counts = {"all": [most], "one": [1], "both": sorted({1, most})}
    metafunc.parametrize(
        ("case", "threads"),
        [
            pytest.param(case, threads, id=f"{case}-{case.whose}-{threads}")
            for case in metafunc.module.CASES
            for threads in counts[case.threads]
        ],
    )
