"""Processes from their start to their end."""

from pathlib import Path

import processes
import pytest

import suslov_fast

TREE = Path(suslov_fast.__path__[0]).parent


@pytest.fixture
def process(benchmark, tmp_path_factory):
    """Time a process with nothing compiled, or with what the one before it has compiled."""

    def run(key, label, code, rounds, first=False):
        if benchmark.disabled and key != "iterate-again":
            pytest.skip("one process is test enough")
        whose = "this package" if "suslov_fast" in code else "others"
        row = {"table": "processes", "key": key, "label": label, "whose": whose}
        benchmark.extra_info.update(row, unit="processes", work=1)
        # A test takes the kernels that are there.
        cache = None if benchmark.disabled else tmp_path_factory.mktemp("cache")
        if cache and not first:
            processes.run(code, TREE, cache)
        benchmark.pedantic(processes.run, (code, TREE, cache), rounds=rounds)

    return run


@pytest.mark.parametrize("key", processes.IMPORTS)
def bench_import(process, key):
    label, code, _ = processes.IMPORTS[key]
    process(key, label, code, rounds=3)


@pytest.mark.parametrize("key", processes.CALLS)
def bench_second_process(process, key):
    label, call = processes.CALLS[key]
    process(f"{key}-again", f"{label}, compiled before", processes.IMPORT + call, rounds=2)


@pytest.mark.once
@pytest.mark.parametrize("key", processes.CALLS)
def bench_first_call(process, key):
    label, call = processes.CALLS[key]
    label = f"{label}, nothing compiled"
    process(f"{key}-first", label, processes.IMPORT + call, rounds=1, first=True)
