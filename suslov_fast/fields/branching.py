"""Functions with `if` on symbols: each path is traced, and `select` joins their results."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from ..core.expressions.function_records import same
from .symbols import Symbol, Untraceable, asked
from .tolerances import MOST_PATHS
from .tracer import Tracer

# Comparisons of a value a with a constant c, by whether a comes first: whether a is below a cut
# when they are true, and the place of this cut: 0 just below c, 1 just above it.
_CUTS = {
    ("olt", True): (True, 0),
    ("ogt", True): (False, 1),
    ("oge", True): (False, 0),
    ("olt", False): (False, 1),
    ("ogt", False): (True, 0),
    ("oge", False): (True, 1),
}
# Instructions that can be NaN at numbers; a division by a constant cannot.
_PARTIAL = {*"fdiv sqrt log log2 log10 log1p arcsin arccos arccosh arctanh pow".split()}
_Cut = tuple[float, int]
_ANYWHERE: tuple[_Cut, _Cut] = (-float("inf"), 0), (float("inf"), 1)


class Raised(Exception):
    """A `raise` or `assert` of f itself; the attribute `error` is what it raises."""

    def __init__(self, error: Exception) -> None:
        super().__init__()
        self.error = error


class _Path:
    """The truth values that one call of f was given, by operand, in the order of the questions."""

    def __init__(self, tracer: Tracer, taken: dict[int, bool]) -> None:
        self.tracer, self.given, self.new = tracer, taken, dict[int, bool]()
        self.ranges: dict[int, tuple[_Cut, _Cut]] = {}
        self.numbers = set[int]()  # values of which a comparison was true: they are not NaN
        for key, value in taken.items():
            self._note(key, value)

    def decide(self, symbol: Symbol) -> bool:
        """Return the truth value of a condition; True where nothing decides it yet."""
        key = self.tracer.truth(symbol)
        if isinstance(key, bool):
            return key
        for known in (self.given, self.new):
            if key in known:
                return known[key]
        if (implied := self._implied(key)) is not None:
            return implied
        if len(self.given) + len(self.new) >= MOST_PATHS:
            raise asked(str(symbol))
        self.new[key] = True
        self._note(key, True)
        return True

    def _comparison(self, key: int) -> tuple[int, _Cut, bool] | None:
        """Return (a, cut, whether a is below it) for a comparison of a value with a constant."""
        name, of = self.tracer.values.parts_of(key)
        is_first = len(of) == 2 and type(of[1]) is float
        if (name, is_first) not in _CUTS or is_first is (type(of[0]) is float):
            return None
        is_below, side = _CUTS[name, is_first]
        return of[not is_first], (of[is_first], side), is_below

    def _note(self, key: int, value: bool) -> None:
        if (found := self._comparison(key)) is not None:
            a, cut, is_below = found
            low, high = self.ranges.get(a, _ANYWHERE)
            self.ranges[a] = (low, min(high, cut)) if is_below is value else (max(low, cut), high)
            if value:
                self.numbers.add(a)

    def _implied(self, key: int) -> bool | None:
        """Return the value of a comparison that earlier ones imply, as t < 5 implies t < 6.

        Of NaN all comparisons are false: there not (a > 0) does not imply a <= 0.
        """
        if (found := self._comparison(key)) is None:
            return None
        a, cut, is_below = found
        low, high = self.ranges.get(a, _ANYWHERE)
        if low >= high:  # a is NaN
            return False
        value = is_below if high <= cut else not is_below if low >= cut else None
        return value if not value or a in self.numbers or not self._may_be_nan(a) else None

    @property
    def is_of_nan(self) -> bool:
        """True if the answers are those for a value that is NaN."""
        return any(low >= high for low, high in self.ranges.values())

    def _may_be_nan(self, operand: Any) -> bool:
        """Return True if a value can be NaN where the variables and parameters are numbers."""
        seen, left = set[Any](), [operand]
        while left:
            name, of = self.tracer.values.parts_of(a := left.pop())
            is_total = name == "fdiv" and type(of[1]) is float and of[1] != 0.0
            if a != a or (name in _PARTIAL and not is_total):
                return True
            left += [each for each in of if each not in seen]
            seen.update(of)
        return False


class _Paths:
    """The paths of a function, their number, and the errors that it raises on some."""

    def __init__(self, tracer: Tracer, call: Callable[[], list[Any]]) -> None:
        self.tracer, self.call = tracer, call
        self.count, self.errors = 0, list[Exception]()

    def result(self, path: _Path) -> list[Any]:
        """Return the operands; none if f raises an error, so that it has no value on this path.

        If only NaN leads to this path, f may also lack a value by any other error.
        """
        self.tracer.decide = path.decide
        try:
            return self.call()
        except Raised as error:
            self.errors.append(error.error)
        except (TypeError, ValueError, NameError):
            if not path.is_of_nan:
                raise
        return []

    def along(self, taken: dict[int, bool]) -> list[Any]:
        """Return the operands on all paths that begin with the answers `taken`."""
        self.count += 1
        tracer, path = self.tracer, _Path(self.tracer, taken)
        rows = self.result(path)
        if not taken:
            again = self.result(_Path(tracer, taken))
            if [*map(repr, rows)] != [*map(repr, again)]:  # equal operations share a number
                how = "f must compute from x and its parameters alone, without random numbers or "
                raise ValueError(f"two calls of f differ: {how}memory")
        questions = [*path.new]
        for k in reversed(range(len(questions))):
            key = questions[k]
            if self.count >= MOST_PATHS:
                raise asked(str(Symbol(tracer, key)))
            others = self.along({**taken, **dict.fromkeys(questions[:k], True), key: False})
            rows, others = rows or [math.nan] * len(others), others or [math.nan] * len(rows)
            if len(others) != len(rows):
                raise Untraceable("returns different numbers of components after an `if`")
            pairs = zip(rows, others, strict=True)
            rows = [
                a if same(a, b) else tracer.applied("where", [key, a, b]).operand for a, b in pairs
            ]
        return rows


def along_all_paths(tracer: Tracer, call: Callable[[], list[Any]]) -> list[Any]:
    """Return the operands that `call` returns, where it may ask whether symbols are true.

    The first path is taken twice, and must return the same operands.
    """
    paths = _Paths(tracer, call)
    try:
        if not (rows := paths.along({})):
            raise paths.errors[0]
        return rows
    finally:
        tracer.decide = None
