"""Exact experiments on the integrability of Kahan maps.

A quadratic vector field and a step size define a birational map. Four computations tell whether it
may be integrable: the growth of the degrees of its iterates, Hirota-Kimura bases, which give first
integrals, and Darboux polynomials, which give invariant measures and first integrals::

    from suslov_fast import Suslov3D, integrability as lab

    map = lab.kahan(lab.QuadraticField.of(Suslov3D(4, 1, -0.5, -0.25)), eps=0.25)
    lab.growth(lab.degrees(map, 20))
    lab.hk_bases(map, 2).integrals
    lab.darboux_polynomials(map, 3)

All arithmetic is exact: over the rationals, or modulo primes of 62 bits with points and lines drawn
from a seeded generator, so that results are reproducible. What is found modulo a prime is confirmed
modulo another one; the probability of a wrong answer is of the order of the number of operations
over 2**62. Rational coefficients are reconstructed from several primes.

The module needs python-flint: ``pip install 'suslov_fast[algebra]'``.
"""

from __future__ import annotations

import contextlib
import math
import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import combinations_with_replacement, islice
from numbers import Rational
from typing import Any, NamedTuple

import numpy as np

from ._engine.progress import Progress, check_progress, reporter

try:
    import flint
except ImportError as error:
    raise ImportError(
        "suslov_fast.integrability needs python-flint: pip install 'suslov_fast[algebra]'"
    ) from error

__all__ = [
    "Growth",
    "HKBasis",
    "KahanMap",
    "Polynomials",
    "QuadraticField",
    "darboux_polynomials",
    "degrees",
    "growth",
    "hk_bases",
    "kahan",
]

Point = tuple[Fraction, ...]
Matrix = tuple[tuple[Fraction, ...], ...]
# A linear form in 1, x1, ..., xD: its nonzero coefficients, by index.
Form = tuple[tuple[int, Any], ...]

_DRAWS = 8  # of a line, a point or a prime, before an exceptional case counts as the generic one
_MORE = 10  # equations more than unknowns
_MOST_PRIMES = 128  # for numerators and denominators of 1000 decimal digits


class _BadDrawError(ArithmeticError):
    """A line, a point or a prime for which the computation does not go through."""


# --- Fields and maps ------------------------------------------------------------------------------


@dataclass(frozen=True, init=False, repr=False)
class QuadraticField:
    """A quadratic vector field with rational coefficients.

    ``dx_i/dt = sum_jk q_ijk x_j x_k + sum_j l_ij x_j + c_i``

    Parameters
    ----------
    quadratic : array_like(shape=(D, D, D))
        q, integers, fractions, or floats, which are taken exactly (0.1 is not 1/10: use
        ``Fraction(1, 10)``). It is made symmetric in the last two indices, which does not change
        the field.
    linear : array_like(shape=(D, D)), optional
        l, by default 0.
    constant : array_like(shape=(D,)), optional
        c, by default 0.

    Raises
    ------
    TypeError, ValueError
        If a coefficient is not a finite rational number, or a shape is not as above.

    Examples
    --------
    >>> from suslov_fast.integrability import QuadraticField
    >>> QuadraticField([[[0, 1], [0, 0]], [[-1, 0], [0, 0]]], constant=[0, 0.5])
    QuadraticField(x1' = x1*x2, x2' = -x1^2 + 1/2)
    """

    quadratic: tuple[Matrix, ...]
    linear: Matrix
    constant: Point

    def __init__(self, quadratic: Any, linear: Any = None, constant: Any = None) -> None:
        q = _array("quadratic", quadratic)
        n = len(q) if q.ndim else 0
        if q.shape != (n, n, n) or n == 0:
            raise ValueError(f"quadratic: expected the shape (D, D, D), got {q.shape}")
        q = (q + q.transpose(0, 2, 1)) / 2
        zero = Fraction(0)
        l = np.full((n, n), zero) if linear is None else _array("linear", linear, (n, n))
        c = np.full(n, zero) if constant is None else _array("constant", constant, (n,))
        object.__setattr__(self, "quadratic", tuple(_rows(each) for each in q))
        object.__setattr__(self, "linear", _rows(l))
        object.__setattr__(self, "constant", tuple(c))

    @classmethod
    def from_function(cls, f: Callable[[Point], Sequence[Any]], dimension: int) -> QuadraticField:
        """Return the field that a function computes.

        Parameters
        ----------
        f : callable
            It takes a point, a tuple of fractions, and returns the `dimension` components of the
            field there as exact numbers.
        dimension : int
            Number of variables.

        Returns
        -------
        QuadraticField

        Raises
        ------
        TypeError, ValueError
            If `f` returns floats or another number of components, or is no polynomial of degree 2.

        Examples
        --------
        >>> from suslov_fast.integrability import QuadraticField
        >>> QuadraticField.from_function(lambda x: (x[1] * x[2], x[2] * x[0], x[0] * x[1]), 3)
        QuadraticField(x1' = x2*x3, x2' = x1*x3, x3' = x1*x2)
        """
        n = _count("dimension", dimension, least=1)

        def at(*indices: int, sign: int = 1) -> Any:
            x = [Fraction(0)] * n
            for i in indices:
                x[i] += sign
            return _value(f, tuple(x), n)

        c = at()
        q = np.empty((n, n, n), object)
        l = np.empty((n, n), object)
        for i in range(n):
            l[:, i] = (at(i) - at(i, sign=-1)) / 2
            q[:, i, i] = (at(i) + at(i, sign=-1)) / 2 - c
        for i in range(n):
            for j in range(i):
                crossed = at(i, j) - q[:, i, i] - q[:, j, j] - l[:, i] - l[:, j] - c
                q[:, i, j] = q[:, j, i] = crossed / 2
        field = cls(q, l, c)
        x = tuple(Fraction(k) for k in random.Random(0).sample(range(100, 10_000), n))
        if tuple(_value(f, x, n)) != field(x):
            raise ValueError("from_function: expected polynomials of degree 2 at most")
        return field

    @classmethod
    def of(cls, body: Any) -> QuadraticField:
        """Return the equations of motion of a body, its parameters taken exactly.

        Parameters
        ----------
        body : Suslov3D, SuslovND or SuslovGyrostat
            A single body.

        Returns
        -------
        QuadraticField
            In the variables of the package, Omega_1, Omega_2 or Omega_in.

        Raises
        ------
        TypeError, ValueError
            If `body` is not one of the above, or a batch of them.

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> from suslov_fast.integrability import QuadraticField
        >>> QuadraticField.of(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.25))
        QuadraticField(x1' = 1/8*x1*x2 + 1/16*x2^2, x2' = -1/2*x1^2 - 1/4*x1*x2)
        """
        kind = type(body).__name__
        if kind not in ("Suslov3D", "SuslovGyrostat", "SuslovND"):
            raise TypeError(f"body: expected Suslov3D, SuslovND or SuslovGyrostat, got {kind}")
        if body.shape != ():
            raise ValueError(f"body: expected a single body, got a batch of shape {body.shape}")
        if kind == "SuslovND":
            return _suslov_nd(_array("J", body.J), _array("I", body.I))
        parameters = (body.I1, body.I2, body.I13, body.I23, getattr(body, "k", 0))
        return _suslov_3d(*_array("parameters", parameters))

    @property
    def dimension(self) -> int:
        """The number of variables."""
        return len(self.constant)

    def __call__(self, point: Any) -> Point:
        """Return the field at a point, exactly."""
        x = np.array(_point(self, point))
        q, l, c = (np.array(each) for each in (self.quadratic, self.linear, self.constant))
        return tuple(q @ x @ x + l @ x + c)

    @cached_property
    def components(self) -> Polynomials:
        """The components of the field as polynomials."""
        x = _ring(self.dimension, flint.fmpq_mpoly_ctx).gens()
        indices = range(self.dimension)
        return Polynomials(
            sum((_fmpq(q[j][k]) * x[j] * x[k] for j in indices for k in indices), _fmpq(c))
            + sum(_fmpq(l[j]) * x[j] for j in indices)
            for q, l, c in zip(self.quadratic, self.linear, self.constant, strict=True)
        )

    def __repr__(self) -> str:
        lines = [f"x{i}' = {each}" for i, each in enumerate(self.components, start=1)]
        return f"QuadraticField({_shortened(', '.join(lines))})"


def _suslov_3d(I1: Fraction, I2: Fraction, I13: Fraction, I23: Fraction, k: Fraction) -> Any:
    def field(omega: Point) -> Sequence[Fraction]:
        l = I13 * omega[0] + I23 * omega[1] + k
        return -l * omega[1] / I1, l * omega[0] / I2

    return QuadraticField.from_function(field, 2)


def _suslov_nd(J: Any, I: Any) -> QuadraticField:
    def field(omega: Point) -> Sequence[Fraction]:
        w = np.array(omega)
        return tuple(((I @ w) * w - I * (w @ w)) / J)

    return QuadraticField.from_function(field, len(I))


@dataclass(frozen=True)
class KahanMap:
    """The Kahan discretization of a quadratic field, an exact birational map.

    Made by :func:`kahan`. Called with a point, D rational numbers, it returns the next one as a
    tuple of fractions; at a pole it raises `ZeroDivisionError`.
    """

    field: QuadraticField
    eps: Fraction

    @property
    def dimension(self) -> int:
        """The number of variables."""
        return self.field.dimension

    @cached_property
    def inverse(self) -> KahanMap:
        """The inverse map, which is the Kahan map of the same field with -eps."""
        return kahan(self.field, -self.eps)

    def __call__(self, point: Any) -> Point:
        """Return the image of a point, exactly."""
        x = _point(self, point)
        (image,) = zip(*self._solve(x, [[row[-1]] for row in self._system(x)]), strict=True)
        return image

    def jacobian(self, point: Any) -> Matrix:
        """Return the matrix of derivatives at a point, exactly, as rows."""
        x = _point(self, point)
        return self._solve(x, self.inverse._matrix(self(x)))

    def determinant(self, point: Any) -> Fraction:
        """Return the determinant of the Jacobian matrix at a point, exactly."""
        x = _point(self, point)
        image = self(x)
        return _fraction(
            _fmpq_mat(self.inverse._matrix(image)).det() / _fmpq_mat(self._matrix(x)).det()
        )

    def __repr__(self) -> str:
        return f"kahan({self.field}, eps={self.eps})"

    @cached_property
    def _forms(self) -> tuple[tuple[Form, ...], ...]:
        """The equations A(x) x~ = b(x) of a step: the rows of (A | b), linear in 1, x1, ..., xD."""
        n, half = self.dimension, self.eps / 2
        rows = []
        for i in range(n):
            q, l, c = self.field.quadratic[i], self.field.linear[i], self.field.constant[i]
            unit = [Fraction(i == j) for j in range(n)]
            row = [(unit[j] - half * l[j], *(-self.eps * each for each in q[j])) for j in range(n)]
            row.append((self.eps * c, *(unit[j] + half * l[j] for j in range(n))))
            rows.append(tuple(tuple((k, a) for k, a in enumerate(each) if a) for each in row))
        return tuple(rows)

    def _modulo(self, p: int) -> list[list[list[tuple[int, int]]]]:
        """The equations of a step modulo a prime."""
        return [[[(k, _mod(a, p)) for k, a in form] for form in row] for row in self._forms]

    def _system(self, x: Point) -> list[list[Any]]:
        return _evaluate(self._forms, (1, *x))

    def _matrix(self, x: Point) -> list[list[Any]]:
        return [row[:-1] for row in self._system(x)]

    def _solve(self, x: Point, right: Sequence[Sequence[Any]]) -> Matrix:
        try:
            solution = _fmpq_mat(self._matrix(x)).solve(_fmpq_mat(right))
        except ZeroDivisionError:
            where = ", ".join(map(str, x))
            raise ZeroDivisionError(f"({where}) has no image: it is a pole of the map") from None
        return tuple(tuple(map(_fraction, row)) for row in solution.table())


def kahan(field: QuadraticField, eps: Any) -> KahanMap:
    """Return the Kahan map of a field.

    Parameters
    ----------
    field : QuadraticField
    eps : int, Fraction or float
        Step size, of any sign; a float is taken exactly.

    Returns
    -------
    KahanMap
        ``(x~ - x) / eps = q(x, x~) + l((x + x~) / 2) + c``, solved for x~. It is callable, and has
        `inverse`, `jacobian`, `determinant`, `dimension`, `field` and `eps`.

    Raises
    ------
    TypeError
        If `field` is no :class:`QuadraticField`, or `eps` no rational number.
    ValueError
        If the linear equations of a step are singular at every point (a linear field with an
        eigenvalue 2/eps).

    Examples
    --------
    >>> from suslov_fast.integrability import QuadraticField, kahan
    >>> map = kahan(QuadraticField([[[1]]]), eps=1)  # x' = x**2
    >>> [str(x) for x in map([2])], [str(x) for x in map.inverse([-2])]
    (['-2'], ['2'])
    """
    if not isinstance(field, QuadraticField):
        raise TypeError(
            f"field: expected a QuadraticField, got {type(field).__name__}; "
            "QuadraticField.of(body) makes one of a body"
        )
    map = KahanMap(field, _exact("eps", eps))
    rng = random.Random(0)
    for p in islice(_primes(map), 2):
        x = [1, *(rng.randrange(p) for _ in range(map.dimension))]
        if flint.nmod_mat([row[:-1] for row in _evaluate(map._modulo(p), x)], p).det() != 0:
            return map
    raise ValueError(f"eps = {map.eps}: the equations of a step are singular at every point")


# --- Degrees --------------------------------------------------------------------------------------


def degrees(map: KahanMap, n: int, *, seed: int = 0, progress: Progress = None) -> list[int]:
    """Degrees of the iterates of a map.

    Parameters
    ----------
    map : KahanMap
    n : int
        Number of iterates.
    seed : int, optional
        Of the lines that are drawn.
    progress : bool or callable, optional
        True shows a bar (needs tqdm); a callable is called as ``progress(done, total)``.

    Returns
    -------
    list of int
        Degrees of the 1st, ..., n-th iterate as maps of projective space: the largest degree of
        the numerators and the common denominator, common factors cancelled.

    Raises
    ------
    TypeError, ValueError
        If an argument is not as above.
    ArithmeticError
        If no two lines agree, or every line runs into points where the map is undefined.

    Notes
    -----
    The image of a random line is iterated modulo a prime of 62 bits; another line and another prime
    confirm. An exceptional line or prime can only lower a degree, so that of two which disagree
    the larger counts, once a further one confirms it. The time for an iterate is little more than
    proportional to its degree.

    Examples
    --------
    >>> from suslov_fast import Suslov3D
    >>> from suslov_fast.integrability import QuadraticField, degrees, kahan
    >>> degrees(kahan(QuadraticField.of(Suslov3D(4, 1, -0.5, -0.25)), 0.25), 8)
    [2, 3, 4, 5, 6, 7, 8, 9]
    """
    _check_map(map)
    _count("n", n)
    check_progress(progress)
    rng = random.Random(seed)
    found: list[list[int]] = []
    with reporter(progress, 2 * n) as report:
        for p in islice(_primes(map), _DRAWS):
            done = min(len(found), 1) * n
            try:
                found.append(_degrees_on_a_line(map, n, p, rng, lambda k, at=done: report(at + k)))
            except _BadDrawError:
                continue
            largest = [max(each) for each in zip(*found, strict=True)]
            if found.count(largest) > 1:
                report(2 * n)
                return largest
    if not found:
        raise ArithmeticError(
            f"every one of {_DRAWS} random lines runs into points where the map is undefined"
        )
    raise ArithmeticError(f"no two of {len(found)} random lines agree on the degrees: {found}")


def _degrees_on_a_line(
    map: KahanMap, n: int, p: int, rng: random.Random, report: Callable[[int], object]
) -> list[int]:
    forms = map._modulo(p)
    line = [flint.nmod_poly([rng.randrange(p), rng.randrange(p)], p) for _ in range(map.dimension)]
    x = [flint.nmod_poly([1], p), *line]
    result = []
    for k in range(1, n + 1):
        x = _cramer(_evaluate(forms, x))
        common = flint.nmod_poly([0], p)
        for each in x:
            common = common.gcd(each)
            if common.degree() == 0:
                break
        else:
            x = [each // common for each in x]
        result.append(max(each.degree() for each in x))
        report(k)
    return result


def _cramer(system: list[list[Any]]) -> list[Any]:
    """Solve (A | b) over a ring: det A, and the numerators of the solution over it.

    The elimination of Gauss, Jordan and Bareiss: its divisions leave no remainder.
    """
    n = len(system)
    previous = 1
    for k in range(n):
        pivots = [i for i in range(k, n) if system[i][k] != 0]
        if not pivots:
            raise _BadDrawError
        best = min(pivots, key=lambda i: system[i][k].degree())
        system[k], system[best] = system[best], system[k]
        top = system[k]
        for i in (i for i in range(n) if i != k):
            row = system[i]
            for j in range(k + 1, n + 1):
                row[j] = (top[k] * row[j] - row[k] * top[j]) // previous
        previous = top[k]
    return [previous, *(row[n] for row in system)]


class Growth(NamedTuple):
    """Growth of a sequence of degrees, see :func:`growth`."""

    kind: str
    """"bounded", "linear", "quadratic", "exponential", or "unclear"."""
    entropy: float
    """The algebraic entropy, log of the limit of the ratio of consecutive degrees."""
    based_on: str
    """How kind and entropy were found."""


def growth(degrees: Sequence[int]) -> Growth:
    """Classify the growth of a sequence of degrees.

    Parameters
    ----------
    degrees : sequence of int
        Degrees of consecutive iterates, as :func:`degrees` returns them.

    Returns
    -------
    Growth
        A named tuple `kind, entropy, based_on`. `kind` is "bounded", "linear", "quadratic" or
        "exponential"; polynomial growth beyond is "cubic" or "polynomial of degree 4" and so on,
        and "unclear" stands for sequences too short to tell, with the entropy NaN.

    Raises
    ------
    TypeError, ValueError
        If `degrees` is not a sequence of integers >= 0.

    Notes
    -----
    If the degrees obey a linear recurrence with integer coefficients that has at least two terms
    fewer than it must satisfy, its characteristic polynomial gives kind and entropy: they are exact
    if the recurrence goes on. Otherwise they are estimated by a fit, and `based_on` says so.

    Examples
    --------
    >>> from suslov_fast.integrability import growth
    >>> growth([2, 3, 4, 5, 6, 7, 8, 9])
    Growth(kind='linear', entropy=0.0, based_on='d(k+2) = 2 d(k+1) - d(k), for all 8 degrees')
    >>> growth([3, 9, 27, 81, 243]).entropy == math.log(3)
    True
    """
    d = [_count("degrees", each) for each in degrees]
    recurrence = _recurrence(d)
    if recurrence:
        return _growth_of(recurrence, len(d))
    if len(d) < 6 or min(d) == 0:
        return Growth("unclear", math.nan, f"{len(d)} degrees, which obey no short recurrence")
    half = len(d) // 2
    what = f"a fit to the last {len(d) - half} of {len(d)} degrees, which obey no short recurrence"
    if max(d[half:]) <= max(d[:half]):
        return Growth("bounded", 0.0, f"{len(d)} degrees, the largest among the first {half}")
    k, logs = np.arange(half + 1, len(d) + 1), np.log(d[half:])
    (power, _), [of_power], *_ = np.polyfit(np.log(k), logs, 1, full=True)
    (rate, _), [of_rate], *_ = np.polyfit(k, logs, 1, full=True)
    if of_rate < of_power:
        return Growth("exponential", float(rate), what)
    return Growth(_polynomial(max(round(power), 1)), 0.0, what)


def _recurrence(d: list[int]) -> list[int]:
    """Characteristic polynomial, ascending, of the shortest recurrence; [] if it is not certain."""
    for order in range((len(d) - 2) // 2 + 1):
        hankel = [d[i : i + order + 1] for i in range(len(d) - order)]
        reduced, rank = flint.fmpq_mat(flint.fmpz_mat(hankel)).rref()
        if rank <= order:
            coefficients = [-reduced[i, order] for i in range(order)]
            whole = all(each.q == 1 for each in coefficients)  # as of all sequences of integers
            return [*(int(each.p) for each in coefficients), 1] if whole else []
    return []


def _growth_of(recurrence: list[int], n: int) -> Growth:
    """Growth of a sequence of n integers with this characteristic polynomial."""
    order = len(recurrence) - 1
    terms = [(-a, f"d(k+{i})" if i else "d(k)") for i, a in enumerate(recurrence[:-1]) if a]
    right = _sum_of(terms[::-1]) if terms else "0"
    what = f"d(k+{order}) = {right}, for all {n} degrees"
    exponent, radius = 0, 1.0
    for factor, multiplicity in flint.fmpz_poly(recurrence).factor()[1]:
        if factor.is_cyclotomic():
            exponent = max(exponent, multiplicity - 1)
        elif factor != flint.fmpz_poly([0, 1]):
            radius = max(radius, *(abs(complex(root)) for root, _ in factor.complex_roots()))
    if radius > 1:
        return Growth("exponential", math.log(radius), what)
    return Growth(_polynomial(exponent), 0.0, what)


def _polynomial(exponent: int) -> str:
    kinds = ("bounded", "linear", "quadratic", "cubic")
    return kinds[exponent] if exponent < len(kinds) else f"polynomial of degree {exponent}"


# --- Hirota-Kimura bases --------------------------------------------------------------------------


@dataclass(frozen=True, repr=False)
class HKBasis:
    """Linear relations between monomials along orbits, see :func:`hk_bases`."""

    monomials: tuple[tuple[int, ...], ...]
    """Exponents of each monomial."""
    dimension: int
    """Number of independent relations along an orbit."""
    point: Point
    """A point of the orbit to which `basis` belongs."""
    basis: tuple[Point, ...] | None
    """Coefficients of the relations along that orbit, a row for each relation; in each row one
    monomial, which the others leave out, has the coefficient 1. None if they are too long."""
    integrals: Polynomials
    """Polynomials whose quotients are first integrals, or none: see the notes of `hk_bases`."""
    independent: int
    """Number of independent first integrals among the coefficients."""

    @cached_property
    def polynomials(self) -> Polynomials:
        """The relations as polynomials, which vanish on the orbit of `point`."""
        return _polynomials(self.basis or (), self.monomials)

    def as_sympy(self, symbols: Sequence[Any] | None = None) -> list[Any]:
        """Return the relations along the orbit of `point` as SymPy expressions."""
        return self.polynomials.as_sympy(symbols)

    def __repr__(self) -> str:
        return (
            f"<HKBasis: dimension {self.dimension}, {len(self.monomials)} monomials, "
            f"{self.independent} independent integrals; quotients {self.integrals}>"
        )


def hk_bases(
    map: KahanMap,
    monomials: int | Sequence[Sequence[int]],
    *,
    point: Any = None,
    seed: int = 0,
) -> HKBasis:
    """Find the linear relations between monomials that hold along orbits.

    Parameters
    ----------
    map : KahanMap
    monomials : int or sequence of exponents
        A degree stands for all monomials up to that degree, 1 included; otherwise the exponents
        (e1, ..., eD) of each.
    point : sequence of D rational numbers, optional
        Point whose orbit `basis` belongs to; by default small integers are drawn.
    seed : int, optional
        Of the points that are drawn.

    Returns
    -------
    HKBasis
        `dimension` is 0 where the monomials are independent along orbits. Then no rational first
        integral exists whose numerator and denominator are sums of them.

    Raises
    ------
    TypeError, ValueError
        If an argument is not as above.
    ArithmeticError
        If the orbit of `point` ends at a pole.

    Notes
    -----
    The orbit is longer by 10 points than there are monomials, and the dimension remains the same
    on one twice as long. The coefficients of a relation are constant along its orbit, so that as
    functions of the orbit they are first integrals; `independent` is the rank of their derivatives.
    If the relations of all orbits together span one dimension more than those of one orbit, these
    polynomials P_1, P_2, ... are `integrals`: then P_i / P_j is constant on every orbit.

    The dimension is that of a random orbit modulo a prime, confirmed modulo another one.

    References
    ----------
    M. Petrera, A. Pfadler, Yu. B. Suris, arXiv:1008.1040.

    Examples
    --------
    >>> from suslov_fast import Suslov3D
    >>> from suslov_fast.integrability import QuadraticField, hk_bases, kahan
    >>> map = kahan(QuadraticField.of(Suslov3D(4, 1, -0.5, -0.25)), eps=1)
    >>> hk_bases(map, 1).dimension, hk_bases(map, 2).dimension
    (0, 1)
    >>> hk_bases(map, 2).integrals
    (4*x1^2 + x2^2, 4*x1*x2 + 256)
    """
    _check_map(map)
    exponents = _monomials(monomials, map.dimension)
    rng = random.Random(seed)
    start = None if point is None else _point(map, point)

    def relations(p: int, x: Point | None = None) -> list[list[int]]:
        drawn = [rng.randrange(p) for _ in range(map.dimension)]
        return _relations(map, exponents, [_mod(a, p) for a in x] if x else drawn, p)

    p, generic = _confirmed(map, lambda p: len(relations(p)))
    for largest in range(10, 10 + _DRAWS) if start is None else ():
        x = tuple(Fraction(k) for k in rng.choices(range(-largest, largest), k=map.dimension))
        with contextlib.suppress(_BadDrawError):
            if len(relations(p, x)) == generic:
                start = x
                break
    if start is None:
        raise ArithmeticError(f"{_DRAWS} points with small integers are exceptional: pass `point`")
    basis = _over_rationals(map, lambda p: relations(p, start))
    independent, integrals = 0, Polynomials()
    if generic > 0:
        independent = _confirmed(map, lambda p: _independent(map, exponents, rng, p), max)[1]
        span = _over_rationals(map, lambda p: _span(relations, generic, p))
        integrals = _polynomials(_short(span or ()), exponents)
    dimension = generic if basis is None else len(basis)
    return HKBasis(exponents, dimension, start, basis, integrals, independent)


def _relations(map: KahanMap, exponents: Any, x: list[int], p: int) -> list[list[int]]:
    """A basis of the relations along the orbit of x modulo p, in reduced echelon form."""
    steps = len(exponents) + _MORE
    relations = None
    while True:
        rows = [_values(exponents, each, p) for each in _orbit(map, x, steps, p)]
        shorter, relations = relations, _null_space(rows, p)
        if not relations or (shorter is not None and len(shorter) == len(relations)):
            return relations
        steps *= 2


def _orbit(map: KahanMap, x: list[int], steps: int, p: int) -> Iterator[list[int]]:
    forms = map._modulo(p)
    for _ in range(steps):
        yield x
        system = _evaluate(forms, (1, *x))
        x = [int(a) for a in _solve_mod(system, [row[-1:] for row in system], p).entries()]


def _span(relations: Callable[[int], list[list[int]]], generic: int, p: int) -> list[list[int]]:
    """The span of the relations along all orbits, if its dimension is that of one orbit + 1."""
    span = relations(p)
    for _ in range(3):
        reduced, rank = flint.nmod_mat(span + relations(p), p).rref()
        if rank > generic + 1:
            return []
        span = [[int(a) for a in row] for row in reduced.tolist()[:rank]]
    return span if len(span) == generic + 1 else []


def _independent(map: KahanMap, exponents: Any, rng: random.Random, p: int) -> int:
    """Number of independent functions among the coefficients of the relations.

    The derivative of ``sum_i c_i m_i(x_k) = 0`` with respect to x_0 is a linear equation for the
    derivatives of the c_i, of which those that the echelon form makes 0 and 1 are constant.
    """
    n = map.dimension
    start = [rng.randrange(p) for _ in range(n)]
    orbit = list(_orbit(map, start, len(exponents) + _MORE + 1, p))
    rows = [_values(exponents, x, p) for x in orbit[:-1]]
    relations = _null_space(rows, p)
    free = {max(i for i, a in enumerate(relation) if a) for relation in relations}
    bound = [i for i in range(len(exponents)) if i not in free]
    coefficients = flint.nmod_mat(relations, p).transpose()
    forward, backward = map._modulo(p), map.inverse._modulo(p)
    derivative = flint.nmod_mat([[int(i == j) for j in range(n)] for i in range(n)], p)
    system = []
    for row, x, image in zip(rows, orbit, orbit[1:], strict=False):
        changes = (
            flint.nmod_mat(_gradients(exponents, x, p), p) * derivative
        ).transpose() * coefficients
        system.append([row[i] for i in bound] + [int(a) for a in changes.entries()])
        onward = _evaluate(backward, (1, *image))
        derivative = (
            _solve_mod(_evaluate(forward, (1, *x)), [r[:-1] for r in onward], p) * derivative
        )
    reduced = flint.nmod_mat(system, p).rref()[0].tolist()
    solution = [row[len(bound) :] for row in reduced[: len(bound)]]
    # A row for each coefficient that is not constant, a column for each direction at x_0.
    by_direction = [
        [solution[i][k * len(relations) + j] for k in range(n)]
        for i in range(len(bound))
        for j in range(len(relations))
    ]
    return int(flint.nmod_mat(by_direction, p).rank()) if by_direction else 0


# --- Darboux polynomials --------------------------------------------------------------------------


def darboux_polynomials(
    map: KahanMap, degree: int, cofactor: Any = None, *, seed: int = 0
) -> Polynomials:
    """Find the polynomials P with P(map(x)) = C(x) P(x) for a given cofactor C.

    Parameters
    ----------
    map : KahanMap
    degree : int
        Largest degree of P.
    cofactor : number or callable, optional
        C: a rational number, or a function that takes a point, a tuple of fractions, and returns
        a rational number, exactly. By default the determinant of the Jacobian matrix.
    seed : int, optional
        Of the points that are drawn.

    Returns
    -------
    Polynomials
        A basis of all such polynomials, a tuple of ``flint.fmpz_mpoly`` in x1, ..., xD without
        common factors of their coefficients. It has `as_sympy`.

    Raises
    ------
    TypeError, ValueError
        If an argument is not as above, or `cofactor` does not return rational numbers.
    ArithmeticError
        If the coefficients have more than about 1000 digits, or fresh points do not confirm them.

    Notes
    -----
    For the default cofactor 1/P is the density of an invariant measure, and for any the quotients
    of two such polynomials are first integrals. The linear equations are those of random integer
    points, 10 more than there are monomials, modulo primes; the result is confirmed at fresh points
    over the rationals.

    References
    ----------
    E. Celledoni, C. Evripidou, D. I. McLaren, B. Owren, G. R. W. Quispel, B. K. Tapley,
    P. H. van der Kamp, arXiv:1902.04685.

    Examples
    --------
    >>> from suslov_fast import Suslov3D
    >>> from suslov_fast.integrability import QuadraticField, darboux_polynomials, kahan
    >>> map = kahan(QuadraticField.of(Suslov3D(4, 1, 0, 1)), eps=1)
    >>> for P in darboux_polynomials(map, 3):
    ...     print(P.factor())
    """
    _check_map(map)
    exponents = _up_to(map.dimension, _count("degree", degree))
    if cofactor is None:
        cofactor = map.determinant
    elif not callable(cofactor):
        cofactor = lambda x, constant=_exact("cofactor", cofactor): constant  # noqa: E731
    rng = random.Random(seed)

    def samples(count: int) -> list[tuple[Point, Point, Fraction]]:
        found: list[tuple[Point, Point, Fraction]] = []
        for _ in range(2 * count):
            x = tuple(Fraction(rng.randrange(-(2**30), 2**30)) for _ in range(map.dimension))
            with contextlib.suppress(ZeroDivisionError):  # a pole: another point
                found.append((x, map(x), _exact("cofactor", cofactor(x))))
            if len(found) == count:
                return found
        raise ArithmeticError("the map or the cofactor is undefined at most points")

    equations = samples(len(exponents) + _MORE)

    def solutions(p: int) -> list[list[int]]:
        rows = []
        for x, image, factor in equations:
            before, after = (_values(exponents, [_mod(a, p) for a in y], p) for y in (x, image))
            c = _mod(factor, p)
            rows.append([(a - c * b) % p for a, b in zip(after, before, strict=True)])
        return _null_space(rows, p)

    basis = _over_rationals(map, solutions)
    if basis is None:
        raise ArithmeticError(f"the coefficients have more than {_MOST_PRIMES * 9} digits")
    for x, image, factor in samples(3) if basis else ():
        before, after = (_values(exponents, y) for y in (x, image))
        for row in basis:
            if _dot(row, after) != factor * _dot(row, before):
                raise ArithmeticError("fresh points do not confirm the polynomials")
    return _polynomials(_short(basis), exponents)


class Polynomials(tuple[Any, ...]):
    """A tuple of polynomials of python-flint, in the variables x1, ..., xD."""

    __slots__ = ()

    def as_sympy(self, symbols: Sequence[Any] | None = None) -> list[Any]:
        """Return the polynomials as SymPy expressions.

        Parameters
        ----------
        symbols : sequence of sympy.Symbol, optional
            The variables, by default x1, ..., xD.

        Returns
        -------
        list of sympy.Expr

        Raises
        ------
        ImportError
            If SymPy is not installed.
        ValueError
            If `symbols` are not as many as the variables.

        Examples
        --------
        >>> from suslov_fast.integrability import QuadraticField
        >>> QuadraticField([[[1]]]).components.as_sympy()
        [x1**2]
        """
        import sympy

        def expression(polynomial: Any) -> Any:
            names = polynomial.context().names()
            x = sympy.symbols(names) if symbols is None else symbols
            if len(x) != len(names):
                raise ValueError(f"symbols: expected {len(names)}, got {len(x)}")
            terms = polynomial.to_dict().items()
            return sympy.Add(
                *(
                    sympy.Rational(str(a))
                    * sympy.Mul(*(v**e for v, e in zip(x, each, strict=True)))
                    for each, a in terms
                )
            )

        return [expression(polynomial) for polynomial in self]

    def __repr__(self) -> str:
        return f"({', '.join(_shortened(str(each)) for each in self)})"


# --- Linear algebra modulo primes, and back to the rationals --------------------------------------


def _primes(map: KahanMap) -> Iterator[int]:
    """Primes below 2**62, in descending order, at which the map has good reduction."""
    denominator = math.lcm(*(a.denominator for row in map._forms for form in row for _, a in form))
    for p in range(2**62 - 1, 0, -2):
        if flint.fmpz(p).is_prime() and denominator % p:
            yield p


def _confirmed(
    map: KahanMap, count: Callable[[int], int], best: Callable[[list[int]], int] = min
) -> tuple[int, int]:
    """A number that is `best` for generic points and primes: a prime that gives it, and it."""
    found: list[int] = []
    for p in islice(_primes(map), _DRAWS):
        with contextlib.suppress(_BadDrawError):
            found.append(count(p))
            if found[-1] == best(found) and found.count(found[-1]) > 1:
                return p, found[-1]
    raise ArithmeticError(f"no two of {_DRAWS} random orbits agree: {found}")


def _over_rationals(
    map: KahanMap, matrix: Callable[[int], list[list[int]]]
) -> tuple[Point, ...] | None:
    """The rational matrix that `matrix` returns modulo primes; None if its entries are too long."""
    modulus, residues, shape, candidate = 1, [], None, None
    good = 0
    for p in islice(_primes(map), _MOST_PRIMES):
        try:
            rows = matrix(p)
        except _BadDrawError:
            continue
        new = [a for row in rows for a in row]
        if good and len(rows) > shape:
            continue  # a prime for which the rank is lower
        if good == 0 or len(rows) < shape:
            modulus, residues, shape, candidate, good = 1, [0] * len(new), len(rows), None, 0
        if candidate is not None and [_mod(a, p) for a in candidate] == new:
            width = len(rows[0]) if rows else 1
            return tuple(tuple(candidate[i : i + width]) for i in range(0, len(new), width))
        lift = modulus * pow(modulus, -1, p)
        residues = [r + lift * (a - r) % (modulus * p) for r, a in zip(residues, new, strict=True)]
        modulus *= p
        residues = [r % modulus for r in residues]
        good += 1
        if good & (good - 1) == 0:
            candidate = _reconstructed(residues, modulus)
    if not good:
        raise ArithmeticError("the orbit ends at a pole")
    return None


def _reconstructed(residues: list[int], modulus: int) -> list[Fraction] | None:
    """The fractions of these residues, numerators and denominators below sqrt(modulus / 2)."""
    bound = math.isqrt(modulus // 2)
    fractions = []
    for residue in residues:
        (r0, t0), (r1, t1) = (modulus, 0), (residue, 1)
        while r1 > bound:
            quotient = r0 // r1
            (r0, t0), (r1, t1) = (r1, t1), (r0 - quotient * r1, t0 - quotient * t1)
        if abs(t1) > bound or math.gcd(r1, t1) != 1:
            return None
        fractions.append(Fraction(r1, t1))
    return fractions


def _null_space(rows: list[list[int]], p: int) -> list[list[int]]:
    """Basis of the null space: the last nonzero entry of a vector is 1, and 0 in the others."""
    width = len(rows[0])
    reduced, rank = flint.nmod_mat(rows, p).rref()
    reduced = [[int(a) for a in row] for row in reduced.tolist()[:rank]]
    pivots = [next(i for i, a in enumerate(row) if a) for row in reduced]
    vectors = []
    for free in sorted({*range(width)} - {*pivots}):
        vector = [0] * width
        vector[free] = 1
        for pivot, row in zip(pivots, reduced, strict=True):
            vector[pivot] = -row[free] % p
        vectors.append(vector)
    return vectors


def _solve_mod(system: list[list[int]], right: list[list[int]], p: int) -> Any:
    try:
        return flint.nmod_mat([row[: len(system)] for row in system], p).solve(
            flint.nmod_mat(right, p)
        )
    except ZeroDivisionError:
        raise _BadDrawError from None


def _evaluate(forms: Any, x: Any) -> list[list[Any]]:
    zero = x[0] - x[0]
    return [[sum((a * x[k] for k, a in form), zero) for form in row] for row in forms]


def _values(exponents: Any, x: Sequence[Any], p: int | None = None) -> list[Any]:
    """The monomials at a point, modulo p if it is given."""
    highest = max(max(each) for each in exponents)
    powers = [[pow(a, e, p) for e in range(highest + 1)] for a in x]
    values = []
    for each in exponents:
        value = 1
        for i, e in enumerate(each):
            if e:
                value *= powers[i][e]
        values.append(value if p is None else value % p)
    return values


def _gradients(exponents: Any, x: list[int], p: int) -> list[list[int]]:
    """The derivatives of the monomials at a point: a row for each."""
    columns = []
    for i in range(len(x)):
        lowered = [(*each[:i], max(each[i] - 1, 0), *each[i + 1 :]) for each in exponents]
        values = _values(lowered, x, p)
        columns.append([each[i] * v % p for each, v in zip(exponents, values, strict=True)])
    return [list(row) for row in zip(*columns, strict=True)]


# --- Monomials, numbers, matrices -----------------------------------------------------------------


def _up_to(n: int, degree: int) -> tuple[tuple[int, ...], ...]:
    """Exponents of the monomials in n variables up to a degree, the lowest first."""
    return tuple(
        tuple(chosen.count(i) for i in range(n))
        for d in range(degree + 1)
        for chosen in combinations_with_replacement(range(n), d)
    )


def _monomials(monomials: Any, n: int) -> tuple[tuple[int, ...], ...]:
    if isinstance(monomials, (int, np.integer)):
        return _up_to(n, _count("monomials", monomials))
    try:
        exponents = tuple(tuple(_count("monomials", e) for e in each) for each in monomials)
    except TypeError:
        raise TypeError(
            f"monomials: expected a degree or a list of exponents, got {monomials!r}"
        ) from None
    wrong = next((each for each in exponents if len(each) != n), None)
    if wrong is not None:
        raise ValueError(f"monomials: expected {n} exponents for each monomial, got {wrong}")
    if not exponents or len({*exponents}) < len(exponents):
        raise ValueError("monomials: expected one monomial or more, each once")
    return exponents


def _ring(n: int, context: Any) -> Any:
    return context.get([f"x{i}" for i in range(1, n + 1)], "deglex")


def _polynomials(rows: Sequence[Sequence[Any]], exponents: Any) -> Polynomials:
    """Polynomials with these coefficients, made integers without a common factor."""
    ring = _ring(len(exponents[0]), flint.fmpz_mpoly_ctx)
    result = []
    for row in rows:
        terms = zip(exponents, _primitive(row), strict=True)
        polynomial = ring.from_dict({e: a for e, a in terms if a})
        result.append(-polynomial if polynomial.coeffs()[0] < 0 else polynomial)
    return Polynomials(result)


def _primitive(row: Sequence[Any]) -> list[int]:
    denominator = math.lcm(*(a.denominator for a in row))
    integers = [int(a * denominator) for a in row]
    divisor = math.gcd(*integers)
    return [a // divisor for a in integers]


def _short(rows: Sequence[Point]) -> Sequence[Sequence[int]]:
    """Short integer vectors with the same span."""
    if not rows:
        return ()
    reduced = flint.fmpz_mat([_primitive(row) for row in rows]).lll()
    return [[int(a) for a in row] for row in reduced.tolist()]


def _exact(name: str, value: Any) -> Fraction:
    if isinstance(value, Rational):
        return Fraction(int(value.numerator), int(value.denominator))
    if isinstance(value, flint.fmpz | flint.fmpq):
        return _fraction(flint.fmpq(value))
    if isinstance(value, float | np.floating):
        if not math.isfinite(value):
            raise ValueError(f"{name}: expected finite numbers, got {value}")
        return Fraction(*value.as_integer_ratio())
    raise TypeError(f"{name}: expected integers, fractions or floats, got {type(value).__name__}")


def _array(name: str, value: Any, shape: tuple[int, ...] | None = None) -> Any:
    """Array of fractions, of a given shape."""
    for unit in ("unit", "units"):
        if hasattr(value, unit):
            raise TypeError(f"{name}: expected numbers without units, got {type(value).__name__}")
    try:
        raw = np.array(value, dtype=object)
    except ValueError:
        raise ValueError(f"{name}: expected an array, got rows of different lengths") from None
    if shape is not None and raw.shape != shape:
        raise ValueError(f"{name}: expected the shape {shape}, got {raw.shape}")
    array = np.empty(raw.shape, object)
    array[...] = (
        np.vectorize(lambda each: _exact(name, each), otypes=[object])(raw) if raw.size else 0
    )
    return array


def _point(map: KahanMap | QuadraticField, point: Any) -> Point:
    return tuple(_array("point", point, (map.dimension,)))


def _value(f: Callable[[Point], Any], x: Point, n: int) -> Any:
    value = _array("from_function", f(x), (n,))
    return value


def _rows(matrix: Any) -> Matrix:
    return tuple(tuple(row) for row in matrix)


def _count(name: str, value: Any, least: int = 0) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer | flint.fmpz):
        raise TypeError(f"{name}: expected an integer, got {type(value).__name__}")
    if value < least:
        raise ValueError(f"{name}: expected an integer >= {least}, got {value}")
    return int(value)


def _check_map(map: Any) -> None:
    if not isinstance(map, KahanMap):
        raise TypeError(
            f"map: expected a map that kahan(field, eps) returns, got {type(map).__name__}"
        )


def _mod(a: Fraction, p: int) -> int:
    try:
        return a.numerator * pow(a.denominator, -1, p) % p
    except ValueError:
        raise _BadDrawError from None


def _dot(row: Point, values: list[Any]) -> Any:
    return sum(a * b for a, b in zip(row, values, strict=True))


def _fmpq(a: Fraction) -> Any:
    return flint.fmpq(a.numerator, a.denominator)


def _fraction(a: Any) -> Fraction:
    return Fraction(int(a.p), int(a.q))


def _fmpq_mat(rows: Any) -> Any:
    return flint.fmpq_mat([[_fmpq(a) for a in row] for row in rows])


def _shortened(text: str) -> str:
    return text if len(text) <= 300 else f"{text[:297]}..."


def _sum_of(terms: list[tuple[int, str]]) -> str:
    """2 a - b from the terms (2, "a"), (-1, "b")."""
    text = ""
    for factor, name in terms:
        sign = " - " if factor < 0 else " + "
        text += sign + (name if abs(factor) == 1 else f"{abs(factor)} {name}")
    return text[3:] if text.startswith(" + ") else f"-{text[3:]}"
