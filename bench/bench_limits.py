"""The limits of the machine, measured in the run that is compared with them."""

from limits import CASES  # noqa: F401


def bench_case(measure, case, threads):
    measure(case, threads)
