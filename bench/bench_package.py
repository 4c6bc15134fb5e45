"""The cases of this package."""

from cases import CASES  # noqa: F401


def bench_case(measure, case, threads):
    measure(case, threads)
