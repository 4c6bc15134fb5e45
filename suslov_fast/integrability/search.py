"""The search of a report: tasks, each of which finds one fact about a map, in a fixed order.

Results lead to further tasks. A new Darboux polynomial, for example, leads to its proof, and to
searches for polynomials with the cofactors of its products with earlier ones.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from operator import attrgetter
from typing import Any, NamedTuple

from . import linear_relations, polynomials, rational_functions
from .birational_maps import RationalMap
from .darboux import Determinant, candidate_cofactors, nullity, space_of, with_constants
from .degrees_of_iterates import agreed_degrees, growth
from .entropy import PlanarEntropy, planar_entropy, proved_by_integral
from .integrals_of_polynomials import DarbouxInvariants
from .kahan_maps import KahanMap
from .levels import Level, on_level
from .levels_of_integrals import quotient_of_lines
from .linear_relations import ImplicitIntegral, count_relations, implicit_integrals, written_out
from .polynomials import Polynomials, degree_of, exponents_up_to, sort_key, without_content
from .rational_functions import IDENTITY, MODULAR, RationalFunction, factored, independent_of
from .symmetries import Reversor, reversors
from .tolerances import (
    COST_OF_ITERATES,
    COST_OF_KNOWN_GROWTH,
    COST_OF_LATEST_DEGREE,
    DEGREE_OF_CHEAP_ITERATES,
    ENOUGH_ITERATES,
    HIGHEST_MAP_OF_CURVES,
    LONGEST_PROOF_BEFORE_FACTORS,
    LONGEST_PULLBACK,
    MOST_COEFFICIENTS_OF_OTHERS,
    MOST_DIMENSIONS_OF_PERMUTATIONS,
    MOST_ITERATES,
    MOST_TERMS_WRITTEN,
)

# Kinds of tasks in the order in which they run; in one tuple, tasks of lower degree run first.
_GROUPS = (
    ("Hamiltonian",), ("relations",), ("usual cofactors", "few monomials", "quotients"),
    ("early proofs",), ("degrees",), ("factors",), ("known cofactors", "all cofactors"),
    ("symmetries",), ("proofs",), ("normal forms",), ("formulas",), ("planar entropy",),
    ("pencil",), ("levels",), ("lines",),
)  # fmt: skip
_ORDER = {kind: k for k, kinds in enumerate(_GROUPS) for kind in kinds}

Tasks = Iterable["Task"]


@dataclass(frozen=True, eq=False)
class Task:
    """The search for one fact: a degree of an iterate, the polynomials of a cofactor, a proof."""

    run: Callable[[], Tasks]  # does the work, and returns the tasks that follow from its result
    kind: str
    degree: int = 0  # of the polynomials sought; a report says to which degree each kind is done
    needed: bool = True  # False: the task runs only if `Search._is_wanted(degree)`

    def __str__(self) -> str:
        return self.kind + f", degree {self.degree}" * (self.degree > 0)

    @property
    def place(self) -> tuple[int, int, bool]:
        """The sort key of the task in the queue; tasks with equal keys run as they were added."""
        return _ORDER[self.kind], self.degree, self.kind == "all cofactors"


class Queue:
    """The tasks that are `waiting`. Iteration runs them in order, and yields each finished task.

    A task runs only if it is `needed`, or if ``is_wanted(degree)`` is True for its degree.
    Iteration ends when no such task is waiting.
    """

    def __init__(self, tasks: Tasks, is_wanted: Callable[[int], bool]) -> None:
        self.done, self.waiting, self._is_wanted = 0, list[Task](), is_wanted
        self.task: Any = None  # the task that runs
        # Called before the first task of each kind and degree.
        self.at_start: Callable[[Task], None] = lambda task: None
        self._degrees = defaultdict[str, set[int]](set)  # degrees of all tasks so far, by kind
        self._add(tasks)

    def _add(self, tasks: Tasks) -> None:
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
        waiting = {(task.kind, task.degree) for task in self.waiting}
        highest: dict[str, int] = {}
        for kind, degrees in self._degrees.items():
            for degree in sorted(degrees):
                if (kind, degree) in waiting:
                    break
                highest[kind] = degree
        return highest


class Written(tuple[RationalFunction, ...]):
    """The integrals that have a formula; `others` is the number of integrals without one."""

    others = 0

    def __repr__(self) -> str:
        return super().__repr__() + f" and {self.others} without a formula" * (self.others > 0)


class Known(NamedTuple):
    """Integrals, measures and Darboux polynomials that are known at some moment of a search."""

    integrals: tuple[RationalFunction, ...]  # independent integrals
    implicit: tuple[ImplicitIntegral, ...]  # further independent integrals, without a formula
    measures: tuple[RationalFunction, ...]  # densities
    polynomials: tuple[RationalFunction, ...]


class Search:
    """The known facts about a map, and tasks that find more with polynomials up to a degree."""

    def __init__(self, map: RationalMap, degree: int, only_integrals: bool = False):
        self.map, self.degree = map, degree
        self._only_integrals = only_integrals
        self.invariants = DarbouxInvariants(map, degree)
        self.degrees: list[int] = []
        self.relations: int | None = None
        self.symmetries: tuple[Reversor, ...] = ()
        self._of_lines = dict[
            str, RationalFunction
        ]()  # integrals as quotients of lines, by formula
        self._sought = ""  # kinds of reversing symmetries that were sought
        self.planar: PlanarEntropy | None = None
        self.level: Level | None = None
        self.on_level: PlanarEntropy | None = None  # the entropy of the map on `level`
        self._searched_to: dict[int, int] = {}  # {cofactor at a random point: degree searched}
        self._of_relations: list[ImplicitIntegral] = []  # from minimal sets of dependent monomials
        self._known: Known | None = None  # None after a change of `invariants`
        self.queue = Queue(self._first_tasks(), self._is_wanted)

    def fill(self, report: Any) -> None:
        """Put all known facts into a report."""
        report.degrees, report.relations = self.degrees, self.relations
        names = self.map.names, self.map.letter
        for name in ("integrals", "measures", "polynomials"):
            functions = (self._of_lines.get(str(f), f) for f in getattr(self.known, name))
            setattr(report, name, tuple(f.renamed(*names) for f in functions))
        report.implicit, report.integrals = self.known.implicit, Written(report.integrals)
        report.integrals.others = report.independent - len(report.integrals)
        report.symmetries = self.symmetries
        report.level, report.on_level = self.level, self.on_level
        report.planar = proved_by_integral(self.planar, self.known.integrals)
        report.searched = [*self._searched()]

    @property
    def known(self) -> Known:
        """The facts that follow from the polynomials and relations found so far."""
        if self._known is None:
            facts = self.invariants
            integrals = facts.integrals
            implicit = tuple(independent_of(integrals, self._of_relations, self.map.prime))
            measures = facts.measures
            functions = integrals if facts.has_factors else (*integrals, *measures)
            polynomials = *facts.polynomials, *facts.parts_of(functions)
            self._known = Known(integrals, implicit, measures, polynomials)
        return self._known

    @property
    def is_complete(self) -> bool:
        """True if a measure is known, and as many integrals as the relations show."""
        enough = self.relations or self.map.dimension
        return bool(self.known.measures) and len(self.known.integrals) >= enough

    def _is_wanted(self, degree: int) -> bool:
        """Return True if polynomials of this degree may add integrals, or replace longer ones."""
        is_small = self.unknowns(degree) <= MOST_COEFFICIENTS_OF_OTHERS
        if degree > self.degree:  # up to twice: P times its conjugate, if P is not rational
            return is_small and len(self.known.integrals) < (self.relations or 0)
        if not self.is_complete:
            return True
        if len(self.map.letters) > 1:  # to seek shorter integrals would take too long
            return False
        highest = max((f.degree for f in self.known.integrals), default=0)
        return highest > self.degree or (is_small and degree <= highest)

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
            if isinstance(map, KahanMap) and map.dimension <= MOST_DIMENSIONS_OF_PERMUTATIONS:
                yield Task(self._find_symmetries, "symmetries")
            if map.dimension == 2 and len(map.letters) < 2:
                yield Task(self._find_quotients_of_lines, "lines")
        if not map.is_invertible:
            return
        if map.hamiltonian is not None:
            yield Task(self._add_modified_energy, "Hamiltonian")
        for k in range(1, self.degree + 1):
            yield Task(partial(self._count_relations, k), "relations", k)
        one = RationalFunction(())
        for cofactor in (one, -one, Determinant(map), Determinant(map, -1)):
            yield self._polynomials_of(cofactor, 1, "usual cofactors")
        yield Task(self._find_factors, "factors")

    def _next_degree(self, following: Iterator[int]) -> Task:
        """Return the task that takes a degree from `following`, and adds the next such task."""

        def run() -> Tasks:
            self.degrees = [*self.degrees, next(following)]
            if not self._has_enough_degrees():
                yield self._next_degree(following)

        return Task(run, "degrees")

    @property
    def _expected_degree(self) -> float:
        """The degree of the next iterate if degrees grow by a constant factor."""
        d: list[int] = [1, *self.degrees]
        return d[-1] ** 2 / max(1, d[-2])

    @property
    def _next_degree_is_too_long(self) -> bool:
        """True if the next degree would take long."""
        is_long = self.degrees[-1] * self.map.length > COST_OF_LATEST_DEGREE
        return is_long or self._expected_degree > COST_OF_ITERATES

    def _has_enough_degrees(self) -> bool:
        if self._next_degree_is_too_long or len(self.degrees) == MOST_ITERATES:
            return True
        may_end = (
            len(self.degrees) >= ENOUGH_ITERATES and self.degrees[-1] > DEGREE_OF_CHEAP_ITERATES
        )
        may_end = may_end or self._expected_degree * self.map.length > COST_OF_KNOWN_GROWTH
        by_degrees = growth(self.degrees, planar=self.map.is_planar)
        return may_end and not math.isnan(by_degrees.entropy)

    def _find_planar_entropy(self) -> Tasks:
        """Follow the contracted curves, unless that takes long and a proved integral suffices."""
        is_proved = any(f.basis == IDENTITY for f in self.known.integrals)
        has_letters, degree = len(self.map.letters) > 1, self.map.degree
        if is_proved and (has_letters or self.map.length > 1 or degree > HIGHEST_MAP_OF_CURVES):
            self.planar = PlanarEntropy(reason="not followed: a proved integral gives the entropy")
        elif degree > HIGHEST_MAP_OF_CURVES:
            self.planar = PlanarEntropy(reason=f"not followed: a map of degree {degree} takes long")
        elif has_letters and self.map.cost_of_factors > LONGEST_PULLBACK:
            self.planar = PlanarEntropy(reason="not followed: a map with such letters takes long")
        else:
            self.planar = planar_entropy(self.map)
        if text := self.planar.contradiction(self.degrees):
            raise ArithmeticError(f"{self.map}: {text}: this is an error of the package")
        degree = self.planar.pencil or 0
        if (
            self.degree < degree
            and self.unknowns(degree) <= MOST_COEFFICIENTS_OF_OTHERS
            and not self.known.integrals
        ):
            yield Task(partial(self._find_quotients_of_relations, degree), "pencil", degree)

    def _find_entropy_on_level(self) -> Tasks:
        """Find the entropy on the generic level of D - 2 integrals."""
        integrals = self.known.integrals
        if len(integrals) == self.map.dimension - 2:
            try:
                self.level = on_level(self.map, integrals)
                self.on_level = planar_entropy(self.level.map)
            except (ArithmeticError, ValueError) as error:
                self.on_level = PlanarEntropy(reason=str(error))
        return []

    def _find_symmetries(self) -> Tasks:
        found, self._sought = reversors(self.map)  # type: ignore[arg-type]
        self.symmetries = tuple(found)
        return []

    def _find_quotients_of_lines(self) -> Tasks:
        """Find functions of integrals that are quotients of products of lines."""
        for f in self.known.integrals:
            if quotient := quotient_of_lines(f, self.invariants.reducible):
                self._of_lines[str(f)] = quotient
        return []

    def _add_modified_energy(self) -> Tasks:
        """Add the density 1 / det A and the modified energy, which follow from a Hamiltonian."""
        ring, modified = self.map.ring, self.map.modified_energy
        denominator = without_content(self.map.denominator)
        density = rational_functions.quotient_of(ring.constant(1), denominator, IDENTITY)
        self.invariants.densities.append(density)
        self._known = None
        return self._add_space(modified.as_quotient(ring)) if modified else []

    def _count_relations(self, k: int) -> Tasks:
        """Count the integrals that relations up to degree k show; yield tasks for formulas."""
        independent = count_relations(self.map, exponents_up_to(k, self.map.dimension)).integrals
        if independent > (self.relations or 0):
            yield Task(partial(self._find_integrals_of_circuits, k), "few monomials", k)
        self.relations = max(self.relations or 0, independent)
        if independent:
            yield Task(partial(self._find_quotients_of_relations, k), "quotients", k)

    def _find_quotients_of_relations(self, k: int) -> Tasks:
        """Find integrals that are quotients of relations up to degree k, if formulas lack."""
        if len(self.known.integrals) >= max(1, self.relations or 0):
            return []
        exponents = exponents_up_to(k, self.map.dimension)
        return self._add_space(linear_relations.integrals_of_relations(self.map, exponents))

    def _find_integrals_of_circuits(self, k: int) -> Tasks:
        """Find missing integrals from circuits of monomials up to degree k."""
        missing = (self.relations or 0) - len(self.known.integrals)
        if missing <= len(self.known.implicit):
            return
        candidates = implicit_integrals(self.map, exponents_up_to(k, self.map.dimension))
        independent = independent_of(self.known.integrals, candidates, self.map.prime)
        self._of_relations = [*islice(independent, missing)]
        self._known = None
        # Tasks "formulas" run late: Darboux polynomials, found first, often give simpler integrals.
        for integral in self._of_relations:
            if self.unknowns(integral.degree) <= MOST_TERMS_WRITTEN:
                yield Task(partial(self._write_out, integral), "formulas", integral.degree)

    def _write_out(self, integral: ImplicitIntegral) -> Tasks:
        """Write out the formula of an integral of a circuit, if none was found since."""
        formula = written_out(integral) if integral in self.known.implicit else None
        return [] if formula is None else self._add_space(formula.as_quotient(self.map.ring))

    def _find_factors(self) -> Tasks:
        """Factor det DPhi, look up the cofactors of polynomials found so far, and try others."""
        polynomial = self.invariants.polynomial
        spaces = [tuple(map(polynomial, functions)) for functions in self.invariants.spaces]
        if self.map.factors is None:
            for space in spaces:
                yield from self._proof_of_quotients(space)
            return
        self.invariants.has_factors = True
        self._known = None
        self.invariants.spaces.clear()
        self.invariants.early_densities.clear()
        for space in spaces:
            yield from self._add_space(space)
        for k in range(1, 2 * self.degree + 1):
            if k <= self.degree or self.unknowns(k) <= MOST_COEFFICIENTS_OF_OTHERS:
                yield self._next_candidate(candidate_cofactors(self.map, k), k)

    def _next_candidate(self, candidates: Iterator[RationalFunction], k: int) -> Task:
        """Return the task that tries the next of `candidates`, cofactors of degree k."""

        def run() -> Tasks:
            for candidate in candidates:
                for cofactor in with_constants(self.map, k, candidate):
                    yield self._polynomials_of(cofactor, k, "all cofactors", k)
                yield self._next_candidate(candidates, k)
                return

        return Task(run, "all cofactors", k, needed=False)

    def _polynomials_of(self, cofactor: Any, k: int, kind: str, last: int = 0) -> Task:
        """Return the task, of the `kind`, that finds P up to degree k with P(Phi) = cofactor * P.

        When it ends, it starts the task for the degree k + 1, up to the degree `last`; 0 stands for
        the degree of the search.
        """

        def run() -> Tasks:
            yield from self._find_polynomials(cofactor, k)
            if k < (last or self.degree):
                yield self._polynomials_of(cofactor, k + 1, kind, last)

        return Task(run, kind, k, needed=False)

    def _find_polynomials(self, cofactor: Any, k: int) -> Tasks:
        """Find the polynomials of `_polynomials_of`, unless they are known; return new tasks."""
        facts, known = self.invariants, list[Any]()
        if isinstance(cofactor, Determinant) and facts.has_factors:
            cofactor = self.map.jacobian_cofactor * cofactor.sign  # type: ignore[operator]
        in_factors = cofactor if isinstance(cofactor, RationalFunction) else None
        if in_factors:
            value = facts.value(cofactor)
            if self._searched_to.get(value, 0) >= k:
                return []
            self._searched_to[value] = k
            known = facts.products.get(value, [])
        try:
            dimension = nullity(self.map, k, cofactor)
            if dimension <= min(1, len(known)):
                return []
            if in_factors and dimension == len(facts.elements(value, k)):
                return []
            space = space_of(self.map, k, cofactor)
        except ArithmeticError:  # too many terms, long coefficients, or a special random point
            return []
        if cofactor == Determinant(self.map):
            densities = (factored(P) ** -1 for P in sorted(space, key=sort_key))
            facts.early_densities += [replace(f, basis=MODULAR) for f in densities]
        return self._add_space(space, in_factors)

    # Polynomials that were found.

    def _add_space(self, space: Polynomials, cofactor: RationalFunction | None = None) -> Tasks:
        """Add polynomials with the same cofactor, None if unknown; return the tasks that follow."""
        if not space:
            return []
        space = tuple(sorted(map(without_content, space), key=sort_key))
        self._known = None
        if not self.invariants.has_factors:
            self.invariants.spaces.append([replace(factored(P), basis=MODULAR) for P in space])
            return self._proof_of_quotients(space, "early proofs", LONGEST_PROOF_BEFORE_FACTORS)
        tasks: list[Task] = []
        # Factors that have a cofactor are Darboux polynomials themselves.
        for f in (f for P in space for f, _ in polynomials.irreducible_factors(P) if degree_of(f)):
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
        """Replace polynomials of a cofactor by a simpler basis of the same space; yield tasks."""
        new = self.invariants.normalize(value)
        self._known = None
        for P in (P for g in new if len(g.factors) > 1 for P, _ in g.factors):
            if (cofactor := self.map.cofactor(P)) is not None:  # such factors replace g
                yield from self._add_generator(P, cofactor)
        yield from (self._proof(g) for g in new if g.basis != IDENTITY)

    def _add_generator(self, P: Any, cofactor: RationalFunction) -> Tasks:
        """Add a Darboux polynomial, unless it is a combination of products of others."""
        known = self.invariants
        if known.is_known(P, cofactor):
            return
        g = replace(factored(P), basis=MODULAR, cofactor=cofactor)
        added = known.add(g)
        self._known = None
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
                    product = sign * known.cofactors[value]
                    yield self._polynomials_of(product, degree, "known cofactors")

    def _proof(self, g: RationalFunction) -> Task:
        """Return the task that proves P(Phi) = C P as an identity, for a Darboux polynomial g."""
        map, P = self.map, self.invariants.polynomial(g)
        cost = map.cost_of_pullback(P, g.degree)

        def run() -> Tasks:
            if cost <= LONGEST_PULLBACK and g in self.invariants.generators:
                scale = g.cofactor * factored(map.forms[-1]) ** g.degree
                numerator, denominator = scale.as_quotient(map.ring)
                if map.pullback(P, g.degree) * denominator != P * numerator:
                    raise ArithmeticError(f"{g} has not the cofactor {g.cofactor}")
                number = self.invariants.generators.index(g)
                self.invariants.generators[number] = replace(g, basis=IDENTITY)
                self._known = None
            return []

        return Task(run, "proofs")

    def _proof_of_quotients(
        self, space: Polynomials, kind: str = "proofs", longest: float = LONGEST_PULLBACK
    ) -> Tasks:
        """Yield the task that proves that quotients of `space` are integrals, in `longest` s."""
        cost = self.map.cost_of_pullbacks(space)

        def run() -> Tasks:
            if cost <= longest:
                images = self.map.pullbacks(space)
                pairs = zip(images, space, strict=True)
                if any(image * space[0] != images[0] * P for image, P in pairs):
                    raise ArithmeticError(f"{space} have different cofactors")
                proved = [replace(factored(P), basis=IDENTITY) for P in space]
                spaces = self.invariants.spaces
                spaces[:] = [proved if str(each) == str(proved) else each for each in spaces]
                self._known = None
            return []

        yield Task(run, kind)

    def _searched(self) -> Iterator[str]:
        """Yield texts for the report: which polynomials were searched, and up to which degree."""
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
                if kind == "symmetries":
                    reason = f": {self._sought}"
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
    "pencil": "relations between the {count} monomials up to the degree {k} of the pencil",
    "levels": "the map on the generic level of the integrals",
    "symmetries": "involutions that take the map to its inverse",
    "all cofactors": "Darboux polynomials up to degree {k} with products of powers of the factors "
    "of det DPhi as cofactors",
}
