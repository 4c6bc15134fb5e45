"""Options of pytest for tests and benchmarks."""

import os

# Peers that solve linear equations by NumPy use one thread, as the rows beside them do.
os.environ |= {"OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


def pytest_configure(config):
    """Run benchmarks once, without timing, unless an option of pytest-benchmark is given."""
    given = [*config.invocation_params.args, *os.environ.get("PYTEST_ADDOPTS", "").split()]
    if not any(str(option).startswith("--benchmark") for option in given):
        config.option.benchmark_disable = True
