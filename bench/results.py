"""Results of benchmarks: rows, their files, and shares of the machine's limits."""

import importlib.metadata
import json
import platform
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import native

BENCH = Path(__file__).parent
PACKAGES = ["Numba", "NumPy", "SciPy", "heyoka"]


class Row(NamedTuple):
    """One measured benchmark.

    `seconds` is the best time of `work` units, `error` the largest relative error, `limit` a limit
    of the machine and the amount of it that a unit needs, `x` the column in a table with columns.
    """

    name: str
    table: str
    key: str
    label: str
    whose: str
    work: float
    seconds: float
    threads: int = 1
    error: float | None = None
    limit: tuple[str, float] | None = None
    x: float | None = None

    @property
    def rate(self):
        """Units of work per second."""
        return self.work / self.seconds


class Results(NamedTuple):
    """Rows of one machine, the best of several passes."""

    date: str
    machine: dict
    passes: int
    rows: tuple[Row, ...]

    def one(self, table, key, **wanted):
        """The row of that key with these attributes, or None."""
        wanted = {"table": table, "key": key, **wanted}.items()
        return next((row for row in self.rows if wanted <= row._asdict().items()), None)

    def best(self, table):
        """Rows of a table, fastest first; for each key the one with the most threads."""
        rows = [row for row in self.rows if row.table == table]
        most = {
            (row.key, row.whose, row.x): row for row in sorted(rows, key=lambda row: row.threads)
        }
        return sorted(most.values(), key=lambda row: -row.rate)

    def share(self, row):
        """Share of its limit that a row reaches, or None.

        The limit is the highest rate of any row: if a row exceeds the benchmark of the limit, the
        benchmark ran at a slow moment.
        """
        if row.limit is None:
            return None
        limited = [each for each in self.rows if each.limit and each.threads == row.threads]
        found = [each for each in limited if each.limit[0] == row.limit[0]]
        if not any(each.whose == "the machine" for each in found):
            return None
        return row.rate * row.limit[1] / max(each.rate * each.limit[1] for each in found)


def dump(results, path):
    """Write results to a file."""
    rows = [{k: v for k, v in row._asdict().items() if v is not None} for row in results.rows]
    text = json.dumps(results._asdict() | {"rows": rows}, indent=1, ensure_ascii=False)
    Path(path).write_text(text + "\n", encoding="utf-8")


def load(path):
    """Load a file of `dump` or of pytest-benchmark, without names of machines and users."""
    content = json.loads(Path(path).read_text(encoding="utf-8"))
    if "benchmarks" in content:
        content = {
            "date": content["datetime"][:10],
            "machine": content["machine_info"]["ours"],
            "passes": 1,
            "rows": [
                each["extra_info"] | {"name": each["name"], "seconds": each["stats"]["min"]}
                for each in content["benchmarks"]
            ],
        }
    rows = [row | {"limit": tuple(row.get("limit") or ()) or None} for row in content["rows"]]
    return Results(**content | {"rows": tuple(Row(**row) for row in rows)})


def merge(several):
    """Merge results from one machine with one set of versions: the best time of each benchmark."""
    best = {}
    for results in several:
        if results.machine != several[0].machine:
            raise ValueError("expected results of one machine and one set of versions")
        for row in results.rows:
            best[row.name] = min(row, best.get(row.name, row), key=lambda each: each.seconds)
    return Results(
        date=max(results.date for results in several),
        machine=several[0].machine,
        passes=sum(results.passes for results in several),
        rows=tuple(best.values()),
    )


def machine(described):
    """Processor, threads and versions from the data of pytest-benchmark, without the host name."""
    import numba
    from llvmlite import binding

    import suslov_fast

    versions = {"Python": platform.python_version(), "suslov_fast": suslov_fast.__version__}
    for package in PACKAGES:
        with suppress(importlib.metadata.PackageNotFoundError):
            versions[package] = importlib.metadata.version(package.lower())
    versions["LLVM"] = ".".join(map(str, binding.llvm_version_info))
    if native.version():
        versions["gcc"] = native.version()
    compiled_for = f", compiled for {native.PROCESSOR}" if native.PROCESSOR else ""
    return {
        "processor": described["cpu"].get("brand_raw", platform.machine()) + compiled_for,
        "threads": int(numba.config.NUMBA_NUM_THREADS),
        "versions": versions,
    }
