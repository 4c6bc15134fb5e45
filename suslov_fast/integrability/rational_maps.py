"""Rational maps of users: a `Map` as quotients of polynomials, with an inverse and letters."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..bodies.rigid import Suslov3D
from ..checks import kind_of, wrong
from ..fields.base import Body
from ..fields.map import Map
from ..fields.names import labels
from ..keywords import public
from . import arithmetic
from .arithmetic import EPS, as_written, constant
from .birational_maps import RationalMap
from .composed_maps import composed
from .interpolation import MOST
from .polynomials import ring_with_letters
from .rational_functions import RationalFunction, as_function, factored, over_common_denominator


def _power(a: RationalFunction, exponent: RationalFunction) -> RationalFunction | None:
    number = exponent.constant
    return None if exponent.factors or number.denominator > 1 else a ** int(number)


_RULES: dict[str, Any] = {
    "fadd": operator.add, "fsub": operator.sub, "fmul": operator.mul, "fdiv": operator.truediv,
    "pow": _power,
}  # fmt: skip
_POINTS = 3  # at which an inverse is checked


@public
def rational_map(map: Map, inverse: Map | None = None, *, letters: Any = None) -> RationalMap:
    """Return a `Map` as a rational map, exact, with its inverse or with letters.

    The other functions of this module take a :class:`suslov_fast.Map` itself, without an inverse.

    Parameters
    ----------
    map : Map
        A single one. Its function computes quotients of polynomials, by ``+``, ``-``, ``*``, ``/``
        and integer powers.
    inverse : Map, optional
        The inverse map: ``inverse(map(x)) = x`` is checked at three random points modulo a prime of
        62 bits. Without it the map may not be birational, and `RationalMap.inverse` is None.
    letters : str or sequence of str, optional
        Names of parameters of both maps that stay symbols, ``"a b"``. What is found then holds for
        general values, and `subs` sets them.

    Returns
    -------
    RationalMap
        It is callable, and has `inverse`, `jacobian`, `determinant` and `dimension`.

    Raises
    ------
    TypeError, ValueError
        If the function computes anything else, such as a root, or the inverse is another map.

    Examples
    --------
    The map of Lyness:

    >>> from suslov_fast import Map
    >>> from suslov_fast.integrability import planar_entropy, rational_map
    >>> lyness = Map(lambda x, a: (x[1], (x[1] + a) / x[0]), "x y", a=3)
    >>> back = Map(lambda x, a: ((x[0] + a) / x[1], x[0]), "x y", a=3)
    >>> map = rational_map(lyness, back)
    >>> map
    rational_map(y, (y + 3)/x)
    >>> [str(a) for a in map.inverse([2, 5])], planar_entropy(map).entropy
    (['1', '2'], 0.0)
    >>> rational_map(lyness, letters="a")([1, 2])
    (2, a + 2)
    """
    names = () if letters is None else checked_letters(map, letters)
    own = map.names if map.names != labels(map.dimension) else None
    forward = _stages("map", map, names)
    given = {name: constant(name, map.parameters[name]) for name in names}
    if inverse is None:
        return composed(forward, None, names, own, given)
    backward = _stages("inverse", inverse, names)
    back = composed(backward, composed(forward, None, names, own), names, own)
    found = composed(forward, back, names, own, given)
    if back.dimension != found.dimension or not _takes_images_back(found):
        raise ValueError("inverse is not the inverse of the map: inverse(map(x)) differs from x")
    return found


def checked_letters(system: Any, letters: Any) -> tuple[str, ...]:
    """Return `letters`, parameters that stay symbols, as checked names; True stands for all."""
    if not isinstance(system, Body):
        raise wrong("letters", "left out for a map, which has its own", letters, TypeError)
    if system.shape:
        raise wrong("system", "a single one", f"a batch of shape {system.shape}: pass system[i]")
    has = places_of_letters(system)
    if letters is True:
        return tuple(n for n, (parameter, *_) in has.items() if parameter in system.parameters)
    names = letters.replace(",", " ").split() if isinstance(letters, str) else letters
    names = [*names] if isinstance(names, Sequence) else []
    if not names or {*names} - {*has} or len({*names}) < len(names):
        known = f"names of its parameters {', '.join(has)}" if has else "left out: it has none"
        raise wrong("letters", known, repr(letters))
    if "eps" in names and not isinstance(system, Map):
        raise wrong("letters", "names of parameters: eps is a letter in any case", repr(letters))
    most = MOST - (not isinstance(system, Map))  # with eps
    if len(names) > most:
        raise wrong("letters", f"at most {most} names", len(names))
    return tuple(names)


def places_of_letters(system: Body) -> dict[str, tuple[str, Any, Any]]:
    """Return {letter: (parameter, indices of entries, value)} for all letters a system may have.

    Of a body in n dimensions J1 stands for all J_i that equal the first one, and I1 for I_1.
    """
    found: dict[str, tuple[str, Any, Any]] = {}
    parameters = {"k": 0.0} if isinstance(system, Suslov3D) else {}  # k = 0 is no parameter
    for name, a in (parameters | system.parameters).items():
        if not np.ndim(a):
            found[name] = name, (), a
            continue
        for i, value in enumerate(a):
            indices = np.flatnonzero(a == value) if name == "J" else np.array([i])
            if indices[0] == i:
                found[f"{name}{i + 1}"] = name, indices, value
    return found


def _stages(name: str, map: Any, letters: Sequence[str]) -> list[list[Any]]:
    """Return polynomials F_1, ..., F_D, F_0 of a map F_i / F_0, from its expression program.

    If D values of the program determine all that follows, it is divided there into two stages. A
    float stands for the number that was written, see `as_written`. Errors begin with `name`.
    """
    if not isinstance(map, Map):
        received = f"{kind_of(map)}: pass Map(f, names) of a function"
        raise wrong(name, "a Map", received, TypeError)
    if map.shape:
        raise wrong(name, "a single one", f"a family of shape {map.shape}: pass {name}[i]")
    D, ring = map.dimension, ring_with_letters(map.dimension, letters)
    symbols = [factored(x) for x in ring.gens()]
    named = dict(zip(letters, symbols, strict=False))
    x = symbols[len(letters) :]
    values: dict[Any, Any] = dict(enumerate(x))
    for k, (parameter, a) in enumerate(map.parameters.items(), D):
        known = named.get(parameter)
        values[k] = as_function(constant(parameter, a)) if known is None else known
    equations, stages, starts = map._equations, list[list[Any]](), [*range(D)]
    operations, results = equations.values.operations, equations.results
    last = {a: k for k, (_, _, operands) in enumerate(operations) for a in _places(operands)}
    last |= dict.fromkeys(_places(results), len(operations))
    varying: dict[int, Any] = dict.fromkeys(starts)  # the operations that depend on x, by place

    def value(a: Any) -> Any:
        if type(a) is not float:
            return values[a]
        return as_function(equations.ratios.get(a) or as_written(a))

    def computed(rule: str, place: int, operands: Any) -> Any:
        try:
            known = _RULES[rule](*[value(a) for a in operands]) if rule in _RULES else None
        except ZeroDivisionError:
            raise ValueError(f"{name}: {equations.shown(place)} has the denominator 0") from None
        if known is None:
            shown = "a comparison, as in np.maximum," if rule[0] == "o" else equations.shown(place)
            raise TypeError(f"{name}: {shown} is no quotient of polynomials")
        return known

    for k, (rule, place, operands) in enumerate(operations):
        values[place] = computed(rule, place, operands)
        if not varying.keys() & _places(operands):
            continue
        varying[place] = rule, place, operands
        left = {a for a in varying if last.get(a, -1) > k}
        again = [
            a
            for a in varying
            if a in left - {*starts} and _places(varying[a][2]) & varying.keys() <= left
        ]
        cut = [a for a in varying if a in left.difference(again)]
        if len(cut) == D and cut != starts and {*cut} != _places(results):
            stages.append(over_common_denominator([values[a] for a in cut], ring))
            starts = cut
            values |= dict(zip(cut, x, strict=True))
            for a in again:
                values[a] = computed(*varying[a])
    return [*stages, over_common_denominator([value(a) for a in results], ring)]


def _places(operands: Sequence[Any]) -> set[int]:
    """Return the operands that are places of other operations, and not numbers."""
    return {a for a in operands if type(a) is not float}


def _takes_images_back(map: RationalMap) -> bool:
    """Return True if the inverse of a map takes back the images of random points modulo a prime."""
    rng, at_number, returned = map.generator(), map.at_eps(EPS), []
    for _ in range(_POINTS):
        x = arithmetic.random_point(map.dimension, map.prime, rng)
        try:
            returned.append(at_number.inverse.image(at_number.image(x)) == x)
        except ZeroDivisionError:
            returned.append(False)
    return all(returned)
