"""The tools that report and compare benchmarks, on made-up results: nothing is timed here."""

import json
import shutil

import charts
import compare
import pytest
import report


def row(name, seconds, table="last states", **more):
    defaults = {"row": name, "table": table, "unit": "steps", "work": 1_000_000, "threads": 2}
    return {"name": f"bench.py::{name}", "seconds": seconds, "error": 1e-15} | defaults | more


def results(*rows, date="2026-11-20", passes=1, **machine):
    machine = {
        "processor": "Abacus",
        "cores": 2,
        "threads": 2,
        "versions": {"numba": "1"},
    } | machine
    return {"date": date, "machine": machine, "passes": passes, "benchmarks": list(rows)}


@pytest.fixture
def raw():
    """What pytest-benchmark writes, as far as it matters."""
    stats = {"min": 0.25, "max": 0.5, "data": [0.25, 0.5]}
    extra = {"table": "last states", "row": "ours", "work": 100, "threads": 1}
    return {
        "datetime": "2026-11-20T07:00:00.000000+00:00",
        "machine_info": {"node": "secret", "user": "secret", "processor": "Abacus", "cores": 2},
        "commit_info": {"author_name": "secret"},
        "benchmarks": [
            {"fullname": "secret/bench/bench_a.py::b[1/2]", "stats": stats, "extra_info": extra}
        ],
    }


def test_what_is_kept_names_no_machine_and_no_person(raw):
    kept = report.trim(raw)
    assert "secret" not in json.dumps(kept)
    assert kept["machine"] == {"processor": "Abacus", "cores": 2}
    assert kept["date"] == "2026-11-20"
    assert kept["benchmarks"] == [
        {"name": "bench_a.py::b[1/2]", "seconds": 0.25} | raw["benchmarks"][0]["extra_info"]
    ]


def test_files_of_both_kinds_are_read(raw, tmp_path):
    path = tmp_path / "results.json"
    path.write_text(json.dumps(raw), encoding="utf-8")
    trimmed = report.load(path)
    assert trimmed == report.trim(raw)
    path.write_text(json.dumps(trimmed), encoding="utf-8")
    assert report.load(path) == trimmed


def test_merging_takes_the_best_time_of_each():
    merged = report.merge(
        [
            results(row("a", 2.0), row("b", 5.0), passes=2),
            results(row("a", 3.0), row("b", 4.0, error=1e-9), row("c", 1.0), date="2026-11-21"),
        ]
    )
    assert [(each["row"], each["seconds"]) for each in merged["benchmarks"]] == [
        ("a", 2.0),
        ("b", 4.0),
        ("c", 1.0),
    ]
    assert merged["benchmarks"][1]["error"] == 1e-9
    assert merged["passes"] == 3
    assert merged["date"] == "2026-11-21"


def test_machines_are_not_mixed():
    with pytest.raises(ValueError, match="one machine"):
        report.merge([results(row("a", 1.0)), results(row("a", 1.0), processor="Slide rule")])


FULL = results(
    row("**suslov_fast**", 1e-4, limit=["divisions", 1]),
    row("**suslov_fast**", 1.9e-4, limit=["divisions", 1], threads=1),
    row("C, (ds2) as printed", 2e-4, limit=["divisions", 2]),
    row("Python", 1.0, threads=1),
    row("ours, stored", 1e-3, "all states", limit=["bytes, streaming stores", 16]),
    row("divisions", 1e-4, "limits", work=2_000_000),
    row("divisions", 1e-4, "limits", work=1_000_000, threads=1),
    row("bytes, streaming stores", 1e-3, "limits", work=64_000_000),
    row("bytes, plain stores", 1e-3, "limits", work=32_000_000),
    row("ours, nd", 1e-3, "nd", components=2, threads=1),
    row("ours, nd", 1e-2, "nd", components=4, threads=1),
    row("one step", 1e-5, "calls", work=1, threads=1),
    row("`import numba`", 0.2, "starts", work=1, threads=1, baseline=True),
    row("first result", 0.5, "starts", work=1, threads=1),
    row("dense", 1e-3, "one orbit"),
    row("jump", 1e-3, "jumps"),
    row("flow", 1e-3, "motion"),
    *(row("serial", 1e-4, "batch", x=x, threads=1, work=x) for x in (1, 10, 100)),
    *(row("parallel", 5e-5 + 1e-3 / x, "batch", x=x, work=x) for x in (1, 10, 100)),
    *(row('order "F"', 1e-4, "saved", x=x) for x in (1, 10)),
    *(row("3D", 1e-4 / threads, "threads", x=threads, threads=threads) for threads in (1, 2)),
)


def cells(text, name):
    """The cells of the line that begins with a name."""
    (line,) = [line for line in text.splitlines() if line.startswith(f"| {name} |")]
    return [cell.strip() for cell in line.split("|")[2:-1]]


def test_tables():
    text = report.tables(FULL)
    # 1e10 steps per second, of 2e10 divisions.
    assert cells(text, "**suslov_fast**") == ["10", "2", "1", "50 %", "1e-15"]
    assert cells(text, "C, (ds2) as printed") == ["5", "1", "2", "50 %", "1e-15"]
    assert cells(text, r"*limit: one division per step*") == ["20", "4", "1", "100 %", ""]
    # Who loses stays, and says so if it has one thread.
    assert cells(text, "Python, one thread")[:2] == ["0.001", "0.0002"]
    # 1e9 states of 16 bytes, of 64e9 bytes.
    assert cells(text, "ours, stored") == ["1", "16", "25 %", "1e-15"]
    assert cells(text, "ours, nd") == ["1", "10", "1e-15"]
    assert cells(text, "one step") == ["10"]
    assert cells(text, "first result") == ["0.5", "2.5"]
    for fact in ("Abacus", "numba 1", "2026-11-20", "2 threads"):
        assert fact in text


def test_what_passes_a_limit_raises_it():
    rows = [
        row("divisions", 1e-4, "limits"),
        row("C", 5e-5, limit=["divisions", 2]),
        row("ours", 1e-4, limit=["divisions", 1]),
        row("jump", 1e-6),
    ]
    text = report.tables(results(*rows))
    assert [cells(text, name)[3] for name in ("C", "ours", "jump")] == ["100 %", "25 %", ""]


def test_tables_of_a_part_of_the_benchmarks():
    """Without peers and limits there is nothing to compare with, and nothing fails."""
    assert cells(report.tables(results(row("ours", 1e-4))), "ours") == ["10", "", "", "", "1e-15"]


def test_tables_replace_those_between_the_markers():
    old = f"before\n{report.BEGIN}\nold\n{report.END}\nafter\n"
    new = report.replace(old, report.tables(FULL))
    assert new.startswith("before\n" + report.BEGIN)
    assert new.endswith(report.END + "\nafter\n")
    assert "old" not in new.splitlines()
    assert report.replace(new, report.tables(FULL)) == new
    with pytest.raises(ValueError, match="expected one"):
        report.replace("no markers", report.tables(FULL))


def test_the_readme_shows_the_results_that_are_kept():
    kept = report.load(report.RESULTS / "benchmarks.json")
    assert set(kept["machine"]) == set(report.MACHINE)
    text = report.README.read_text(encoding="utf-8")
    assert report.replace(text, report.tables(kept)) == text


@pytest.mark.parametrize("given", [FULL, results(row("ours", 1e-4))], ids=["full", "part"])
def test_charts(given, tmp_path):
    charts.draw(report.Rows(given), tmp_path)
    for name in ("speed.png", "scaling.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")


def test_the_crossing_is_where_parallel_stays_faster():
    assert charts.crossing(report.Rows(FULL).every("batch")) == 100


@pytest.mark.parametrize(
    ("b", "verdict"),
    [
        ({"x": 1.0, "y": 2.0}, []),
        ({"x": 1.09, "y": 2.0}, []),
        ({"x": 1.11, "y": 1.0}, ["x"]),
        ({"x": 0.5, "y": 9.0}, ["y"]),
        ({"y": 2.0}, ["x"]),  # it ran with A alone
        ({"x": 1.0, "y": 2.0, "new": 9.0}, []),
    ],
)
def test_verdict(b, verdict):
    a = {"x": 1.0, "y": 2.0}
    assert compare.slower(a, b, threshold=1.1) == verdict
    text = compare.table(a, b, threshold=1.1)
    assert [line.split()[0] for line in text.splitlines() if line.endswith("SLOWER")] == verdict


@pytest.fixture
def run(monkeypatch):
    """`compare.py HEAD .` with made-up times, round by round, for A and B."""

    def run(a, b, *options):
        times, calls = {"A": iter(a), "B": iter(b)}, []

        def measure(label, tree, folder, select=None, names=None):
            calls.append((label, names))
            return next(times[label])

        monkeypatch.setattr(compare, "measure", measure)
        monkeypatch.setattr("sys.argv", ["compare.py", ".", ".", "--rounds", "2", *options])
        return compare.main(), calls

    return run


def test_equal_revisions_pass(run, capsys):
    status, calls = run([{"x": 1.0}, {"x": 1.3}], [{"x": 1.4}, {"x": 1.05}])
    assert status == 0
    assert [label for label, _ in calls] == ["A", "B", "B", "A"]
    assert "1.050" in capsys.readouterr().out


def test_a_slower_revision_fails_after_more_rounds(run):
    status, calls = run([{"x": 1.0, "y": 1.0}] * 6, [{"x": 1.5, "y": 1.0}] * 6)
    assert status == 1
    assert len(calls) == 12
    assert calls[-1][1] == ["x"]


def test_bad_luck_is_measured_away(run):
    status, calls = run([{"x": 1.0}] * 6, [{"x": 1.5}] * 2 + [{"x": 1.02}])
    assert status == 0
    assert len(calls) == 6


def test_the_threshold_is_an_option(run):
    assert run([{"x": 1.0}] * 2, [{"x": 1.5}] * 2, "--threshold", "2")[0] == 0


def test_a_lost_benchmark_fails(run):
    assert run([{"x": 1.0, "y": 1.0}] * 2, [{"x": 1.0}] * 2)[0] == 1


@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
def test_unknown_revisions_are_named():
    with pytest.raises(SystemExit, match="no such revision: nowhere-at-all"):
        compare.resolve("nowhere-at-all")
