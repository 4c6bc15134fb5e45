"""Reports on maps: degrees, first integrals, invariant measures, Darboux polynomials.

`process` fills it fact by fact.
"""

from __future__ import annotations

import dataclasses
import json
import math
import time
from collections.abc import Iterable
from contextlib import closing
from fractions import Fraction
from typing import Any

import numpy as np

from ..bodies.field import QuadraticField
from ..bodies.polynomials import polynomial_of
from ..checks import integer, real_number, wrong
from . import arithmetic
from .functions import IDENTITY, MODULAR, RationalFunction
from .growth import Growth, growth
from .implicit import ImplicitIntegral
from .kahan import KahanMap, kahan
from .maps import RationalMap, check_map
from .planar import PlanarEntropy
from .process import search_until, search_with_interrupts
from .symmetries import Reversor

_WIDTH = 150  # characters of a polynomial in the text
_PROOF = {IDENTITY: "proved", MODULAR: "checked modulo primes, at random points"}

_ROUNDING = 1e-12  # of an entropy
_LONG = 2**20  # denominators of floats such as 0.1
_ODD = 1000  # factors of denominators of fractions of floats
_DIGITS = 12  # of decimals that sums and products of floats can be

Functions = tuple[RationalFunction, ...]


@dataclasses.dataclass(repr=False)
class Report:
    """Results of `report` for a map.

    Each of `integrals`, `measures` (densities) and `polynomials` (Darboux polynomials, with their
    cofactors) can be called with a point; `str` gives its formula, and its `basis` says what it
    rests on: "identity", checked as an identity of rational functions, or "modulo a prime, at
    random points". For a density, rho(Phi) det DPhi = rho; if none is found, but one up to sign,
    rho(Phi) det DPhi = -rho, this is listed with the `cofactor` -1, and abs(rho) is a density.
    Independent integrals whose formulas are too long are in `implicit`, and can be called as well.
    A growth is evidence. If eps is symbolic, formulas are functions of x and eps, and `special_eps`
    has the rational eps at which one of them has no meaning, there is no map, or det DPhi is 0
    everywhere.
    """

    map: RationalMap
    degree: int  # the largest that was searched
    degrees: list[int] = dataclasses.field(default_factory=list)
    integrals: Functions = ()  # independent
    implicit: tuple[ImplicitIntegral, ...] = ()  # independent of these
    measures: Functions = ()
    polynomials: Functions = ()
    symmetries: tuple[Reversor, ...] = ()  # reversing ones, of a field
    planar: PlanarEntropy | None = None  # of a birational map of the plane
    relations: int | None = None  # the number of independent integrals that orbits show
    special_eps: tuple[Fraction, ...] = ()
    searched: list[str] = dataclasses.field(default_factory=list)
    notes: list[str] = dataclasses.field(default_factory=list)
    finished: bool = False

    @property
    def growth(self) -> Growth:
        """The growth of the degrees.

        If `planar` shows that a recurrence is accidental, the entropy is no longer exact.
        """
        found, exact = growth(self.degrees, planar=self.map.is_planar), self.planar
        if exact is None or exact.entropy is None or found.entropy_error > 0:
            return found
        error = abs(exact.entropy - found.entropy)
        if error <= exact.entropy_error + _ROUNDING:
            return found
        what = f"{found.based_on}, by accident, as the contracted curves show"
        return found._replace(entropy_error=error, based_on=what)

    @property
    def dimension(self) -> int:
        """The dimension of the level sets of all integrals."""
        known = len(self.integrals) + len(self.implicit)
        return self.map.dimension - max(known, self.relations or 0)

    def __repr__(self) -> str:
        d, D = self.degree, self.map.dimension
        title = f"Map of {D} variables"
        if isinstance(self.map, KahanMap):
            field, eps = str(self.map.field), self.map.eps
            field = field if len(field) <= 2 * _WIDTH else f"a quadratic field of {D} variables"
            title = f"Kahan map of {field}, eps {'symbolic' if eps is None else f'= {eps}'}"
        kind, entropy, error, based_on = self.growth
        rate = "" if math.isnan(entropy) else f", entropy {entropy:.4g}"
        rate += f" with a spread of {error:.1g}" if error > 0 else ""
        if kind == "linear" and D == 2:
            based_on += "; in the plane a sign of an invariant fibration, which may be no integral"
        none = f"none found up to degree {d}" if self.finished else "none found so far"
        if self.finished and self.relations is None:
            none = "not sought"
        no_formula = "none written" if self.implicit else none
        more = ", ..." if len(self.degrees) > 8 else ""
        sign = ", up to sign" if any(f.cofactor for f in self.measures) else ""
        lines = [
            title,
            f"Degrees of iterates: {', '.join(map(str, self.degrees[:8]))}{more}",
            f"Growth: {kind}{rate}; evidence, not a proof: {based_on}",
            *self._lines_of_planar_entropy(),
            _listed("First integrals", self.integrals, 6, no_formula),
            _listed(f"Densities of measures{sign}", self.measures, 1, none),
            _listed("Darboux polynomials", self.polynomials, 6, none),
        ]
        if self.implicit:
            where = next(k for k, line in enumerate(lines) if line.startswith("First integrals"))
            lines.insert(where + 1, f"{self._count_of_integrals()}.")
        if self.symmetries:
            lines.append(f"Reversing symmetries: {'; '.join(map(str, self.symmetries))}")
        if (self.relations or 0) > len(self.integrals) + len(self.implicit):
            text = f"{self.relations} independent integrals, {MODULAR}"
            lines.append(f"Relations along orbits up to degree {d} show {text}.")
        if self.integrals or self.relations:
            more = ". These may not be all: a larger degree may show more" * (self.dimension > 1)
            lines.append(
                f"Level sets of the integrals have dimension {self.dimension} of {D}{more}."
            )
        if self.special_eps:
            listed = ", ".join(map(str, self.special_eps))
            lines.append(
                f"A formula has no meaning, or there is no birational map, at eps = {listed}."
            )
        lines += [f"Searched: {'; '.join(self.searched) or 'nothing yet'}.", *self.notes]
        lines += [] if self.finished else ["Not finished."]
        return "\n".join(lines)

    def _lines_of_planar_entropy(self) -> list[str]:
        exact = self.planar
        if exact is None:
            return []
        if exact.entropy is None:
            return [f"Entropy from contracted curves: none, {exact.reason}"]
        how = "proved" if exact.proved else f"not proved, error {exact.entropy_error:.1g}"
        root = f", log of the largest root of {exact.minimal}" if exact.entropy else ""
        lengths = ", ".join("not confined" if n is None else str(n) for n in exact.lengths)
        orbits = f"; lengths of their orbits: {lengths}" if lengths else ""
        return [f"Entropy from contracted curves ({how}): {exact.entropy:.6g}{root}{orbits}"]

    def _count_of_integrals(self) -> str:
        """Return how many integrals are written, and the degrees of the others."""
        *first, last = (f.degree for f in self.implicit)
        degrees = " and ".join([", ".join(map(str, first))] * bool(first) + [str(last)])
        if len({*first, last}) == 1:
            degrees = str(last)
        total, written = len(self.integrals) + len(self.implicit), len(self.integrals)
        others = f"{len(self.implicit)} of degree {degrees} by their bases"
        return f"{total} integrals: {written} written, {others}"

    def to_dict(self) -> dict[str, Any]:
        """Return the report as numbers, strings, lists and dictionaries, for JSON."""
        parts = {each.name: getattr(self, each.name) for each in dataclasses.fields(self)}
        parts |= {name: getattr(self.map, name, None) for name in ("field", "eps")}
        parts |= {"growth": self.growth._asdict(), "dimension": self.dimension}
        text = json.dumps(parts, default=_plain)
        return json.loads(text, parse_constant=lambda nan: None)  # type: ignore[no-any-return]


def _plain(value: Any) -> Any:
    if isinstance(value, QuadraticField):
        return value.to_dict()
    if isinstance(value, PlanarEntropy):
        plain = {each.name: getattr(value, each.name) for each in dataclasses.fields(value)}
        return plain | {"lengths": value.lengths, "contractions": [*map(str, value.contractions)]}
    if isinstance(value, ImplicitIntegral):
        return {"relation": str(value), "degree": value.degree, "basis": value.basis}
    if not isinstance(value, RationalFunction):
        return str(value)
    plain = {"formula": str(value), "degree": value.degree, "basis": value.basis}
    return plain if value.cofactor is None else {**plain, "cofactor": str(value.cofactor)}


def _listed(title: str, found: Functions, most: int, none: str) -> str:
    if not found:
        return f"{title}: {none}"
    formulas = "; ".join(f.text(_WIDTH) for f in found[:most])
    more = f"; {len(found) - most} more" if len(found) > most else ""
    how = " and ".join(_PROOF[each] for each in sorted({f.basis for f in found}))
    return f"{title} ({len(found)}, {how}): {formulas}{more}"


def report(
    field: Any,
    /,
    eps: Any = None,
    degree: int = 3,
    *,
    decimals: bool = False,
    time_limit: float | None = None,
    seed: int = 0,
    progress: Any = None,
) -> Report:
    """Report the growth of degrees, first integrals, measures and Darboux polynomials of a map.

    First integrals come from a Hamiltonian, from quotients of Darboux polynomials of equal
    cofactor, and from products of their powers whose cofactors multiply to 1. Relations between
    monomials along orbits count integrals in another way; the search ends when as many are written,
    and a measure.

    Parameters
    ----------
    field : QuadraticField, body, KahanMap or RationalMap
        A single one.
    eps : int, Fraction, float or str, optional
        Step size of a field or body; a string may be "1/3". Without it, eps is symbolic.
    degree : int, optional
        Largest degree of polynomials, by default 3.
    decimals : bool, optional
        True takes floats as the decimals that are written, 0.1 as 1/10, not as binary numbers.
    time_limit : float, optional
        Seconds after which the report has what was found so far; the search then runs in a process
        of its own. Without a limit the report does not depend on `seed`.
    seed : int, optional
        Seed of the random primes, points and lines.
    progress : callable, optional
        Called as ``progress(done, parts)`` after each part of the search.

    Returns
    -------
    Report

    Raises
    ------
    ArithmeticError
        If there is no map, since the equations have no solution at any x, or if det DPhi is 0
        everywhere, so that the image of the map of a field is a curve, say. Without `eps`, such
        step sizes are in `special_eps`.
    KeyboardInterrupt
        After Ctrl-C, within about a second; its attribute `report` has what was found so far.

    Examples
    --------
    >>> from suslov_fast import Suslov3D
    >>> from suslov_fast.integrability import report
    >>> found = report(Suslov3D(4, 1, -0.5, -0.25), eps=0.25)
    >>> found.growth.kind, found.integrals
    ('linear', (16*(4*x1^2 + x2^2)/(4*x1^2 + 4*x1*x2 + x2^2 + 4096),))
    >>> found.measures[0]
    1/((2*x1 + x2)*(4*x1^2 + 4*x1*x2 + x2^2 + 4096))
    >>> report(Suslov3D(4, 1, -0.5, -0.25)).integrals
    ((4*x1^2 + x2^2)/(4*eps^2*x1^2 + 4*eps^2*x1*x2 + eps^2*x2^2 + 256),)
    """
    degree, seed = integer("degree", degree, 1), integer("seed", seed, 0)
    map, notes = _map_of(field, eps, decimals)
    check_map(map)
    if isinstance(map, KahanMap) and not map.is_invertible:
        shape = map.shape_of_image
        raise ArithmeticError(f"{map} has no inverse: det DPhi = 0, and the image is {shape}")
    arithmetic.check_unknowns("degree", degree, map.dimension)
    if progress is not None and not callable(progress):
        expected = "a function that is called as progress(done, parts)"
        raise wrong("progress", expected, type(progress).__name__, TypeError)
    found = Report(map, degree, notes=notes)
    if time_limit is None:
        parts: Any = search_with_interrupts(found, seed)
    else:
        seconds = float(real_number("time_limit", time_limit))
        if seconds < 0:
            raise wrong("time_limit", "0 seconds or more, or left out", seconds)
        parts = search_until(time.monotonic() + seconds, found, seed)
    with closing(parts):
        try:
            for now, done, known in parts:
                found = now
                if progress is not None:
                    progress(done, known)
        except KeyboardInterrupt as error:
            error.report = found  # type: ignore[attr-defined]
            raise
    return found


def _map_of(field: Any, eps: Any, decimals: bool) -> tuple[RationalMap, list[str]]:
    """Return the map of the arguments of a report, and notes on them."""
    if isinstance(field, RationalMap):
        if eps is not None:
            raise wrong("eps", "left out, because a map has its own", eps)
        missing = not isinstance(field, KahanMap) and field.inverse is None
        text = "No inverse was given: it is not checked that the map is birational."
        return field, [text] if missing else []
    found = QuadraticField.of(field)
    if decimals and not found.shape:
        found = _in_decimals(field)
        eps = _decimal(eps) if isinstance(eps, float) else eps
    map = kahan(found, eps)
    given = [*_numbers_in(field), map.eps or 0]
    return map, [] if decimals else _note_on_floats(arithmetic.rational("field", c) for c in given)


def _numbers_in(body: Any) -> list[Any]:
    """Return the numbers of a body or field as they are written: parameters, then coefficients."""
    if not isinstance(body, QuadraticField):
        return [c for each in body._parts.values() for c in np.ravel(each)]
    polynomials = [*body.table] if body.H is None else [body.H.tensor]
    terms = [c for each in polynomials for c in polynomial_of(each).terms.values()]
    return [*body.parameters.values(), *terms, *np.ravel(0 if body.H is None else body.K)]


def _in_decimals(body: Any) -> QuadraticField:
    """Return the field of a single body or field with its floats as decimals."""
    decimals = np.vectorize(_decimal, "O")
    if not isinstance(body, QuadraticField):
        parts = {name: decimals(each) for name, each in body._parts.items()}
        return QuadraticField.of(body._of(parts))
    own = body._coefficients if body.H is None else {"H": body.H.tensor, "K": body.K}
    own, names = ({n: decimals(a)[()] for n, a in each.items()} for each in (own, body.parameters))
    return QuadraticField._read(**own, parameters=names, names=body.names)


def _decimal(a: Any) -> Fraction:
    """Return the decimal of at most 15 digits that a float was written as, or its binary value.

    So 0.1 is 1/10, and 1/3 remains the binary number. Of the thirds of floats, say, that
    coefficients of a Hamiltonian are, the float is replaced.
    """
    binary = Fraction(a)
    odd = binary.denominator // (binary.denominator & -binary.denominator)
    if odd > 1:
        return _decimal(binary * odd) / odd if odd < _ODD else binary
    if binary.denominator < _LONG:
        return binary
    text = f"{float(binary):.14e}"
    simple = Fraction(text)
    digits = len(text.partition("e")[0].replace(".", "").lstrip("-").rstrip("0"))
    near = digits <= _DIGITS and abs(simple - binary) <= abs(binary) / 2**50
    return simple if near or float(simple) == binary else binary


def _note_on_floats(numbers: Iterable[Any]) -> list[str]:
    """Return a note on the first number that looks like a decimal rounded to a float."""
    for c in numbers:
        simple, q = c.limit_denominator(10**6), c.denominator
        if q > _LONG and q & (q - 1) == 0 and float(simple) == c:
            return [
                f"The float {float(c)!r} is taken exactly, as {c}: if {simple} is meant, write "
                f"Fraction({simple.numerator}, {simple.denominator}), or decimals=True for all."
            ]
    return []
