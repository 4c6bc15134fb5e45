"""The limits of the machine, measured in the run that is compared with them."""

import limits
import pytest


@pytest.fixture(autouse=True)
def _gcc():
    try:
        limits.library("limits.c")
    except ImportError as error:
        pytest.skip(str(error))


def bench_divisions(measure, threads):
    blocks, rounds = measure.size(1024, 8), measure.size(1000, 10)
    measure(
        lambda: limits.divide(blocks, rounds, threads),
        table="limits",
        row="divisions",
        unit="divisions",
        work=64 * blocks * rounds,
        threads=threads,
        rounds=20,
    )


@pytest.mark.parametrize("kind", ["plain", "streaming"])
def bench_stores(measure, kind, threads):
    to = limits.aligned((measure.size(2**25, 2**10),))  # 256 MiB
    try:
        limits.store(to, threads, kind == "streaming")
    except ImportError as error:
        pytest.skip(str(error))
    measure(
        lambda: limits.store(to, threads, kind == "streaming"),
        table="limits",
        row=f"bytes, {kind} stores",
        unit="bytes",
        work=to.nbytes,
        threads=threads,
        rounds=20,
    )
