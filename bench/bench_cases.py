"""Benchmarks of this package, of the limits of the machine, and of other implementations."""

import cases
import limits
import numba
import peers
import pytest

CASES = [*cases.CASES, *limits.CASES, *peers.CASES]
MOST = int(numba.config.NUMBA_NUM_THREADS)
THREADS = {"all": [MOST], "one": [1], "both": sorted({1, MOST})}
PARAMETERS = [
    pytest.param(
        case,
        threads,
        id=case.name + "-one_thread" * (case.threads == "both" and threads == 1),
        marks=[pytest.mark.slow] * case.slow,
    )
    for case in CASES
    for threads in THREADS[case.threads]
]


@pytest.mark.parametrize(("case", "threads"), PARAMETERS)
@pytest.mark.filterwarnings("ignore")  # warnings of the peers
def bench_case(measure, case, threads):
    measure(case, threads)
