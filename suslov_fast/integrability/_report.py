"""A report of what is there: degrees, first integrals, measures, invariant hypersurfaces.

`_search` fills it: with the degrees of iterates on random lines (`_growth`), the number of
integrals that relations along orbits show (`_relations`), the Darboux polynomials of all products
of factors of the map (`_projective`), found modulo primes (`_darboux`), the integrals and measures
that follow from them and are checked as identities (`_invariants`), and the curves of a planar map
(`_planar`).
"""

from __future__ import annotations

import dataclasses
import math
import random
import textwrap
import time
from collections.abc import Callable, Iterator
from fractions import Fraction
from typing import Any

from .._bodies.field import QuadraticField
from .._checks import integer, real_array, wrong
from .._engine.progress import Progress, check_progress, reporter
from . import _exact
from ._functions import IDENTITY, MODULAR, RationalFunction, independent, latex, quotient_of
from ._growth import Growth, degrees_on_a_line, growth
from ._invariants import Invariants
from ._maps import KahanMap, kahan
from ._planar import Pencil, pencil
from ._projective import Projective
from ._relations import Relations, hk_bases

_FEW = 80  # coefficients of a polynomial of more than the degree
_ENOUGH, _DEGREES = 10, 24  # iterates, if a recurrence holds and at most
_LARGE, _LARGEST = 3_000, 25_000  # degrees, likewise
_WIDTH = 110  # of a line of the text
_LONG = 2**30  # denominators of floats such as 0.1
_PROOF = {IDENTITY: "proved", MODULAR: f"checked {MODULAR}"}

Functions = tuple[RationalFunction, ...]


@dataclasses.dataclass(repr=False)
class Report:
    """Results of `report` for a Kahan map.

    Each of `integrals`, `measures` (densities) and `polynomials` (Darboux polynomials) can be
    called with a point; `str` gives its formula, and its `basis` says what it rests on: "identity",
    checked as an identity of rational functions, or "modulo a prime, at random points". A growth is
    evidence.
    """

    field: QuadraticField
    eps: Fraction
    degree: int  # the largest that was searched
    degrees: list[int] = dataclasses.field(default_factory=list)
    integrals: Functions = ()  # independent
    measures: Functions = ()
    polynomials: Functions = ()
    pencil: Pencil | None = None  # of invariant curves, of a planar map with an integral
    relations: int | None = None  # the number of independent integrals that orbits show
    searched: list[str] = dataclasses.field(default_factory=list)
    notes: list[str] = dataclasses.field(default_factory=list)
    finished: bool = False

    @property
    def growth(self) -> Growth:
        """The growth of the degrees."""
        return growth(self.degrees)

    @property
    def entropy(self) -> float:
        """The algebraic entropy."""
        return self.growth.entropy

    @property
    def hyperplanes(self) -> Functions:
        """Those of `polynomials` that are 0 on invariant lines, planes or hyperplanes."""
        return tuple(f for f in self.polynomials if f.degree == 1 and not f.maps_to_infinity)

    @property
    def dimension(self) -> int:
        """The dimension of the level sets of all integrals."""
        return self.field.dimension - max(len(self.integrals), self.relations or 0)

    def __repr__(self) -> str:
        d, D = self.degree, self.field.dimension
        none = f"none found up to degree {d}" if self.finished else "none found so far"
        if self.finished and self.relations is None:
            none = "not sought"
        error = f" +- {self.growth.entropy_error:.2g}" if self.growth.entropy_error else ""
        entropy = "" if math.isnan(self.entropy) else f", entropy {self.entropy:.4g}{error}"
        degrees = ", ".join(map(str, self.degrees[:8]))
        plane = {1: "points", 2: "lines", 3: "planes"}.get(D, "hyperplanes")
        lines = [
            f"Kahan map of {self.field}, eps = {self.eps}",
            f"Degrees of iterates: {degrees}{', ...' if len(self.degrees) > 8 else ''}",
            f"Growth: {self.growth.kind}{entropy}; evidence, not a proof: {self.growth.based_on}",
            _listed("First integrals", self.integrals, none, 4),
            _listed("Densities of measures", self.measures, none, 1),
            _listed("Darboux polynomials", self.polynomials, none, 4),
            f"Invariant {plane}: " + ("; ".join(f"{P} = 0" for P in self.hyperplanes) or none),
        ]
        if (self.relations or 0) > len(self.integrals):
            text = f"{self.relations} independent integrals, {MODULAR}"
            lines.append(f"Relations along orbits up to degree {d} show {text}.")
        if self.integrals or self.relations:
            lines.append(f"Level sets of the integrals have dimension {self.dimension} of {D}.")
        lines += [f"Pencil: {self.pencil}"] if self.pencil else []
        lines += [f"Searched: {'; '.join(self.searched) or 'nothing yet'}.", *self.notes]
        lines += [] if self.finished else ["Not finished."]
        return "\n".join(_shortened(line, 3 * _WIDTH) for line in lines)

    def _repr_latex_(self) -> str:
        kinds = {"F": self.integrals, "\\rho": self.measures[:1], "P": self.polynomials}
        degrees = ", ".join(map(str, self.degrees[:8]))
        lines = [f"d_n &= {degrees}, \\ldots \\quad \\text{{({self.growth.kind})}}"]
        for name, found in kinds.items():
            lines += [f"{name}_{{{k}}} &= {latex(f)}" for k, f in enumerate(found, start=1)]
        return "$$\\begin{aligned}" + " \\\\ ".join(lines) + "\\end{aligned}$$"

    def to_dict(self) -> dict[str, Any]:
        """Return the report as numbers, strings, lists and dictionaries, for JSON."""
        derived = ("growth", "hyperplanes", "dimension")
        names = (*(each.name for each in dataclasses.fields(self)), *derived)
        return {name: _for_json(getattr(self, name)) for name in names}


def _for_json(value: Any) -> Any:
    """Return numbers, strings, lists and dictionaries in place of other types."""
    match value:
        case RationalFunction():
            plain = {"formula": str(value), "degree": value.degree, "basis": value.basis}
            return plain if value.cofactor is None else {**plain, "cofactor": str(value.cofactor)}
        case QuadraticField():
            return value.to_dict()
        case Growth():
            return {name: _for_json(each) for name, each in value._asdict().items()}
        case Pencil():
            return {name: _for_json(each) for name, each in vars(value).items()}
        case list() | tuple():
            return [_for_json(each) for each in value]
        case float():
            return None if math.isnan(value) else value
        case int() | None:
            return value
    return str(value)


def _shortened(text: str, width: int = _WIDTH) -> str:
    return textwrap.shorten(text, width, placeholder=" ...")


def _listed(title: str, found: Functions, none: str, most: int) -> str:
    if not found:
        return f"{title}: {none}"
    formulas = "; ".join(_shortened(str(f)) for f in found[:most])
    more = f"; {len(found) - most} more" if len(found) > most else ""
    how = " and ".join(_PROOF[each] for each in sorted({f.basis for f in found}))
    return f"{title} ({len(found)}, {how}): {formulas}{more}"


def report(
    field: Any,
    eps: Any,
    degree: int = 3,
    *,
    time_limit: float | None = None,
    seed: int = 0,
    progress: Progress = None,
) -> Report:
    """Report what is there: growth of degrees, first integrals, measures, invariant hypersurfaces.

    First integrals come from the Hamiltonian structure of the field, from quotients of Darboux
    polynomials of equal cofactor, and from products of powers of Darboux polynomials whose
    cofactors multiply to 1. The polynomials have rational coefficients. Relations between monomials
    along orbits count integrals in another way. A float is taken exactly.

    Parameters
    ----------
    field : QuadraticField or body
        A single one.
    eps : int, Fraction, float or str
        Step size; a string may be "1/3".
    degree : int
        Largest degree of polynomials.
    time_limit : float, optional
        Seconds after which the report is returned with what was found so far. Without a limit
        the report does not depend on `seed`.
    seed : int, optional
        Seed of the random primes, points and lines.
    progress : bool or callable, optional
        True shows a bar (needs tqdm); a callable is called as ``progress(done, parts)``.

    Returns
    -------
    Report
        Its repr is a text, and `Report.to_dict` for programs.

    Raises
    ------
    TypeError, ValueError
        If an argument has a wrong type or value, or polynomials of this degree have too many
        coefficients.
    ArithmeticError
        If the map is undefined everywhere.
    KeyboardInterrupt
        After Ctrl-C; its attribute `report` has what was found so far.

    Examples
    --------
    >>> from suslov_fast import Suslov3D
    >>> from suslov_fast.integrability import report
    >>> found = report(Suslov3D(4, 1, -0.5, -0.25), eps=0.25)
    >>> found.growth.kind, found.integrals, found.integrals[0].basis
    ('linear', ((4*x1^2 + x2^2)/(x1*x2 + 1024),), 'identity')
    >>> found.measures[0]
    1/((2*x1 + x2)*(x1*x2 + 1024))
    """
    field, degree = QuadraticField.of(field), integer("degree", degree, 1)
    integer("seed", seed, 0)
    check_progress(progress)
    _exact.check_unknowns("degree", degree, field.dimension)
    seconds = math.inf if time_limit is None else float(real_array("time_limit", time_limit))
    if seconds < 0:
        raise wrong("time_limit", "None or a number of seconds of at least 0", seconds)
    deadline = time.monotonic() + seconds

    def pulse() -> None:
        if time.monotonic() > deadline:
            raise _TimeUp

    map = kahan(field, eps)
    found = Report(field, map.eps, degree, notes=_notes_on_floats(map))
    with reporter(progress, degree + 3) as show:
        try:
            for k, _ in enumerate(_search(found, map, seed, pulse), start=1):
                show(k)
                pulse()
            found.finished = True
        except _TimeUp:
            pass
        except KeyboardInterrupt as error:
            error.report = found  # type: ignore[attr-defined]
            raise
        except ZeroDivisionError:
            raise ArithmeticError(f"{map}: expected a map, got one without images") from None
    return found


class _TimeUp(Exception):
    pass


def _search(found: Report, map: KahanMap, seed: int, pulse: Callable[[], object]) -> Iterator[None]:
    """Fill a report, and yield after each part."""
    found.degrees = _degrees(map, seed, pulse)
    found.searched.append(f"degrees of {len(found.degrees)} iterates")
    yield
    projective, d, D = Projective(map, pulse), found.degree, map.dimension
    if projective.backward is None:
        found.searched.append("nothing else: the map has no inverse, since det DPhi = 0")
        return
    exponents = _exact.exponents_up_to(d, D)
    found.relations = Relations(map, random.Random(seed)).counts(exponents)[1]
    found.searched.append(f"relations between the {len(exponents)} monomials up to degree {d}")
    yield
    invariants = Invariants(projective)

    def update() -> None:
        found.integrals = independent(invariants.integrals)
        found.measures = tuple(invariants.measures)
        found.polynomials = tuple(invariants.polynomials)

    H, K = map.field.H, map.field.K
    # H and K of a field in a file of a batch are rounded.
    if H is not None and map.field == QuadraticField.from_hamiltonian(H, D, K):
        invariants.add_modified_energy()
        found.searched.append("the modified energy and 1/det A of the Hamiltonian")
        update()
    if projective.affine_factors is None:
        polynomials = hk_bases(map, d, seed=seed).integrals
        invariants.quotients += [quotient_of(P, polynomials[0], MODULAR) for P in polynomials[1:]]
        update()
        found.searched.append("no Darboux polynomials, since det DPhi is too long")
        return
    many = sum(a > 0 for a in projective.of_jacobian)
    cofactors = f"products of powers of all factors of det DPhi ({many}) as cofactors"
    before = [*found.searched]
    for k in invariants.up_to(d):
        update()
        found.searched = [*before, f"Darboux polynomials up to degree {k} with {cofactors}"]
        yield
    update()
    # Integrals with irrational coefficients have rational norms, of a higher degree.
    k = d + 1
    while len(found.integrals) < found.relations and k <= 2 * d and math.comb(D + k, D) <= _FEW:
        invariants.of_degree(k, k)
        update()
        found.searched.append(f"the same up to degree {k}, since relations show more integrals")
        k += 1
    if D == 2 and len(found.integrals) == 1:
        found.pencil = pencil(projective, found.integrals[0])


def _degrees(map: KahanMap, seed: int, pulse: Callable[[], object]) -> list[int]:
    """Return degrees of iterates, as many as a recurrence needs."""

    def compute(p: int) -> list[int]:
        found: list[int] = []
        for each in degrees_on_a_line(map, p, random.Random(p)):
            pulse()
            found.append(each)
            following = each**2 / max(1, found[-2:][0])
            settled = len(found) >= _ENOUGH or following > _LARGE
            if settled and growth(found).entropy_error == 0:
                break
            if following > _LARGEST or len(found) == _DEGREES:
                break
        return found

    return list(_exact.confirmed(random.Random(seed), compute))


def _notes_on_floats(map: KahanMap) -> list[str]:
    """Return a note if numbers look like decimal fractions taken as floats."""
    for c in (map.eps, *(c for P in map.field.polynomials for c in P.terms.values())):
        simple, q = c.limit_denominator(10**6), c.denominator
        if q > _LONG and q & (q - 1) == 0 and float(simple) == c:
            return [
                f"The float {float(c)!r} is taken exactly, as {c}: if {simple} is meant, write "
                f"Fraction({simple.numerator}, {simple.denominator})."
            ]
    return []
