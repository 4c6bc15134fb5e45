"""The calls of this package, the limits of the machine, and the same work by other means."""

import cases
import limits
import peers
import processes
import pytest

CASES = [*cases.CASES, *limits.CASES, *peers.CASES, *processes.cases()]


@pytest.mark.filterwarnings("ignore")  # those of the peers
def bench_case(measure, case, threads):
    measure(case, threads)
