"""Sums with the rounding errors of their partial sums, and implicit steps that need them."""

from fractions import Fraction

import numpy as np
import pytest
from systems import robertson

from suslov_fast import Field, flow
from suslov_fast.core.expressions.compensated import compensated
from suslov_fast.core.expressions.numpy_evaluation import results_at
from suslov_fast.core.expressions.programs import Program


def of_sums(terms, program):
    return results_at(program, dict(enumerate(terms)), ())


def test_sums_are_rounded_once_where_terms_cancel():
    rng = np.random.default_rng(5)
    operations = [
        ("fadd", 8, (0, 1)), ("fsub", 9, (8, 2)), ("fadd", 10, (3, 4)), ("fsub", 11, (5, 10)),
        ("fsub", 12, (9, 11)), ("fsub", 13, (6, 12)), ("fadd", 14, (13, 7)), ("fsub", 15, (0, 8)),
    ]  # fmt: skip
    signs = [-1, -1, 1, -1, -1, 1, 1, 1]  # of the terms in value 14; 8 is a term of two sums
    program = Program(operations, [14, 15, 3, 0.5])
    wrong, ulp = 0, Fraction(1, 2**52)
    for _ in range(200):
        terms = np.append(rng.normal(size=7) * 10.0 ** rng.uniform(-9.0, 0.0, 7), 0.0)
        terms[7] = -(1.0 + 1e-9 * rng.normal()) * of_sums(terms, program)[0]
        partial = terms[0] + terms[1]
        exact = [Fraction(sign) * Fraction(a) for sign, a in zip(signs, terms, strict=True)]
        exact = sum(exact[2:]) - Fraction(partial)
        found, other, third, constant = of_sums(terms, compensated(program))
        assert abs(Fraction(found) - exact) <= abs(exact) * ulp
        assert (other, third, constant) == (terms[0] - partial, terms[3], 0.5)
        plain = of_sums(terms, program)[0]
        wrong += abs(Fraction(plain) - exact) > abs(exact) * ulp
    assert wrong > 100


def e5(y):
    slow, third = 7.89e-10 * y[0], 1.1e7 * y[0] * y[2]
    fast, fourth = 1.13e9 * y[1] * y[2], 1.13e3 * y[3]
    return -slow - third, slow - fast, slow - third + fourth - fast, third - fourth


# The ends, computed with 33 digits, and about twice the steps; without compensated sums E5 takes
# 10,000 and more.
KINETICS = {
    "E5": (
        e5, [1.76e-3, 0, 0, 0], 1e5, 1e-20, 400,
        [7.4813208224292225e-06, 2.3734781561205976e-12, 2.2123586689581664e-12,
         1.6111948716243115e-13],
    ),
    "Robertson": (
        robertson, [1.0, 0, 0], 1e11, 1e-14, 2000,
        [2.0833401497012941e-08, 8.3333607703347832e-14, 0.99999997916651517],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", KINETICS)
def test_rounding_does_not_limit_steps(name):
    f, x0, last, size, steps, right = KINETICS[name]
    found = flow(Field(f, len(x0)), x0, time=last, rtol=1e-12, atol=1e-12 * size)
    np.testing.assert_allclose(found.final, right, rtol=1e-8)
    assert found.steps <= steps
