"""Measure everything, and write the tables and charts.

`python bench/report.py` runs the benchmarks in several short passes, takes the best time of each,
and writes to `results/`: `benchmarks.json`, all tables as `tables.md`, and the charts. With files
as arguments (of this script, or of `pytest bench --benchmark-json`) it draws those and measures
nothing. `--write` also replaces the table in README.md.
"""

import argparse

import tables
from measuring import BENCH, measure
from results import dump, load, merge

RESULTS = BENCH / "results"
README = BENCH.parent / "README.md"
PASSES = 4


def main():
    """Measure or load, print, draw, and write if asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", help="draw these results instead of measuring")
    parser.add_argument("--write", action="store_true", help="replace the table in README.md")
    parser.add_argument("--passes", type=int, default=PASSES, help=f"how often ({PASSES})")
    parser.add_argument("-k", dest="select", help="only benchmarks that match, as for pytest")
    options = parser.parse_args()
    import charts  # needs matplotlib: say so before all is measured

    if options.files:
        results = merge([load(path) for path in options.files])
    else:
        results = measure(options.passes, options.select)
    RESULTS.mkdir(exist_ok=True)
    if options.write or not options.files:
        dump(results, RESULTS / "benchmarks.json")
    text = tables.everything(results)
    print(text)
    (RESULTS / "tables.md").write_text(text, encoding="utf-8")
    charts.draw(results, RESULTS)
    if options.write:
        page = tables.replace(README.read_text(encoding="utf-8"), tables.summary(results))
        README.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
