"""A report of what is there: degrees, first integrals, measures, invariant hypersurfaces."""

from __future__ import annotations

import math
import random
import textwrap
import time
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import count
from typing import Any

from .._bodies.algebra import Polynomial
from .._bodies.field import QuadraticField
from .._checks import integer, real_array, wrong
from .._engine.progress import Progress, check_progress, reporter
from . import _exact
from ._darboux import Pulse
from ._growth import Growth, degrees_on_a_line, growth
from ._integrals import IDENTITY, MODULAR, Found, Invariants, independent, quotient
from ._maps import kahan
from ._planar import Pencil, pencil
from ._projective import TERMS, Projective, latex, projective
from ._relations import Relations, hk_bases

_UNKNOWNS, _FEW = 300, 80  # coefficients of a polynomial, and if it has more than the degree
_ENOUGH, _DEGREES = 10, 24  # iterates, if a recurrence holds and at most
_LARGE, _LARGEST = 3_000, 25_000  # degrees, likewise
_WIDTH = 110  # of a line of the text
_LONG = 2**30  # denominators of floats such as 0.1
_PROOF = {IDENTITY: "proved", MODULAR: f"checked {MODULAR}"}


@dataclass(frozen=True, repr=False)
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
    degrees: list[int]
    growth: Growth
    integrals: tuple[Found, ...]  # independent
    measures: tuple[Found, ...]
    polynomials: tuple[Found, ...]
    pencil: Pencil | None  # of invariant curves, of a planar map with an integral
    relations: int | None  # the number of independent integrals that relations on orbits show
    searched: tuple[str, ...]
    notes: tuple[str, ...]
    finished: bool

    @property
    def entropy(self) -> float:
        """The algebraic entropy."""
        return self.growth.entropy

    @property
    def hyperplanes(self) -> tuple[Found, ...]:
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
        plane = {1: "points", 2: "lines", 3: "planes"}.get(D, "hyperplanes")
        shown = ", ".join(map(str, self.degrees[:8])) + (", ..." if len(self.degrees) > 8 else "")
        lines = [
            f"Kahan map of {self.field}, eps = {self.eps}",
            f"Degrees of iterates: {shown}",
            f"Growth: {self.growth.kind}{entropy}; evidence, not a proof: {self.growth.based_on}",
            *_listed("First integrals", self.integrals, none, 4),
            *_listed("Densities of measures", self.measures, none, 1),
            *_listed("Darboux polynomials", self.polynomials, none, 4),
            f"Invariant {plane}: " + ("; ".join(f"{P} = 0" for P in self.hyperplanes) or none),
        ]
        if self.relations is not None and self.relations > len(self.integrals):
            text = f"{self.relations} independent integrals, {MODULAR}"
            lines.append(f"Relations along orbits up to degree {d} show {text}.")
        if self.integrals or self.relations:
            lines.append(f"Level sets of the integrals have dimension {self.dimension} of {D}.")
        lines += [f"Pencil: {self.pencil}"] if self.pencil else []
        lines += [f"Searched: {'; '.join(self.searched) or 'nothing yet'}.", *self.notes]
        return "\n".join(textwrap.shorten(line, 3 * _WIDTH, placeholder=" ...") for line in lines)

    def _repr_latex_(self) -> str:
        kinds = {"F": self.integrals, "\\rho": self.measures[:1], "P": self.polynomials}
        lines = [
            f"{name}_{{{k}}} &= {latex(f)}"
            for name, found in kinds.items()
            for k, f in enumerate(found, start=1)
        ]
        degrees = ", ".join(map(str, self.degrees[:8]))
        lines.insert(0, f"d_n &= {degrees}, \\ldots \\quad \\text{{({self.growth.kind})}}")
        return "$$\\begin{aligned}" + " \\\\ ".join(lines) + "\\end{aligned}$$"

    def to_dict(self) -> dict[str, Any]:
        """Return the report as numbers, strings, lists and dictionaries, for JSON."""
        entropy = None if math.isnan(self.entropy) else self.entropy
        error = None if entropy is None else self.growth.entropy_error
        found = {
            name: [_plain(each) for each in getattr(self, name)]
            for name in ("integrals", "measures", "polynomials", "hyperplanes")
        }
        return {
            "field": self.field.to_dict(),
            "eps": str(self.eps),
            "degree": self.degree,
            "degrees": self.degrees,
            "growth": self.growth._asdict() | {"entropy": entropy, "entropy_error": error},
            **found,
            "pencil": self.pencil and self.pencil.to_dict(),
            "relations": self.relations,
            "dimension": self.dimension,
            "searched": [*self.searched],
            "notes": [*self.notes],
            "finished": self.finished,
        }


def _plain(f: Found) -> dict[str, Any]:
    own = {"formula": str(f), "degree": f.degree, "basis": f.basis}
    return own if f.cofactor is None else {**own, "cofactor": str(f.cofactor)}


def _listed(title: str, found: tuple[Found, ...], none: str, most: int) -> Iterator[str]:
    if not found:
        yield f"{title}: {none}"
        return
    formulas = "; ".join(textwrap.shorten(str(f), _WIDTH, placeholder=" ...") for f in found[:most])
    more = f"; {len(found) - most} more" if len(found) > most else ""
    how = " and ".join(_PROOF[each] for each in sorted({f.basis for f in found}))
    yield f"{title} ({len(found)}, {how}): {formulas}{more}"


class _TimeUp(Exception):
    pass


class _Work:
    """The parts of a report, found one after the other."""

    def __init__(self, field: Any, eps: Any, degree: int, seed: int, pulse: Pulse) -> None:
        self.map, self.degree, self.seed, self.pulse = kahan(field, eps), degree, seed, pulse
        self.field = self.map.field
        self.degrees: list[int] = []
        self.relations: int | None = None
        self.integrals: list[Found] = []
        self.measures: list[Found] = []
        self.invariants: Invariants | None = None
        self.searched: list[str] = []

    def steps(self) -> Iterator[None]:
        """Do the work, and yield after each part."""
        self._find_degrees()
        yield
        self.projective = projective(self.map)
        if self.projective.backward == 0:
            self.searched.append("nothing else: the map has no inverse, since det DPhi = 0")
            return
        D, d = self.field.dimension, self.degree
        N = math.comb(D + d, d)
        search = Relations(self.map, random.Random(self.seed))
        self.relations = search.independent(_exact.exponents_up_to(d, D))
        self.searched.append(f"relations between the {N} monomials up to degree {d}")
        yield
        if self.field.H is not None:
            self._of_hamiltonian(self.projective)
        if self.projective.factors is not None:
            yield from self._darboux(self.projective)
        else:
            found = hk_bases(self.map, self.degree, seed=self.seed).integrals
            self.integrals += [quotient(P, found[0], MODULAR) for P in found[1:]]
            self.searched.append("no Darboux polynomials, since det DPhi is too long")
        yield

    def _find_degrees(self) -> None:
        def compute(p: int) -> list[int]:
            found: list[int] = []
            rng = random.Random(p)
            for each in degrees_on_a_line(self.map, p, rng):
                self.pulse()
                found.append(each)
                following = each**2 / max(1, found[-2:][0])
                settled = len(found) >= _ENOUGH or following > _LARGE
                if settled and growth(found).entropy_error == 0:
                    break
                if following > _LARGEST or len(found) == _DEGREES:
                    break
            return found

        self.degrees = _exact.confirmed(random.Random(self.seed), compute)
        self.searched.append(f"degrees of {len(self.degrees)} iterates")

    def _of_hamiltonian(self, map: Projective) -> None:
        """Add the modified energy H + grad H (x~ - x) / 3 and the density 1 / det A."""
        H, x = _integral(self.field.hamiltonian, map.ring), map.ring.gens()
        steps = (F - a * map.F[0] for F, a in zip(map.F[1:], x, strict=True))
        change = sum((H.derivative(i) * step for i, step in enumerate(steps)), 0 * H)
        if H.is_constant():
            return
        modified = quotient(3 * H * map.F[0] + change, 3 * map.F[0], MODULAR)
        if k := modified.degree:
            P, Q = modified.numerator, modified.denominator
            short = map.terms(k) + math.comb(map.D + k, k) <= TERMS
            if short and map.pullback(P, k) * Q != map.pullback(Q, k) * P:
                raise ArithmeticError(f"{modified}: expected an integral")
            self.integrals.append(quotient(P, Q, IDENTITY if short else MODULAR))
        one = map.ring.constant(1)
        self.measures.append(quotient(one, map.determinant, MODULAR))
        if map.factors is not None:
            self.measures = [Invariants(map).density(map.determinant)]
        self.searched.append("the modified energy and 1/det A of the Hamiltonian")

    def _darboux(self, map: Projective) -> Iterator[None]:
        self.invariants = Invariants(map, self.pulse)
        many = sum(a > 0 for a in map.of_jacobian)
        for d in self.invariants.steps(self.degree):
            text = f"Darboux polynomials up to degree {d} with products of powers of all factors"
            self.searched = [each for each in self.searched if not each.startswith("Darboux")]
            self.searched.append(f"{text} of det DPhi ({many}) as cofactors")
            yield
        self._more_than_searched(self.invariants)

    def _more_than_searched(self, invariants: Invariants) -> None:
        """Search higher degrees for integrals that relations show.

        Those of lower degree may have irrational coefficients, and a rational norm.
        """
        D, k = self.field.dimension, self.degree + 1
        while math.comb(D + k, D) <= _FEW and k <= 2 * self.degree:
            found = self.integrals + invariants.integrals + invariants.products
            if len(independent(found)) >= (self.relations or 0):
                break
            invariants.of_degree(k, k)
            self.searched.append(f"the same up to degree {k}, since relations show more integrals")
            k += 1

    def report(self, finished: bool) -> Report:
        integrals, measures, polynomials = [*self.integrals], [*self.measures], []
        if self.invariants is not None:
            integrals += self.invariants.integrals + self.invariants.products
            measures += self.invariants.measures
            polynomials = self.invariants.polynomials
        different = {str(f): f for f in measures}
        chosen = independent(integrals)
        curves = None
        if finished and len(chosen) == 1 and self.field.dimension == 2:
            lines = [f.numerator for f in polynomials if f.degree == 1]
            curves = pencil(self.projective, chosen[0], lines)
        return Report(
            self.field,
            self.map.eps,
            self.degree,
            self.degrees,
            growth(self.degrees),
            chosen,
            tuple(different.values()),
            tuple(polynomials),
            curves,
            self.relations,
            tuple(self.searched),
            (*_floats(self.field, self.map.eps), *([] if finished else ["Not finished."])),
            finished,
        )


def _integral(P: Polynomial, ring: Any) -> Any:
    """Return a multiple of a polynomial, with integer coefficients."""
    factor = math.lcm(*(c.denominator for c in P.terms.values()))
    n = ring.nvars()
    return ring.from_dict(
        {tuple(map(e.count, range(n))): int(c * factor) for e, c in P.terms.items()}
    )


def _floats(field: QuadraticField, eps: Fraction) -> Iterator[str]:
    """Yield a note if numbers look like decimal fractions taken as floats."""
    for c in (eps, *(c for P in field.polynomials for c in P.terms.values())):
        simple = c.limit_denominator(10**6)
        if (
            c.denominator > _LONG
            and c.denominator & (c.denominator - 1) == 0
            and float(simple) == c
        ):
            yield (
                f"The float {float(c)!r} is taken exactly, as {c}: if {simple} is meant, write "
                f"Fraction({simple.numerator}, {simple.denominator})."
            )
            return


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
    eps : int, Fraction or float
        Step size.
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
    D = field.dimension
    if (unknowns := math.comb(D + degree, D)) > _UNKNOWNS:
        most = next(d for d in count() if math.comb(D + d + 1, D) > _UNKNOWNS)
        expected = f"at most {most} for {D} variables ({math.comb(D + most, D)} coefficients)"
        raise wrong("degree", expected, f"{degree} ({unknowns} coefficients)")
    deadline = math.inf
    if time_limit is not None:
        seconds = float(real_array("time_limit", time_limit))
        if seconds < 0:
            raise wrong("time_limit", "None or a number of seconds of at least 0", seconds)
        deadline = time.monotonic() + seconds

    def pulse() -> None:
        if time.monotonic() > deadline:
            raise _TimeUp

    work = _Work(field, eps, degree, seed, pulse)
    with reporter(progress, degree + 3) as show:
        try:
            for k, _ in enumerate(work.steps(), start=1):
                show(k)
                pulse()
        except _TimeUp:
            return work.report(finished=False)
        except KeyboardInterrupt as error:
            error.report = work.report(finished=False)  # type: ignore[attr-defined]
            raise
        except ZeroDivisionError:
            raise ArithmeticError(f"{work.map}: expected a map, got one without images") from None
        return work.report(finished=True)
