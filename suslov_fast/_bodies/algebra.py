"""Rational numbers, polynomials, and arrays of their coefficients, without other libraries."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from fractions import Fraction
from functools import lru_cache
from itertools import combinations_with_replacement
from numbers import Rational
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._checks import common_shape, real_array, refuse_units, without_labels, wrong

Monomial = tuple[int, ...]  # the indices of the variables, in ascending order: (0, 0, 2) is x1^2*x3
_NUMBERS = Rational | float | np.integer | np.floating


def rational(name: str, value: Any, exact: bool = False) -> Fraction:
    """Return a number as a fraction; floats raise an error if `exact`."""
    number = value.item() if isinstance(value, np.generic) else value
    allowed = Rational if exact else Rational | float | np.floating
    if not isinstance(number, allowed) or isinstance(number, bool):
        kinds = "integers or fractions" if exact else "integers, fractions or floats"
        raise wrong(name, kinds, type(value).__name__, TypeError)
    if not isinstance(number, Rational) and not math.isfinite(number):
        raise wrong(name, "finite numbers", number)
    return Fraction(*map(int, number.as_integer_ratio()))  # type: ignore[union-attr]


def numbers(name: str, value: Any) -> NDArray[Any]:
    """Return an array of the numbers as they are: one of integers and floats is one of objects."""
    refuse_units(name, value)
    without_labels({name: value})
    return value if isinstance(value, np.ndarray) else np.array(value, dtype=object)


def exact_array(name: str, value: Any, shape: Any) -> NDArray[Any]:
    """Return an array of fractions."""
    given = numbers(name, value)
    if given.shape != shape:
        raise wrong(name, f"shape {shape}", given.shape)
    samples = given.flat if given.dtype == object else given.ravel()[:1]
    for each in {type(each): each for each in samples}.values():  # the types of zeros, too
        refuse_units(name, each)
        rational(name, each)
    array, nonzero = np.full(shape, Fraction(0)), given.astype(bool)
    array[nonzero] = [rational(name, each) for each in given[nonzero]]
    return array


def plain(a: Fraction) -> float | str:
    """Return a float if it is this number exactly, else the string "p/q"."""
    try:
        return float(a) if Fraction(float(a)) == a else str(a)
    except OverflowError:
        return str(a)


class Polynomial:
    """A polynomial in x1, x2, ..., exact: `terms` maps monomials to coefficients."""

    def __init__(self, terms: dict[Monomial, Fraction]) -> None:
        self.terms = {powers: c for powers, c in terms.items() if c}

    @classmethod
    def variables(cls, count: int) -> tuple[Polynomial, ...]:
        return tuple(cls({(i,): Fraction(1)}) for i in range(count))

    @classmethod
    def of(cls, name: str, value: Any) -> Polynomial:
        """Return a polynomial, or a number as a polynomial."""
        return value if isinstance(value, cls) else cls({(): rational(name, value)})

    def derivative(self, i: int) -> Polynomial:
        """Return the derivative with respect to variable i, counted from 0."""
        terms = {}
        for powers, c in self.terms.items():
            if i in powers:
                k = powers.index(i)
                terms[powers[:k] + powers[k + 1 :]] = powers.count(i) * c
        return type(self)(terms)

    def __call__(self, x: Any) -> Any:
        """Return the value at a point."""
        terms = (math.prod((x[i] for i in powers), start=c) for powers, c in self.terms.items())
        return sum(terms, start=Fraction(0))

    def __add__(self, other: Any) -> Polynomial:
        if not isinstance(other, Polynomial | _NUMBERS):
            return NotImplemented
        terms = dict(self.terms)
        for powers, c in Polynomial.of("number", other).terms.items():
            terms[powers] = terms.get(powers, Fraction(0)) + c
        return Polynomial(terms)

    def __mul__(self, other: Any) -> Polynomial:
        if not isinstance(other, Polynomial | _NUMBERS):
            return NotImplemented
        terms: dict[Monomial, Fraction] = {}
        for right, b in Polynomial.of("number", other).terms.items():
            for left, a in self.terms.items():
                powers = tuple(sorted(left + right))
                terms[powers] = terms.get(powers, Fraction(0)) + a * b
        return Polynomial(terms)

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> Polynomial:
        return Polynomial({powers: -c for powers, c in self.terms.items()})

    def __pos__(self) -> Polynomial:
        return self

    def __sub__(self, other: Any) -> Any:
        return self + -other

    def __rsub__(self, other: Any) -> Any:
        return -self + other

    def __truediv__(self, other: Any) -> Polynomial:
        if not isinstance(other, _NUMBERS):
            return NotImplemented
        return self * (1 / rational("divisor", other))

    def __pow__(self, power: Any) -> Polynomial:
        if power not in range(1000):
            raise wrong("power", "a small integer of at least 0", power)
        return math.prod([self] * int(power), start=Polynomial({(): Fraction(1)}))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Polynomial) and self.terms == other.terms

    def __hash__(self) -> int:
        return hash(frozenset(self.terms.items()))

    def __repr__(self) -> str:
        """Return the polynomial as text, the terms of highest degree first."""
        terms = []
        for powers, c in sorted(self.terms.items(), key=lambda term: (-len(term[0]), term[0])):
            a = abs(c)
            factors = [] if a == 1 and powers else [str(plain(a) if a.denominator > 2**20 else a)]
            for i in dict.fromkeys(powers):
                power = powers.count(i)
                factors.append(f"x{i + 1}^{power}" if power > 1 else f"x{i + 1}")
            terms.append((" - " if c < 0 else " + ") + "*".join(factors))
        whole = "".join(terms) or " + 0"
        return whole[3:] if whole[1] == "+" else f"-{whole[3:]}"


class BatchPolynomial(Polynomial):
    """Polynomials of a batch of fields: a coefficient is an array of floats of its shape."""

    # As of objects: fields compare the arrays.
    __eq__, __hash__ = object.__eq__, object.__hash__

    def __init__(self, terms: Mapping[Monomial, Any]) -> None:
        self.terms = {powers: c for powers, c in terms.items() if c.any()}

    @classmethod
    def of_table(cls, table: NDArray[Any], n: int) -> BatchPolynomial:
        """Return the polynomials whose coefficients `dense` returns."""
        present = np.flatnonzero(table.any(axis=tuple(range(table.ndim - 1))))
        return cls({monomials(n)[t]: table[..., t] for t in present})

    def __call__(self, x: Any) -> Any:
        """Return the values at points (..., D)."""
        x = real_array("x", x, allow_nan=True)
        terms: list[tuple[Monomial, Any]] = sorted(self.terms.items())
        common_shape({"H": terms[0][1].shape, "x": x.shape[:-1]} if terms else {})
        return sum(math.prod((x[..., i] for i in powers), start=c) for powers, c in terms)

    def __repr__(self) -> str:
        terms = Polynomial(dict.fromkeys(self.terms, Fraction(1)))
        return f"<polynomials with the terms of {terms}>"


@lru_cache(8)
def monomials(n: int) -> tuple[Monomial, ...]:
    """Return the monomials in n variables of degree 3 or less, in a fixed order."""
    indices = combinations_with_replacement(range(n + 1), 3)
    return tuple(tuple(i for i in powers if i < n) for powers in indices)


def dense(terms: Mapping[Monomial, Any], n: int, shape: tuple[int, ...] = ()) -> NDArray[Any]:
    """Return the coefficients (..., T) of these monomials."""
    of_all = monomials(n)
    array = np.zeros((*shape, len(of_all)))
    for t, powers in enumerate(of_all):
        c = terms.get(powers, 0.0)
        try:
            array[..., t] = c
        except OverflowError:
            raise wrong("H", "coefficients in the range of float64", "larger ones") from None
        except ValueError:
            raise wrong("H", f"coefficients of shape {shape}", np.shape(c)) from None
    return array


def polynomials_of(arrays: Mapping[str, NDArray[Any]]) -> tuple[Polynomial, ...]:
    """Return the polynomials f_i with coefficients (D, ...), an array for each degree, by name."""
    terms: dict[int, dict[Monomial, Fraction]] = {}
    for name, array in arrays.items():
        exact = exact_array(name, array, array.shape)
        of = [terms.setdefault(i, {}) for i in range(len(array))]
        for i, *powers in np.argwhere(exact).tolist():
            monomial = tuple(sorted(powers))
            of[i][monomial] = of[i].get(monomial, Fraction(0)) + exact[(i, *powers)]
    return tuple(map(Polynomial, terms.values()))


def fill(table: NDArray[Any], components: Iterable[Mapping[Monomial, Any]]) -> None:
    """Set the entries (..., i, j, k) of a table to those of the terms of f_i, with x_D = 1."""
    D = table.shape[-3]
    try:
        for i, terms in enumerate(components):
            for powers, c in terms.items():
                j, k = (*powers, D, D)[:2]
                table[..., i, j, k] = table[..., i, k, j] = c / 2 if j != k and k < D else c
    except OverflowError as error:
        raise ValueError("coefficients: expected the range of float64, got larger ones") from error


def coefficients_in(table: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Return q_ijk = q_ikj, l_ij and c_i in a table, by name."""
    q, slopes, c = table[..., :-1, :-1], table[..., :-1, -1], table[..., -1, -1]
    return {"quadratic": q, "linear": slopes, "constant": c}


def values_of(
    name: str, f: Callable[[Any], Any], n: int, count: int, degree: int
) -> tuple[Polynomial, ...]:
    """Return the polynomials in n variables that a function of the user returns."""
    kinds = f"polynomials of degree at most {degree}"
    try:
        found = f(Polynomial.variables(n))
    except TypeError as error:
        if re.search("(positional|keyword) argument", str(error)):
            how = "a field is autonomous: add the time as a variable, t' = 1, or a forcing as two"
            others = ", ".join(re.findall(r"'(\w+)'", str(error)))
            received = f"other arguments {others}; {how}"
            expected = "a function of x and of parameters given by name"
            raise wrong(name, expected, received, TypeError) from error
        how = f"{kinds}, by +, -, * and divisions by numbers"
        ufunc = re.search(r"callable (\w+) method", str(error))
        examples = ufunc[1] if ufunc else "a function, a comparison or a quotient"
        received = f"another operation on x, such as {examples}"
        raise wrong(name, how, received, TypeError) from error
    except IndexError as error:
        raise wrong(name, f"x[0] to x[{n - 1}]: the dimension is {n}", "a larger index") from error
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error
    if not isinstance(found, (tuple, list, np.ndarray)):
        raise wrong(name, f"a tuple of {count} components", f"{found!r:.60}", TypeError)
    if len(found) != count:
        raise wrong(name, f"{count} components", f"{len(found)} in {n} dimensions")
    polynomials = tuple(Polynomial.of(f"the value of {name}", each) for each in found)
    highest = max(len(powers) for each in polynomials for powers in (*each.terms, ()))
    if highest > degree:
        how = "; x^3 is x y with a variable y = x^2, y' = 2 x x', which steps keep to order eps^2"
        raise wrong(name, kinds, f"degree {highest}{how * (degree == 2)}")
    return polynomials


def antisymmetric(K: Any, n: int) -> NDArray[Any]:
    """Return the exact antisymmetric matrix (n, n), read-only; the canonical one for None."""
    if K is None:
        if n % 2:
            raise wrong("dimension", "an even number without K", n)
        K = np.eye(n, k=n // 2, dtype=np.int64) - np.eye(n, k=-n // 2, dtype=np.int64)
    matrix = exact_array("K", K, (n, n))
    if (matrix != -matrix.T).any():
        i, j = np.argwhere(matrix != -matrix.T)[0]
        received = f"{matrix[i, j]} at [{i}, {j}] and {matrix[j, i]} at [{j}, {i}]"
        raise wrong("K", "an antisymmetric matrix", received)
    matrix.flags.writeable = False
    return matrix


def plain_lists(array: Any) -> Any:
    """Return an array of numbers as nested lists of floats and strings "p/q"."""
    return np.vectorize(plain, "O")(array).tolist()


def from_plain(name: str, value: Any) -> Any:
    """Return nested lists of numbers whose strings "p/q" are fractions."""
    if isinstance(value, list):
        return [from_plain(name, each) for each in value]
    if not isinstance(value, str):
        return value
    try:
        return Fraction(value)
    except (ValueError, ZeroDivisionError):
        raise wrong(name, 'numbers or strings "p/q"', repr(value)) from None
