"""What was measured: rows of benchmarks, how they are loaded, merged and compared with limits."""

import json
from dataclasses import asdict, dataclass
from enum import Enum
from pathlib import Path

# What is told about a machine; nothing that names it or its owner.
MACHINE = ("processor", "cores", "threads", "system", "versions")


class Table(str, Enum):
    """What rows have in common, so that they are compared with each other."""

    LAST = "last states"
    SAVED = "saved states"
    FEW = "few orbits"
    JUMPS = "jumps"
    MOTION = "motion"
    OBSERVABLES = "observables"
    ND = "n dimensions"
    ND_SAVED = "n dimensions, saved states"
    ATTITUDE = "attitude"
    CALLS = "calls"
    STARTS = "starts"
    LIMITS = "limits"
    BATCH = "batch"
    EVERY = "save_every"
    STEPS = "steps"
    THREADS = "threads"


class Whose(str, Enum):
    """Who does the work of a row."""

    OURS = "this package"
    C = "C"
    NUMPY = "NumPy"
    OTHER = "others"
    MACHINE = "the machine"


class Limit(str, Enum):
    """What a machine does at most: the keys of the rows of `Table.LIMITS`."""

    DIVISIONS = "divisions"
    STREAMING = "streaming"
    PLAIN = "plain"
    COPY = "copy"
    NEW = "new"
    NEW_COPY = "new copy"


@dataclass(frozen=True)
class Row:
    """One benchmark.

    Attributes
    ----------
    key, whose
        Which line of its table it is on; rows with one key may differ in x, whose and threads.
    label
        What is shown for it, in Markdown.
    seconds, work
        The best time, of so many units.
    error
        The largest relative error, if it was measured.
    limit
        (what, how much of it a unit needs), what being a `Limit`.
    share
        How much of the limit was reached in turns with it: the median, if that was measured.
    x
        Where it stands in a chart or a table with columns.
    """

    name: str
    table: Table
    key: str
    label: str
    whose: Whose
    unit: str
    work: float
    seconds: float
    threads: int = 1
    error: float | None = None
    limit: tuple[Limit, float] | None = None
    share: float | None = None
    x: float | None = None

    @property
    def rate(self):
        """Units of work per second."""
        return self.work / self.seconds

    @classmethod
    def of(cls, values):
        """A row from what JSON has of it."""
        known = {
            "table": Table(values["table"]),
            "whose": Whose(values["whose"]),
            "limit": values.get("limit") and (Limit(values["limit"][0]), values["limit"][1]),
        }
        return cls(**values | known)


@dataclass(frozen=True)
class Results:
    """Rows of one machine, the best of several passes."""

    date: str
    machine: dict
    passes: int
    rows: tuple[Row, ...]

    @property
    def threads(self):
        """The most threads that were used."""
        return self.machine["threads"]

    def of(self, table, **wanted):
        """Rows of a table with these attributes, fastest first."""
        rows = [
            row
            for row in self.rows
            if row.table is table
            and all(getattr(row, name) == value for name, value in wanted.items())
        ]
        return sorted(rows, key=lambda row: row.rate, reverse=True)

    def best(self, table, **wanted):
        """The same, each key with the most threads it was measured with."""
        rows = self.of(table, **wanted)
        most = {}
        for row in rows:
            most[row.key, row.x] = max(most.get((row.key, row.x), 0), row.threads)
        return [row for row in rows if row.threads == most[row.key, row.x]]

    def one(self, table, key, **wanted):
        """The fastest row of that key, or None."""
        return next(iter(self.of(table, key=key, **wanted)), None)

    def limit(self, what, threads):
        """Divisions or bytes per second on so many threads, or None where not measured.

        Who gets more than the benchmark of the limit shows that it was measured at a bad moment:
        the most that any got is the limit.
        """
        measured = self.one(Table.LIMITS, what, threads=threads)
        if measured is None:
            return None
        used = [
            row.rate * row.limit[1]
            for row in self.rows
            if row.limit and row.limit[0] is what and row.threads == threads
        ]
        return max([measured.rate, *used])

    def share(self, row):
        """How much of its limit a row reaches, or None."""
        if row.limit is None or row.share is not None:
            return row.share
        what, count = row.limit
        limit = self.limit(what, row.threads)
        return limit and row.rate * count / limit


def dump(results, path):
    """Write results to a file."""
    text = json.dumps(asdict(results), indent=1, ensure_ascii=False)
    Path(path).write_text(text + "\n", encoding="utf-8")


def load(path):
    """Results from a file of `dump`, or of pytest-benchmark."""
    content = json.loads(Path(path).read_text(encoding="utf-8"))
    if "passes" not in content:
        content = _trimmed(content)
    return Results(**content | {"rows": tuple(map(Row.of, content["rows"]))})


def merge(several):
    """The best time of each benchmark; all come from one machine with one set of versions."""
    first = several[0]
    best = {}
    for results in several:
        if results.machine != first.machine:
            raise ValueError("expected results of one machine and one set of versions")
        for row in results.rows:
            known = best.get(row.name)
            if known is None or row.seconds < known.seconds:
                best[row.name] = row
    return Results(
        date=max(results.date for results in several),
        machine=first.machine,
        passes=sum(results.passes for results in several),
        rows=tuple(best.values()),
    )


def _trimmed(raw):
    """What of pytest-benchmark's output is kept: nothing that tells whose machine it was."""
    return {
        "date": raw["datetime"][:10],
        "machine": {key: raw["machine_info"][key] for key in MACHINE if key in raw["machine_info"]},
        "passes": 1,
        "rows": [
            {
                "name": _short_name(each["fullname"]),
                "seconds": each["stats"]["min"],
                **each["extra_info"],
            }
            for each in raw["benchmarks"]
        ],
    }


def _short_name(fullname):
    """The name of a test without the folders of its file."""
    path, separator, test = fullname.partition("::")
    return path.rsplit("/", 1)[-1] + separator + test
