"""A quadratic field in more variables from the equations of a smooth one: lifting.

The right-hand sides are polynomials in the state and in added variables u = g(p) (`expressions`).
Three steps make all derivatives quadratic:

1. The chain rule gives u' as a polynomial, with g' in terms of u: (e^p)' = e^p p', and for
   u = 1/p u' = -u**2 p'.
2. Products are reduced by relations between variables: u lead(p) = 1 - u (p - lead(p)) for u = 1/p,
   with the leading monomial of p, and the like for roots.
3. Words, which are products of variables, are added until each derivative of a word is a sum of
   products of two words: always for the missing product of least degree, and of the ways to write
   it as a product of two words one that leaves the fewest products missing.

A polynomial is here a dict from monomials, sorted tuples of indices, to fractions. Symbols of
parameters have negative indices.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from fractions import Fraction
from functools import cache
from itertools import combinations_with_replacement
from textwrap import shorten
from typing import NamedTuple

from .definitions import HALF, ONE, Definitions, brief, number, variable
from .polynomials import Polynomial

MOST = 200  # variables added for products
MOST_TERMS = 200_000  # of all derivatives; half as many take 20 s, and the plan of a step a minute
LENGTH = 2**18  # of all products that divide one that is looked for, a second
WORK = 400_000  # products looked at, a few seconds

Monomial = tuple[int, ...]
Terms = dict[Monomial, Fraction]


class TooMany(ValueError):
    """More than MOST further variables, or MOST_TERMS terms, would be needed."""


class Lifted(NamedTuple):
    """The variables of a lifted field, as products of definitions, and their derivatives.

    words   products of variables of the state and of added ones, those of the state first
    terms   for each word the terms of its derivative: places j <= k of two words, of which the
            number of words stands for 1, and coefficients as polynomials in the symbols
    """

    words: tuple[Monomial, ...]
    terms: tuple[tuple[tuple[int, int, Terms], ...], ...]


def lifted(definitions: Definitions, equations: Sequence[Polynomial]) -> Lifted:
    """Return the words that make the equations quadratic."""
    _count_terms(definitions, equations)
    rates = _rates(definitions, equations)
    algebra = _Algebra(definitions, rates)
    needed = [*range(definitions.D)]
    for i in needed:  # the list grows
        needed += sorted({j for m in algebra.rates[i] for j in m if j >= 0} - {*needed})
    words: list[Monomial] = [(i,) for i in sorted(needed)]
    return _quadratic(definitions, algebra, words)


def _count_terms(definitions: Definitions, equations: Sequence[Polynomial]) -> None:
    """Refuse equations whose added variables have derivatives of too many terms."""
    count, D = 0, definitions.D
    for _, p, _ in definitions.list:
        of_state = {i for m in p.terms for i in m if 0 <= i < D}
        count += sum(len(equations[i].terms) for i in of_state)
    if count > MOST_TERMS:
        raise TooMany(
            f"the derivatives of the added variables would have some {count:,} terms, and at most "
            f"{MOST_TERMS:,} are possible, because each variable has a term for each term of the "
            "equations of the variables that it depends on: use SciPy's solve_ivp"
        )


def rate(definitions: Definitions, i: int, of: dict[int, Polynomial]) -> Polynomial:
    """Return the derivative in time of the added variable i, by those of its argument."""
    function, p, exponent = definitions.list[i - definitions.D]
    u, dp = variable(i), derivative(p, of)
    if function == "inverse":
        slope = -u * u
    elif function == "root":
        slope = -HALF * u * definitions.inverse(p)
    elif function == "power":
        slope = exponent * u * definitions.inverse(p)
    elif function == "cbrt":
        slope = Fraction(1, 3) * u * definitions.inverse(p)
    elif function == "log":
        slope = definitions.inverse(p)
    elif function == "arctan":
        slope = definitions.inverse(p * p + ONE)
    elif function == "exp":
        slope = u
    elif function in ("tan", "tanh"):
        slope = ONE + u * u if function == "tan" else ONE - u * u
    else:
        other = {"sin": "cos", "cos": "sin", "sinh": "cosh", "cosh": "sinh"}[function]
        slope = definitions.added(other, p)
        if function == "cos":
            slope = -slope
    result: Polynomial = slope * dp
    return result


def derivative(p: Polynomial, of: dict[int, Polynomial]) -> Polynomial:
    """Return the derivative in time of a polynomial, by those of its variables."""
    variables = sorted({i for m in p.terms for i in m if i >= 0})
    return sum((partial(p, i) * of[i] for i in variables if of[i].terms), number(0))


def partial(p: Polynomial, i: int) -> Polynomial:
    """Return the derivative of a polynomial by variable i."""
    return Polynomial(
        ((*m[:k], *m[k + 1 :]), c)
        for m, c in p.terms.items()
        for k, each in enumerate(m)
        if each == i
    )


def gradient(definitions: Definitions, p: Polynomial) -> list[Polynomial]:
    """Return the derivatives of a polynomial by the variables of the state, by the chain rule."""
    slopes, D = [], definitions.D
    for j in range(D):
        of = {i: number(int(i == j)) for i in range(D)}
        for i in range(D, D + len(definitions.list)):
            of[i] = rate(definitions, i, of) if _depends(definitions, i, of) else number(0)
        slopes.append(derivative(p, of))
    return slopes


def _depends(definitions: Definitions, i: int, of: dict[int, Polynomial]) -> bool:
    """Return whether the argument of an added variable has a derivative other than 0."""
    p = definitions.list[i - definitions.D].argument
    return any(of[j].terms for m in p.terms for j in m if j >= 0)


def _rates(definitions: Definitions, equations: Sequence[Polynomial]) -> list[Terms]:
    """Return the derivatives in time of all variables; some may be added meanwhile."""
    of = dict(enumerate(equations))
    for i, definition in enumerate(definitions.list, definitions.D):  # the list grows
        for j in sorted({j for m in definition.argument.terms for j in m if j > i}):
            of[j] = rate(definitions, j, of)  # added by the chain rule, for an argument
        of[i] = rate(definitions, i, of)
    return [of[i].terms for i in range(definitions.D + len(definitions.list))]


# ----------------------------------------------------------------------------------------- algebra
def _merged(a: Monomial, b: Monomial) -> Monomial:
    return tuple(sorted(a + b))


def _without(m: Monomial, part: Monomial) -> Monomial | None:
    """Return m / part; None if it is no monomial."""
    rest, k = [], 0
    for i in m:
        if k < len(part) and part[k] == i:
            k += 1
        elif k < len(part) and part[k] < i:
            return None
        else:
            rest.append(i)
    return tuple(rest) if k == len(part) else None


def _without_symbols(m: Monomial) -> Monomial:
    return tuple(i for i in m if i >= 0)


def _order(m: Monomial) -> tuple[int, Monomial]:
    """A key for monomials: by degree, then those with the earlier variables first."""
    return len(m), tuple(-i for i in m)


class _Algebra:
    """Monomials of the variables, reduced by the relations between them."""

    def __init__(self, definitions: Definitions, rates: Iterable[Terms]) -> None:
        self._inverse_of = definitions.inverse_of
        self._normal: dict[Monomial, Terms] = {}
        self._derivatives: dict[Monomial, Terms] = {}
        self.rules = [*self._relations(definitions)]
        self.rates = [self.reduced(each) for each in rates]

    def _relations(self, definitions: Definitions) -> Iterator[tuple[Monomial, Terms]]:
        """Yield monomials, each with a polynomial of lower order that equals it."""
        for k, (function, p, _) in enumerate(definitions.list):
            u = (definitions.D + k,)
            if function == "root":
                inverse = definitions.inverse(p)
                yield u + u, inverse.terms
            if function != "inverse":
                continue
            if (found := self._lead(p)) is None:
                continue
            lead, symbols, inverse_of_c = found
            terms: Terms = {symbols: inverse_of_c}
            for m, c in p.terms.items():
                if _without_symbols(m) != lead:
                    key = self.cancelled(_merged(_merged(m, u), symbols))
                    terms[key] = terms.get(key, Fraction(0)) - c * inverse_of_c
            yield _merged(lead, u), {m: c for m, c in terms.items() if c}

    def _lead(self, p: Polynomial) -> tuple[Monomial, Monomial, Fraction] | None:
        """Return the leading monomial, without symbols, and the inverse of its coefficient.

        The inverse is a product of symbols and a number; None if it is not known as one.
        """
        lead = max(map(_without_symbols, p.terms), key=_order)
        (m, c), *others = (term for term in p.terms.items() if _without_symbols(term[0]) == lead)
        symbols = [i for i in m if i < 0]
        if others or not all(i in self._inverse_of for i in symbols):
            return None
        return lead, tuple(sorted(self._inverse_of[i] for i in symbols)), 1 / c

    def cancelled(self, m: Monomial) -> Monomial:
        """Return a monomial without products of a symbol and its inverse."""
        if not m or m[0] >= 0 or not self._inverse_of:
            return m
        rest = [*m]
        for i in m:
            if i < 0 and i in rest and (j := self._inverse_of.get(i)) in rest:
                rest.remove(i)
                rest.remove(j)
        return tuple(rest)

    def reduced(self, terms: Terms) -> Terms:
        """Return a polynomial reduced by the relations."""
        result: Terms = {}
        for m, c in terms.items():
            form = self._normal_form(m)
            for n, d in form.items():
                product = c if n == m else c * d  # of most monomials the form is 1 times themselves
                result[n] = result[n] + product if n in result else product
        return {m: c for m, c in result.items() if c}

    def _normal_form(self, m: Monomial) -> Terms:
        if m not in self._normal:
            n = self.cancelled(m)
            for lead, replacement in self.rules:
                rest = _without(n, lead)
                if rest is not None:
                    self._normal[m] = self.reduced(
                        {_merged(rest, r): c for r, c in replacement.items()}
                    )
                    break
            else:
                self._normal[m] = {n: Fraction(1)}
        return self._normal[m]

    def derivative(self, word: Monomial) -> Terms:
        """Return the derivative in time of a product of variables."""
        if word not in self._derivatives:
            terms: Terms = {}
            for k, i in enumerate(word):
                rest = word[:k] + word[k + 1 :]
                for m, c in self.rates[i].items():
                    n = _merged(rest, m)
                    terms[n] = terms[n] + c if n in terms else c
            self._derivatives[word] = self.reduced(terms)
        return self._derivatives[word]

    def products(self, word: Monomial) -> set[Monomial]:
        """Return the monomials, without symbols, in the derivative of a word."""
        return {*map(_without_symbols, self.derivative(word))}


# ----------------------------------------------------------------------------------- quadratization
def _quadratic(definitions: Definitions, algebra: _Algebra, words: list[Monomial]) -> Lifted:
    """Add words until the derivatives of all are quadratic in them; of two ways the shorter."""
    most = len(words) + MOST
    by_degree = _closed(algebra, words, lambda left: sum(len(m) - 2 for m in left), most)
    most = most if by_degree is None else len(by_degree) - 1
    closed = _closed(algebra, words, len, most) or by_degree
    if closed is None:
        missing = sorted({m for w in words for m in algebra.products(w) if len(m) > 2}, key=_order)
        texts = [brief(definitions.text(Polynomial([(m, Fraction(1))]))) for m in missing[:3]]
        products = ", ".join(shorten(text, 100, placeholder=" ...") for text in texts)
        raise TooMany(
            f"more than {MOST} variables would be added, for products such as {products}: use "
            "SciPy's solve_ivp, or make differences variables if f has powers of them, or write "
            "products of sums of sines and cosines as sums of functions of differences, such as "
            "sin(x2 - x1)"
        )
    return _with_places(algebra, closed)


def _closed(
    algebra: _Algebra,
    words: Sequence[Monomial],
    measure: Callable[[set[Monomial]], int],
    most: int,
) -> list[Monomial] | None:
    """Return words whose derivatives are quadratic in them; None if there are more than `most`.

    `measure` says how far from that a set of missing products is.
    """
    words = [*words]  # variables alone: a product of two of them is never missing
    missing = {m for word in words for m in algebra.products(word) if len(m) > 2}
    if not missing:
        return words
    pairs = {_merged(a, b) for a, b in combinations_with_replacement([(), *words], 2)}
    work = 0
    while missing:
        target = min(missing, key=_order)
        if len(words) >= most or _length(target) > LENGTH or work > WORK:
            return None
        best = None
        for fresh in _ways(target, words):
            more = {_merged(a, b) for b in fresh for a in ((), *words, *fresh)}
            left = missing - more
            for word in fresh:
                left |= algebra.products(word) - pairs - more
            work += len(left) + len(fresh) * len(words)
            size = measure(left) + 2 * len(fresh), max(map(len, fresh)), sum(map(len, fresh))
            if best is None or (*size, fresh) < best[0]:
                best = (*size, fresh), fresh, more, left
        assert best is not None
        words += best[1]
        pairs |= best[2]
        missing = best[3]
    return words


def _ways(target: Monomial, words: Sequence[Monomial]) -> Iterator[list[Monomial]]:
    """Yield the words to add so that a monomial is a product of two words."""
    for part in sorted(_parts(target), key=lambda m: (len(m), m)):
        rest = _without(target, part)
        assert rest is not None
        if len(part) >= len(rest):
            fresh = [w for w in dict.fromkeys((part, rest)) if w not in words and len(w) > 1]
            yield [target] if part == target else fresh


def _length(m: Monomial) -> int:
    """Return the degree of m times the number of monomials that divide it."""
    return len(m) * math.prod(m.count(i) + 1 for i in {*m})


def _parts(m: Monomial) -> set[Monomial]:
    """Return all monomials that divide m."""
    parts: set[Monomial] = {()}
    for i in m:
        parts |= {(*part, i) for part in parts}
    return parts


def _with_places(algebra: _Algebra, words: Sequence[Monomial]) -> Lifted:
    """Return the words with their derivatives as sums of products of two words."""
    M = len(words)
    number = {word: k for k, word in enumerate([*words, ()])}

    @cache
    def place_of(m: Monomial) -> tuple[int, int]:
        if m in number:  # a word itself, rather than a product
            return number[m], M
        rests = ((part, _without(m, part)) for part in _parts(m))
        found = [(number[a], number[b]) for a, b in rests if a in number and b in number]
        k, j = min((k, j) for j, k in found if j <= k)
        return j, k

    terms = []
    for word in words:
        sums: dict[tuple[int, int], Terms] = {}
        for m, c in algebra.derivative(word).items():
            symbols = tuple(i for i in m if i < 0)
            of_place = sums.setdefault(place_of(_without_symbols(m)), {})
            of_place[symbols] = of_place.get(symbols, 0) + c
        terms.append(tuple((j, k, sums[j, k]) for j, k in sorted(sums)))
    return Lifted(tuple(words), tuple(terms))
