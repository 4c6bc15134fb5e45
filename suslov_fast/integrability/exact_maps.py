"""Exact maps of systems: a `Map` as a rational map, and Kahan maps of fields and bodies.

Letters are eps and named parameters that stay symbols.
"""

import math
import operator
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..bodies.n_dimensions import SuslovND
from ..bodies.rigid import Suslov3D
from ..checks import kind_of, wrong
from ..fields import coefficients
from ..fields.base import Body
from ..fields.field import Field
from ..fields.map import Map
from ..fields.terms import Terms
from ..keywords import public
from .arithmetic import EPS, constant, random_point
from .birational_maps import RationalMap, check_map
from .composed_maps import composed
from .interpolation import MOST
from .kahan_maps import InLetters, KahanMap, exact_body
from .polynomials import coprime, polynomial_ring, value_at
from .rational_functions import RationalFunction, as_function, factored, over_common_denominator
from .tolerances import POINTS_OF_INVERSE


def _power(a: RationalFunction, exponent: RationalFunction) -> RationalFunction | None:
    number = exponent.constant
    return None if exponent.factors or number.denominator > 1 else a ** int(number)


_RULES: dict[str, Any] = {
    "fadd": operator.add, "fsub": operator.sub, "fmul": operator.mul, "fdiv": operator.truediv,
    "pow": _power, "scale": lambda a, b: as_function(1),  # values of f do not depend on it
}  # fmt: skip


@public
def rational_map(map: Map, inverse: Map | None = None, *, letters: Any = None) -> RationalMap:
    """Return a `Map` as an exact rational map, with its inverse or with symbolic parameters.

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
        Called with a point, it returns the image. Its `inverse` is such a map, too, or None.

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
    forward, variables = _stages("map", map, names), map._layout.components
    given = {name: constant(name, map.parameters[name]) for name in names}
    if inverse is None:
        return composed(forward, None, names, variables, given)
    backward = _stages("inverse", inverse, names)
    back = composed(backward, composed(forward, None, names, variables), names, variables)
    checked = composed(forward, back, names, variables, given)
    if back.dimension != checked.dimension or not has_inverse(checked):
        raise ValueError("inverse is not the inverse of the map: inverse(map(x)) differs from x")
    return checked


def checked_map(map: RationalMap | Body, letters: Any = None) -> RationalMap:
    """Return a checked `RationalMap`: `map` itself, or the exact map of a system with `letters`."""
    is_system = isinstance(map, Body) or letters is not None
    checked: Any = exact_map(map, None, letters) if is_system else map
    check_map(checked)
    return checked


def exact_map(system: Any, eps: Any, letters: Any) -> RationalMap:
    """Return the rational map of a `Map`, or the Kahan map of a field or body.

    The parameters `letters` stay symbols, and so does `eps` if it is None. A parameter eps among
    `letters` is the step size.
    """
    if isinstance(system, Map):
        return rational_map(system, letters=letters)
    if letters is None:
        return system if isinstance(system, RationalMap) else kahan(system, eps)
    names, system = checked_letters(system, letters), system._autonomous
    every = ["eps", *(name for name in names if name != "eps")]
    gens = map(factored, polynomial_ring(system._layout.D, every).gens())
    symbols = {name: x for name, x in zip(every, gens, strict=False) if name in names}
    places = places_of_letters(system)
    given = {name: places[name][-1] for name in every[1:]}
    in_letters = InLetters(given, *_coefficients(system, symbols))
    return KahanMap(system._field, None, in_letters=in_letters)


@public
def kahan(field: Any, /, eps: Any = None, *, letters: Any = None) -> KahanMap:
    """Return the Kahan map of a field, ``(x~ - x) / eps = q(x, x~) + l((x + x~) / 2) + c``.

    Parameters
    ----------
    field : Field or body
        The field to discretize, a single one.
    eps : int, Fraction, float or str, optional
        Step size, of any sign; a string may be "1/3". Without it, eps is symbolic in all results
        for the map. Floats, also in the field, stand for the numbers typed: 0.1 for 1/10.
    letters : str, sequence of str or True, optional
        Names of parameters that stay symbols in addition to eps. A parameter eps among them is the
        step size: then coefficients of the field may depend on it.

    Returns
    -------
    KahanMap
        Called with a point, it returns the image. Its `inverse` is the map for -eps, `formulas` are
        its components as functions, and `subs` replaces a symbolic eps by a number.

    Examples
    --------
    >>> from suslov_fast import Field
    >>> from suslov_fast.integrability import kahan
    >>> map = kahan(Field.from_terms([[[1]]]), eps=1)  # x' = x**2
    >>> [str(x) for x in map([2])], [str(x) for x in map.inverse([-2])]
    (['-2'], ['2'])
    >>> kahan(map.field)([2]), kahan(map.field).formulas
    ((2/(-2*eps + 1),), (x1/(-eps*x1 + 1),))
    >>> corrected = Field(lambda x, eps: (x[0]**2 + eps**2,), 1, eps=1)
    >>> kahan(corrected, letters="eps")([0])
    (eps^3,)
    """
    if letters is not None and eps is not None:
        raise wrong("eps", "left out beside letters", eps)
    if letters is not None:
        return exact_map(field, None, letters)  # type: ignore[return-value]
    if not isinstance(field, Body):
        raise wrong("field", "a Field or a body", kind_of(field), TypeError)
    _ = field._has_eps or field._field  # `_field` raises for a `Map`
    if field.shape:
        raise wrong("field", "a single one", f"a batch of shape {field.shape}: pass field[i]")
    if str(eps).isidentifier() and eps is not None:  # a name, as a text or as a symbol of SymPy
        how = "leave it out, kahan(field), for formulas in eps"
        raise wrong("eps", "a number", f"the symbol {eps}: {how}", TypeError)
    step = None if eps is None else constant("eps", eps)
    if isinstance(field, Field):
        map = KahanMap(field._autonomous, step)
    else:
        map = KahanMap(exact_body(field)._field, step, is_exact=True)
    _ = map.terms  # raises for a field that is not of degree 2
    return map


def _coefficients(system: Body, symbols: Mapping[str, Any]) -> tuple[Any, Any]:
    """Return {(i, j, k): coefficient} of f, and of H or None, with `symbols` for parameters."""
    if not isinstance(system, Field):
        body, places = exact_body(system), places_of_letters(system)
        parts = {name: np.array(a, object) for name, a in body._parts.items()}
        for name, symbol in symbols.items():
            part, indices, _ = places[name]
            parts.setdefault(part, np.array(0, object))[indices] = symbol
        body = system._of({name: a[()] for name, a in parts.items()})
        terms = Terms(*body._terms) if isinstance(body, SuslovND) else body._field._own_terms
        return {place: as_function(c) for place, c in terms.members() if c}, None
    equations = system._equations

    def number(a: Any) -> RationalFunction:
        return as_function(a if isinstance(a, RationalFunction) else equations.ratios.get(a, a))

    values = [symbols.get(name, a) for name, a in system.parameters.items()]

    def read(results: Sequence[Any], degree: int) -> Any:
        entries = coefficients.coefficients_by(number, equations, results, degree, values)
        return {place: c for place, c in entries.items() if c}

    try:
        energy = None if equations.H is None else read([equations.H], 3)
        return read(equations.results, 2), energy
    except coefficients.NotQuadratic as error:
        raise TypeError(f"system: {error}, so it has no Kahan map") from None
    except TypeError as error:
        text = "must enter by + - * / and powers with integers"
        raise TypeError(f"letters: {', '.join(symbols)} {text}: {error}") from None


def with_values_of_letters(system: RationalMap, values: Mapping[str, Any]) -> RationalMap:
    """Return a map with functions of its other letters, in `values`, in place of letters."""
    kept, zeros = [name for name in system.letters if name not in values], (0,) * system.dimension
    ring = polynomial_ring(system.dimension, kept)
    gens = [*map(factored, ring.gens())]
    symbols = dict(zip(kept, gens, strict=False))
    for name, f in values.items():
        terms = ([{(*e, *zeros): c for e, c in P.to_dict().items()}, n] for P, n in f.factors)
        powers = (factored(ring.from_dict(P)) ** n for P, n in terms)
        symbols[name] = math.prod(powers, start=RationalFunction((), f.constant))
    point = [*(symbols[name] for name in system.letters), *gens[len(kept) :]]

    def substituted(P: Any) -> RationalFunction:
        return as_function(value_at(P, point))

    def function(f: RationalFunction) -> RationalFunction:
        numerator, denominator = map(substituted, f.as_quotient(system.ring))
        return numerator / denominator

    given = {name: a for name, a in system.given.items() if name in kept}
    if isinstance(system, KahanMap) and system.in_letters:
        _, rates, energy = system.in_letters
        rates = {place: rate for place, c in rates.items() if (rate := function(c))}
        energy = energy and {place: function(c) for place, c in energy.items()}
        return KahanMap(system.field, None, in_letters=InLetters(given, rates, energy))

    def with_values(each: RationalMap) -> RationalMap:
        *forms, _ = over_common_denominator(map(substituted, each.forms), ring)
        return RationalMap(coprime(forms), None, kept, each.names, given)

    new, inverse = with_values(system), system.inverse
    new.inverse = inverse and with_values(inverse)
    return new


def checked_letters(system: Any, letters: Any) -> tuple[str, ...]:
    """Return `letters`, parameters that stay symbols, as checked names; True stands for all."""
    if not isinstance(system, Body):
        raise wrong("letters", "left out for a map, which has its own", letters, TypeError)
    if system.shape:
        raise wrong("system", "a single one", f"a batch of shape {system.shape}: pass system[i]")
    places = places_of_letters(system)
    if letters is True:
        return tuple(n for n, (parameter, *_) in places.items() if parameter in system.parameters)
    names = letters.replace(",", " ").split() if isinstance(letters, str) else letters
    names = [*names] if isinstance(names, Sequence) else []
    if not names or {*names} - {*places} or len({*names}) < len(names):
        known = f"names of its parameters {', '.join(places)}"
        if "eps" in names and not isinstance(system, Map):
            known = "names of parameters: eps is a letter in any case"
        raise wrong("letters", known if places else "left out: it has none", repr(letters))
    most = MOST - (not isinstance(system, Map) and "eps" not in names)  # eps is a letter, too
    if len(names) > most:
        raise wrong("letters", f"at most {most} names", len(names))
    return tuple(names)


def places_of_letters(system: Body) -> dict[str, tuple[str, Any, Any]]:
    """Return {letter: (parameter, indices of entries, value)} for the letters a system may have.

    In the arrays J and I of a body in n dimensions, the letter J1 stands for all entries that equal
    J[0], and I1 for I[0] alone.
    """
    places: dict[str, tuple[str, Any, Any]] = {}
    parameters = {"k": 0.0} if isinstance(system, Suslov3D) else {}  # its `parameters` omit k = 0
    for name, a in (parameters | system.parameters).items():
        if not np.ndim(a):
            places[name] = name, (), a
            continue
        for i, value in enumerate(a):
            indices = np.flatnonzero(a == value) if name == "J" else np.array([i])
            if indices[0] == i:
                places[f"{name}{i + 1}"] = name, indices, value
    return places


def _stages(name: str, map: Any, letters: Sequence[str]) -> list[list[Any]]:
    """Return stages, of which a map is the composition; each is polynomials F_1, ..., F_D, F_0.

    A stage ends where the remaining operations of the map's program need only D values that depend
    on x. Messages of errors begin with the argument's `name`.
    """
    if not isinstance(map, Map):
        received = f"{kind_of(map)}: pass Map(f, names) of a function"
        raise wrong(name, "a Map", received, TypeError)
    if map.shape:
        raise wrong(name, "a single one", f"a family of shape {map.shape}: pass {name}[i]")
    D = map._layout.D
    ring = polynomial_ring(D, letters)
    symbols = [factored(x) for x in ring.gens()]
    named = dict(zip(letters, symbols, strict=False))
    x = symbols[len(letters) :]
    values: dict[Any, Any] = dict(enumerate(x))
    for k, (parameter, a) in enumerate(map.parameters.items(), D):
        values[k] = as_function(named.get(parameter, a))
    equations, stages, starts = map._equations, list[list[Any]](), [*range(D)]
    operations, results = equations.values.operations, equations.results
    # For each value, the number of the last operation that needs it.
    last = {a: k for k, (_, _, operands) in enumerate(operations) for a in _places(operands)}
    last |= dict.fromkeys(_places(results), len(operations))
    # For each value that depends on x, its operands that do so, too; {None} where a stage starts.
    sources: dict[int, set[Any]] = {a: {None} for a in starts}

    def value(a: Any) -> Any:
        return as_function(equations.ratios.get(a, a)) if type(a) is float else values[a]

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
        if rule == "scale" or not (operands_in_x := sources.keys() & _places(operands)):
            continue
        sources[place] = operands_in_x
        needed = {a for a in sources if last.get(a, -1) > k}
        cut = [a for a in sources if a in needed and not sources[a] <= needed]
        if len(cut) == D and cut != starts and {*cut} != _places(results):
            stages.append(over_common_denominator([values[a] for a in cut], ring))
            starts = cut
            values |= dict(zip(cut, x, strict=True))
            sources |= {a: {None} for a in cut}
            for operation in (each for each in operations if each[1] in needed.difference(cut)):
                values[operation[1]] = computed(*operation)
    return [*stages, over_common_denominator([value(a) for a in results], ring)]


def _places(operands: Sequence[Any]) -> set[int]:
    """Return the operands that are places of other operations, and not numbers."""
    return {a for a in operands if type(a) is not float}


def has_inverse(map: RationalMap) -> bool:
    """Return True if `map.inverse` maps images of random points modulo a prime to these points."""
    rng, at_number = map.generator(), map.at_eps(EPS)
    points = (random_point(map.dimension, map.prime, rng) for _ in range(POINTS_OF_INVERSE))
    try:
        return all(at_number.inverse.image(at_number.image(x)) == x for x in points)
    except ZeroDivisionError:
        return False
