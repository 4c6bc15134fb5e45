"""Benchmarks of this package, of the limits of the machine, and of other implementations."""

import cases
import limits
import numba
import peers
import pytest

CASES = [*cases.CASES, *limits.CASES, *peers.CASES]
MOST = int(numba.config.NUMBA_NUM_THREADS)
THREADS = {"all": [MOST], "one": [1], "both": sorted({1, MOST})}
PAIRS = [(case, threads) for case in CASES for threads in THREADS[case.threads]]
IDS = [f"{case.name}-{case.whose}-{threads}" for case, threads in PAIRS]


@pytest.mark.parametrize(("case", "threads"), PAIRS, ids=IDS)
@pytest.mark.filterwarnings("ignore")  # warnings of the peers
def bench_case(measure, case, threads):
    measure(case, threads)
