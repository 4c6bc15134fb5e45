"""Measure everything, and draw the tables of the README and two charts.

`python bench/report.py` runs the benchmarks in several short passes, takes the best time of each,
and writes `results/benchmarks.json`, `results/speed.png` and `results/scaling.png`; with files as
arguments (of this script, or of `pytest bench --benchmark-json`) it draws those and measures
nothing. `--write` also replaces the tables in README.md.

Passes are short and follow each other because a shared machine is slow for seconds at a time:
what is measured once may have been measured then.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

BENCH = Path(__file__).parent
RESULTS = BENCH / "results"
README = BENCH.parent / "README.md"
BEGIN, END = "<!-- begin of the tables -->", "<!-- end of the tables -->"
PASSES = 5
MACHINE = ("processor", "cores", "threads", "system", "versions")
BASE = "C, (ds2) as printed"
DIVIDER = "divisions"


def run_pytest(target, tests, *options, **keywords):
    """Run benchmarks once; their JSON is written to `target`. Keywords are those of `run`."""
    command = [
        *(sys.executable, "-m", "pytest", *tests, "--benchmark-enable", "--benchmark-only"),
        *("--benchmark-min-rounds=3", "--benchmark-max-time=0.1", "--benchmark-columns=min"),
        *(f"--benchmark-json={target}", "--rootdir", str(BENCH.parent)),
        *("-c", str(BENCH.parent / "pyproject.toml"), *options),
    ]
    # The peers that solve linear systems are measured on one thread, like the others beside them.
    environment = {"OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"} | keywords.pop("env", {})
    return subprocess.run(command, env=os.environ | environment, **keywords)


def measure(passes):
    """The results of several passes over all benchmarks."""
    results = []
    with tempfile.TemporaryDirectory() as folder:
        for k in range(passes):
            print(f"pass {k + 1} of {passes}", flush=True)
            target = Path(folder) / f"{k}.json"
            run_pytest(target, [str(BENCH)], "-q", "--benchmark-quiet", check=True)
            results.append(load(target))
    return merge(results)


def load(path):
    """Results from a file of this script, or of pytest-benchmark."""
    content = json.loads(Path(path).read_text(encoding="utf-8"))
    return content if "passes" in content else trim(content)


def trim(raw):
    """What of pytest-benchmark's output is kept: nothing that tells whose machine it was."""
    return {
        "date": raw["datetime"][:10],
        "machine": {key: raw["machine_info"][key] for key in MACHINE if key in raw["machine_info"]},
        "passes": 1,
        "benchmarks": [
            {
                "name": short_name(each["fullname"]),
                "seconds": each["stats"]["min"],
                **each["extra_info"],
            }
            for each in raw["benchmarks"]
        ],
    }


def short_name(fullname):
    """The name of a test without the folders of its file."""
    path, separator, test = fullname.partition("::")
    return path.rsplit("/", 1)[-1] + separator + test


def merge(results):
    """The best time of each benchmark; all come from one machine with one set of versions."""
    first = results[0]
    best = {}
    for result in results:
        if result["machine"] != first["machine"]:
            raise ValueError("expected results of one machine and one set of versions")
        for each in result["benchmarks"]:
            known = best.get(each["name"])
            if known is None or each["seconds"] < known["seconds"]:
                best[each["name"]] = each
    return {
        "date": max(result["date"] for result in results),
        "machine": first["machine"],
        "passes": sum(result["passes"] for result in results),
        "benchmarks": list(best.values()),
    }


class Rows:
    """Benchmarks by table, with their rates and what share of the machine's limits they reach."""

    def __init__(self, results):
        self.machine, self.date = results["machine"], results["date"]
        self.passes = results["passes"]
        self._benchmarks = results["benchmarks"]

    def of(self, table, threads=None):
        """Rows of a table, fastest first; of all threads (or as many as the row has), or of one."""
        rows = self.every(table)
        if threads is None:
            most = {}
            for row in rows:
                most[row["row"]] = max(most.get(row["row"], 0), row["threads"])
            return [row for row in rows if row["threads"] == most[row["row"]]]
        return [row for row in rows if row["threads"] == threads]

    def every(self, table):
        """All rows of a table, fastest first."""
        rows = [each for each in self._benchmarks if each.get("table") == table]
        return sorted(rows, key=rate, reverse=True)

    def limit(self, what, threads):
        """Divisions or bytes per second on so many threads, or None where not measured.

        Who gets more than the benchmark of the limit shows that it was measured at a bad moment:
        the most that any got is the limit.
        """
        if not any(row["row"] == what for row in self.of("limits", threads)):
            return None
        rows = [row for row in self._benchmarks if row.get("threads") == threads]
        used = [rate(row) * row["limit"][1] for row in rows if (row.get("limit") or [0])[0] == what]
        return max([*used, *(rate(row) for row in rows if row["row"] == what)])

    def share(self, row):
        """How much of its limit a row reaches, or None."""
        if not row.get("limit"):
            return None
        what, count = row["limit"]
        limit = self.limit(what, row["threads"])
        return limit and rate(row) * count / limit

    def rate_of(self, table, name):
        """The rate of one row, or None."""
        return next((rate(row) for row in self.of(table) if row["row"] == name), None)


def rate(row):
    """Units of work per second."""
    return row["work"] / row["seconds"]


def figure(value, digits=3):
    """A number in so many digits, without exponent."""
    return "" if value is None else f"{float(f'{value:.{digits}g}'):,.10g}"


def percent(value):
    """A share in percent."""
    return "" if value is None else f"{100 * value:.0f} %"


def error(row):
    """The error of a row."""
    return "" if row.get("error") is None else f"{row['error']:.0e}"


def markdown(header, rows):
    """A table whose columns but the first are numbers."""
    lines = ["| " + " | ".join(header) + " |", "|---|" + "---:|" * (len(header) - 1)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def named(row, threads):
    """The name of a row, and that it has one thread where others have more."""
    return row["row"] + (", one thread" if row["threads"] == 1 < threads else "")


def table_last(rows, threads):
    """Last states."""
    base, limit = rows.rate_of("last states", BASE), rows.limit(DIVIDER, threads)
    lines = []
    for row in rows.of("last states"):
        divisions = row["limit"][1] if row.get("limit") else None
        ratio = figure(rate(row) / base, 2) if base else ""
        lines.append(
            [
                *(named(row, threads), figure(rate(row) / 1e9), ratio),
                *(figure(divisions), percent(rows.share(row)), error(row)),
            ]
        )
    if limit:
        ratio = figure(limit / base, 2) if base else ""
        lines.append(
            ["*limit: one division per step*", figure(limit / 1e9), ratio, "1", "100 %", ""]
        )
        lines.sort(key=lambda line: -float(line[1].replace(",", "")))
    header = ["", "1e9 steps/s", "of C as printed", "divisions per step", "of the divider", "error"]
    return markdown(header, lines)


def table_all(rows, threads):
    """All states."""
    lines = [
        [
            *(named(row, threads), figure(rate(row) / 1e9), figure(16 * rate(row) / 1e9)),
            *(percent(rows.share(row)), error(row)),
        ]
        for row in rows.of("all states")
    ]
    limits = {kind: rows.limit(f"bytes, {kind} stores", threads) for kind in ("streaming", "plain")}
    for kind, limit in limits.items():
        if limit:
            share = percent(limits["streaming"] and limit / limits["streaming"])
            lines.append(
                [f"*limit: {kind} stores*", figure(limit / 16e9), figure(limit / 1e9), share, ""]
            )
    lines.sort(key=lambda line: -float(line[1].replace(",", "")))
    return markdown(["", "1e9 states/s", "GB/s", "of streaming stores", "error"], lines)


def table_one_orbit(rows, threads):
    """All states of one trajectory."""
    lines = [
        [named(row, threads), figure(rate(row) / 1e9), percent(rows.share(row)), error(row)]
        for row in rows.of("one orbit")
    ]
    return markdown(["", "1e9 states/s", "of streaming stores", "error"], lines)


def table_simple(rows, threads, table, unit):
    """Millions per second, and errors."""
    lines = [[named(row, threads), figure(rate(row) / 1e6), error(row)] for row in rows.of(table)]
    return markdown(["", f"1e6 {unit}/s", "error"], lines)


def table_nd(rows, threads):
    """Nanoseconds per step, by components."""
    found = rows.of("nd", 1) + (rows.of("nd", threads) if threads > 1 else [])
    sizes = sorted({row["components"] for row in found})
    by_name = {}
    for row in found:
        name = row["row"] + (f", {row['threads']} threads" if row["threads"] > 1 else "")
        by_name.setdefault(name, {})[row["components"]] = row
    lines = []
    for name, cells in sorted(by_name.items(), key=lambda item: -rate(item[1][max(item[1])])):
        times = [figure(1e9 / rate(cells[size])) if size in cells else "" for size in sizes]
        lines.append([name, *times, f"{max(cell['error'] for cell in cells.values()):.0e}"])
    return markdown(["n - 1 =", *map(str, sizes), "largest error"], lines)


def table_calls(rows):
    """Microseconds per call."""
    lines = [[row["row"], figure(1e6 / rate(row))] for row in rows.of("calls")]
    return markdown(["a call", "µs"], lines)


def table_starts(rows):
    """Seconds per process, and as a multiple of `import numba`."""
    base = rows.rate_of("starts", "`import numba`")
    lines = [
        [row["row"], figure(1 / rate(row), 2), figure(base / rate(row), 2) if base else ""]
        for row in rows.of("starts")
    ]
    return markdown(["a process", "seconds", "of `import numba`"], lines)


def caption(rows):
    """Machine, versions, date and threads, in one line."""
    versions = ", ".join(f"{name} {value}" for name, value in rows.machine["versions"].items())
    threads = spelled(rows.machine["threads"])
    return f"{rows.machine['processor']}, {threads}, {rows.date}; {versions}"


def spelled(threads):
    """So many threads."""
    return f"{threads} thread" + "s" * (threads > 1)


def tables(results):
    """All tables in Markdown, with the markers around them."""
    rows = Rows(results)
    threads = rows.machine["threads"]
    sections = [
        f"Measured on {caption(rows)}. Best of {rows.passes} interleaved passes. Errors are the "
        "largest relative ones of 64 trajectories (8 in n dimensions) against long doubles. A "
        "limit is the most that its own benchmark, or any other, got of it. "
        f"All rows on {spelled(threads)} unless they say otherwise.",
        "**Last states** of 65,536 trajectories after 1000 steps; slower peers do a part of it. A "
        "share of the divider is that of the divisions which the form needs; what needs fewer than "
        "one per step can pass the limit of one per step.",
        table_last(rows, threads),
        "**All states** of 65,536 trajectories and 256 steps, 16 bytes each:",
        table_all(rows, threads),
        "**All states of one trajectory**, 5,000,000 of them:",
        table_one_orbit(rows, threads),
        "**One far state by the closed form**, for n = 1,000,000; the error is that for n = 1000:",
        table_simple(rows, threads, "jumps", "states"),
        "**The continuous motion** to t = 200, the time of those 1000 steps: what one would do "
        "without the map. Errors are against the motion, not the map:",
        table_simple(rows, threads, "motion", "trajectories"),
        "**In n dimensions**, nanoseconds per step of one trajectory, 512 trajectories, one thread "
        "unless said otherwise:",
        table_nd(rows, threads),
        "**Small calls**, and **processes** from start to end, with what an earlier one compiled:",
        table_calls(rows),
        table_starts(rows),
    ]
    return "\n\n".join([BEGIN, *sections, END])


def replace(text, new):
    """The text with new tables between its markers."""
    if text.count(BEGIN) != 1 or text.count(END) != 1:
        raise ValueError(f"expected one {BEGIN!r} and one {END!r}")
    head, rest = text.split(BEGIN)
    return head + new + rest.split(END)[1]


def main():
    """Measure or load, print, draw, and write if asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", help="draw these results instead of measuring")
    parser.add_argument("--write", action="store_true", help="replace the tables in README.md")
    parser.add_argument("--passes", type=int, default=PASSES, help=f"how often ({PASSES})")
    options = parser.parse_args()
    if options.files:
        results = merge([load(path) for path in options.files])
    else:
        results = measure(options.passes)
        RESULTS.mkdir(exist_ok=True)
        text = json.dumps(results, indent=1, ensure_ascii=False)
        (RESULTS / "benchmarks.json").write_text(text + "\n", encoding="utf-8")
    text = tables(results)
    print(text)
    import charts  # needs matplotlib

    charts.draw(Rows(results), RESULTS)
    if options.write:
        README.write_text(replace(README.read_text(encoding="utf-8"), text), encoding="utf-8")


if __name__ == "__main__":
    main()
