"""Benchmarks of this package, of the limits of the machine, and of other implementations."""

import cases
import limits
import peers
import pytest

CASES = [*cases.CASES, *limits.CASES, *peers.CASES]


@pytest.mark.filterwarnings("ignore")  # warnings of the peers
def bench_case(measure, case, threads):
    measure(case, threads)
