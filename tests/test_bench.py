"""The tools that report and compare benchmarks, on invented results: nothing is timed."""

import json
import os
import runpy
import subprocess
import sys
from types import SimpleNamespace

import compare
import pytest
import report
import results
import tables
from bench_cases import CASES


def test_files_contain_no_host_and_no_user(tmp_path):
    extra = {"table": "last states", "key": "auto", "label": "ours", "whose": "this package"}
    extra |= {"work": 100, "threads": 1, "limit": ["divisions", 2]}
    benchmark = {"name": "b[1]", "fullname": "secret/b", "stats": {"min": 0.25, "max": 0.5}}
    raw = {
        "datetime": "2026-11-20T07:00:00.000000+00:00",
        "machine_info": {"node": "secret", "ours": {"processor": "Abacus", "threads": 2}},
        "commit_info": {"author_name": "secret"},
        "benchmarks": [benchmark | {"extra_info": extra}],
    }
    path = tmp_path / "raw.json"
    path.write_text(json.dumps(raw), encoding="utf-8")
    loaded = results.load(path)
    results.dump(loaded, path)
    assert "secret" not in path.read_text(encoding="utf-8")
    assert results.load(path) == loaded
    assert loaded.rows[0].rate == 400


def test_the_readme_and_the_page_show_the_stored_results():
    stored = results.load(report.FOLDER / "benchmarks.json")
    text = report.README.read_text(encoding="utf-8")
    assert tables.replace(text, tables.summary(stored)) == text
    assert (report.FOLDER / "tables.md").read_text(encoding="utf-8") == tables.everything(stored)
    with pytest.raises(ValueError, match="expected one"):
        tables.replace("no markers", "new")


def test_each_case_has_a_table_and_a_name_of_its_own():
    assert {case.table for case in CASES} == {each.name for each in tables.TABLES}
    names = [case.name for case in CASES]
    assert len(set(names)) == len(CASES)
    assert not any(set(" ,[]") & set(name) for name in names + [case.group for case in CASES])


def benchmark_disabled(*options):
    given = SimpleNamespace(args=options)
    config = SimpleNamespace(invocation_params=given, option=SimpleNamespace())
    runpy.run_path(str(results.BENCH / "conftest.py"))["pytest_configure"](config)
    return getattr(config.option, "benchmark_disable", False)


def test_benchmarks_are_timed_if_an_option_asks_for_it(tmp_path):
    """As users run them, from the folder of the project; the smallest case stands for all."""
    assert benchmark_disabled("-k", "rows")
    assert not benchmark_disabled("--benchmark-only")
    words = "-m pytest bench -k processes-python -p no:cacheprovider --benchmark-autosave"
    words += " --benchmark-compare"  # with nothing to compare with
    # Without the variables that tell a child it is a worker of this run.
    env = {name: each for name, each in os.environ.items() if not name.startswith("PYTEST_")}
    command = [sys.executable, *words.split(), f"--benchmark-storage={tmp_path}"]
    run = subprocess.run(command, capture_output=True, text=True, cwd=results.BENCH.parent, env=env)
    assert run.returncode == 0, run.stdout + run.stderr
    assert "1 passed" in run.stdout
    assert "benchmark 'processes': 1 tests" in run.stdout
    assert len(list(tmp_path.glob("*/*.json"))) == 1


@pytest.mark.compiled
@pytest.mark.slow
def test_two_revisions_are_compared(capfd):
    """The working tree with itself, with a huge threshold, then with a tiny one."""
    here, case = str(results.BENCH.parent), ["-k", "quantities-energy"]
    assert compare.main([here, here, *case, "--threshold", "1e9"]) == 0
    assert compare.main([here, *case, "--threshold", "1e-9"]) == 1
    assert "1 slower than allowed\n  quantities-energy" in capfd.readouterr().out
    assert compare.ratios([1.0, 2.0, 4.0], [2.0, 2.0, 6.0]) == (1.5, 2.0)
    with pytest.raises(SystemExit, match="no such revision"):
        compare.main([here, "nowhere-at-all"])
