"""Reducible levels, base points and genera of integrals, against identities and fractions."""

import functools
from fractions import Fraction as F

import pytest
import sympy

from suslov_fast import Field
from suslov_fast.integrability import kahan, pencil, report, zoo
from suslov_fast.integrability.rational_functions import RationalFunction

H = Field.from_hamiltonian
TRIANGLE = H(lambda x: x[0] * x[1] * (x[0] + x[1] + 1), "x y")
CONJUGATE = H(lambda x: x[0] * x[1] * (x[0] + x[1]) - 3 * x[0] + 2 * x[1], "x y")
STAR = H(lambda x: x[0] ** 3 - 3 * x[0] * x[1] ** 2 + x[1] ** 2, "x y")


def lines(x, a, b, c):
    """Three lines through a point, with the exponents a, b, c."""
    (u, v), w = x, x[0] + x[1]
    return b * u * w + c * u * v, -(a * v * w + c * u * v)


SEXTIC = Field(lines, "x y", a=1, b=2, c=3)


@functools.cache
def integral_of(field, eps, degree=3):
    (integral,) = report(field, eps=eps, degree=degree).integrals
    return integral


def symbolic(f):
    """A formula for SymPy, with eps = 2/7."""
    return sympy.sympify(str(f).replace("^", "**")).subs("eps", sympy.Rational(2, 7))


@pytest.mark.parametrize(
    ("field", "eps", "degree", "points", "genus"),
    [
        (TRIANGLE, 1, 3, 9, 1),
        pytest.param(TRIANGLE, None, 3, 9, 1, marks=pytest.mark.slow),
        (CONJUGATE, 1, 3, 9, 1),
        pytest.param(CONJUGATE, None, 3, 9, 1, marks=pytest.mark.slow),
        (STAR, F(1, 3), 3, 9, 1),
        (STAR, 1, 3, 7, 1),  # two members touch, at two points
        pytest.param(SEXTIC, None, 6, 11, 1, marks=pytest.mark.slow),
        pytest.param(zoo()["Nahm, octahedral"][0], None, 4, 10, 1, marks=pytest.mark.slow),
        (zoo()["Suslov body"][0], F(1, 3), 2, 4, 0),
        (zoo()["Lyness"][0], None, 3, 7, 1),
        (zoo()["McMillan"][0], None, 4, 2, 1),  # two points with four near each
    ],
)
def test_pencils(field, eps, degree, points, genus):
    integral = integral_of(field, eps, degree)
    found = pencil(integral)
    assert (found.degree, found.genus, found.reason) == (degree, genus, "")
    assert sum(point.number for point in found.base_points) == points
    at_points = [point.number * point.intersection for point in found.base_points]
    assert sum(at_points) == degree**2  # Bezout
    N, D = symbolic(integral.numerator), symbolic(integral.denominator)
    for point in found.base_points:
        assert_is_base_point(point, N, D, integral)
    for member in found.members:
        assert_is_member(member, N, D)


def assert_is_base_point(point, N, D, integral):
    if point.coordinates is None:
        return
    x, y, z = map(symbolic, point.coordinates)
    names = integral.numerator.context().names()[-2:]
    u, v, w = sympy.symbols([*names, "w"])
    degree = integral.degree
    for P in (N, D):
        on_plane = sympy.expand(sympy.simplify(P.subs({u: u / w, v: v / w}) * w**degree))
        value = sympy.together(on_plane.subs({u: x, v: y, w: z}, simultaneous=True))
        value = sympy.numer(value)
        if point.root is not None:
            value = sympy.rem(value, symbolic(point.root), sympy.Symbol("r"))
        assert sympy.expand(value) == 0


def assert_is_member(member, N, D):
    """The product of N - h D for all roots h of `value`, and its lines."""
    h, r = sympy.symbols("h r")
    value, product = symbolic(member.value), symbolic(member.polynomial)
    if value.has(h):
        expected = sympy.resultant(value, N - h * D, h)
    else:
        expected = D
    assert not sympy.cancel(product / expected).free_symbols
    for line in member.lines:
        L = symbolic(line.line)
        x = next(s for s in sorted(L.free_symbols, key=str) if str(s) != "r")
        on_line = sympy.numer(sympy.together(product.subs(x, sympy.solve(L, x)[0])))
        if line.root is not None:
            on_line = sympy.rem(on_line, symbolic(line.root), r)
        assert sympy.expand(on_line) == 0


def test_conjugate_lines():
    """Two conjugate members of three lines each: 361 eps^8 + ... + 3 eps^6 h^2 = 27."""
    conic, conjugate = pencil(integral_of(CONJUGATE, None)).members
    assert (conic.conjugates, conic.components, conic.lines) == (1, 2, ())
    assert (conjugate.conjugates, conjugate.components) == (2, 3)
    assert [line.number for line in conjugate.lines] == [6]
    assert "6 lines" in repr(conjugate)


def test_a_report_prints_a_quotient_of_products_of_lines():
    """See arXiv:2309.00799."""
    for eps in (1, None):
        integral = integral_of(TRIANGLE, eps)
        for part in (integral.numerator, integral.denominator):
            factors = [P for P, _ in part.factor()[1]]
            assert all(P.degrees()[-1] + P.degrees()[-2] <= 2 for P in factors)
            assert len(factors) == 3
        step = kahan(TRIANGLE, 1)
        at_one = integral if eps else integral.subs(eps=1)
        assert at_one.basis == "identity"
        assert at_one(step((F(1, 3), 2))) == at_one((F(1, 3), 2))
    triangle, other, *_ = pencil(integral_of(TRIANGLE, 1)).members
    quotient = triangle.polynomial / other.polynomial
    assert str(quotient) == "x*y*(x + y + 1)/((2*x + 3)*(2*y + 3)*(2*x + 2*y - 1))"


def test_integrals_without_a_pencil_of_irreducible_levels():
    integral = integral_of(TRIANGLE, 1)
    assert str(pencil(integral**3)) == str(pencil(integral))
    composed = integral + 1 / integral
    with pytest.raises(ValueError, match="irreducible levels"):
        pencil(composed)
    with pytest.raises(ValueError, match="of degree 2 to 6"):
        pencil(composed + integral / (integral + 2))
    with pytest.raises(TypeError, match="integral"):
        pencil(TRIANGLE)
    (_, second) = report(zoo()["Volterra chain, N = 3"][0], eps=1).integrals
    assert isinstance(second, RationalFunction)
    found = pencil(second)
    assert (found.genus, found.base_points) == (None, ())
    assert "no plane curves" in repr(found)
