"""Values of a parameter with more relations along orbits, against conditions from papers."""

from fractions import Fraction as F

import numpy as np
import pytest

from suslov_fast import QuadraticField, Suslov3D

pytest.importorskip("flint")

from papers import three_lines

from suslov_fast.integrability import kahan, locus, rational_map
from suslov_fast.integrability.polynomials import exponents_up_to
from suslov_fast.integrability.relations import count_relations

field_of = QuadraticField.from_function


def henon_heiles(c):
    return QuadraticField.from_hamiltonian(
        lambda x: (x[2] ** 2 + x[3] ** 2) / 2 + x[0] ** 2 * x[1] + c * x[1] ** 3 / 3, 4
    )


def rotors(b):
    """Zhukovski and Volterra, beta = (1, b, 0)."""
    return field_of(
        lambda x: (
            x[1] * x[2] - b * x[2],
            2 * x[2] * x[0] + x[2],
            -3 * x[0] * x[1] + b * x[0] - x[1],
        ),
        3,
    )


def counted(map, degree):
    """The number of relations, by another program."""
    return count_relations(map, exponents_up_to(degree, map.dimension)).relations


@pytest.mark.slow
@pytest.mark.parametrize(
    ("f", "degree", "generic", "values"),
    [
        (lambda b: three_lines(b, 1), 4, 0, {F(-2): 10, F(-1): 6, F(0): 6, F(1): 3, F(2): 1}),
        (rotors, 3, 4, {F(0): 8}),
    ],
)
def test_known_loci(f, degree, generic, values):
    calls = []
    found = locus(f, degree, progress=lambda *done: calls.append(done))
    assert found.generic == generic
    assert {each.value: each.relations for each in found} == values
    assert found == sorted(found)
    assert calls == [(1, 2), (2, 2)]
    for each in found[:2]:  # counted in another way
        assert counted(kahan(f(each.value)), degree) == each.relations


@pytest.mark.slow
def test_texts_heights_and_monomials():
    """Of 7 b, 1 and 2 are 1/7 and 2/7, of a height that may be too large."""
    wide = locus(lambda b: three_lines(7 * b, 1), 4, height=7)
    assert [each.value for each in wide] == [F(k, 7) for k in (-2, -1, 0, 1, 2)]
    assert repr(wide).endswith("1/7 (3), 2/7 (1), of all fractions of height up to 7)")
    narrow = locus(lambda b: three_lines(7 * b, 1), 4, height=6)
    assert [each.value for each in narrow] == [0]
    none = locus(rotors, 1, height=2, monomials=[(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0)])
    assert none == []
    assert "more at none, of all fractions of height up to 2" in repr(none)


@pytest.mark.slow
def test_rational_maps():
    """The map of Lyness is periodic for 0 and 1."""

    def lyness(a):
        return rational_map(lambda x: (x[1], (x[1] + a) / x[0]), 2)

    found = locus(lyness, 3, height=3)
    assert (found.generic, [each.value for each in found]) == (1, [0, 1])
    assert found[1].relations == counted(lyness(1), 3)


def test_a_field_that_becomes_linear():
    """For 0; and for 1, by which it is divided, there is none."""

    def f(b):
        return field_of(lambda x: (b / (1 - b) * x[0] ** 2 - x[1], x[0]), 2)

    found = locus(f, 2, height=1)
    assert [each.value for each in found] == [0]
    assert found.left_out == (1,)
    assert "of all fractions of height up to 1 but 1, without a map" in repr(found)


@pytest.mark.parametrize(
    ("error", "argument", "call"),
    [
        (TypeError, "f", lambda: locus(3, 2)),
        (TypeError, "f", lambda: locus(lambda b: b, 2)),
        (TypeError, "f", lambda: locus(lambda b: Suslov3D(4, 1, 1, 0), 2)),
        (TypeError, "f", lambda: locus(lambda b: QuadraticField(np.zeros((2, 1, 1, 1))), 2)),
        (ArithmeticError, "f", lambda: locus(lambda b: rotors(b / 0), 2)),
        (ValueError, "f", lambda: locus(lambda b: rotors(b) if b > 2 else henon_heiles(b), 2)),
        (ValueError, "f", lambda: locus(lambda b: field_of(lambda x: (x[5],), 1), 2)),
        (ValueError, "degree", lambda: locus(rotors, 0)),
        (ValueError, "height", lambda: locus(rotors, 2, height=0)),
        (ValueError, "monomials", lambda: locus(rotors, 99)),
        (TypeError, "progress", lambda: locus(rotors, 2, progress=1)),
    ],
)
def test_bad_input(error, argument, call):
    with pytest.raises(error, match=rf"^{argument}\b"):
        call()


def test_ctrl_c():
    def interrupt(done, parts):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        locus(rotors, 2, progress=interrupt)
