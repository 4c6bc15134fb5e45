"""The limits of the machine, measured in the run that is compared with them."""

import limits
import numpy as np
import pytest
from results import Limit, Table, Whose

pytestmark = pytest.mark.other


@pytest.fixture
def _gcc():
    try:
        limits.library("limits.c")
    except ImportError as error:
        pytest.skip(str(error))


def row(key, label, work, unit="bytes", **more):
    """What the rows of all limits have in common."""
    return {
        "table": Table.LIMITS,
        "key": key,
        "label": label,
        "whose": Whose.MACHINE,
        "unit": unit,
        "work": work,
    } | more


@pytest.mark.usefixtures("_gcc")
def bench_divisions(measure, threads):
    blocks, rounds = measure.size(1024, 8), measure.size(1000, 10)
    work = 64 * blocks * rounds
    measure(
        lambda: limits.divide(blocks, rounds, threads),
        rounds=10,
        **row(Limit.DIVISIONS, "divisions", work, "divisions", threads=threads),
    )


@pytest.mark.usefixtures("_gcc")
@pytest.mark.parametrize("kind", [Limit.PLAIN, Limit.STREAMING])
def bench_stores(measure, kind, threads):
    to = limits.aligned((measure.size(limits.LARGE, 2**10),))
    try:
        limits.store(to, threads, kind is Limit.STREAMING)
    except ImportError as error:
        pytest.skip(str(error))
    share = {"limit": (Limit.STREAMING, 1)} if kind is Limit.PLAIN else {}
    measure(
        lambda: limits.store(to, threads, kind is Limit.STREAMING),
        rounds=10,
        **row(kind, f"{kind.value} stores", to.nbytes, threads=threads, **share),
    )


@pytest.mark.usefixtures("_gcc")
def bench_copy(measure, threads):
    """Bytes read and written, into memory that is used again."""
    source, to = (limits.aligned((measure.size(limits.LARGE // 2, 2**10),)) for _ in range(2))
    measure(
        lambda: limits.copy(source, to, threads),
        rounds=10,
        **row(Limit.COPY, "a copy in C", 2 * to.nbytes, threads=threads),
    )


def bench_new_copy(measure):
    """Bytes read and written, into new memory."""
    source = np.ones(measure.size(limits.LARGE // 2, 2**10))
    work = 2 * source.nbytes
    measure(source.copy, rounds=3, **row(Limit.NEW_COPY, "`ndarray.copy`, new memory", work))


def bench_new_memory(measure):
    size = measure.size(limits.LARGE, 2**10)
    share = {"threads": 1, "limit": (Limit.STREAMING, 1)}
    new = row(Limit.NEW, "`np.ones`, new memory", 8 * size, **share)
    measure(lambda: np.ones(size), rounds=3, **new)
