"""The search of a report: facts about a map, each found by a task, in a fixed order.

Tasks share their results through `Search`: a new Darboux polynomial leads to tasks for the
cofactors of its products with earlier ones, and to a task for its proof.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from operator import attrgetter
from typing import Any, NamedTuple

from .birational_maps import LONGEST, RationalMap
from .darboux import candidate_cofactors, nullity, space_of, with_constants
from .degrees_of_iterates import agreed_degrees, growth
from .entropy import PlanarEntropy, planar_entropy, proved_by_integral
from .invariants import Invariants, NormalForms
from .kahan_maps import KahanMap
from .levels import Level, level_of
from .linear_relations import (
    ImplicitIntegral,
    count_relations,
    implicit_integrals,
    integrals_of_relations,
    is_short,
    written_out,
)
from .polynomials import (
    Polynomials,
    degree_of,
    exponents_up_to,
    irreducible_factors,
    sort_key,
    without_content,
)
from .rational_functions import (
    IDENTITY,
    MODULAR,
    RationalFunction,
    factored,
    independent_of,
    quotient_of,
)
from .symmetries import DEGREES, Reversor, reversors

_FEW = 80  # coefficients, at most, of polynomials whose degree exceeds that of the report
_ENOUGH, _MOST = 10, 40  # iterates: enough if a recurrence holds, and at most
_CHEAP, _COSTLY, _TOO_COSTLY = 100, 3_000, 8_000  # degrees, of a map of few monomials
_TOO_LONG = 6_000  # latest degree times length: the next takes 1 to 4 s in the zoo, on an AMD EPYC
_SHORT = 1.0  # seconds that a proof may take before the factors of the map are known
_HIGHEST = 8  # degree of maps whose contracted curves are followed: those of 18 take minutes
_MANY_LETTERS = "contracted curves are followed with one letter at most: set others by map.subs"
# Kinds of tasks in the order in which they run; those of a group run by degree.
_GROUPS = (
    ("Hamiltonian",), ("relations",), ("usual cofactors", "few monomials", "quotients"),
    ("early proofs",), ("degrees",), ("factors",), ("known cofactors", "all cofactors"),
    ("symmetries",), ("proofs",), ("normal forms",), ("formulas",), ("planar entropy",),
    ("levels",),
)  # fmt: skip
_ORDER = {kind: k for k, kinds in enumerate(_GROUPS) for kind in kinds}

ONE = RationalFunction(())
Tasks = Iterable["Task"]


@dataclass(frozen=True, eq=False)
class Task:
    """The search for one fact: a degree, the polynomials of a cofactor, a proof.

    `run` does the work, and returns the tasks that follow from its result. When all tasks of a
    `kind` for polynomials of a `degree` are done, the report lists this kind as searched up to this
    degree. A task that is not `needed` may be left out when tasks of its degree are not expected to
    find more. Tasks run in the order of `place`, and equal ones as they were added.
    """

    run: Callable[[], Tasks]
    kind: str
    degree: int = 0
    needed: bool = True

    def __str__(self) -> str:
        return self.kind + f", degree {self.degree}" * (self.degree > 0)

    @property
    def place(self) -> tuple[int, int, bool]:
        """The sort key of the task in the queue."""
        return _ORDER[self.kind], self.degree, self.kind == "all cofactors"


class Queue:
    """Tasks that are `waiting`; iteration runs them in their order, and yields each when done.

    A task that is not `needed` waits until ``is_wanted(degree)`` is True. Before tasks of a
    kind and a degree run, `at_start` is called with the first one.
    """

    def __init__(self, tasks: Iterable[Task], is_wanted: Callable[[int], bool]) -> None:
        self.done, self.waiting, self._is_wanted = 0, list[Task](), is_wanted
        self.task: Any = None  # that runs
        self.at_start: Callable[[Task], None] = lambda task: None
        self._degrees = defaultdict[str, set[int]](set)  # of all tasks so far, by kind
        self._add(tasks)

    def _add(self, tasks: Iterable[Task]) -> None:
        for task in tasks:
            self.waiting.append(task)
            self._degrees[task.kind].add(task.degree)

    def __iter__(self) -> Iterator[Task]:
        while self.waiting:
            wanted = {k for k in {task.degree for task in self.waiting} if self._is_wanted(k)}
            ready = [task for task in self.waiting if task.needed or task.degree in wanted]
            if not ready:
                break
            task = min(ready, key=attrgetter("place"))
            if str(task) != str(self.task):
                self.at_start(task)
            self.task = task
            self._add(task.run())
            self.waiting.remove(task)
            self.done += 1
            yield task

    def finished(self) -> dict[str, int]:
        """Return, for each kind, the degree up to which all tasks are done."""
        left = {(task.kind, task.degree) for task in self.waiting}
        highest: dict[str, int] = {}
        for kind, degrees in self._degrees.items():
            for degree in sorted(degrees):
                if (kind, degree) in left:
                    break
                highest[kind] = degree
        return highest


class Written(tuple[RationalFunction, ...]):
    """Integrals with a formula; `others` is the number of integrals without one."""

    others = 0

    def __repr__(self) -> str:
        return super().__repr__() + f" and {self.others} without a formula" * (self.others > 0)


class Known(NamedTuple):
    """Integrals, measures and polynomials that follow from other facts of a `Search`."""

    integrals: tuple[RationalFunction, ...] = ()  # independent
    implicit: tuple[ImplicitIntegral, ...] = ()  # independent of those that are written out
    measures: tuple[RationalFunction, ...] = ()  # densities
    polynomials: tuple[RationalFunction, ...] = ()  # Darboux polynomials


class Search:
    """The facts known about a map, and the tasks that find more, by polynomials up to a degree."""

    def __init__(self, map: RationalMap, degree: int, only_integrals: bool = False):
        self.map, self.degree = map, degree
        self._only_integrals = only_integrals
        self.invariants = Invariants(map, degree)
        self.degrees: list[int] = []
        self.relations: int | None = None
        self.symmetries: tuple[Reversor, ...] = ()
        self.planar: PlanarEntropy | None = None
        self.level: Level | None = None
        self.on_level: PlanarEntropy | None = None  # the entropy of the map there
        self.version = 0  # of the polynomials, from which integrals and measures follow
        self._normal_forms = NormalForms(self.invariants)
        self._searched_to: dict[int, int] = {}  # the degree of the latest task of each cofactor
        self._waiting: list[Polynomials] = []  # spaces found before the factors of the map
        self._of_relations: list[ImplicitIntegral] = []  # between few monomials
        self._known, self._version_of_known = Known(), self.version
        self.queue = Queue(self._first_tasks(), self._is_wanted)

    def fill(self, report: Any) -> None:
        """Put all known facts into a report."""
        report.degrees, report.relations = self.degrees, self.relations
        names = self.map.names, self.map.letter
        for name in ("integrals", "measures", "polynomials"):
            setattr(report, name, tuple(f.renamed(*names) for f in getattr(self.known, name)))
        report.implicit, report.integrals = self.known.implicit, Written(report.integrals)
        report.integrals.others = report.independent - len(report.integrals)
        report.symmetries = self.symmetries
        report.level, report.on_level = self.level, self.on_level
        report.planar = proved_by_integral(self.planar, self.known.integrals)
        report.searched = [*self._searched()]

    @property
    def known(self) -> Known:
        """The facts that follow from the polynomials and relations found so far."""
        if self._version_of_known != self.version:
            self._version_of_known, found = self.version, self.invariants
            integrals = found.integrals
            others = tuple(independent_of(integrals, self._of_relations, self.map.prime))
            self._known = Known(integrals, others, found.measures, found.polynomials)
        return self._known

    @property
    def is_complete(self) -> bool:
        """True if a measure is known, and as many integrals as the relations show."""
        enough = self.relations or self.map.dimension
        return bool(self.known.measures) and len(self.known.integrals) >= enough

    def _is_wanted(self, degree: int) -> bool:
        """Return True if polynomials up to a degree may add integrals or replace known ones.

        If enough integrals are known, polynomials of lower degree can still replace them. Above the
        degree of the report, only norms are wanted: products of conjugate polynomials.
        """
        is_small = self.unknowns(degree) <= _FEW
        if degree > self.degree:
            return is_small and len(self.known.integrals) < (self.relations or 0)
        highest = max((f.degree for f in self.known.integrals), default=0)
        if self.is_complete:
            if len(self.map.letters) > 1:  # replacements cost more than they are worth
                return False
            return highest > self.degree or (is_small and degree <= highest)
        return True

    def unknowns(self, degree: int) -> int:
        """Return the number of coefficients of a polynomial of a degree."""
        return math.comb(self.map.dimension + degree, degree)

    # The tasks, by kind.

    def _first_tasks(self) -> Iterator[Task]:
        map = self.map
        if not self._only_integrals:
            yield self._next_degree(agreed_degrees(map))
            if map.is_planar:
                yield Task(self._find_planar_entropy, "planar entropy")
            if map.dimension > 2 and map.is_birational and not map.is_symbolic:
                yield Task(self._find_entropy_on_level, "levels")
            if isinstance(map, KahanMap) and map.dimension in DEGREES:
                yield Task(self._find_symmetries, "symmetries")
        if not map.is_invertible:
            return
        if map.hamiltonian is not None:
            yield Task(self._modified_energy, "Hamiltonian")
        for k in range(1, self.degree + 1):
            yield Task(partial(self._count_relations, k), "relations", k)
        for cofactor in (ONE, None):
            for sign in (1, -1):
                yield self._polynomials_of(cofactor, sign, 1, "usual cofactors")
        yield Task(self._find_factors, "factors")

    def _next_degree(self, following: Iterator[int]) -> Task:
        """Return a task: take a degree from `following`, and add another such task if needed."""

        def run() -> Tasks:
            self.degrees = [*self.degrees, next(following)]
            self._check_degrees()
            if not self._has_enough_degrees():
                yield self._next_degree(following)

        return Task(run, "degrees")

    def _expected_degree(self) -> float:
        """Return the degree that is expected next, d_n**2 / d_(n - 1)."""
        d: list[int] = [1, *self.degrees]
        return d[-1] ** 2 / max(1, d[-2]) if len(d) > 2 else float(d[-1] * self.map.degree)

    @property
    def _next_degree_is_too_long(self) -> bool:
        """True if the next degree, including common factors, would take long."""
        is_long = self.degrees[-1] * self.map.length > _TOO_LONG
        return is_long or self._expected_degree() > _TOO_COSTLY

    def _has_enough_degrees(self) -> bool:
        count, expected = len(self.degrees), self._expected_degree()
        if self._next_degree_is_too_long or count == _MOST:
            return True
        may_end = count >= _ENOUGH and self.degrees[-1] > _CHEAP
        may_end = may_end or expected * self.map.length > _COSTLY
        by_degrees = growth(self.degrees, planar=self.map.is_planar)
        return may_end and not math.isnan(by_degrees.entropy)

    def _check_degrees(self) -> None:
        """Raise an error if degrees and contracted curves contradict each other."""
        if self.planar and (text := self.planar.contradiction(self.degrees)):
            raise ArithmeticError(f"{self.map}: {text}: this is an error of the package")

    def _find_planar_entropy(self) -> Tasks:
        """Follow the contracted curves, unless that takes long and a proved integral suffices."""
        is_proved = any(f.basis == IDENTITY for f in self.known.integrals)
        has_letters, degree = len(self.map.letters) > 1, self.map.degree
        if is_proved and (has_letters or self.map.length > 1 or degree > _HIGHEST):
            self.planar = PlanarEntropy(reason="not followed: a proved integral gives the entropy")
        elif has_letters:
            self.planar = PlanarEntropy(reason=_MANY_LETTERS)
        elif degree > _HIGHEST:
            self.planar = PlanarEntropy(reason=f"not followed: a map of degree {degree} takes long")
        else:
            self.planar = planar_entropy(self.map)
        self._check_degrees()
        return []

    def _find_entropy_on_level(self) -> Tasks:
        """Find the entropy on the generic level of D - 2 integrals."""
        integrals = self.known.integrals
        if len(integrals) == self.map.dimension - 2:
            try:
                self.level = level_of(self.map, integrals)
                self.on_level = planar_entropy(self.level.map)
            except (ArithmeticError, ValueError) as error:
                self.on_level = PlanarEntropy(reason=str(error))
        return []

    def _find_symmetries(self) -> Tasks:
        self.symmetries = tuple(reversors(self.map))  # type: ignore[arg-type]
        return []

    def _modified_energy(self) -> Tasks:
        """Add the density 1 / det A, and the modified energy if there is one; return tasks."""
        ring, modified = self.map.ring, self.map.modified_energy
        density = quotient_of(ring.constant(1), without_content(self.map.denominator), IDENTITY)
        self.invariants.densities.append(density)
        self.version += 1
        return self._add_space(modified.as_quotient(ring)) if modified else []

    def _count_relations(self, k: int) -> Tasks:
        """Count the integrals that relations up to degree k show; yield tasks for formulas."""
        exponents = exponents_up_to(k, self.map.dimension)
        independent = count_relations(self.map, exponents).integrals
        if independent > (self.relations or 0):
            yield Task(partial(self.integrals_between_few_monomials, k), "few monomials", k)
        self.relations = max(self.relations or 0, independent)
        if independent:
            yield Task(partial(self.quotients_of_relations, k), "quotients", k)

    def quotients_of_relations(self, k: int) -> Tasks:
        """Add integrals by relations of all monomials to degree k, if any lack; return tasks."""
        if len(self.known.integrals) >= (self.relations or 0):
            return []
        exponents = exponents_up_to(k, self.map.dimension)
        return self._add_space(integrals_of_relations(self.map, exponents))

    def integrals_between_few_monomials(self, k: int) -> Tasks:
        """Find missing integrals by relations of few monomials to degree k; yield tasks."""
        missing = (self.relations or 0) - len(self.known.integrals)
        exponents = exponents_up_to(k, self.map.dimension)
        if missing <= len(self.known.implicit):
            return
        candidates = implicit_integrals(self.map, exponents)
        independent = independent_of(self.known.integrals, candidates, self.map.prime)
        self._of_relations = [*islice(independent, missing)]
        self.version += 1
        # Darboux polynomials, which come before, give nicer formulas.
        for integral in filter(is_short, self._of_relations):
            yield Task(partial(self._write_out, integral), "formulas", integral.degree)

    def _write_out(self, integral: ImplicitIntegral) -> Tasks:
        """Write out the formula of an integral of a relation, if still needed; return tasks."""
        formula = written_out(integral) if integral in self.known.implicit else None
        return [] if formula is None else self._add_space(formula.as_quotient(self.map.ring))

    def _find_factors(self) -> Tasks:
        if self.map.factors is None:
            for space in self._waiting:
                yield from self._proof_of_quotients(space)
            return
        self.invariants.has_factors = True
        self.version += 1
        self.invariants.spaces.clear()
        self.invariants.early_densities.clear()
        for space in self._waiting:
            yield from self._add_space(space)
        for k in range(1, 2 * self.degree + 1):
            if k <= self.degree or self.unknowns(k) <= _FEW:
                yield self._next_candidate(candidate_cofactors(self.map, k), k)

    def _next_candidate(self, candidates: Iterator[RationalFunction], k: int) -> Task:
        """Return a task: try the next of `candidates`, cofactors of degree k; add a like task."""

        def run() -> Tasks:
            for candidate in candidates:
                for cofactor in with_constants(self.map, k, candidate):
                    yield self._polynomials_of(cofactor, 1, k, "all cofactors", k)
                yield self._next_candidate(candidates, k)
                return

        return Task(run, "all cofactors", k, needed=False)

    def _polynomials_of(
        self, cofactor: RationalFunction | None, sign: int, k: int, kind: str, last: int = 0
    ) -> Task:
        """Return a task of this `kind`: find P with P(Phi) = sign * cofactor * P up to degree k.

        Tasks to `last`, by default the search's degree, follow. The cofactor None is det DPhi.
        """

        def run() -> Tasks:
            yield from self._find_polynomials(cofactor, sign, k)
            if k < (last or self.degree):
                yield self._polynomials_of(cofactor, sign, k + 1, kind, last)

        return Task(run, kind, k, needed=False)

    def _find_polynomials(self, cofactor: RationalFunction | None, sign: int, k: int) -> Tasks:
        """Add P to degree k, P(Phi) = sign * cofactor (None: det DPhi) * P; return tasks."""
        if cofactor is None and self.invariants.has_factors:
            cofactor = self.map.jacobian_cofactor
        known: list[Any] = []
        if cofactor is not None:
            cofactor, sign = sign * cofactor, 1
            value = self.invariants.value(cofactor)
            if self._searched_to.get(value, 0) >= k:
                return []
            self._searched_to[value] = k
            known = self.invariants.products.get(value, [])
        try:
            dimension = nullity(self.map, k, cofactor, sign)
            if dimension <= min(1, len(known)):
                return []
            if cofactor is not None and dimension == len(self.invariants.elements(value, k)):
                return []
            space = space_of(self.map, k, cofactor, sign)
        except ArithmeticError:  # the coefficients are too long, or a number is special
            return []
        if cofactor is None and sign == 1 and space:
            densities = (factored(P) ** -1 for P in sorted(space, key=sort_key))
            self.invariants.early_densities += [replace(f, basis=MODULAR) for f in densities]
            self.version += 1
        return self._add_space(space, cofactor)

    # Polynomials that were found.

    def _add_space(self, space: Polynomials, cofactor: RationalFunction | None = None) -> Tasks:
        """Add `space`, polynomials with one cofactor (None: unknown); return tasks that follow."""
        if not space:
            return []
        space = tuple(sorted(map(without_content, space), key=sort_key))
        self.version += 1
        if not self.invariants.has_factors:
            self._waiting.append(space)
            self.invariants.spaces.append([replace(factored(P), basis=MODULAR) for P in space])
            return self._proof_of_quotients(space, "early proofs", _SHORT)
        tasks: list[Task] = []
        # Factors that have a cofactor are Darboux polynomials themselves.
        for f in (f for P in space for f, _ in irreducible_factors(P) if degree_of(f)):
            if (cofactor_of_f := self.map.cofactor(f)) is not None:
                tasks += self._add_generator(f, cofactor_of_f)
        if cofactor is None:
            cofactor = self.map.cofactor(space[0])
        if cofactor is None:
            self.invariants.spaces.append([replace(factored(P), basis=MODULAR) for P in space])
            return [*tasks, *self._proof_of_quotients(space)]
        for P in space:
            tasks += self._add_generator(P, cofactor)
        return tasks

    def _normal_form(self, value: int) -> Tasks:
        """Replace P of the cofactor that `value` identifies by a simpler basis; yield tasks."""
        new = self._normal_forms.update(value)
        self.version += 1
        for P in (P for g in new if len(g.factors) > 1 for P, _ in g.factors):
            if (cofactor := self.map.cofactor(P)) is not None:  # then the product is left out
                yield from self._add_generator(P, cofactor)
        yield from (self._proof(g) for g in new if g.basis != IDENTITY)

    def _add_generator(self, P: Any, cofactor: RationalFunction) -> Tasks:
        """Add a Darboux polynomial, unless products of others give it; yield tasks that follow."""
        known = self.invariants
        if known.is_known(P, cofactor):
            return
        g = replace(factored(P), basis=MODULAR, cofactor=cofactor)
        added = known.add(g)
        self.version += 1
        if not self._only_integrals:
            yield self._proof(g)
            values = {known.value(generator.cofactor) for generator in known.generators}
            for value in values & {value for value, _ in added}:
                yield Task(partial(self._normal_form, value), "normal forms")
        lowest: dict[int, int] = {}
        for value, degree in added:
            lowest[value] = min(degree, lowest.get(value, degree))
        for value, degree in lowest.items():
            for sign in (1, -1):
                if self._searched_to.get(sign * value % self.map.prime, 0) < degree <= self.degree:
                    yield self._polynomials_of(
                        known.cofactors[value], sign, degree, "known cofactors"
                    )

    def _proof(self, g: RationalFunction) -> Task:
        """Return the task that proves P(Phi) = C P for a Darboux polynomial g, as an identity."""
        map, P = self.map, self.invariants.polynomial(g)
        cost = map.cost_of_pullback(P, g.degree)

        def run() -> Tasks:
            if cost <= LONGEST and g in self.invariants.generators:
                scale = g.cofactor * factored(map.forms[-1]) ** g.degree
                numerator, denominator = scale.as_quotient(map.ring)
                if map.pullback(P, g.degree) * denominator != P * numerator:
                    raise ArithmeticError(f"{g} has not the cofactor {g.cofactor}")
                number = self.invariants.generators.index(g)
                self.invariants.generators[number] = replace(g, basis=IDENTITY)
                self.version += 1
            return []

        return Task(run, "proofs")

    def _proof_of_quotients(
        self, space: Polynomials, kind: str = "proofs", longest: float = LONGEST
    ) -> Tasks:
        """Yield a task, `kind`: prove that quotients of `space` are integrals, in `longest` s."""
        cost = self.map.cost_of_pullbacks(space)

        def run() -> Tasks:
            if cost <= longest:
                images = self.map.pullbacks(space)
                pairs = zip(images, space, strict=True)
                if any(image * space[0] != images[0] * P for image, P in pairs):
                    raise ArithmeticError(f"{space} have different cofactors")
                proved = [replace(factored(P), basis=IDENTITY) for P in space]
                for number, known in enumerate(self.invariants.spaces):
                    if str(known) == str(proved):
                        self.invariants.spaces[number] = proved
                self.version += 1
            return []

        yield Task(run, kind)

    def _searched(self) -> Iterator[str]:
        """Yield texts for the report: what was searched, and up to which degree."""
        degrees = self.queue.finished()
        if self.degrees:
            is_unclear = math.isnan(growth(self.degrees, planar=self.map.is_planar).entropy)
            ended = ", the next takes long" * (is_unclear and self._next_degree_is_too_long)
            yield f"degrees of {len(self.degrees)} iterates{ended}"
        if not self.map.is_invertible:
            yield "nothing else: the map has no inverse, since det DPhi = 0"
        for kind, text in _TEXTS.items():
            if (k := degrees.get(kind)) is not None:
                count = self.unknowns(k)
                planar = self.planar if kind == "planar entropy" else None
                reason = f" ({planar.reason})" if planar and planar.reason else ""
                yield text.format(k=k, count=count) + reason
        if "factors" in degrees and not self.invariants.has_factors:
            yield "no other Darboux polynomials, since det DPhi is too long"
        if self.is_complete and self.queue.waiting:
            yield "no more, since as many integrals as relations show are known"


_TEXTS = {
    "Hamiltonian": "the modified energy and 1/det A of the Hamiltonian",
    "relations": "relations between the {count} monomials up to degree {k}",
    "usual cofactors": "polynomials up to degree {k} with the cofactors 1, -1, det DPhi and "
    "-det DPhi",
    "known cofactors": "polynomials up to degree {k} with products of known cofactors, and minus "
    "these",
    "planar entropy": "the orbits of contracted curves",
    "levels": "the map on the generic level of the integrals",
    "symmetries": "affine involutions with numbers as entries that take the map to its inverse",
    "all cofactors": "Darboux polynomials up to degree {k} with products of powers of the factors "
    "of det DPhi as cofactors",
}
