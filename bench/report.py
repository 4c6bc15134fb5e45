"""Run all benchmarks, and write tables and a chart.

`python bench/report.py` runs the benchmarks in several short passes, takes the best time of each,
and writes to `results/`: `benchmarks.json`, all tables as `tables.md`, and the chart. With files
as arguments (of this script, or of `pytest bench --benchmark-json`), it draws them and measures
nothing. `--write` also replaces the table in README.md.
"""

import argparse
import subprocess
import sys
import tempfile

import charts
import results
import tables

README = results.BENCH.parent / "README.md"
FOLDER = results.BENCH / "results"
# Short, consecutive passes, since the speed of a shared machine varies over seconds.
PASSES = 3
PYTEST = "-q --benchmark-only --benchmark-quiet --benchmark-min-rounds=3 --benchmark-max-time=0.1"


def measure():
    """Run several passes over all benchmarks, each in its own process, and merge the results."""
    several = []
    command = [sys.executable, "-m", "pytest", results.BENCH, *PYTEST.split()]
    with tempfile.TemporaryDirectory() as folder:
        for k in range(PASSES):
            print(f"pass {k + 1} of {PASSES}", flush=True)
            # The slow ones, processes that compile everything, are in the first pass only.
            more = [f"--benchmark-json={folder}/{k}.json", *(["-m", ""] if k == 0 else [])]
            subprocess.run([*command, *more], cwd=results.BENCH.parent, check=True)
            several.append(results.load(f"{folder}/{k}.json"))
    return results.merge(several)


def main():
    """Measure or load, print, draw, and write if requested."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", help="draw these results instead of measuring")
    parser.add_argument("--write", action="store_true", help="replace the table in README.md")
    options = parser.parse_args()
    files = [results.load(path) for path in options.files]
    measured = results.merge(files) if files else measure()
    results.dump(measured, FOLDER / "benchmarks.json")
    text = tables.everything(measured)
    print(text)
    (FOLDER / "tables.md").write_text(text, encoding="utf-8")
    charts.draw(measured, FOLDER)
    if options.write:
        page = tables.replace(README.read_text(encoding="utf-8"), tables.summary(measured))
        README.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
