"""The same work by other means, as far as it is installed."""

import pytest
from peers import CASES  # noqa: F401


@pytest.mark.filterwarnings("ignore")  # their own
def bench_case(measure, case, threads):
    measure(case, threads)
