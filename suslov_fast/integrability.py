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

All arithmetic is exact, over the rationals or modulo primes of 62 bits, with points and lines from
a seeded generator, so that results are reproducible. What is found modulo one prime is confirmed
modulo another; the probability of an error is of the order of the number of operations over 2**62.
The module needs python-flint: ``pip install 'suslov_fast[algebra]'``.
"""

from __future__ import annotations

import contextlib
import math
import random
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import combinations_with_replacement, islice, pairwise
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
Matrix = tuple[Point, ...]
Exponents = tuple[tuple[int, ...], ...]
Residues = list[list[int]]  # a matrix modulo a prime

_DRAWS = 8  # of lines, points or primes, of which two must agree
_MORE = 10  # equations more than unknowns
_PRIMES = 128  # enough for numerators and denominators of 1000 decimal digits


class _BadDrawError(ArithmeticError):
    """A line, a point or a prime for which the computation does not go through."""


class Polynomials(tuple[Any, ...]):
    """A tuple of polynomials of python-flint, in the variables x1, ..., xD."""

    __slots__ = ()

    def as_sympy(self, symbols: Sequence[Any] | None = None) -> list[Any]:
        """Return the polynomials as SymPy expressions in `symbols`, by default x1, ..., xD."""
        import sympy

        expressions = []
        for polynomial in self:
            names = polynomial.context().names()
            x = sympy.symbols(names) if symbols is None else symbols
            if len(x) != len(names):
                raise ValueError(f"symbols: expected {len(names)}, got {len(x)}")
            terms = [
                sympy.Mul(sympy.Rational(str(a)), *(v**e for v, e in zip(x, each, strict=True)))
                for each, a in polynomial.to_dict().items()
            ]
            expressions.append(sympy.Add(*terms))
        return expressions

    def __repr__(self) -> str:
        return f"({', '.join(_shortened(str(each)) for each in self)})"


# --- Fields and maps ------------------------------------------------------------------------------


@dataclass(frozen=True, init=False, repr=False)
class QuadraticField:
    """A quadratic vector field with rational coefficients.

    ``dx_i/dt = sum_jk q_ijk x_j x_k + sum_j l_ij x_j + c_i``

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
            raise ValueError(f"quadratic: expected the shape (D, D, D), got {q.shape}")
        q = (q + q.transpose(0, 2, 1)) / 2
        l = _array("linear", np.zeros((n, n), int) if linear is None else linear, (n, n))
        c = _array("constant", np.zeros(n, int) if constant is None else constant, (n,))
        object.__setattr__(self, "quadratic", tuple(tuple(map(tuple, each)) for each in q))
        object.__setattr__(self, "linear", tuple(map(tuple, l)))
        object.__setattr__(self, "constant", tuple(c))

    @classmethod
    def from_function(cls, f: Callable[[Point], Any], dimension: int) -> QuadraticField:
        """Return the field that a function computes.

        Parameters
        ----------
        f : callable
            It takes a point, a tuple of fractions, and returns the `dimension` components of the
            field there, exactly.
        dimension : int
            Number of variables.

        Returns
        -------
        QuadraticField

        Raises
        ------
        TypeError, ValueError
            If `f` returns anything else, or is no polynomial of degree 2 at most.

        Examples
        --------
        >>> from suslov_fast.integrability import QuadraticField
        >>> QuadraticField.from_function(lambda x: (x[1] * x[2], x[2] * x[0], x[0] * x[1]), 3)
        QuadraticField(x1' = x2*x3, x2' = x1*x3, x3' = x1*x2)
        """
        n = _count("dimension", dimension, least=1)
        unit = _array("unit", np.eye(n, dtype=int))

        def at(x: Any) -> Any:
            return _array("the value of f", f(tuple(x)), (n,), (Rational,))

        c = at(0 * unit[0])
        l = np.stack([at(e) - at(-e) for e in unit], axis=-1) / 2
        q = np.empty((n, n, n), object)
        for i, j in combinations_with_replacement(range(n), 2):
            mixed = at(unit[i] + unit[j]) - at(unit[i]) - at(unit[j]) + c
            q[:, i, j] = q[:, j, i] = mixed / 2
        field = cls(q, l, c)
        x = [Fraction(k, 7) for k in random.Random(0).sample(range(100, 10_000), n)]
        if tuple(at(x)) != field(x):
            raise ValueError("f: expected polynomials of degree 2 at most, computed exactly")
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
            In Omega_1 and Omega_2, or in Omega_1n, ..., Omega_(n-1)n.

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
            J, I = _array("J", body.J), _array("I", body.I)
            return cls.from_function(lambda x: _suslov_nd(J, I, np.array(x)), len(J))
        rotor = getattr(body, "k", 0)
        parameters = _array("body", [body.I1, body.I2, body.I13, body.I23, rotor])
        return cls.from_function(lambda x: _suslov_3d(*parameters, *x), 2)

    @property
    def dimension(self) -> int:
        """The number of variables."""
        return len(self.constant)

    @property
    def components(self) -> Polynomials:
        """The components of the field as polynomials, ``flint.fmpq_mpoly``."""
        unit = np.eye(self.dimension, dtype=int)
        ring = _ring(self.dimension, flint.fmpq_mpoly_ctx)
        components = []
        for q, l, c in zip(self.quadratic, self.linear, self.constant, strict=True):
            terms = {(0,) * self.dimension: c}
            for i, e in enumerate(unit):
                terms[tuple(e.tolist())] = l[i]
                for j, d in enumerate(unit[: i + 1]):
                    terms[tuple((e + d).tolist())] = q[i][j] * (1 if i == j else 2)
            fractions = {e: flint.fmpq(a.numerator, a.denominator) for e, a in terms.items()}
            components.append(ring.from_dict(fractions))
        return Polynomials(components)

    def __call__(self, point: Any) -> Point:
        """Return the field at a point, exactly."""
        x = _array("point", point, (self.dimension,))
        return tuple(np.array(self.quadratic) @ x @ x + np.array(self.linear) @ x + self.constant)

    def __repr__(self) -> str:
        equations = (f"x{i}' = {each}" for i, each in enumerate(self.components, start=1))
        return f"QuadraticField({_shortened(', '.join(equations))})"


def _suslov_3d(I1: Any, I2: Any, I13: Any, I23: Any, k: Any, omega1: Any, omega2: Any) -> Any:
    momentum = I13 * omega1 + I23 * omega2 + k
    return -momentum * omega2 / I1, momentum * omega1 / I2


def _suslov_nd(J: Any, I: Any, omega: Any) -> Any:
    return (np.dot(I, omega) * omega - I * np.dot(omega, omega)) / J


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

    @cached_property
    def inverse(self) -> KahanMap:
        """The inverse map, which is the Kahan map of the same field with -eps."""
        return kahan(self.field, -self.eps)

    def __call__(self, point: Any) -> Point:
        """Return the image of a point, exactly."""
        A, b = self._equations(point)
        return tuple(a for (a,) in self._solve(A, b, point))

    def jacobian(self, point: Any) -> Matrix:
        """Return the matrix of derivatives at a point, exactly, as a tuple of rows."""
        backward, _ = self.inverse._equations(self(point))
        return self._solve(self._equations(point)[0], backward, point)

    def determinant(self, point: Any) -> Fraction:
        """Return the determinant of the matrix of derivatives at a point, exactly."""
        backward, _ = self.inverse._equations(self(point))
        return _fraction(backward.det() / self._equations(point)[0].det())

    def __repr__(self) -> str:
        return f"kahan({self.field}, eps={self.eps})"

    @cached_property
    def _forms(self) -> list[list[list[tuple[int, Fraction]]]]:
        """The equations A(x) x~ = b(x) of a step, as rows of (A | b).

        Each entry is a linear form in x0 = 1, x1, ..., xD: its nonzero coefficients, by index.
        """
        n, half = self.dimension, self.eps / 2
        rows = []
        for i in range(n):
            q, l, c = self.field.quadratic[i], self.field.linear[i], self.field.constant[i]
            row = [[(i == j) - half * l[j], *(-self.eps * a for a in q[j])] for j in range(n)]
            rows.append([*row, [self.eps * c, *((i == j) + half * l[j] for j in range(n))]])
        return [[[(k, a) for k, a in enumerate(form) if a] for form in row] for row in rows]

    def _modulo(self, p: int) -> list[list[list[tuple[int, int]]]]:
        return [[[(k, _residue(a, p)) for k, a in form] for form in row] for row in self._forms]

    def _equations(self, point: Any) -> tuple[Any, Any]:
        """A and b at a point."""
        x = _array("point", point, (self.dimension,))
        system = _evaluate(self._forms, [Fraction(1), *x])
        A, b = ([row[:-1] for row in system], [row[-1:] for row in system])
        return _rational_matrix(A), _rational_matrix(b)

    def _solve(self, A: Any, b: Any, point: Any) -> Matrix:
        try:
            return tuple(tuple(map(_fraction, row)) for row in A.solve(b).tolist())
        except ZeroDivisionError:
            where = ", ".join(map(str, point))
            raise ZeroDivisionError(f"({where}) has no image: it is a pole of the map") from None


def kahan(field: QuadraticField, eps: Any) -> KahanMap:
    """Return the Kahan map of a field.

    Parameters
    ----------
    field : QuadraticField
        The field to discretize.
    eps : int, Fraction or float
        Step size, of any sign; a float is taken exactly.

    Returns
    -------
    KahanMap
        The x~ of ``(x~ - x) / eps = q(x, x~) + l((x + x~) / 2) + c`` as a function of x. It is
        callable, and has `inverse`, `jacobian`, `determinant`, `dimension`, `field` and `eps`.

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
    if not isinstance(field, QuadraticField):
        raise TypeError(
            f"field: expected a QuadraticField, got {type(field).__name__}; "
            "QuadraticField.of(body) is that of a body"
        )
    map = KahanMap(field, _array("eps", eps, ()).item())
    rng = random.Random(0)
    for p in islice(_primes(map), 2):
        x = [1, *(rng.randrange(p) for _ in range(field.dimension))]
        A = [row[:-1] for row in _evaluate(map._modulo(p), x)]
        if flint.nmod_mat(A, p).det() != 0:
            return map
    raise ValueError(f"eps: with {map.eps}, the equations of a step are singular everywhere")


# --- Degrees --------------------------------------------------------------------------------------


def degrees(map: KahanMap, n: int, *, seed: int = 0, progress: Progress = None) -> list[int]:
    """Degrees of the iterates of a map.

    Parameters
    ----------
    map : KahanMap
        The map to iterate.
    n : int
        Number of iterates.
    seed : int, optional
        Seed of the random lines.
    progress : bool or callable, optional
        True shows a bar (needs tqdm); a callable is called as ``progress(done, total)``.

    Returns
    -------
    list of int
        Degrees of the iterates 1, ..., n as maps of projective space: the largest degree of the
        numerators and the common denominator, after cancelling common factors.

    Raises
    ------
    TypeError, ValueError
        If an argument is not as above.
    ArithmeticError
        If no two lines agree, or every line runs into points without an image.

    Notes
    -----
    The image of a random line is iterated modulo a prime, and so is another line modulo another
    prime. Should they disagree, further ones are drawn until two agree.
    The time for an iterate grows a little faster than its degree.

    Examples
    --------
    >>> from suslov_fast import Suslov3D
    >>> from suslov_fast.integrability import QuadraticField, degrees, kahan
    >>> degrees(kahan(QuadraticField.of(Suslov3D(4, 1, -0.5, -0.25)), 0.25), 8)
    [2, 4, 6, 8, 10, 12, 14, 16]
    """
    _check_map(map)
    n = _count("n", n)
    check_progress(progress)
    rng = random.Random(seed)
    found: list[int] = []
    with reporter(progress, 2 * n) as report:

        def on_a_line(p: int) -> list[int]:
            nonlocal found
            done = n if found else 0
            for found in _degrees_on_a_line(map, n, p, rng):
                report(done + len(found))
            return found

        return list(_confirmed(map, on_a_line))


def _degrees_on_a_line(map: KahanMap, n: int, p: int, rng: random.Random) -> Iterator[list[int]]:
    forms = map._modulo(p)
    line = [[rng.randrange(p), rng.randrange(p)] for _ in range(map.dimension)]
    x = [flint.nmod_poly(each, p) for each in ([1], *line)]
    degrees = []
    for _ in range(n):
        x = _cramer(_evaluate(forms, x))
        common = x[0]
        for each in x[1:]:
            common = common.gcd(each)
        x = [each // common for each in x]
        degrees.append(max(each.degree() for each in x))
        yield degrees


def _cramer(system: list[list[Any]]) -> list[Any]:
    """Solve (A | b) over polynomials: det A, followed by the numerators of the solution over it.

    The elimination of Gauss, Jordan and Bareiss, whose divisions leave no remainder.
    """
    n = len(system)
    previous = 1
    for k in range(n):
        pivot = next((i for i in range(k, n) if system[i][k] != 0), None)
        if pivot is None:
            raise _BadDrawError
        system[k], system[pivot] = system[pivot], system[k]
        top = system[k]
        for row in system[:k] + system[k + 1 :]:
            for j in range(k + 1, n + 1):
                row[j] = (top[k] * row[j] - row[k] * top[j]) // previous
        previous = top[k]
    return [previous, *(row[n] for row in system)]


class Growth(NamedTuple):
    """Growth of a sequence of degrees, which `growth` returns."""

    kind: str
    """"bounded", "linear", "quadratic", "exponential" or "unclear"."""
    entropy: float
    """Algebraic entropy, the log of the limit of d_(k+1) / d_k."""
    based_on: str
    """The recurrence or the fit that kind and entropy follow from."""


def growth(degrees: Sequence[int]) -> Growth:
    """Classify the growth of a sequence of degrees.

    Parameters
    ----------
    degrees : sequence of int
        Degrees of consecutive iterates, as `degrees` returns them.

    Returns
    -------
    Growth
        A named tuple `kind, entropy, based_on`. Apart from the four kinds of `Growth`, kind
        may be "cubic", "polynomial of degree 4" and so on; it is "unclear", and the entropy NaN,
        if the sequence is too short to tell.

    Raises
    ------
    TypeError, ValueError
        If `degrees` is not a sequence of non-negative integers.

    Notes
    -----
    If all degrees obey a linear recurrence with integer coefficients, and are at least two more
    than those that determine it, then kind and entropy are those of its characteristic polynomial:
    exact, if the recurrence goes on. Otherwise they are a fit to the last half of the sequence.

    Examples
    --------
    >>> from suslov_fast.integrability import growth
    >>> growth([2, 4, 6, 8, 10, 12])
    Growth(kind='linear', entropy=0.0, based_on='d(k+2) = 2 d(k+1) - d(k), all 6 degrees')
    >>> kind, entropy, _ = growth([2, 3, 5, 8, 13, 21])
    >>> kind, round(entropy, 6)  # the log of the golden ratio
    ('exponential', 0.481212)
    """
    if not isinstance(degrees, Iterable):
        raise TypeError(f"degrees: expected a sequence of integers, got {type(degrees).__name__}")
    d = [_count("degrees", each) for each in degrees]
    recurrence = _recurrence(d)
    if recurrence:
        return _growth_of(recurrence, len(d))
    if len(d) < 6 or min(d) == 0:
        return Growth("unclear", math.nan, f"{len(d)} degrees without a short recurrence")
    half = len(d) // 2
    what = f"a fit to the last {len(d) - half} of {len(d)} degrees, without a short recurrence"
    if max(d[half:]) <= max(d[:half]):
        return Growth("bounded", 0.0, what)
    k, logs = np.arange(half + 1, len(d) + 1), np.log(d[half:])
    (power, _), [of_power], *_ = np.polyfit(np.log(k), logs, 1, full=True)
    (rate, _), [of_rate], *_ = np.polyfit(k, logs, 1, full=True)
    if of_rate < of_power:
        return Growth("exponential", float(rate), what)
    return Growth(_power_law(max(round(power), 1)), 0.0, what)


def _recurrence(d: list[int]) -> list[int]:
    """Characteristic polynomial of the shortest recurrence, ascending; [] if none is certain."""
    for order in range(len(d) // 2):
        hankel = flint.fmpz_mat([d[i : i + order + 1] for i in range(len(d) - order)])
        reduced, rank = flint.fmpq_mat(hankel).rref()
        if rank <= order:
            coefficients = [-reduced[i, order] for i in range(order)]
            if all(a.q == 1 for a in coefficients):  # as for every infinite sequence of integers
                return [*(int(a.p) for a in coefficients), 1]
    return []


def _growth_of(recurrence: list[int], n: int) -> Growth:
    order = len(recurrence) - 1
    right = ""
    for k in range(order - 1, -1, -1):
        if a := -recurrence[k]:
            factor = "" if abs(a) == 1 else f"{abs(a)} "
            right += f" {'-' if a < 0 else '+'} {factor}d(k{f'+{k}' if k else ''})"
    what = f"d(k+{order}) = {right.removeprefix(' + ').strip() or 0}, all {n} degrees"
    exponent, radius = 0, 1.0
    for factor, multiplicity in flint.fmpz_poly(recurrence).factor()[1]:
        if factor.is_cyclotomic():
            exponent = max(exponent, multiplicity - 1)
        elif factor != flint.fmpz_poly([0, 1]):
            radius = max(radius, *(abs(complex(root)) for root, _ in factor.complex_roots()))
    if radius > 1:
        return Growth("exponential", math.log(radius), what)
    return Growth(_power_law(exponent), 0.0, what)


def _power_law(exponent: int) -> str:
    kinds = ("bounded", "linear", "quadratic", "cubic")
    return kinds[exponent] if exponent < len(kinds) else f"polynomial of degree {exponent}"


# --- Hirota-Kimura bases --------------------------------------------------------------------------


@dataclass(frozen=True, repr=False)
class HKBasis:
    """Linear relations between monomials along orbits, which `hk_bases` returns."""

    monomials: Exponents
    """Exponents of each monomial."""
    dimension: int
    """Number of independent relations along the orbit of `point`."""
    independent: int
    """Number of independent first integrals among their coefficients."""
    integrals: Polynomials
    """Polynomials whose quotients are first integrals; none if the relations give none."""
    point: Point
    """Point whose orbit `basis` belongs to."""
    basis: Matrix | None
    """Coefficients of the relations along that orbit: a row for each. The last nonzero entry of a
    row is 1, and 0 in the others. None if they are too long to reconstruct."""

    @property
    def polynomials(self) -> Polynomials:
        """The relations as polynomials, which vanish on the orbit of `point`."""
        return _polynomials(self.basis or (), self.monomials)

    def as_sympy(self, symbols: Sequence[Any] | None = None) -> list[Any]:
        """Return the relations along the orbit of `point` as SymPy expressions."""
        return self.polynomials.as_sympy(symbols)

    def __repr__(self) -> str:
        return (
            f"<HKBasis of dimension {self.dimension} among {len(self.monomials)} monomials, "
            f"independent={self.independent}, integrals={self.integrals}>"
        )


def hk_bases(
    map: KahanMap, monomials: int | Sequence[Sequence[int]], *, point: Any = None, seed: int = 0
) -> HKBasis:
    """Find the linear relations between monomials that hold along orbits.

    Parameters
    ----------
    map : KahanMap
        The map to examine.
    monomials : int or sequence of exponents
        All monomials up to a degree, 1 included, or the exponents (e1, ..., eD) of each.
    point : sequence of D rational numbers, optional
        Point whose orbit `basis` and `dimension` belong to; by default one with small integers
        whose orbit has as many relations as a random one.
    seed : int, optional
        Seed of the random points.

    Returns
    -------
    HKBasis
        If its `dimension` is 0, no quotient of two linear combinations of the monomials is a first
        integral.

    Raises
    ------
    TypeError, ValueError
        If an argument is not as above.
    ArithmeticError
        If orbits end at poles, that of `point` or those of most points.

    Notes
    -----
    `dimension`, `independent` and `integrals` are those of random orbits modulo a prime, confirmed
    modulo another one. An orbit has 10 points more than there are monomials, and is made longer
    until the number of relations remains the same.

    The coefficients of a relation in the form of `basis` are functions of the orbit, that is, first
    integrals; `independent` is the rank of their derivatives. If the relations of all orbits
    together span one dimension more than those of one orbit, then values of these polynomials at
    two points of an orbit are proportional: they are `integrals`.

    References
    ----------
    M. Petrera, A. Pfadler, Yu. B. Suris, arXiv:1008.1040.

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
    _check_map(map)
    n = map.dimension
    exponents = _exponents(monomials, n)
    rng = random.Random(seed)

    def relations(p: int, x: Any = None) -> Residues:
        start = [rng.randrange(p) if x is None else _residue(x[i], p) for i in range(n)]
        return _relations(map, exponents, start, p)

    dimension = _confirmed(map, lambda p: len(relations(p)))
    if point is None:
        start = _ordinary_point(map, rng, lambda p, x: len(relations(p, x)) == dimension)
    else:
        start = _array("point", point, (n,))
    basis: Matrix | None = ()
    if dimension > 0 or point is not None:
        basis = _over_rationals(map, lambda p: relations(p, start))
    independent, integrals = 0, Polynomials()
    if dimension > 0:
        independent = _confirmed(map, lambda p: _independent(map, exponents, rng, p))
        span = _over_rationals(map, lambda p: _span(relations, dimension, p))
        integrals = _polynomials(_short(span or ()), exponents)
    of_point = dimension if basis is None else len(basis)
    return HKBasis(exponents, of_point, independent, integrals, tuple(start), basis)


def _ordinary_point(map: KahanMap, rng: random.Random, ordinary: Callable[[int, Any], bool]) -> Any:
    """A point with small integers that is `ordinary` modulo a prime."""
    p = next(_primes(map))
    for _ in range(_DRAWS):
        x = _array("point", rng.choices(range(-9, 10), k=map.dimension))
        with contextlib.suppress(_BadDrawError):
            if ordinary(p, x):
                return x
    raise ArithmeticError("the orbits of small integers are exceptional: pass `point`")


def _relations(map: KahanMap, exponents: Exponents, x: list[int], p: int) -> Residues:
    """Relations along the orbit of x, in the form of `HKBasis.basis`."""
    steps = len(exponents) + _MORE
    before = None
    while True:
        relations = _null_space(_values(exponents, islice(_orbit(map, x, p), steps), p), p)
        if len(relations) in (0, before):
            return relations
        before, steps = len(relations), 2 * steps


def _orbit(map: KahanMap, x: list[int], p: int) -> Iterator[list[int]]:
    forms = map._modulo(p)
    while True:
        yield x
        system = _evaluate(forms, [1, *x])
        image = _solve_modulo([row[:-1] for row in system], [row[-1:] for row in system], p)
        x = [int(a) for a in image.entries()]


def _span(relations: Callable[[int], Residues], dimension: int, p: int) -> Residues:
    """The span of the relations along several orbits, if it has one dimension more than one."""
    span = relations(p)
    for _ in range(3):
        reduced, rank = flint.nmod_mat(span + relations(p), p).rref()
        if rank > dimension + 1:
            return []
        span = [[int(a) for a in row] for row in reduced.tolist()[:rank]]
    return span if len(span) == dimension + 1 else []


def _independent(map: KahanMap, exponents: Exponents, rng: random.Random, p: int) -> int:
    """Rank of the derivatives of the coefficients of the relations with respect to the orbit.

    For each k, ``sum_i c_i m_i(x_k) = 0`` is differentiated with respect to x_0. The coefficients
    that the form of `HKBasis.basis` makes 0 or 1 are constant.
    """
    n, count = map.dimension, len(exponents)
    forward, backward = map._modulo(p), map.inverse._modulo(p)
    orbit = list(islice(_orbit(map, [rng.randrange(p) for _ in range(n)], p), count + _MORE + 1))
    rows = _values(exponents, orbit[:-1], p)
    relations = _null_space(rows, p)
    last = {max(i for i, a in enumerate(row) if a) for row in relations}
    varying = [i for i in range(count) if i not in last]
    c = flint.nmod_mat(relations, p).transpose()
    derivative = flint.nmod_mat(np.eye(n, dtype=int).tolist(), p)  # of x_k
    equations = []
    for row, (x, image) in zip(rows, pairwise(orbit), strict=True):
        changes = (derivative.transpose() * flint.nmod_mat(_gradient(exponents, x, p), p)) * c
        equations.append([row[i] for i in varying] + [int(a) for a in changes.entries()])
        A, B = _evaluate(forward, [1, *x]), _evaluate(backward, [1, *image])
        derivative = _solve_modulo([r[:-1] for r in A], [r[:-1] for r in B], p) * derivative
    solved = flint.nmod_mat(equations, p).rref()[0].tolist()
    width = len(relations)
    changes = [
        row[len(varying) + j :: width] for row in solved[: len(varying)] for j in range(width)
    ]
    return int(flint.nmod_mat(changes, p).rank()) if changes else 0


# --- Darboux polynomials --------------------------------------------------------------------------


def darboux_polynomials(
    map: KahanMap, degree: int, cofactor: Any = None, *, seed: int = 0
) -> Polynomials:
    """Find the polynomials P with P(map(x)) = C(x) P(x), for a cofactor C.

    Parameters
    ----------
    map : KahanMap
        The map to examine.
    degree : int
        Largest degree of P.
    cofactor : number or callable, optional
        C: a rational number, or a function that takes a point, a tuple of fractions, and returns
        a rational number, exactly. By default it is ``map.determinant``.
    seed : int, optional
        Seed of the random points.

    Returns
    -------
    Polynomials
        A basis of these polynomials: a tuple of ``flint.fmpz_mpoly`` in x1, ..., xD, whose
        coefficients have no common factor. `as_sympy()` converts them.

    Raises
    ------
    TypeError, ValueError
        If an argument is not as above, or `cofactor` does not return rational numbers.
    ArithmeticError
        If the coefficients have more than 1000 digits, if the result fails at fresh points, or if
        the map or the cofactor is undefined at most points.

    Notes
    -----
    For the default cofactor 1 / P is the density of an invariant measure. For any cofactor the
    quotients of two such polynomials are first integrals. The equations for the coefficients are
    those of random integer points, 10 more than there are monomials, solved modulo primes; fresh
    points confirm the result over the rationals.

    References
    ----------
    E. Celledoni, C. Evripidou, D. I. McLaren, B. Owren, G. R. W. Quispel, B. K. Tapley,
    P. H. van der Kamp, arXiv:1902.04715.

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
    _check_map(map)
    exponents = _exponents(_count("degree", degree), map.dimension)
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
                found.append((x, map(x), _array("cofactor", C(x), (), (Rational,)).item()))
            if len(found) == count:
                return found
        raise ArithmeticError("the map or the cofactor is undefined at most points")

    equations = samples(len(exponents) + _MORE)

    def solutions(p: int) -> Residues:
        points = ([_residue(a, p) for a in y] for x, image, _ in equations for y in (x, image))
        values = _values(exponents, points, p)
        rows = []
        for (_, _, c), before, after in zip(equations, values[::2], values[1::2], strict=True):
            factor = _residue(c, p)
            rows.append([(a - factor * b) % p for a, b in zip(after, before, strict=True)])
        return _null_space(rows, p)

    basis = _over_rationals(map, solutions)
    if basis is None:
        raise ArithmeticError("the coefficients have more than 1000 digits")
    for x, image, c in samples(3):
        before, after = np.array(_values(exponents, (x, image)), object)
        if any(np.array(row, object) @ (after - c * before) for row in basis):
            raise ArithmeticError("the polynomials fail at fresh points")
    return _polynomials(_short(basis), exponents)


# --- Modulo primes, and back to the rationals -----------------------------------------------------


def _primes(map: KahanMap) -> Iterator[int]:
    """Primes below 2**62, in descending order, that divide no coefficient of the map."""
    coefficients = {a for row in map._forms for form in row for _, a in form}
    for p in range(2**62 - 1, 0, -2):
        if flint.fmpz(p).is_prime() and all(
            a.numerator % p and a.denominator % p for a in coefficients
        ):
            yield p


def _confirmed(map: KahanMap, result: Callable[[int], Any]) -> Any:
    """The first result on which two primes agree, with points or lines of their own."""
    found: list[Any] = []
    for p in islice(_primes(map), _DRAWS):
        with contextlib.suppress(_BadDrawError):
            found.append(result(p))
            if found.count(found[-1]) > 1:
                return found[-1]
    if not found:
        raise ArithmeticError("the iterates run into points without an image")
    raise ArithmeticError(f"results modulo primes do not agree: {found}")


def _over_rationals(map: KahanMap, matrix: Callable[[int], Residues]) -> Matrix | None:
    """The rational matrix with these residues modulo primes; None if its entries are too long."""
    height = _confirmed(map, lambda p: len(matrix(p)))
    modulus, used = 1, 0
    residues: list[int] = []
    candidate = None
    for p in islice(_primes(map), _PRIMES):
        with contextlib.suppress(_BadDrawError):
            rows = matrix(p)
            if len(rows) != height:
                continue
            new = [a for row in rows for a in row]
            if candidate is not None and [_residue(a, p) for a in candidate] == new:
                width = len(new) // max(height, 1)
                return tuple(tuple(candidate[i * width : (i + 1) * width]) for i in range(height))
            inverse = pow(modulus, -1, p)
            old = residues or [0] * len(new)
            residues = [
                r + modulus * ((a - r) * inverse % p) for r, a in zip(old, new, strict=True)
            ]
            modulus *= p
            used += 1
            if used & (used - 1) == 0:  # a power of two
                candidate = _reconstructed(residues, modulus)
    return None


def _reconstructed(residues: list[int], modulus: int) -> list[Fraction] | None:
    """The fractions with these residues, numerators and denominators below sqrt(modulus / 2)."""
    bound = math.isqrt(modulus // 2)
    fractions = []
    for residue in residues:
        (r0, t0), (r1, t1) = (modulus, 0), (residue, 1)
        while r1 > bound:
            q = r0 // r1
            (r0, t0), (r1, t1) = (r1, t1), (r0 - q * r1, t0 - q * t1)
        if abs(t1) > bound or math.gcd(r1, t1) != 1:
            return None
        fractions.append(Fraction(r1, t1))
    return fractions


def _null_space(rows: Residues, p: int) -> Residues:
    """Basis of the null space: the last nonzero entry of a vector is 1, and 0 in the others."""
    reduced, rank = flint.nmod_mat(rows, p).rref()
    if rank == len(rows[0]):
        return []
    entries = [[int(a) for a in row] for row in reduced.tolist()[:rank]]
    pivots = [next(i for i, a in enumerate(row) if a) for row in entries]
    vectors = []
    for free in sorted({*range(len(rows[0]))} - {*pivots}):
        vector = [int(i == free) for i in range(len(rows[0]))]
        for pivot, row in zip(pivots, entries, strict=True):
            vector[pivot] = -row[free] % p
        vectors.append(vector)
    return vectors


def _solve_modulo(A: Residues, b: Residues, p: int) -> Any:
    try:
        return flint.nmod_mat(A, p).solve(flint.nmod_mat(b, p))
    except ZeroDivisionError:
        raise _BadDrawError from None


def _residue(a: Fraction, p: int) -> int:
    if a.denominator % p == 0:
        raise _BadDrawError
    return a.numerator * pow(a.denominator, -1, p) % p


# --- Linear forms, monomials, numbers -------------------------------------------------------------


def _evaluate(forms: Any, x: Sequence[Any]) -> list[list[Any]]:
    zero = x[0] - x[0]
    return [[sum((a * x[k] for k, a in form), zero) for form in row] for row in forms]


def _values(exponents: Exponents, points: Iterable[Any], p: int | None = None) -> list[list[Any]]:
    """The monomials at points, a row for each, modulo p unless that is None."""
    powers = np.array(exponents).T
    rows = []
    for x in points:
        values = np.ones(len(exponents), object)
        for a, e in zip(x, powers, strict=True):
            values *= np.array([pow(a, k, p) for k in range(e.max() + 1)], object)[e]
        rows.append(list(values if p is None else values % p))
    return rows


def _gradient(exponents: Exponents, x: list[int], p: int) -> Residues:
    """The derivatives of the monomials at a point: a row for each variable."""
    rows = []
    for i in range(len(x)):
        lower = tuple((*each[:i], max(each[i] - 1, 0), *each[i + 1 :]) for each in exponents)
        (values,) = _values(lower, [x], p)
        rows.append([each[i] * value % p for each, value in zip(exponents, values, strict=True)])
    return rows


def _exponents(monomials: Any, n: int) -> Exponents:
    """The exponents of monomials in n variables, those up to a degree in ascending order."""
    if isinstance(monomials, int | np.integer):
        return tuple(
            tuple(chosen.count(i) for i in range(n))
            for degree in range(_count("monomials", monomials) + 1)
            for chosen in combinations_with_replacement(range(n), degree)
        )
    try:
        exponents = tuple(tuple(_count("monomials", e) for e in each) for each in monomials)
    except TypeError:
        raise TypeError(
            f"monomials: expected a degree or a list of exponents, got {monomials!r}"
        ) from None
    for each in exponents:
        if len(each) != n:
            raise ValueError(f"monomials: expected {n} exponents for each monomial, got {each}")
    if not exponents or len({*exponents}) < len(exponents):
        raise ValueError("monomials: expected at least one monomial, and none twice")
    return exponents


def _ring(n: int, context: Any) -> Any:
    return context.get([f"x{i}" for i in range(1, n + 1)], "deglex")


def _polynomials(rows: Sequence[Sequence[Any]], exponents: Exponents) -> Polynomials:
    """Polynomials that are proportional to these, with coprime integer coefficients."""
    ring = _ring(len(exponents[0]), flint.fmpz_mpoly_ctx)
    polynomials = []
    for row in rows:
        terms = zip(exponents, _coprime(row), strict=True)
        polynomial = ring.from_dict({each: a for each, a in terms if a})
        polynomials.append(-polynomial if polynomial.coeffs()[0] < 0 else polynomial)
    return Polynomials(polynomials)


def _coprime(row: Sequence[Any]) -> list[int]:
    denominator = math.lcm(*(a.denominator for a in row))
    integers = [int(a * denominator) for a in row]
    divisor = math.gcd(*integers)
    return [a // divisor for a in integers]


def _short(rows: Sequence[Sequence[Any]]) -> Residues:
    """Short integer vectors with the same span, for the sake of readers."""
    if not rows:
        return []
    reduced = flint.fmpz_mat([_coprime(row) for row in rows]).lll()
    return [[int(a) for a in row] for row in reduced.tolist()]


def _array(name: str, value: Any, shape: Any = None, kinds: Any = (Rational, float)) -> Any:
    """Array of fractions, made of numbers of these kinds."""
    if hasattr(value, "unit") or hasattr(value, "units"):
        raise TypeError(f"{name}: expected numbers without units, got {type(value).__name__}")
    raw = np.array(value, dtype=object)
    if any(isinstance(each, list | tuple | np.ndarray) for each in raw.flat):
        raise ValueError(f"{name}: expected an array, got rows of different lengths")
    if shape is not None and raw.shape != shape:
        raise ValueError(f"{name}: expected the shape {shape}, got {raw.shape}")
    result = np.empty(raw.shape, object)
    for index, each in np.ndenumerate(raw):
        number = each.item() if isinstance(each, np.generic) else each
        if not isinstance(number, kinds):
            expected = (
                "integers, fractions or floats" if float in kinds else "integers or fractions"
            )
            raise TypeError(f"{name}: expected {expected}, got {type(each).__name__}")
        if isinstance(number, float) and not math.isfinite(number):
            raise ValueError(f"{name}: expected finite numbers, got {number}")
        if isinstance(number, float):
            number = Fraction(number)
        # NumPy's integers would overflow, also as parts of a Fraction.
        result[index] = Fraction(int(number.numerator), int(number.denominator))
    return result


def _count(name: str, value: Any, least: int = 0) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise TypeError(f"{name}: expected an integer, got {type(value).__name__}")
    if value < least:
        raise ValueError(f"{name}: expected an integer of at least {least}, got {value}")
    return int(value)


def _check_map(map: Any) -> None:
    if not isinstance(map, KahanMap):
        kind = type(map).__name__
        raise TypeError(f"map: expected a map made by kahan(field, eps), got {kind}")


def _rational_matrix(rows: Sequence[Sequence[Fraction]]) -> Any:
    return flint.fmpq_mat([[flint.fmpq(a.numerator, a.denominator) for a in row] for row in rows])


def _fraction(a: Any) -> Fraction:
    return Fraction(int(a.p), int(a.q))


def _shortened(text: str) -> str:
    return text if len(text) <= 300 else f"{text[:297]}..."
