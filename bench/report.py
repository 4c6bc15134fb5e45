"""Run all benchmarks, and write tables and a chart.

`python bench/report.py` runs the benchmarks in several short passes, takes the best time of each,
and writes to `results/`: what tables show, as `benchmarks.json` and `motions.json`, all tables as
`tables.md`, and the chart. With such files as arguments it draws them and measures nothing.
`--motions` measures the tables of motions alone, which `motions.json` has. `--write` also replaces
the table in README.md; `-k` chooses cases, prints, and writes nothing.
"""

import argparse
import subprocess
import sys
import tempfile

import charts
import results
import tables
from work import MOTIONS

README = results.BENCH.parent / "README.md"
FOLDER = results.BENCH / "results"
# Short, consecutive passes, since the speed of a shared machine varies over seconds.
PYTEST = "-q --benchmark-only --benchmark-quiet --benchmark-min-rounds=3 --benchmark-max-time=0.1"


def measure(passes, select):
    """Yield the results of several passes over all benchmarks, each in its own process."""
    command = [sys.executable, "-m", "pytest", results.BENCH, *PYTEST.split(), "-k", select]
    command += ["-m", ""]  # the slow ones, processes that compile everything, too
    with tempfile.TemporaryDirectory() as folder:
        for k in range(passes):
            print(f"pass {k + 1} of {passes}", flush=True)
            path = f"{folder}/{k}.json"
            subprocess.run([*command, f"--benchmark-json={path}"], cwd=README.parent, check=True)
            yield results.load(path)


def parts(content):
    """Return a content without tables of motions, and one with them alone."""
    of_motions = [each["extra_info"]["table"] in MOTIONS for each in content["benchmarks"]]
    for wanted in (False, True):
        chosen = zip(content["benchmarks"], of_motions, strict=True)
        yield content | {"benchmarks": [each for each, is_one in chosen if is_one is wanted]}


def main():
    """Measure or load, print, draw, and write if requested."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", help="draw these results instead of measuring")
    parser.add_argument("--write", action="store_true", help="replace the table in README.md")
    parser.add_argument("--motions", action="store_true", help="measure the motions alone")
    parser.add_argument("--passes", type=int, default=3, help="number of passes (3)")
    parser.add_argument("-k", dest="select", default="", help="some cases, as for pytest")
    options = parser.parse_args()
    if options.motions:
        options.select = " or ".join(table.replace(" ", "_") for table in MOTIONS)
    files = map(results.load, options.files)
    content = results.merge(list(files) or list(measure(options.passes, options.select)))
    others, motions = parts(content)
    if options.motions:
        others = results.load(FOLDER / "benchmarks.json")
    measured = results.Results(others, motions)
    text = tables.page(measured, "tables.md")
    print(text)
    if options.select and not options.motions:
        return
    for name, part in (("benchmarks", others), ("motions", motions)):
        results.write(FOLDER / f"{name}.json", part, "benchmarks")
    (FOLDER / "tables.md").write_text(text, encoding="utf-8")
    charts.draw(measured, FOLDER / "speed.png")
    if options.write:
        page = tables.replace(README.read_text("utf-8"), tables.page(measured, "readme.md"))
        README.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
