"""Results of benchmarks: the files of pytest-benchmark, and shares of the machine's limits."""

import json
import platform
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import SimpleNamespace

import native
import numba

import suslov_fast

BENCH = Path(__file__).parent
PACKAGES = ["Numba", "llvmlite", "NumPy", "SciPy", "heyoka", "jax"]


class Results:
    """Rows of a file of `pytest bench --benchmark-json`, by their names.

    A row has the attributes of its case, the `units` of work, the `rate` in units per second,
    `seconds`, the largest relative `error`, and the number of `threads`. `motions` is the content
    of another file, perhaps of another machine, with the tables of motions.
    """

    def __init__(self, content, motions=None):
        self.machine, self.date = content["machine_info"], content["datetime"][:10]
        self.motions = self if motions is None else Results(motions)
        self.rows = {}
        for each in content["benchmarks"] + ([] if motions is None else motions["benchmarks"]):
            row = SimpleNamespace(seconds=each["stats"]["min"], **each["extra_info"])
            row.rate = row.units / row.seconds
            self.rows[each["param"]] = row

    def of(self, table):
        """Rows of a table, fastest first."""
        rows = [row for row in self.rows.values() if row.table == table]
        return sorted(rows, key=lambda row: -row.rate)

    def share(self, row):
        """Return the share of its limit that a row reaches, or None.

        The limit is the highest rate of any row, because the benchmark of the limit may have run at
        a slow moment.
        """
        if row.limit is None:
            return None
        alike = [other for other in self.rows.values() if other.threads == row.threads]
        alike = [other for other in alike if other.limit and other.limit[0] == row.limit[0]]
        if not any(other.whose == "the machine" for other in alike):
            return None
        return row.rate * row.limit[1] / max(other.rate * other.limit[1] for other in alike)


def load(path):
    return json.loads(Path(path).read_text(encoding="utf-8"))


def write(path, content, name):
    """Write a content with one line for each entry of its list `name`."""
    head = json.dumps({key: value for key, value in content.items() if key != name})
    lines = ",\n".join(json.dumps(each, ensure_ascii=False) for each in content[name])
    Path(path).write_text(f'{head[:-1]}, "{name}": [\n{lines}\n]}}\n', encoding="utf-8")


def shown(each):
    """Return the parts of a benchmark of pytest that tables show."""
    kept = {key: each[key] for key in ("param", "extra_info")}
    return kept | {"stats": {"min": each["stats"]["min"]}}


def merge(several):
    """Merge files from one machine with one set of versions: the best time of each benchmark."""
    if any(content["machine_info"] != several[0]["machine_info"] for content in several):
        raise ValueError("expected results of one machine and one set of versions")
    found = [each for content in several for each in content["benchmarks"]]
    found.sort(key=lambda each: each["stats"]["min"], reverse=True)
    return several[-1] | {"benchmarks": [*{each["param"]: shown(each) for each in found}.values()]}


def machine(processor):
    """Processor, threads and versions, without the name of the host."""
    versions = {"suslov_fast": suslov_fast.__version__, "Python": platform.python_version()}
    versions["gcc"] = native.version()
    for package in PACKAGES:
        with suppress(PackageNotFoundError):
            versions[package] = version(package.lower())
    if native.PROCESSOR:
        processor += f", compiled for {native.PROCESSOR}"
    threads = int(numba.config.NUMBA_NUM_THREADS)
    return {"processor": processor, "threads": threads, "versions": versions}
