"""Exact maps of systems, with letters: eps and named parameters that stay symbols."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from ..bodies.n_dimensions import SuslovND
from ..fields import coefficients
from ..fields.base import Body
from ..fields.field import Field
from ..fields.map import Map
from ..fields.terms import Terms
from .arithmetic import as_written
from .birational_maps import RationalMap, check_map
from .kahan_maps import InLetters, KahanMap, exact_body, kahan
from .polynomials import ring_with_letters
from .rational_functions import RationalFunction, factored
from .rational_maps import checked_letters, places_of_letters, rational_map


def checked_map(map: RationalMap | Body, letters: Any = None) -> RationalMap:
    """Return a checked `RationalMap`; it is made from a `Map`, a field or a body if one is given.

    The map of a field or body is Kahan's, with a symbolic eps. Parameters `letters` stay symbols.
    """
    is_given = letters is None and not isinstance(map, Body)
    checked: Any = map if is_given else exact_map(map, None, letters)
    check_map(checked)
    return checked


def exact_map(system: Any, eps: Any, letters: Any) -> RationalMap:
    """Return a `Map` as a rational map, or a system's Kahan map; `letters` name the symbols."""
    if isinstance(system, Map):
        return rational_map(system, letters=letters)
    if letters is None:
        return kahan(system, eps)
    return kahan_with_letters(system, letters)


def kahan_with_letters(system: Any, letters: Any) -> KahanMap:
    """Return the Kahan map of a field or body; eps and the parameters `letters` are symbols."""
    names = checked_letters(system, letters)
    ring = ring_with_letters(system.dimension, ["eps", *names])
    symbols = dict(zip(names, map(factored, ring.gens()[1:]), strict=False))
    places = places_of_letters(system)
    given = {name: places[name][-1] for name in names}
    in_letters = InLetters(given, *_coefficients(system, symbols))
    return KahanMap(system._field, None, in_letters=in_letters)


def _coefficients(system: Body, symbols: Mapping[str, Any]) -> tuple[Any, Any]:
    """Return {(i, j, k): coefficient} of f, and of H or None; `symbols` replace parameters."""
    if not isinstance(system, Field):
        body, known = exact_body(system), places_of_letters(system)
        parts = {name: np.array(a, object) for name, a in body._parts.items()}
        for name, symbol in symbols.items():
            part, indices, _ = known[name]
            parts.setdefault(part, np.array(0, object))[indices] = symbol
        body = system._of({name: a[()] for name, a in parts.items()})
        terms = Terms(*body._terms) if isinstance(body, SuslovND) else body._field._own_terms
        return {place: _function(c) for place, c in terms.members() if c}, None
    equations = system._equations

    def number(a: Any) -> RationalFunction:
        if isinstance(a, RationalFunction):
            return a
        return _function(equations.ratios[a] if a in equations.ratios else as_written(a))

    values = [symbols.get(name, a) for name, a in system.parameters.items()]

    def read(results: Sequence[Any], degree: int) -> Any:
        found = coefficients.coefficients_by(number, equations, results, degree, values)
        return {place: c for place, c in found.items() if c}

    try:
        energy = None if equations.H is None else read([equations.H], 3)
        return read(equations.results, 2), energy
    except coefficients.NotQuadratic as error:
        raise TypeError(f"system: {error}, so it has no Kahan map") from None
    except TypeError as error:
        text = "must enter by + - * / and powers with integers"
        raise TypeError(f"letters: {', '.join(symbols)} {text}: {error}") from None


def _function(a: Any) -> RationalFunction:
    return a if isinstance(a, RationalFunction) else RationalFunction((), Fraction(a))
