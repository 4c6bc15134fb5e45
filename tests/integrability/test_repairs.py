"""Conditions for letters, and repairs that solve them, against entropies at numbers."""

import random
from fractions import Fraction as F
from itertools import islice

import pytest
import sympy

from suslov_fast import Field, Map
from suslov_fast.integrability import kahan, locus, planar_entropy, rational_map, repairs


def quartic(x, a, d):
    return a * x[0] ** 2 + x[1] ** 2 + x[1] + d, -2 * x[0] * x[1]


def lines(x, a, b, c, r):
    """The lines x = 0, y = 0 and x + y + r = 0, with the exponents a, b, c."""
    (u, v), w = x, x[0] + x[1] + r
    return b * u * w + c * u * v, -(a * v * w + c * u * v)


LYNESS = rational_map(
    Map(lambda x, a, b: (x[1], (x[1] + a) / (x[0] + b)), 2, a=1, b=1),
    Map(lambda x, a, b: ((x[0] + a) / x[1] - b, x[0]), 2, a=1, b=1),
    letters="a b",
)
QUARTIC, LINES = Field(quartic, "x y", a=2, d=1), Field(lines, "x y", a=1, b=1, c=2, r=1)


def lengths_by_polynomial(conditions):
    found = {}
    for condition in conditions:
        text = ", ".join(map(str, condition.polynomials))
        found.setdefault(text, []).append(condition.length)
    return found


def test_conditions_of_all_curves():
    """A line, and two conjugate lines, whose orbits end under the same equation."""
    found = lengths_by_polynomial(locus(QUARTIC, 4, letters="a d"))
    assert found["-eps^2*d + a - 2"] == [2, 4]
    assert found["a - 1"] == [3, 3]
    assert not [text for text in found if "97" in text]  # of a point that was chosen on a curve
    with pytest.raises(ValueError, match="with letters"):
        locus(kahan(QUARTIC, F(1, 3)))


def test_conditions_of_two_equations():
    """At all zeros modulo a prime the orbit, computed here, ends at the point that is told."""
    conditions, p = locus(LYNESS, 4), 997
    assert any("line at infinity: ends at point 1" in text for text in conditions.searched)
    assert lengths_by_polynomial(conditions)["b"] == [3]
    checked = []
    for curve, length, polynomials in conditions:
        assert curve == "a + x2 = 0"
        texts = [str(f).replace("^", "**") for f in polynomials]
        first, *others = [eval(f"lambda a, b: {text}") for text in texts]
        # Two equations hold at a = 1, b = 0, which one equation is not to meet.
        roots = range(2, p) if not others else [a for a in range(1, p) if first(a, 0) % p == 0]
        zeros = ((a, b) for a in roots for b in range(p) if first(a, b) % p == 0)
        for a, b in islice((z for z in zeros if not any(f(*z) % p for f in others)), 5):
            assert length_of_orbit(a, b, p) == length
            checked.append((len(texts) > 1, length))
    assert {(False, 2), (False, 4), (True, 2), (True, 3), (True, 4)} <= {*checked}


def length_of_orbit(a, b, p):
    """The length of the orbit of y = -a, in homogeneous coordinates modulo p."""
    x, y, z = 5, -a, 1
    for n in range(9):
        x, y, z = (
            y * (x + b * z) % p,
            (y + a * z) * z % p,
            z * (x + b * z) % p,
        )
        if not (x or y or z):
            return n
    return None


def test_the_law_of_three_lines():
    """((1 + A) / (1 - A))^(n - 1) = (1 + B) (1 + C) / ((1 - B) (1 - C)) with A = eps r a / 2."""
    found = {text for c in locus(LINES, 4, letters="a b c r") for text in texts_of(c)}
    eps, r, *letters = sympy.symbols("eps r a b c")
    for k in range(3):
        A, B, C = (eps * r * letter / 2 for letter in letters[k:] + letters[:k])
        for n in range(1, 5):
            law = (1 + A) ** (n - 1) * (1 - B) * (1 - C) - (1 - A) ** (n - 1) * (1 + B) * (1 + C)
            (factor,) = (f for f, _ in sympy.factor_list(law)[1] if f not in (eps, r))
            assert {(n, factor), (n, sympy.expand(-factor))} & found, n
            found -= {(n, factor), (n, sympy.expand(-factor))}
    assert not found  # one equation, and no other
    # Two equations: B and one of A, C are 1 or -1.
    pairs = [c.polynomials for c in locus(LINES, 1, letters="b c") if len(c.polynomials) > 1]
    for eps in (2, -2):
        at = {"eps": eps, "b": 1, "c": 7}
        zeros = [
            all(f([], **{name: at[name] for name in f.letters}) == 0 for f in fs) for fs in pairs
        ]
        assert any(zeros)


def texts_of(condition):
    if len(condition.polynomials) == 1:
        yield condition.length, sympy.expand(sympy.sympify(condition.polynomials[0]))


@pytest.mark.slow
def test_two_letters_are_found():
    """Exponents with an integral, and repaired ones, which contain eps."""
    found = {str(values): entropy for values, entropy, _ in repairs(LINES, "b c", 4, letters="b c")}
    k = "eps^2"
    for b, c, lengths in (
        ("1", "1", [3, 3, 3]),
        ("1", f"8/({k} + 4)", [2, 4, 4]),
        (f"8/({k} + 4)", f"({k} + 12)/(3*{k} + 4)", [2, 3, 6]),
    ):
        entropy = found[f"{{'b': {b}, 'c': {c}}}"]
        assert (entropy.entropy, entropy.proved, sorted(entropy.lengths)) == (0, True, lengths)


@pytest.mark.parametrize(
    ("map", "unknown", "letters", "steps"),
    [(QUARTIC, "a", "a d", 4), (LYNESS, "b", None, 6), (LYNESS, "a b", None, 4)],
)
def test_repairs_have_their_entropies(map, unknown, letters, steps):
    found, rng = repairs(map, unknown, steps, letters=letters), random.Random(1)
    assert found
    for values, entropy, repaired in found:
        numbers = {name: F(rng.randrange(20, 99), 7) for name in repaired.letters}
        at_numbers = repaired.subs(**numbers) if numbers else repaired
        assert planar_entropy(at_numbers).entropy == pytest.approx(entropy.entropy, abs=1e-12)
        x = F(2, 7), F(3, 5)
        assert at_numbers.inverse(at_numbers(x)) == x
        if isinstance(map, Field):  # the field with these values has the same map
            (f,) = values.values()
            a = f([], **{name: numbers[name] for name in f.letters})
            field = Field(quartic, "x y", a=a, d=numbers["d"])
            assert kahan(field, numbers["eps"])(x) == at_numbers(x)


def test_letters_that_are_no_unknowns():
    for unknown in ("eps", "a d b", "q", "a a"):
        with pytest.raises(ValueError, match="one or two of the letters eps, a, d"):
            repairs(QUARTIC, unknown, letters="a d")
