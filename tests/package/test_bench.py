"""The tools that report and compare benchmarks, on small problems: nothing is timed."""

import os
import runpy
import subprocess
import sys
from types import SimpleNamespace

import compare
import floors
import pytest
import report
import results
import tables
from cases import CASES


def test_the_readme_and_the_page_show_the_stored_results():
    files = (report.FOLDER / f"{name}.json" for name in ("benchmarks", "motions"))
    stored = results.Results(*map(results.load, files))
    text = report.README.read_text(encoding="utf-8")
    assert tables.replace(text, tables.page(stored, "readme.md")) == text
    page = (report.FOLDER / "tables.md").read_text(encoding="utf-8")
    assert page == tables.page(stored, "tables.md")
    with pytest.raises(ValueError, match="expected one"):
        tables.replace("no markers", "new")


def test_each_case_has_a_place_in_the_page_and_a_name_of_its_own():
    page = (results.BENCH / "pages" / "tables.md").read_text(encoding="utf-8")
    assert {case.table for case in CASES} == {found[0] for found in tables.TABLE.findall(page)}
    names = [case.name for case in CASES]
    assert len(set(names)) == len(CASES)
    assert not any(set(" ,[]") & set(name) for name in names)
    assert page.count("<!-- floors -->") == 1
    assert {name for floor in floors.ROWS for name in floor[1:3]} | {*floors.BEFORE} <= set(names)


def result(key, seconds):
    """A benchmark as pytest-benchmark stores it."""
    extra = {"table": "calls", "key": key, "whose": "C", "label": key, "x": None, "limit": None}
    extra |= {"units": 100, "threads": 1, "error": None}
    return {"name": key, "param": f"calls-{key}", "stats": {"min": seconds}, "extra_info": extra}


def test_the_best_time_counts_and_floors_are_ratios():
    content = {"machine_info": {"threads": 2}, "datetime": "2026-11-20T07:00:00", "benchmarks": []}
    first = content | {"benchmarks": [result("step", 0.5), result("solve", 0.25)]}
    second = content | {"benchmarks": [result("step", 1.0), result("solve", 0.125)]}
    merged = results.Results(results.merge([first, second]))
    pair = "calls-step", "calls-solve"
    assert [merged.rows[name].rate for name in pair] == [200, 800]
    assert tables.floor(merged, *pair, "≤", 3) == ["4", "≤ 3", "**no**"]
    assert tables.floor(merged, *pair, "≥", 0.2) == ["0.25", "≥ 0.2", "yes"]
    assert tables.floor(merged, "absent", pair[1], "≥", 1) == ["", "≥ 1", ""]
    with pytest.raises(ValueError, match="one machine"):
        results.merge([first, second | {"machine_info": {"threads": 1}}])


def benchmark_disabled(*options):
    given = SimpleNamespace(args=options)
    config = SimpleNamespace(invocation_params=given, option=SimpleNamespace())
    runpy.run_path(str(results.BENCH / "conftest.py"))["pytest_configure"](config)
    return getattr(config.option, "benchmark_disable", False)


@pytest.mark.slow
def test_benchmarks_are_timed_if_an_option_asks_for_it(tmp_path):
    """As users run them, from the folder of the project; the smallest case stands for all."""
    assert benchmark_disabled("-k", "rows")
    assert not benchmark_disabled("--benchmark-only")
    words = "-m pytest bench -k import-suslov_fast -p no:cacheprovider --benchmark-autosave"
    words += " --benchmark-compare"  # with nothing to compare with
    # Without the variables that tell a child it is a worker of this run.
    env = {name: each for name, each in os.environ.items() if not name.startswith("PYTEST_")}
    command = [sys.executable, *words.split(), f"--benchmark-storage={tmp_path}"]
    run = subprocess.run(command, capture_output=True, text=True, cwd=results.BENCH.parent, env=env)
    assert "1 passed" in run.stdout, run.stdout + run.stderr
    (path,) = tmp_path.glob("*/*.json")
    stored = results.load(path)
    assert stored["machine_info"].keys() == {"processor", "threads", "versions"}  # no names
    assert stored["commit_info"].keys() == {"id"}
    (row,) = results.Results(stored).rows.values()
    assert row.key == "import-suslov_fast"
    assert row.seconds > 0


@pytest.mark.compiled
@pytest.mark.slow
def test_two_revisions_are_compared(capfd, monkeypatch):
    """The working tree with itself, with a tiny threshold, in short turns."""
    monkeypatch.setattr(compare, "TURN", 0.005)
    here, case = str(results.BENCH.parent), ["--quick", "-k", "quantities-energy"]
    assert compare.main([here, *case, "--threshold", "1e-9"]) == 1
    assert "1 slower than allowed\n  quantities-energy" in capfd.readouterr().out
    assert compare.ratios([1.0, 2.0, 4.0], [2.0, 2.0, 6.0]) == (1.5, 2.0)
    with pytest.raises(SystemExit, match="no such revision"):
        compare.main([here, "nowhere-at-all"])
