"""Options of pytest-benchmark, and what its files say of the machine."""

import os

# Peers that solve linear equations by NumPy use one thread, as the rows beside them do.
os.environ |= {"OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}

import pytest


def pytest_configure(config):
    """Run benchmarks once, without timing, unless an option of pytest-benchmark is given."""
    given = [*config.invocation_params.args, *os.environ.get("PYTEST_ADDOPTS", "").split()]
    if not any(str(option).startswith("--benchmark") for option in given):
        config.option.benchmark_disable = True


@pytest.hookimpl(tryfirst=True)  # before some of the cases are chosen
def pytest_collection_modifyitems(config, items):
    """Leave out cases that differ from others in size or problem alone, unless they are timed."""
    if config.option.benchmark_disable:
        kept = {}
        for item in items:
            is_case = getattr(item, "originalname", None) == "bench_case"
            kept.setdefault(_kind(item.callspec.params["case"]) if is_case else item.nodeid, item)
        chosen = {*kept.values()}
        config.hook.pytest_deselected(items=[item for item in items if item not in chosen])
        items[:] = [item for item in items if item in chosen]


def _kind(case):
    """Return what one small case stands for: a function of a peer, a kind of process, or a row.

    If Numba compiles the functions of a module for seconds, the module stands for them all.
    """
    if case.table == "processes":
        return case.key.rpartition("-")[2]
    peers = [each for each in case.make.args if isinstance(each, str) and "." in each]
    if peers and peers[0].startswith(("numba_loops.", "own_loops.")):
        return peers[0].partition(".")[0]
    return peers[0] if peers else (case.table, case.key)


@pytest.hookimpl(trylast=True)  # below those tables
def pytest_terminal_summary(terminalreporter, config):
    """Add the column that the tables of pytest-benchmark lack: units of work in a second."""
    session = getattr(config, "_benchmarksession", None)
    timed = [each for each in session.benchmarks if each] if session else []
    if timed:
        terminalreporter.section("units of work per second, of the fastest round")
    for each in timed:
        rate = f"{each.extra_info['units_per_second']:16,.0f} {each.extra_info['unit']}s/s"
        terminalreporter.write_line(f"{rate:40}{each.extra_info['whose']:14}{each.param}")


def pytest_benchmark_update_machine_info(machine_info):
    import results  # with Numba, which not every process of `pytest -n` needs

    processor = machine_info["cpu"].get("brand_raw", machine_info["machine"])
    machine_info.clear()  # of the name of the host
    machine_info.update(results.machine(processor))


def pytest_benchmark_update_json(output_json):
    output_json["commit_info"] = {"id": output_json["commit_info"]["id"]}  # no names of branches
    for each in output_json["benchmarks"]:
        each["stats"].pop("data", None)  # the time of each round
        each["params"] = {"case": each["param"]}
