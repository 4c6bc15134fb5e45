"""Fields of papers, and claims of reports, that several tests of the laboratory take."""

import re
from fractions import Fraction as F

from suslov_fast import Field


def three_lines(a, b):
    """Zander (2021): exponents (a, b, 1)."""

    def field(x):
        total, product = x[0] + x[1], x[0] * x[1]
        return b * x[0] * total + product, -a * x[1] * total - product

    return Field(field, 2)


def lotka_volterra(a, b, c):
    """The sum of the three variables is an integral."""

    def field(x):
        u, v, w = x
        return u * (a * v - b * w), v * (c * w - a * u), w * (b * u - c * v)

    return Field(field, 3)


def by_text(f, x, own=None, **parameters):
    """The value of the text of a function, whose numbers are fractions."""
    names = "x{}", "Omega{}", "Omega{}n"
    values = {name.format(i): a for i, a in enumerate(x, start=1) for name in names}
    values |= dict(zip(own or (), x, strict=False)) | parameters | {"F": F}
    return eval(re.sub(r"(?<!\w)\d+", r"F(\g<0>)", str(f).replace("^", "**")), values)


def assert_holds(found, map=None, x=None, **letters):
    """All claims of a report hold at a point and its image under a map, for values of letters."""
    map = map or found.map
    x = x or [F(2 * k + 1, 7) for k in range(map.dimension)]
    y, J = map(x), map.determinant(x)
    before, after = ([f(z, **letters) for f in found.integrals] for z in (x, y))
    assert before == after
    for f in found.measures:
        assert f(y, **letters) * J == f(x, **letters) * (-1 if f.cofactor else 1)
    for P in found.polynomials:
        assert P(y, **letters) == P.cofactor(x, **letters) * P(x, **letters)


def assert_text(found):
    """Formulas are what they say, and nothing is cut in parentheses or printed twice."""
    eps = F(2, 9)
    x = [F(2 * k + 3, 7) for k in range(found.map.dimension)]
    for f in (*found.integrals, *found.measures, *found.polynomials):
        for each in (f, f.cofactor) if f.cofactor else (f,):
            expected = each(x, eps=eps) if each.is_symbolic else each(x)
            assert by_text(each, x, found.map.names, eps=eps) == expected
            assert by_text(each**-2, x, found.map.names, eps=eps) == expected**-2
            text = each._repr_latex_()
            assert text.count("{") == text.count("}")
            assert "*" not in text
    lines = repr(found).splitlines()
    assert all(line.count(a) == line.count(b) for line in lines for a, b in ("()", "[]"))
    assert len({*lines}) == len(lines)
    assert "proved" in repr(found) or not found.integrals
