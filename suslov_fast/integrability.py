"""Exact experiments on the integrability of Kahan maps.

A quadratic vector field and a step size define a birational map. Four computations tell whether it
may be integrable: the degrees of its iterates and their growth, Hirota-Kimura bases, which give
first integrals, and Darboux polynomials, which give invariant measures and first integrals::

    from suslov_fast import Suslov3D
    from suslov_fast.integrability import *

    map = kahan(QuadraticField.of(Suslov3D(4, 1, -0.5, -0.25)), eps=0.25)
    growth(degrees(map, 20))
    hk_bases(map, 2).integrals
    darboux_polynomials(map, 3)

All arithmetic is exact, over the rationals or modulo random primes of 62 bits, two of which must
agree on each result. A seed determines primes, points and lines. The module needs python-flint:
``pip install 'suslov_fast[algebra]'``.
"""

from __future__ import annotations

import contextlib
import math
import random
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import combinations_with_replacement, islice
from numbers import Rational
from typing import Any, NamedTuple

import numpy as np

from ._bodies.gyrostat import SuslovGyrostat
from ._bodies.nd import SuslovND
from ._bodies.three import Suslov3D
from ._checks import instance, integer, wrong
from ._engine.progress import Progress, check_progress, reporter

try:
    import flint
except ImportError as error:
    raise ImportError(
        "suslov_fast.integrability needs python-flint: pip install 'suslov_fast[algebra]'"
    ) from error

__all__ = ["QuadraticField", "darboux_polynomials", "degrees", "growth", "hk_bases", "kahan"]

Point = tuple[Fraction, ...]
Matrix = tuple[Point, ...]
Exponents = tuple[tuple[int, ...], ...]
Residues = list[list[int]]  # a matrix modulo a prime

_DRAWS = 8  # of primes with points or lines, of which two must agree
_MORE = 10  # equations more than unknowns
_PRIMES = 128  # enough for numerators and denominators of 1000 decimal digits


class Polynomials(tuple[Any, ...]):
    """A tuple of polynomials of python-flint in the variables x1, ..., xD."""

    __slots__ = ()

    def as_sympy(self, symbols: Sequence[Any] | None = None) -> list[Any]:
        """Return the polynomials as SymPy expressions in `symbols`, by default x1, ..., xD."""
        import sympy

        expressions = []
        for polynomial in self:
            names = polynomial.context().names()
            x = sympy.symbols(names) if symbols is None else symbols
            if len(x) != len(names):
                raise wrong("symbols", str(len(names)), len(x))
            terms = {e: sympy.Rational(str(a)) for e, a in polynomial.to_dict().items()}
            expressions.append(sympy.Poly(terms or 0, *x).as_expr())
        return expressions

    def __reduce__(self) -> Any:
        rings = [each.context() for each in self]
        terms = [each.to_dict() for each in self]
        return _restored, ([(type(a), a.names(), b) for a, b in zip(rings, terms, strict=True)],)

    def __repr__(self) -> str:
        return f"({', '.join(_shortened(str(each)) for each in self)})"


def _restored(pickled: list[Any]) -> Polynomials:
    return Polynomials(ring.get(names, "deglex").from_dict(terms) for ring, names, terms in pickled)


# --- Fields and maps ------------------------------------------------------------------------------


@dataclass(frozen=True, init=False, repr=False)
class QuadraticField:
    """A quadratic vector field, ``dx_i/dt = sum_jk q_ijk x_j x_k + sum_j l_ij x_j + c_i``.

    Parameters
    ----------
    quadratic : array_like(shape=(D, D, D))
        q, integers, fractions, or floats, which are taken exactly (0.1 is not 1/10: use
        ``Fraction(1, 10)``). It is made symmetric in j and k, which does not change the field.
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
        if n == 0 or q.shape != (n, n, n):
            raise wrong("quadratic", "the shape (D, D, D)", q.shape)
        q = (q + q.transpose(0, 2, 1)) / 2
        l = _array("linear", np.zeros((n, n), int) if linear is None else linear, (n, n))
        c = _array("constant", np.zeros(n, int) if constant is None else constant, (n,))
        object.__setattr__(self, "quadratic", tuple(tuple(map(tuple, each)) for each in q))
        object.__setattr__(self, "linear", tuple(map(tuple, l)))
        object.__setattr__(self, "constant", tuple(c))

    @classmethod
    def from_function(cls, f: Callable[[Point], Any], dimension: int) -> QuadraticField:
        """Return the field with components ``f(x)``, computed exactly for a tuple x of fractions.

        Raises TypeError or ValueError if they are not polynomials of degree 2 or less.

        Examples
        --------
        >>> from suslov_fast.integrability import QuadraticField
        >>> QuadraticField.from_function(lambda x: (x[1] * x[2], x[2] * x[0], x[0] * x[1]), 3)
        QuadraticField(x1' = x2*x3, x2' = x1*x3, x3' = x1*x2)
        """
        n = integer("dimension", dimension, 1)
        unit = _array("unit", np.eye(n, dtype=int))

        def at(x: Any) -> Any:
            return _array("the value of f", f(tuple(x)), (n,), exact=True)

        c = at(0 * unit[0])
        l = np.stack([at(e) - at(-e) for e in unit], axis=-1) / 2
        q = np.empty((n, n, n), object)
        for i, j in combinations_with_replacement(range(n), 2):
            q[:, i, j] = (at(unit[i] + unit[j]) - at(unit[i]) - at(unit[j]) + c) / 2
            q[:, j, i] = q[:, i, j]
        field = cls(q, l, c)
        x = [Fraction(k, 7) for k in random.Random(0).sample(range(100, 10_000), n)]
        if tuple(at(x)) != field(x):
            raise ValueError("f: expected polynomials of degree 2 or less, computed exactly")
        return field

    @classmethod
    def of(cls, body: Suslov3D | SuslovND | SuslovGyrostat) -> QuadraticField:
        """Return the equations of motion of a single body, its parameters taken exactly.

        The variables are Omega_1 and Omega_2, or Omega_1n, ..., Omega_(n-1)n. Raises TypeError or
        ValueError for anything else, or a batch of bodies.

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> from suslov_fast.integrability import QuadraticField
        >>> QuadraticField.of(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.25))
        QuadraticField(x1' = 1/8*x1*x2 + 1/16*x2^2, x2' = -1/2*x1^2 - 1/4*x1*x2)
        """
        instance("body", body, (Suslov3D, SuslovND, SuslovGyrostat))
        if body.shape != ():
            raise wrong("body", "a single body", f"a batch of shape {body.shape}")
        if isinstance(body, SuslovND):
            J, I = _array("J", body.J), _array("I", body.I)
        else:
            J, I = _array("J", (body.I1, body.I2)), _array("I", (body.I23, -body.I13))
        unit = np.eye(len(J), dtype=int)
        # J_i x_i' = sum_j I_j x_j x_i - I_i sum_j x_j x_j
        q = (np.multiply.outer(unit, I) - np.multiply.outer(I, unit)) / J[:, None, None]
        if not isinstance(body, SuslovGyrostat):
            return cls(q)
        k = _array("k", body.k, ()).item()
        return cls(q, [[0, -k / J[0]], [k / J[1], 0]])

    @property
    def dimension(self) -> int:
        """The number of variables."""
        return len(self.constant)

    @property
    def components(self) -> Polynomials:
        """The components of the field as polynomials, ``flint.fmpq_mpoly``."""
        return Polynomials(self._at(_ring(self.dimension, flint.fmpq_mpoly_ctx).gens(), _fmpq))

    def __call__(self, point: Any) -> Point:
        """Return the field at a point, exactly."""
        return tuple(self._at(_array("point", point, (self.dimension,)), Fraction))

    def _at(self, x: Sequence[Any], number: Callable[[Fraction], Any]) -> Iterator[Any]:
        for q, l, c in zip(self.quadratic, self.linear, self.constant, strict=True):
            value = number(c) + 0 * x[0]
            for row, b, y in zip(q, l, x, strict=True):
                value += y * (number(b) + sum(number(a) * z for a, z in zip(row, x, strict=True)))
            yield value

    def __repr__(self) -> str:
        equations = (f"x{i}' = {each}" for i, each in enumerate(self.components, start=1))
        return f"QuadraticField({_shortened(', '.join(equations))})"


@dataclass(frozen=True, repr=False)
class KahanMap:
    """The Kahan map of a quadratic field, exact; made by `kahan`.

    Called with a point, D rational numbers, it returns the next one, a tuple of fractions. Where a
    point has no image, at a pole, its methods raise `ZeroDivisionError`.
    """

    field: QuadraticField
    eps: Fraction

    @property
    def dimension(self) -> int:
        """The number of variables."""
        return self.field.dimension

    @property
    def inverse(self) -> KahanMap:
        """The inverse map, which is the Kahan map of the same field with -eps."""
        return KahanMap(self.field, -self.eps)

    def __call__(self, point: Any) -> Point:
        """Return the image of a point, exactly."""
        return tuple(map(_fraction, self._at(point, self._rational.image)))

    def jacobian(self, point: Any) -> Matrix:
        """Return the matrix of derivatives at a point, exactly, as a tuple of rows."""
        rows = self._at(point, self._rational.derivative).tolist()
        return tuple(tuple(map(_fraction, row)) for row in rows)

    def determinant(self, point: Any) -> Fraction:
        """Return the determinant of the matrix of derivatives at a point, exactly."""
        return _fraction(self._at(point, self._rational.derivative).det())

    def __repr__(self) -> str:
        return f"kahan({self.field}, eps={self.eps})"

    @cached_property
    def _rational(self) -> _Arithmetic:
        return _Arithmetic(self)

    def _at(self, point: Any, compute: Callable[[list[Any]], Any]) -> Any:
        x = _array("point", point, (self.dimension,))
        try:
            return compute([_fmpq(a) for a in x])
        except ZeroDivisionError:
            where = ", ".join(map(str, x))
            raise ZeroDivisionError(f"({where}) has no image: it is a pole of the map") from None


class _Arithmetic:
    """A map over the rationals, or modulo a prime p; divisions by 0 raise `ZeroDivisionError`.

    A step solves the linear equations A(x) x~ = b(x).
    """

    def __init__(self, map: KahanMap, p: int | None = None) -> None:
        self.dimension, self.p = map.dimension, p
        self.forward = self._forms(map.field, map.eps)
        self.backward = self._forms(map.field, -map.eps)

    def number(self, a: Any) -> Any:
        return _fmpq(a) if self.p is None else flint.nmod(_fmpq(a), self.p)

    def matrix(self, rows: Any) -> Any:
        return flint.fmpq_mat(rows) if self.p is None else flint.nmod_mat(rows, self.p)

    def _forms(self, field: QuadraticField, eps: Fraction) -> list[Any]:
        """Rows of (A | b): the nonzero coefficients of linear forms in x0 = 1, x1, ..., xD."""
        rows = []
        for i, c in enumerate(field.constant):
            q, half = field.quadratic[i], [eps / 2 * a for a in field.linear[i]]
            row = [[(i == j) - a, *(-eps * b for b in q[j])] for j, a in enumerate(half)]
            row.append([eps * c, *((i == j) + a for j, a in enumerate(half))])
            rows.append([[(k, self.number(a)) for k, a in enumerate(form) if a] for form in row])
        return rows

    def _equations(self, forms: list[Any], x: Sequence[Any]) -> tuple[Any, Any]:
        rows = _evaluate(forms, [self.number(1), *x])
        return self.matrix([row[:-1] for row in rows]), self.matrix([row[-1:] for row in rows])

    def image(self, x: Sequence[Any]) -> list[Any]:
        A, b = self._equations(self.forward, x)
        return list(A.solve(b).entries())

    def derivative(self, x: Sequence[Any]) -> Any:
        backward, _ = self._equations(self.backward, self.image(x))
        return self._equations(self.forward, x)[0].solve(backward)

    def orbit(self, x: Sequence[Any], length: int) -> Iterator[Sequence[Any]]:
        for _ in range(length):
            yield x
            x = self.image(x)

    def random_point(self, rng: random.Random) -> list[Any]:
        return [self.number(rng.randrange(self.p or 2**62)) for _ in range(self.dimension)]


def kahan(field: QuadraticField, eps: Any) -> KahanMap:
    """Return the Kahan map of a field, ``(x~ - x) / eps = q(x, x~) + l((x + x~) / 2) + c``.

    Parameters
    ----------
    field : QuadraticField
        The field to discretize.
    eps : int, Fraction or float
        Step size, of any sign; a float is taken exactly.

    Returns
    -------
    KahanMap
        It is callable, and has `inverse`, `jacobian`, `determinant`, `dimension`, `field`, `eps`.

    Raises
    ------
    TypeError, ValueError
        If `field` or `eps` is not as above, or no point has an image: 2 / eps is an eigenvalue of
        the derivative of the field everywhere.

    Examples
    --------
    >>> from suslov_fast.integrability import QuadraticField, kahan
    >>> map = kahan(QuadraticField([[[1]]]), eps=1)  # x' = x**2
    >>> [str(x) for x in map([2])], [str(x) for x in map.inverse([-2])]
    (['-2'], ['2'])
    """
    instance("field", field, QuadraticField)
    map = KahanMap(field, _array("eps", eps, ()).item())
    try:
        map._rational.image(map._rational.random_point(random.Random(0)))
    except ZeroDivisionError:
        message = f"eps: with {map.eps}, the equations of a step are singular everywhere"
        raise ValueError(message) from None
    return map


# --- Degrees --------------------------------------------------------------------------------------


def degrees(map: KahanMap, n: int, *, seed: int = 0, progress: Progress = None) -> list[int]:
    """Degrees of the first n iterates of a map, as maps of projective space.

    The degree is the largest of the numerators and the common denominator, after cancelling common
    factors. The images of a random line are computed modulo a prime, and those of another line
    modulo another prime. If their degrees differ, further lines are drawn until two agree.

    Parameters
    ----------
    map : KahanMap
        Made by `kahan`.
    n : int
        Number of iterates.
    seed : int, optional
        Seed of the random primes and lines.
    progress : bool or callable, optional
        True shows a bar (needs tqdm); a callable is called as ``progress(done, total)``.

    Returns
    -------
    list of int
        Degrees of the iterates 1, ..., n.

    Raises
    ------
    TypeError, ValueError, ArithmeticError
        If an argument is not as above; if every line runs into points without an image.

    Examples
    --------
    >>> from suslov_fast import Suslov3D
    >>> from suslov_fast.integrability import QuadraticField, degrees, kahan
    >>> degrees(kahan(QuadraticField.of(Suslov3D(4, 1, -0.5, -0.25)), 0.25), 8)
    [2, 4, 6, 8, 10, 12, 14, 16]
    """
    instance("map", map, KahanMap)
    n = integer("n", n, 0)
    check_progress(progress)
    rng = random.Random(seed)
    done = 0
    with reporter(progress, 2 * n) as report:

        def along_a_line(p: int) -> list[int]:
            nonlocal done
            found = []
            for degree in islice(_degrees_on_a_line(map, p, rng), n):
                found.append(degree)
                report(min(done + len(found), 2 * n))
            done = n
            return found

        return list(_confirmed(rng, along_a_line))


def _degrees_on_a_line(map: KahanMap, p: int, rng: random.Random) -> Iterator[int]:
    forms = _Arithmetic(map, p).forward
    line = [[rng.randrange(p), rng.randrange(p)] for _ in range(map.dimension)]
    x = [flint.nmod_poly(each, p) for each in ([1], *line)]
    while True:
        x = _cramer(_evaluate(forms, x))
        common = x[0]
        for each in x[1:]:
            common = common.gcd(each)
        x = [each // common for each in x]
        yield max(each.degree() for each in x)


def _cramer(system: list[list[Any]]) -> list[Any]:
    """Solve (A | b) over polynomials: det A, followed by the numerators of the solution over it.

    The elimination of Gauss, Jordan and Bareiss, whose divisions leave no remainder.
    """
    n = len(system)
    previous = 1
    for k in range(n):
        pivot = next((i for i in range(k, n) if system[i][k] != 0), None)
        if pivot is None:
            raise ZeroDivisionError
        system[k], system[pivot] = system[pivot], system[k]
        top = system[k]
        for row in system[:k] + system[k + 1 :]:
            for j in range(k + 1, n + 1):
                row[j] = (top[k] * row[j] - row[k] * top[j]) // previous
        previous = top[k]
    return [previous, *(row[n] for row in system)]


class Growth(NamedTuple):
    """Growth of a sequence of degrees, which `growth` returns."""

    kind: str  # "bounded", "linear", "quadratic", "exponential" or "unclear"
    entropy: float  # the log of the limit of d_(k+1) / d_k
    based_on: str  # the recurrence or the fit that kind and entropy follow from


def growth(degrees: Sequence[int]) -> Growth:
    """Classify the growth of a sequence of degrees.

    If all degrees obey a linear recurrence with integer coefficients, and are at least two more
    than those that determine it, then the result is that of its characteristic polynomial: exact,
    if the recurrence goes on. Otherwise it is a fit to the last half of the sequence.

    Parameters
    ----------
    degrees : sequence of int
        Degrees of consecutive iterates, as `degrees` returns them.

    Returns
    -------
    Growth
        A named tuple `kind, entropy, based_on`. Apart from the four kinds of `Growth`, kind may be
        "cubic", "polynomial of degree 4" and so on; it is "unclear", and the entropy NaN, if the
        sequence is too short to tell.

    Raises
    ------
    TypeError, ValueError
        If `degrees` is not a sequence of non-negative integers.

    Examples
    --------
    >>> from suslov_fast.integrability import growth
    >>> growth([2, 4, 6, 8, 10, 12])
    Growth(kind='linear', entropy=0.0, based_on='d(k+2) = 2 d(k+1) - 1 d(k), all 6 degrees')
    >>> kind, entropy, _ = growth([2, 3, 5, 8, 13, 21])
    >>> kind, round(entropy, 6)  # the log of the golden ratio
    ('exponential', 0.481212)
    """
    instance("degrees", degrees, Iterable)
    d = list(degrees)
    for each in d:
        instance("degrees", each, (int, np.integer))
        if each < 0:
            raise wrong("degrees", "integers of at least 0", each)
    d = [int(each) for each in d]
    half = len(d) // 2
    power, rate = 0.0, 0.0
    if recurrence := _recurrence(d):
        *c, _ = recurrence.coeffs()
        terms = [f"{-a} d(k+{i})" for i, a in reversed([*enumerate(c)]) if a]
        what = f"d(k+{len(c)}) = {' + '.join(terms) or 0}, all {len(d)} degrees"
        what = what.replace("+ -", "- ").replace("k+0", "k")
        for factor, multiplicity in recurrence.factor()[1]:
            if factor.is_cyclotomic():
                power = max(power, multiplicity - 1)
            else:
                sizes = [abs(complex(root)) for root, _ in factor.complex_roots()]
                rate = max(rate, math.log(max(1.0, *sizes)))
    elif len(d) < 6 or min(d) == 0:
        return Growth("unclear", math.nan, f"{len(d)} degrees without a short recurrence")
    else:
        what = f"a fit to the last {len(d) - half} of {len(d)} degrees, without a short recurrence"
        if max(d[half:]) > max(d[:half]):
            k, logs = np.arange(half + 1, len(d) + 1), np.log(d[half:])
            (power, _), [of_power], *_ = np.polyfit(np.log(k), logs, 1, full=True)
            (slope, _), [of_rate], *_ = np.polyfit(k, logs, 1, full=True)
            power, rate = max(round(power), 1), float(slope) if of_rate < of_power else 0.0
    if rate > 0:
        return Growth("exponential", rate, what)
    kinds = dict(enumerate(("bounded", "linear", "quadratic", "cubic")))
    return Growth(kinds.get(power, f"polynomial of degree {power}"), 0.0, what)


def _recurrence(d: list[int]) -> Any:
    """Characteristic polynomial of the shortest recurrence; None if none is certain."""
    for order in range(len(d) // 2):
        hankel = flint.fmpz_mat([d[i : i + order + 1] for i in range(len(d) - order)])
        reduced, rank = flint.fmpq_mat(hankel).rref()
        coefficients = [-reduced[i, order] for i in range(order)]
        # Every infinite sequence of integers with a recurrence has one of integers.
        if rank <= order and all(a.q == 1 for a in coefficients):
            c = flint.fmpz_poly([*(a.p for a in coefficients), 1])
            if not any((hankel * flint.fmpz_mat(order + 1, 1, c.coeffs())).entries()):
                return c
    return None


# --- Hirota-Kimura bases --------------------------------------------------------------------------


@dataclass(frozen=True, repr=False)
class HKBasis:
    """Linear relations between `monomials` along orbits, which `hk_bases` returns.

    The rows of `basis`, `dimension` of them, are coefficients of relations along the orbit of
    `point`: the last nonzero entry of a row is 1, and 0 in the others. They are None if they are
    too long to reconstruct. On random orbits `independent` of the coefficients are independent
    first integrals. So are quotients of the polynomials `integrals`, which the fewest monomials
    give: with more there are none, as the relations of one orbit have multiples.
    """

    monomials: Exponents
    dimension: int
    independent: int
    integrals: Polynomials
    point: Point
    basis: Matrix | None

    @property
    def polynomials(self) -> Polynomials:
        """Polynomials that vanish on the orbit of `point`, with the same span as the relations."""
        return _polynomials(self.basis, self.monomials)

    def as_sympy(self, symbols: Sequence[Any] | None = None) -> list[Any]:
        """Return `polynomials` as SymPy expressions."""
        return self.polynomials.as_sympy(symbols)

    def __repr__(self) -> str:
        return (
            f"<HKBasis of dimension {self.dimension} among {len(self.monomials)} monomials, "
            f"independent={self.independent}, integrals={self.integrals}>"
        )


def hk_bases(
    map: KahanMap, monomials: int | Sequence[Sequence[int]], *, point: Any = None, seed: int = 0
) -> HKBasis:
    """Find the linear relations between monomials that hold along orbits (arXiv:1008.1040).

    An orbit has 10 points more than there are monomials, and is made longer until the number of
    relations remains the same. The coefficients of a relation in the form of `HKBasis.basis` are
    functions of the orbit, that is, first integrals; the rank of their derivatives tells how many
    are independent. If the relations of all orbits together span one dimension more than those of
    one orbit, then values of these polynomials at two points of an orbit are proportional, and
    their quotients are first integrals.

    Parameters
    ----------
    map : KahanMap
        Made by `kahan`.
    monomials : int or sequence of exponents
        All monomials up to a degree, 1 included, or the exponents (e1, ..., eD) of each.
    point : sequence of D rational numbers, optional
        Point whose orbit `basis` and `dimension` belong to; by default one with small integers
        whose orbit has as many relations as a random one.
    seed : int, optional
        Seed of the random primes and points.

    Returns
    -------
    HKBasis
        If its `dimension` is 0, no quotient of two linear combinations of the monomials is a first
        integral.

    Raises
    ------
    TypeError, ValueError, ArithmeticError
        If an argument is not as above; if the orbit of `point`, or of most points, ends at a pole.

    Examples
    --------
    >>> from suslov_fast import Suslov3D
    >>> from suslov_fast.integrability import QuadraticField, hk_bases, kahan
    >>> map = kahan(QuadraticField.of(Suslov3D(4, 1, -0.5, -0.25)), eps=0.25)
    >>> hk_bases(map, 1).dimension, hk_bases(map, 2).dimension
    (0, 1)
    >>> hk_bases(map, 2).integrals
    (4*x1^2 + x2^2, x1*x2 + 1024)
    """
    instance("map", map, KahanMap)
    exponents, rng = _exponents(monomials, map.dimension), random.Random(seed)

    def relations(p: int, point: Any = None) -> Residues:
        modular = _Arithmetic(map, p)
        x = modular.random_point(rng) if point is None else [modular.number(a) for a in point]
        return _relations(modular, exponents, x)

    def ordinary_point() -> Any:
        p = _prime(rng)
        for _ in range(_DRAWS):
            x = _array("point", rng.choices(range(-9, 10), k=map.dimension))
            with contextlib.suppress(ZeroDivisionError):
                if len(relations(p, x)) == dimension:
                    return x
        raise ArithmeticError("the orbits of small integers are exceptional: pass `point`")

    def span(p: int) -> Residues:
        rows = [row for _ in range(3) for row in relations(p)]
        reduced, rank = flint.nmod_mat(rows, p).rref()
        return _integers(reduced)[:rank] if rank == dimension + 1 else []

    start = None if point is None else _array("point", point, (map.dimension,))
    dimension = of_point = _confirmed(rng, lambda p: len(relations(p)))
    basis: Matrix | None = ()
    if start is None:
        start = ordinary_point()
    if dimension > 0 or point is not None:
        basis = _over_rationals(rng, lambda p: relations(p, start))
        of_point = dimension if basis is None else len(basis)
    independent, integrals = 0, Polynomials()
    if dimension > 0:
        independent = _confirmed(rng, lambda p: _independent(_Arithmetic(map, p), exponents, rng))
        integrals = _polynomials(_over_rationals(rng, span), exponents)
    return HKBasis(exponents, of_point, independent, integrals, tuple(start), basis)


def _relations(modular: _Arithmetic, exponents: Exponents, x: Sequence[Any]) -> Residues:
    """Relations along the orbit of a point, in the form of `HKBasis.basis`."""
    steps, before = len(exponents) + _MORE, None
    while True:
        rows = [list(_values(exponents, y)) for y in modular.orbit(x, steps)]
        relations = _null_space(rows, modular.p)
        if len(relations) in (0, before):
            return relations
        before, steps = len(relations), 2 * steps


def _independent(modular: _Arithmetic, exponents: Exponents, rng: random.Random) -> int:
    """Rank of the derivatives of the coefficients of the relations with respect to the orbit.

    For each k, ``sum_i c_i m_i(x_k) = 0`` is differentiated with respect to x_0.
    """
    n, x = modular.dimension, modular.random_point(rng)
    relations = _relations(modular, exponents, x)
    ring = _ring(n, flint.nmod_mpoly_ctx, modulus=modular.p)
    polynomials = [ring.from_dict(dict(zip(exponents, c, strict=True))) for c in relations]
    gradients = [[each.derivative(i) for i in range(n)] for each in polynomials]
    derivative = modular.matrix(np.eye(n, dtype=int).tolist())  # of x_k
    rows = []
    for y in modular.orbit(x, len(exponents) + _MORE):
        changes = modular.matrix([[each(*y) for each in row] for row in gradients]) * derivative
        rows.append([*_values(exponents, y), *changes.entries()])
        derivative = modular.derivative(y) * derivative
    reduced = modular.matrix(rows).rref()[0].tolist()[: len(exponents) - len(relations)]
    starts = range(len(exponents), len(rows[0]), n)
    return int(modular.matrix([row[k : k + n] for row in reduced for k in starts]).rank())


# --- Darboux polynomials --------------------------------------------------------------------------


def darboux_polynomials(
    map: KahanMap, degree: int, cofactor: Any = None, *, seed: int = 0
) -> Polynomials:
    """Find the polynomials P with P(map(x)) = C(x) P(x) (arXiv:1902.04715).

    For the default cofactor 1 / P is the density of an invariant measure. For any cofactor the
    quotients of two such polynomials are first integrals. The equations for the coefficients are
    those of random integer points, 10 more than there are monomials, solved modulo primes; fresh
    points confirm the result over the rationals.

    Parameters
    ----------
    map : KahanMap
        Made by `kahan`.
    degree : int
        Largest degree of P.
    cofactor : number or callable, optional
        C: a rational number, or a function that takes a point, a tuple of fractions, and returns
        a rational number, exactly. By default it is ``map.determinant``.
    seed : int, optional
        Seed of the random primes and points.

    Returns
    -------
    Polynomials
        A basis of these polynomials: a tuple of ``flint.fmpz_mpoly`` in x1, ..., xD, whose
        coefficients have no common factor. `as_sympy()` converts them.

    Raises
    ------
    TypeError, ValueError, ArithmeticError
        If an argument, or what `cofactor` returns, is not as above; if the coefficients have more
        than 1000 digits, or the map or the cofactor is undefined at most points.

    Examples
    --------
    >>> from suslov_fast import Suslov3D
    >>> from suslov_fast.integrability import QuadraticField, darboux_polynomials, kahan
    >>> map = kahan(QuadraticField.of(Suslov3D(4, 1, -0.5, -0.25)), eps=0.25)
    >>> for P in darboux_polynomials(map, 3):
    ...     print(P.factor())
    (1, [(2*x1 + x2, 1), (4*x1^2 + x2^2, 1)])
    (1, [(2*x1 + x2, 1), (x1*x2 + 1024, 1)])
    """
    instance("map", map, KahanMap)
    exponents = _exponents(integer("degree", degree, 0), map.dimension)
    C = map.determinant if cofactor is None else cofactor
    if not callable(C):
        constant = _array("cofactor", cofactor, ()).item()
        C = lambda x: constant  # noqa: E731
    rng = random.Random(seed)

    def samples(count: int) -> list[tuple[Point, Point, Fraction]]:
        found = []
        for _ in range(2 * count):
            x = tuple(Fraction(rng.randrange(-(2**30), 2**30)) for _ in range(map.dimension))
            with contextlib.suppress(ZeroDivisionError):  # at poles
                found.append((x, map(x), _array("cofactor", C(x), (), exact=True).item()))
            if len(found) == count:
                return found
        raise ArithmeticError("the map or the cofactor is undefined at most points")

    equations = samples(len(exponents) + _MORE)

    def solutions(p: int) -> Residues:
        number = _Arithmetic(map, p).number
        rows = []
        for x, image, c in equations:
            before, after = (_values(exponents, [number(a) for a in y]) for y in (x, image))
            rows.append(list(after - number(c) * before))
        return _null_space(rows, p)

    basis = _over_rationals(rng, solutions)
    if basis is None:
        raise ArithmeticError("the coefficients have more than 1000 digits")
    for x, image, c in samples(3):
        defect = _values(exponents, image) - c * _values(exponents, x)
        if any(np.array(row) @ defect for row in basis):
            raise ArithmeticError("the polynomials fail at fresh points")
    return _polynomials(basis, exponents)


# --- Modulo primes, and back to the rationals -----------------------------------------------------


def _prime(rng: random.Random) -> int:
    while True:
        p = rng.getrandbits(62) | 2**61 | 1
        if flint.fmpz(p).is_prime():
            return p


def _confirmed(rng: random.Random, compute: Callable[[int], Any]) -> Any:
    """The first result on which two primes agree, with points or lines of their own."""
    found: list[Any] = []
    for _ in range(_DRAWS):
        with contextlib.suppress(ZeroDivisionError):
            found.append(compute(_prime(rng)))
            if found.count(found[-1]) > 1:
                return found[-1]
    if not found:
        raise ArithmeticError("the iterates run into points without an image")
    raise ArithmeticError(f"results modulo primes do not agree: {found}")


def _over_rationals(rng: random.Random, matrix: Callable[[int], Residues]) -> Matrix | None:
    """The rational matrix with these residues modulo primes; None if its entries are too long."""
    height = _confirmed(rng, lambda p: len(matrix(p)))
    if height == 0:
        return ()
    modulus, used = 1, 0
    residues: list[int] = []
    candidate: list[Fraction] = []
    for _ in range(_PRIMES):
        p = _prime(rng)
        with contextlib.suppress(ZeroDivisionError):
            rows = matrix(p)
            if len(rows) != height:
                continue
            new = [a for row in rows for a in row]
            if candidate and [int(flint.nmod(_fmpq(a), p)) for a in candidate] == new:
                width = len(rows[0])
                return tuple(tuple(candidate[i : i + width]) for i in range(0, len(new), width))
            old, inverse = residues or [0] * len(new), pow(modulus, -1, p)
            residues = [
                r + modulus * ((a - r) * inverse % p) for r, a in zip(old, new, strict=True)
            ]
            modulus, used = modulus * p, used + 1
            if used & (used - 1) == 0:  # a power of two
                candidate = [_reconstructed(r, modulus) for r in residues]
    return None


def _reconstructed(residue: int, modulus: int) -> Fraction:
    """The simplest fraction with this residue: the shortest (a, b) with a = residue * b."""
    shortest = flint.fmpz_mat([[modulus, 0], [residue, 1]]).lll()
    return Fraction(int(shortest[0, 0]), int(shortest[0, 1]))


def _null_space(rows: Any, p: Any) -> Residues:
    """Basis of the null space: the last nonzero entry of a vector is 1, and 0 in the others."""
    columns, dimension = flint.nmod_mat(rows, p).nullspace()
    return _integers(columns.transpose())[:dimension]


def _integers(matrix: Any) -> Residues:
    return [[int(a) for a in row] for row in matrix.tolist()]


# --- Linear forms, monomials, numbers -------------------------------------------------------------


def _evaluate(forms: Any, x: Sequence[Any]) -> list[list[Any]]:
    zero = x[0] - x[0]
    return [[sum((a * x[k] for k, a in form), zero) for form in row] for row in forms]


def _values(exponents: Exponents, x: Sequence[Any]) -> Any:
    """The monomials at a point, whose coordinates may be of any type of numbers."""
    values = np.ones(len(exponents), object)
    for a, e in zip(x, np.array(exponents).T, strict=True):
        values *= np.array([a**k for k in range(int(e.max()) + 1)], object)[e]
    return values


def _exponents(monomials: Any, n: int) -> Exponents:
    """The exponents of monomials in n variables, those up to a degree in ascending order."""
    if isinstance(monomials, int | np.integer):
        return tuple(
            tuple(chosen.count(i) for i in range(n))
            for degree in range(integer("monomials", monomials, 0) + 1)
            for chosen in combinations_with_replacement(range(n), degree)
        )
    try:
        exponents = tuple(tuple(integer("monomials", e, 0) for e in each) for each in monomials)
    except TypeError:
        raise wrong("monomials", "a degree or a list of exponents", monomials, TypeError) from None
    for each in exponents:
        if len(each) != n:
            raise wrong("monomials", f"{n} exponents for each monomial", each)
    if not exponents or len({*exponents}) < len(exponents):
        raise wrong("monomials", "at least one monomial, and none twice", monomials)
    return exponents


def _ring(n: int, context: Any, **modulus: Any) -> Any:
    return context.get([f"x{i}" for i in range(1, n + 1)], ordering="deglex", **modulus)


def _polynomials(rows: Matrix | None, exponents: Exponents) -> Polynomials:
    """Polynomials with the same span, whose integer coefficients are short and coprime."""
    if not rows:
        return Polynomials()
    integers = []
    for row in rows:
        numerators = flint.fmpq_mat([[_fmpq(a) for a in row]]).numer_denom()[0].entries()
        divisor = math.gcd(*(int(a) for a in numerators))
        integers.append([a // divisor for a in numerators])
    ring = _ring(len(exponents[0]), flint.fmpz_mpoly_ctx)
    polynomials = []
    for short in flint.fmpz_mat(integers).lll().tolist():
        P = ring.from_dict(dict(zip(exponents, short, strict=True))).primitive()[1]
        polynomials.append(-P if P.leading_coefficient() < 0 else P)
    return Polynomials(polynomials)


def _array(name: str, value: Any, shape: Any = None, exact: bool = False) -> Any:
    """Array of fractions; floats are refused if `exact`."""
    if hasattr(value, "unit") or hasattr(value, "units"):
        raise wrong(name, "numbers without units", type(value).__name__, TypeError)
    array = np.array(value, dtype=object)
    if shape is not None and array.shape != shape:
        raise wrong(name, f"the shape {shape}", array.shape)
    for index, each in np.ndenumerate(array):
        number = each.item() if isinstance(each, np.generic) else each
        if not isinstance(number, Rational if exact else Rational | float):
            expected = "integers or fractions" if exact else "integers, fractions or floats"
            raise wrong(name, expected, type(each).__name__, TypeError)
        if isinstance(number, float) and not math.isfinite(number):
            raise wrong(name, "finite numbers", number)
        a = Fraction(number)
        array[index] = Fraction(int(a.numerator), int(a.denominator))  # of Python's own integers
    return array


def _fmpq(a: Any) -> Any:
    return flint.fmpq(a.numerator, a.denominator)


def _fraction(a: Any) -> Fraction:
    return Fraction(int(a.p), int(a.q))


def _shortened(text: str) -> str:
    return textwrap.shorten(text, 300, placeholder=" ...")
