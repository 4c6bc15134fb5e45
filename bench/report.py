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
from pathlib import Path

import charts
import results
import tables

README = results.BENCH.parent / "README.md"
# Short, consecutive passes, since the speed of a shared machine varies over seconds.
PASSES = 3
PYTEST = "-q --benchmark-only --benchmark-quiet --benchmark-min-rounds=3 --benchmark-max-time=0.1"


def measure(passes, select):
    """Run several passes over all benchmarks, each in its own process, and merge the results."""
    several = []
    command = [sys.executable, "-m", "pytest", results.BENCH, *PYTEST.split(), "-k", select]
    with tempfile.TemporaryDirectory() as folder:
        for k in range(passes):
            print(f"pass {k + 1} of {passes}", flush=True)
            # The slow ones, processes that compile everything, are in the first pass only.
            more = [f"--benchmark-json={folder}/{k}.json", *(["-m", ""] if k == 0 else [])]
            subprocess.run([*command, *more], cwd=results.BENCH.parent, check=True)
            several.append(results.load(f"{folder}/{k}.json"))
    return results.merge(several)


def main(arguments=None):
    """Measure or load, print, draw, and write if requested."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", help="draw these results instead of measuring")
    parser.add_argument("--write", action="store_true", help="replace the table in README.md")
    parser.add_argument("--passes", type=int, default=PASSES, help=f"how often ({PASSES})")
    parser.add_argument("-k", dest="select", default="", help="only benchmarks that match")
    parser.add_argument("--to", type=Path, default=results.BENCH / "results", help="folder")
    options = parser.parse_args(arguments)
    if options.files:
        measured = results.merge([results.load(path) for path in options.files])
    else:
        measured = measure(options.passes, options.select)
    options.to.mkdir(exist_ok=True)
    results.dump(measured, options.to / "benchmarks.json")
    text = tables.everything(measured)
    print(text)
    (options.to / "tables.md").write_text(text, encoding="utf-8")
    charts.draw(measured, options.to)
    if options.write:
        page = tables.replace(README.read_text(encoding="utf-8"), tables.summary(measured))
        README.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
