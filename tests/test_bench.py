"""The tools that report and compare benchmarks, on made-up results: nothing is timed here."""

import ast
import graphlib
import json
import shutil
from pathlib import Path

import charts
import compare
import numpy as np
import pytest
import report
import results
import revision
import tables
from results import Limit, Row, Table, Whose


def row(key, seconds, table=Table.LAST, whose=Whose.OURS, **more):
    defaults = {"label": key, "unit": "steps", "work": 1_000_000, "threads": 2, "error": 1e-15}
    values = defaults | more
    name = f"bench.py::{table.value}[{key}-{whose.value}-{values['threads']}-{values.get('x')}]"
    return Row(name=name, key=key, seconds=seconds, table=table, whose=whose, **values)


def made(*rows, date="2026-11-20", passes=1, **machine):
    machine = {
        "processor": "Abacus",
        "cores": 2,
        "threads": 2,
        "versions": {"numba": "1"},
    } | machine
    return results.Results(date=date, machine=machine, passes=passes, rows=rows)


@pytest.fixture
def raw():
    """What pytest-benchmark writes, as far as it matters."""
    stats = {"min": 0.25, "max": 0.5, "data": [0.25, 0.5]}
    extra = {"table": "last states", "key": "auto", "label": "ours", "whose": "this package"}
    extra |= {"unit": "steps", "work": 100, "threads": 1, "limit": ["divisions", 2]}
    return {
        "datetime": "2026-11-20T07:00:00.000000+00:00",
        "machine_info": {"node": "secret", "user": "secret", "processor": "Abacus", "cores": 2},
        "commit_info": {"author_name": "secret"},
        "benchmarks": [
            {"fullname": "secret/bench/bench_a.py::b[1/2]", "stats": stats, "extra_info": extra}
        ],
    }


@pytest.fixture
def loaded(raw, tmp_path):
    path = tmp_path / "raw.json"
    path.write_text(json.dumps(raw), encoding="utf-8")
    return results.load(path)


def test_what_is_kept_names_no_machine_and_no_person(loaded, tmp_path):
    results.dump(loaded, tmp_path / "kept.json")
    assert "secret" not in (tmp_path / "kept.json").read_text(encoding="utf-8")
    assert loaded.machine == {"processor": "Abacus", "cores": 2}
    assert loaded.date == "2026-11-20"
    (kept,) = loaded.rows
    assert kept.name == "bench_a.py::b[1/2]"
    assert kept.rate == 400
    assert kept.table is Table.LAST
    assert kept.whose is Whose.OURS
    assert kept.limit == (Limit.DIVISIONS, 2)


def test_what_is_kept_is_read_again(loaded, tmp_path):
    results.dump(loaded, tmp_path / "kept.json")
    assert results.load(tmp_path / "kept.json") == loaded


def test_merging_takes_the_best_time_of_each():
    merged = results.merge(
        [
            made(row("a", 2.0), row("b", 5.0), passes=2),
            made(row("a", 3.0), row("b", 4.0, error=1e-9), row("c", 1.0), date="2026-11-21"),
        ]
    )
    assert [(each.key, each.seconds) for each in merged.rows] == [
        ("a", 2.0),
        ("b", 4.0),
        ("c", 1.0),
    ]
    assert merged.rows[1].error == 1e-9
    assert merged.passes == 3
    assert merged.date == "2026-11-21"


def test_machines_are_not_mixed():
    with pytest.raises(ValueError, match="one machine"):
        results.merge([made(row("a", 1.0)), made(row("a", 1.0), processor="Slide rule")])


MACHINE = {"whose": Whose.MACHINE, "table": Table.LIMITS}
IN_TURNS = MACHINE | {"label": "less", "limit": (Limit.STREAMING, 1), "share": 0.75}
SPLIT = {"table": Table.OBSERVABLES, "limit": (Limit.COPY, 24)}
FULL = made(
    row("auto", 1e-4, limit=(Limit.DIVISIONS, 1)),
    row("auto", 1.9e-4, limit=(Limit.DIVISIONS, 1), threads=1),
    row("c-printed", 2e-4, whose=Whose.C, limit=(Limit.DIVISIONS, 2)),
    row("Python", 1.0, whose=Whose.OTHER, threads=1),
    row("stored", 1e-3, Table.SAVED, limit=(Limit.STREAMING, 16), x=1),
    row(Limit.DIVISIONS, 1e-4, work=2_000_000, **MACHINE),
    row(Limit.DIVISIONS, 1e-4, threads=1, **MACHINE),
    row(Limit.STREAMING, 1e-3, work=64_000_000, **MACHINE | {"label": "the most"}),
    row(Limit.PLAIN, 1e-3, work=32_000_000, **IN_TURNS),
    row(Limit.COPY, 1e-3, work=48_000_000, **MACHINE),
    row(Limit.NEW_COPY, 1e-3, work=12_000_000, threads=1, **MACHINE),
    row("energy", 1e-3, **SPLIT),
    row("energy", 2e-3, threads=1, **SPLIT),
    row("energy", 4e-3, threads=1, whose=Whose.NUMPY, **SPLIT),
    row("rank2", 1e-3, Table.ND, x=2, threads=1),
    row("rank2", 1e-2, Table.ND, x=4, threads=1),
    row("c-rank2", 1e-2, Table.ND, Whose.C, x=4, threads=1),
    row("one step", 1e-5, Table.CALLS, work=1, threads=1),
    row("import-numba", 0.2, Table.STARTS, Whose.OTHER, work=1, threads=1),
    row("first", 0.5, Table.STARTS, work=1, threads=1),
    row("jump", 1e-3, Table.JUMPS),
    row("flow", 1e-3, Table.MOTION, unit="trajectories"),
    *(row(key, 1e-4, Table.BATCH, x=x, work=x) for x in (1, 10, 100) for key in ("auto", "other")),
    *(row("auto", 1e-3, Table.FEW, limit=(Limit.STREAMING, 16), x=x) for x in (1, 2)),
    *(row("auto", 1e-4 * x, Table.EVERY, x=x) for x in (1, 10)),
    *(row("exact", 1e-4, Table.STEPS, x=x) for x in (1, 10)),
    *(row("last", 1e-4 / threads, Table.THREADS, x=threads, threads=threads) for threads in (1, 2)),
)


def cells(text, name):
    """The cells of the line that begins with a name."""
    (line,) = [line for line in text.splitlines() if line.startswith(f"| {name} |")]
    return [cell.strip() for cell in line.split("|")[2:-1]]


def test_last_states():
    text = tables.last_states(FULL)
    # 1e10 steps per second, of 2e10 divisions.
    assert cells(text, "**suslov_fast**, auto") == ["10", "2", "1", "50 %", "1e-15"]
    assert cells(text, "c-printed") == ["5", "1", "2", "50 %", "1e-15"]
    assert cells(text, r"*limit: one division per step*") == ["20", "4", "1", "100 %", ""]
    # Who loses stays, and says so if it has one thread.
    assert cells(text, "Python, one thread")[:2] == ["0.001", "0.0002"]


def test_the_rows_of_the_readme():
    text = tables.headline(FULL)
    assert [line.split("|")[1].strip() for line in text.splitlines()[2:]] == [
        "**suslov_fast**, auto",
        "c-printed",
    ]
    assert cells(text, "**suslov_fast**, auto") == ["10", "2", "1e-15"]
    faster = made(*FULL.rows, row("c-tricks", 5e-5, whose=Whose.C))
    assert cells(tables.headline(faster), "c-tricks") == ["20", "4", "1e-15"]
    kept = results.load(report.RESULTS / "benchmarks.json")
    assert tables.headline(kept).count("\n") == 6, "five rows"


def test_saved_states():
    text = tables.saved_states(FULL)
    # 1e9 states of 16 bytes, of 64e9 bytes.
    assert cells(text, "**suslov_fast**, stored") == ["1", "16", "25 %", "1e-15"]
    assert cells(text, "*limit: the most*") == ["4", "64", "100 %", ""]
    assert cells(text, "*limit: less*") == ["2", "32", "75 %", ""], "measured in turns"
    assert cells(tables.few_orbits(FULL), "**suslov_fast**, auto") == ["25 %", "25 %"]


def test_observables():
    # 1, 2 and 4 ns; 24e9 of 48e9 bytes per second, and of 12e9.
    found = cells(tables.observables(FULL), "energy")
    assert found == ["1", "2", "4", "4", "2", "50 %", "2", "1e-15"]


def test_tables_with_columns():
    text = tables.dimensions(FULL)
    assert cells(text, "**suslov_fast**, rank2, one thread") == ["1", "10", "1e-15"]
    assert cells(text, "c-rank2, one thread") == ["", "10", "1e-15"]
    assert cells(tables.save_every(FULL), "**suslov_fast**, auto") == ["0.1", "1"]


def test_calls_and_processes():
    assert cells(tables.calls(FULL), "one step") == ["10"]
    assert cells(tables.starts(FULL), "first") == ["0.5", "2.5"]


def test_all_tables_tell_their_conditions():
    for text in (tables.summary(FULL), tables.everything(FULL)):
        for fact in ("Abacus", "numba 1", "2026-11-20", "2 threads"):
            assert fact in text


def test_what_passes_a_limit_raises_it():
    rows = [
        row(Limit.DIVISIONS, 1e-4, **MACHINE),
        row("C", 5e-5, limit=(Limit.DIVISIONS, 2)),
        row("ours", 1e-4, limit=(Limit.DIVISIONS, 1)),
        row("jump", 1e-6),
    ]
    found = made(*rows)
    assert [found.share(each) for each in rows[1:]] == [1, 0.25, None]


def test_tables_of_a_part_of_the_benchmarks():
    """Without peers and limits there is nothing to compare with, and nothing fails."""
    part = made(row("ours", 1e-4))
    assert cells(tables.everything(part), "**suslov_fast**, ours") == ["10", "", "", "", "1e-15"]
    assert "a call" not in tables.everything(part)


def test_tables_replace_those_between_the_markers():
    old = f"before\n{tables.BEGIN}\nold\n{tables.END}\nafter\n"
    new = tables.replace(old, tables.summary(FULL))
    assert new.startswith("before\n" + tables.BEGIN)
    assert new.endswith(tables.END + "\nafter\n")
    assert "old" not in new.splitlines()
    assert tables.replace(new, tables.summary(FULL)) == new
    with pytest.raises(ValueError, match="expected one"):
        tables.replace("no markers", tables.summary(FULL))


def test_the_pages_show_the_results_that_are_kept():
    kept = results.load(report.RESULTS / "benchmarks.json")
    assert set(kept.machine) == set(results.MACHINE)
    text = report.README.read_text(encoding="utf-8")
    assert tables.replace(text, tables.summary(kept)) == text
    page = (report.RESULTS / "tables.md").read_text(encoding="utf-8")
    assert page == tables.everything(kept)


@pytest.mark.parametrize("given", [FULL, made(row("ours", 1e-4))], ids=["full", "part"])
def test_charts(given, tmp_path):
    charts.draw(given, tmp_path)
    drawn = {path.name for path in tmp_path.iterdir()}
    assert drawn >= {"speed.png", "scaling.png"}
    assert ("observables.png" in drawn) == (given is FULL)
    for path in tmp_path.iterdir():
        assert path.read_bytes().startswith(b"\x89PNG")


def test_no_tool_imports_one_that_imports_it():
    """Measuring, results, tables, charts, report: in one direction."""
    folder = Path(report.__file__).parent
    below = {}
    for path in folder.glob("*.py"):
        tree = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        names = [n.module for n in tree if isinstance(n, ast.ImportFrom) and n.module]
        tree = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        names += [a.name for n in tree if isinstance(n, ast.Import) for a in n.names]
        below[path.stem] = {name for name in names if (folder / f"{name}.py").exists()}
    list(graphlib.TopologicalSorter(below).static_order())  # raises on a circle


def old_iterate(body, omega0, eps, steps, *, save_every=1, order="C", out=None):
    """`iterate` of version 0.1, as far as shapes go: (..., n_saved, D)."""
    states = np.arange(steps + 1.0)[:, None] + np.asarray(omega0)[..., None, :]
    if out is None:
        out = np.empty(states.shape, order=order)
    assert out.shape == states.shape
    assert out.flags.f_contiguous
    out[...] = states
    return out


def test_version_0_1_is_called_in_its_own_shapes(monkeypatch):
    monkeypatch.setattr(revision.suslov_fast, "iterate", old_iterate)
    monkeypatch.setattr(revision, "TIME_FIRST", False)
    omega0 = np.array([[0.0, 0.5], [10.0, 10.5], [20.0, 20.5]])
    found = revision.iterate(None, omega0, 0.1, 4, out=revision.saved_memory(5, 3))
    expected = np.arange(5.0)[:, None, None] + omega0
    assert (revision.time_first(found) == expected).all()
    one = revision.time_first(revision.iterate(None, omega0, 0.1, 4)[0])
    assert (one == expected[:, 0]).all()


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

        def measure(label, tree, folder, *options, names=None):
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
