"""Reports on maps: degrees, first integrals, invariant measures, Darboux polynomials."""

import dataclasses
import math
import sys
from time import perf_counter
from typing import Any, NoReturn

from ..checks import is_false, kind_of, wrong
from ..fields.base import Body
from ..fields.html import html_table
from ..fields.map import Map
from ..keywords import lacking, public
from .birational_maps import RationalMap, check_map
from .darboux import checked_degree
from .degrees_of_iterates import Growth, growth
from .entropy import PlanarEntropy
from .exact_maps import checked_letters, exact_map
from .interpolation import Watch, watch
from .kahan_maps import KahanMap
from .levels import Level
from .linear_relations import ImplicitIntegral, count_relations
from .polynomials import exponents_up_to
from .rational_functions import IDENTITY, MODULAR, RationalFunction
from .search import Search
from .symmetries import Reversor
from .tolerances import MOST_SEARCHES, ROUNDING_OF_ENTROPY, SETS_OF_FIRST_LINE, WIDTH_OF_REPORT

_PROOF = {IDENTITY: "proved", MODULAR: "checked modulo primes, at random points"}
_NO_INVERSE = (
    "No inverse was given: it is not checked that the map is birational, so no entropy is proved, "
    "and densities belong to invariant measures only if the map is one to one."
)
Functions = tuple[RationalFunction, ...]


@dataclasses.dataclass(repr=False)
class Report:
    """Results of `report` for a map.

    Each of `integrals`, `measures` (densities) and `polynomials` (Darboux polynomials, with their
    cofactors) can be called with a point; `str` gives its formula, and its `basis` says what it
    rests on: "identity", checked as an identity of rational functions, or "modulo a prime, at
    random points". A density satisfies rho(Phi) det DPhi = rho, or, with the `cofactor` -1,
    rho(Phi) det DPhi = -rho. Independent integrals without a short formula are in `implicit`;
    `independent` is the number of all integrals that are known.
    """

    map: RationalMap
    degree: int  # the argument `degree` of `report`
    degrees: list[int] = dataclasses.field(default_factory=list)
    integrals: Functions = ()  # independent integrals
    implicit: tuple[ImplicitIntegral, ...] = ()  # further independent integrals, without a formula
    measures: Functions = ()
    polynomials: Functions = ()
    symmetries: tuple[Reversor, ...] = ()  # reversing symmetries of a field
    planar: PlanarEntropy | None = None  # entropy of a birational map of the plane
    level: Level | None = None  # level of D - 2 integrals that the function `on_level` chose
    on_level: PlanarEntropy | None = None  # entropy of the map on `level`
    relations: int | None = None  # number of independent integrals, by `count_relations`
    searched: list[str] = dataclasses.field(default_factory=list)
    notes: list[str] = dataclasses.field(default_factory=list)
    finished: bool = False

    def __getattr__(self, name: str) -> NoReturn:
        raise lacking(self, name)

    @property
    def growth(self) -> Growth:
        """The `Growth` of the degrees; "unclear" if `planar` has another entropy."""
        by_degrees, planar = growth(self.degrees, planar=self.map.is_planar), self.planar
        if planar is None or planar.entropy is None or math.isnan(by_degrees.entropy):
            return by_degrees
        if abs(planar.entropy - by_degrees.entropy) <= ROUNDING_OF_ENTROPY:
            return by_degrees
        based_on = f"{by_degrees.based_on}, by accident, as the contracted curves show"
        return Growth("unclear", math.nan, based_on)

    @property
    def proved_entropy(self) -> float | None:
        """The algebraic entropy of the map if it is proved, else None.

        In the plane, contracted curves or an integral prove it. In three dimensions with one
        integral it is the entropy of the map restricted to the generic level of the integral, if
        that is proved. For D > 2, D - 1 proved integrals show that it is 0. The theorems
        hold for birational maps: without an inverse it is None.
        """
        if self._levels_are_curves:
            return 0.0
        known = self.on_level if self.map.dimension == 3 else self.planar
        return known.entropy if known and known.proved else None

    @property
    def _levels_are_curves(self) -> bool:
        proved = sum(f.basis == IDENTITY for f in self.integrals)
        return self.map.is_birational and 2 < self.map.dimension <= proved + 1

    @property
    def independent(self) -> int:
        """The number of independent integrals, including those without a formula."""
        return max(len(self.integrals) + len(self.implicit), self.relations or 0)

    @property
    def dimension(self) -> int:
        """The dimension of the level sets of all integrals."""
        return self.map.dimension - self.independent

    def __repr__(self) -> str:
        none = f"none found up to degree {self.degree}; a higher one may have some"
        none = none if self.finished else "none found so far"
        if self.finished and self.relations is None:
            none = "not sought"
        # Without factors of det DPhi, only those with the cofactors 1, -1, det DPhi, -det DPhi.
        few = self.finished and self.map.is_invertible and self.map.factors is None
        other = "not sought, but with a few cofactors" if few else none
        up_to_sign = ", up to sign" if any(f.cofactor for f in self.measures) else ""
        no_integral = "none written" if self.implicit else none
        degrees = ", ".join(str(integral.degree) for integral in self.implicit)
        written, others = len(self.integrals), len(self.implicit)
        implicit = f"Integrals: {written} written, {others} of degree {degrees} by their bases."
        lines = [
            self._title(),
            *self._lines_of_growth(),
            *self._lines_of_entropy(),
            _listed("First integrals", self.integrals, 6, no_integral, self.independent),
            *[implicit] * (others > 0),
            _listed(f"Densities of measures{up_to_sign}", self.measures, 1, none),
            _listed("Darboux polynomials", self.polynomials, 6, other),
        ]
        if self.symmetries:
            more = f"; {len(self.symmetries) - 6} more" if len(self.symmetries) > 6 else ""
            shown = "; ".join(map(str, self.symmetries[:6]))
            lines.append(f"Reversing symmetries: {shown}{more}")
        lines += self._lines_of_level_sets()
        lines += [f"Searched: {'; '.join(self.searched) or 'nothing yet'}.", *self.notes]
        lines += [] if self.finished else ["Not finished."]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        title, *lines = str(self).splitlines()
        return html_table(title, ["", "found"], (line.partition(": ")[::2] for line in lines))

    def _title(self) -> str:
        variables, letters = f"{self.map.dimension} variables", self.map.letters
        if len(letters) > 1 or (isinstance(self.map, KahanMap) and self.map.in_letters):
            text = str(self.map) if isinstance(self.map, KahanMap) else f"Map of {variables}"
            return f"{text}, letters {', '.join(letters)}"
        if not isinstance(self.map, KahanMap):
            return f"Map of {variables}" + f", {self.map.letter} symbolic" * self.map.is_symbolic
        field, eps = str(self.map.field), self.map.eps
        field = field if len(field) <= 2 * WIDTH_OF_REPORT else f"a quadratic field of {variables}"
        return f"Kahan map of {field}, eps {'symbolic' if eps is None else f'= {eps}'}"

    def _lines_of_growth(self) -> list[str]:
        kind, entropy, based_on = self.growth
        rate = "" if math.isnan(entropy) else f", entropy {entropy:.4g}"
        if kind == "linear" and self.map.dimension == 2:
            based_on += "; in the plane a sign of an invariant fibration, which may be no integral"
        if (planar := self.planar) and (k := planar.pencil) and not self.integrals:
            based_on += (
                f". By the contracted curves it is quadratic ({planar.certainty}): there is an "
                f"invariant pencil of curves of genus 1, whose degree is a multiple of {k}"
            )
        more = ", ..." if len(self.degrees) > 8 else ""
        return [
            f"Degrees of iterates: {', '.join(map(str, self.degrees[:8]))}{more}",
            f"Growth: {kind}{rate}; evidence, not a proof: {based_on}",
        ]

    def _lines_of_entropy(self) -> list[str]:
        D, planar = self.map.dimension, self.planar or self.on_level
        if self._levels_are_curves:
            levels = "points" if self.dimension == 0 else "curves"
            return [f"Entropy (proved): 0, because the levels of the integrals are {levels}"]
        if planar is None:
            return []
        # If D = 3, the level is a general one, so that its entropy is the entropy of the map.
        where = " on a level" * (D > 3)
        if planar.entropy is None:
            return [f"Entropy{where}: none, {planar.reason}"]
        root = f", log of the largest root of {planar.minimal}" if planar.entropy else ""
        lengths = ", ".join("not confined" if n is None else str(n) for n in planar.lengths)
        orbits = f"; lengths of the orbits of contracted curves: {lengths}" if lengths else ""
        entropy = f"Entropy{where} ({planar.certainty}): {planar.entropy:.6g}{root}"
        return [f"{entropy}; on {self.level.how}" if self.level else f"{entropy}{orbits}"]

    def _lines_of_level_sets(self) -> list[str]:
        lines = []
        if (self.relations or 0) > len(self.integrals) + len(self.implicit):
            plural = "s" * (self.relations != 1)
            shown = f"{self.relations} independent integral{plural}, {MODULAR}"
            lines.append(f"Relations along orbits up to degree {self.degree} show {shown}.")
        if self.integrals or self.relations:
            dimension = f"{self.dimension} of {self.map.dimension}"
            more = ". These may not be all: a larger degree may show more" * (self.dimension > 1)
            lines.append(f"Level sets of the integrals have dimension {dimension}{more}.")
        return lines


def _listed(title: str, functions: Functions, most: int, none: str, total: int = 0) -> str:
    """Return a line: `title`, up to `most` formulas of `total` functions, or the text `none`."""
    if not functions:
        return f"{title}: {none}"
    formulas = "; ".join(f.text(WIDTH_OF_REPORT) for f in functions[:most])
    more = f"; {len(functions) - most} more" if len(functions) > most else ""
    how = " and ".join(_PROOF[basis] for basis in sorted({f.basis for f in functions}))
    count = f"{len(functions)}" + f" of {total}" * (total > len(functions))
    return f"{title} ({count}, {how}): {formulas}{more}"


@public
def report(
    system: Any,
    /,
    *,
    degree: int = 3,
    eps: Any = None,
    letters: Any = None,
    progress: Any = None,
) -> Report:
    """Report the growth of degrees, first integrals, measures and Darboux polynomials of a map.

    First integrals come from a Hamiltonian, from quotients of Darboux polynomials of equal
    cofactor, and from products of powers of Darboux polynomials whose cofactors multiply to 1. The
    search ends when it has written as many integrals as relations between monomials along orbits
    show, and a measure.

    Parameters
    ----------
    system : Field, Map, body, KahanMap or RationalMap
        A single one.
    degree : int, optional
        Largest degree of polynomials, by default 3.
    eps : int, Fraction, float or str, optional
        Step size of a field or body; a string may be "1/3". Without it, eps is symbolic.
    letters : str, sequence of str or True, optional
        Names of parameters of a system that stay symbols in addition to eps, ``"a b"``; True stands
        for all. Of a `SuslovND`, J1 stands for all entries of J that equal the first, I1 for I_1.
        Formulas, degrees and numbers of integrals hold for general values. If the values in
        `system` are special, a note says so.
    progress : bool or callable, optional
        True prints the time, kind and degree of each part of the search to the standard error, and
        how many sets of numbers in place of letters are done. A function is called as
        ``progress(done, parts)`` after each part, and while formulas with letters are interpolated.
        If it returns False, the search ends, and the report has the results found so far.

    Returns
    -------
    Report
        Its attribute `finished` is False if `progress` ended the search.

    Raises
    ------
    ArithmeticError
        If there is no map, because the equations have no solution at any x, or if det DPhi of the
        map of a field is 0 everywhere, so that the image is a curve, for example.
    KeyboardInterrupt
        After Ctrl-C, when the operation at hand ends. The attribute `report` of this error, and of
        any other one during the search, is the report with the results found so far.

    Examples
    --------
    >>> from suslov_fast import Suslov3D
    >>> from suslov_fast.integrability import report
    >>> found = report(Suslov3D(4, 1, -0.5, -0.25), eps=0.25)
    >>> found.growth.kind, found.integrals
    ('linear', ((4*Omega1^2 + Omega2^2)/(4*Omega1^2 + 4*Omega1*Omega2 + Omega2^2 + 4096),))
    >>> found.measures[0]
    1/((2*Omega1 + Omega2)*(4*Omega1^2 + 4*Omega1*Omega2 + Omega2^2 + 4096))
    >>> report(Suslov3D(4, 1, -0.5, -0.25)).integrals
    ((4*Omega1^2 + Omega2^2)/(4*eps^2*Omega1^2 + 4*eps^2*Omega1*Omega2 + eps^2*Omega2^2 + 256),)
    """
    if eps is not None and letters is not None:
        raise wrong("eps", "left out beside letters", eps)
    map, notes = _map_of(system, eps, letters)
    check_map(map)
    if isinstance(map, KahanMap) and not map.is_invertible:
        raise ArithmeticError(f"{map} has no inverse: det DPhi = 0 everywhere")
    degree = checked_degree("degree", degree, map.dimension, least=1)
    if progress not in (None, True, False) and not callable(progress):
        expected = "True, for lines of text, or a function that is called as progress(done, parts)"
        raise wrong("progress", expected, kind_of(progress), TypeError)
    result, search = Report(map, degree, notes=notes), Search(map, degree)
    watched = _Watched(search, progress)
    token = watch.set(watched)
    try:
        for _ in search.queue:
            search.fill(result)
            watched.call()
        search.fill(result)
        notes += _special_values(system, search, letters)
        if not search.is_complete:
            notes += watched.left_out
    except _Stopped:
        return result
    except (KeyboardInterrupt, Exception) as error:
        error.report = result  # type: ignore[union-attr]
        error.args = error.args or ("what was found is sys.last_value.report",)
        raise
    finally:
        watch.reset(token)
    result.finished = True
    return result


class _Watched(Watch):
    """Calls `progress`, or prints a line for each kind of task; collects notes on omissions."""

    def __init__(self, search: Search, progress: Any) -> None:
        self._search, self._progress, self._start = search, progress, perf_counter()
        self._left_out: dict[str, list[str]] = {}  # {why functions were left out: kinds of tasks}
        letters, count = ", ".join(search.map.letters) or "none", search.unknowns(search.degree)
        self._print(f"letters {letters}; {count} monomials to degree {search.degree}")
        search.queue.at_start = self._print

    def _print(self, what: Any) -> None:
        if self._progress is True:
            print(f"{perf_counter() - self._start:7.1f} s  {what}", file=sys.stderr)

    def at_values(self, done: int) -> None:
        if done >= SETS_OF_FIRST_LINE and done.bit_count() == 1:
            self._print(
                f"{self._search.queue.task}: {done} of at most {MOST_SEARCHES} sets of numbers"
            )
        self.call()

    def gave_up(self, reason: str) -> None:
        kinds, task = self._left_out.setdefault(reason, []), self._search.queue.task
        kinds += [task.kind] * (task.kind not in kinds)

    @property
    def left_out(self) -> list[str]:
        """Notes for the report: kinds of tasks that left out functions, and why."""
        left_out = self._left_out.items()
        return [f"Left out, because {why}: {', '.join(kinds)}." for why, kinds in left_out]

    def call(self) -> None:
        """Call ``progress(tasks done, tasks known)``; end the search if it returns False."""
        done = self._search.queue.done
        parts = done + len(self._search.queue.waiting)
        if callable(self._progress) and is_false(self._progress(done, parts)):
            raise _Stopped


class _Stopped(BaseException):
    """Raised to end a report, because `progress` returned False."""


def _special_values(system: Any, search: Search, letters: Any) -> list[str]:
    """Return a note if the system's own values of the letters have no map, or more integrals."""
    map, degree = search.map, search.queue.finished().get("relations", 0)
    if not map.given:
        return []
    values = ", ".join(f"{name} = {float(a):g}" for name, a in map.given.items())
    try:
        is_field = isinstance(map, KahanMap)
        names = [*checked_letters(system, letters)] if is_field else []
        step = "eps" if "eps" in names else None
        special = exact_map(system, None, step) if is_field else map.subs(**map.given)
        check_map(special)
    except (ArithmeticError, TypeError):
        return [f"At {values} there is no map: the results hold for general letters."]
    count = count_relations(special, exponents_up_to(degree, map.dimension)).integrals
    if count <= (search.relations or 0):
        return []
    integrals = "1 independent integral" if count == 1 else f"{count} independent integrals"
    return [
        f"At {values}, relations up to degree {degree} show {integrals}; for general letters they "
        f"show {search.relations or 0}."
    ]


def _map_of(system: Any, eps: Any, letters: Any) -> tuple[RationalMap, list[str]]:
    """Return the exact map of a field, body or map with symbols `letters`, and notes on it."""
    is_map = isinstance(system, RationalMap | Map)
    if is_map and eps is not None:
        raise wrong("eps", "left out, because a map has its own", eps)
    if letters is None and callable(system) and not is_map and not isinstance(system, Body):
        how = "Field(f, names) of equations, or Map(f, names) of a map"
        received = f"{kind_of(system)}: pass {how}"
        raise wrong("field", "a field, a body or a map", received, TypeError)
    map = exact_map(system, eps, letters)
    notes = [_NO_INVERSE] if is_map and not map.inverse else []
    reduced = system.reduced()[0] if letters is None and hasattr(system, "reduced") else map
    if reduced.dimension < map.dimension:
        count = reduced.dimension
        notes.append(f"J has equal entries: SuslovND.reduced leaves {count} coordinates.")
    return map, notes
