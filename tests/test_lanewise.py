"""Formulas compiled by being called: the same bits of a number, of a vector, and interpreted."""

import math
from fractions import Fraction

import numba
import numpy as np
import pytest

from suslov_fast._core.cpu.vector import store_at, vector_at
from suslov_fast._core.formulas import elementary
from suslov_fast._core.lanewise import VECTOR, any_lane, larger, select, smaller, two_product
from suslov_fast._core.staged import staged

SIZE = 3 * VECTOR


def all_kinds(v, w, flag):
    """Every operation, in an order that rounding shows."""
    product, lost = two_product(v, w)
    k = elementary.exponent(w)
    root = np.sqrt(abs(v)) / 3.0 - (1.0 - w) * (2.0 / v) + elementary.two_to_the(k)
    signs = (v < 0.0) & (w >= 0.5) | (v != w) & (v <= -0.25) | (v == 2.0)
    chosen = select(signs | flag, -root, larger(v, smaller(w, 0.125)))
    return chosen, product, lost, elementary.logarithm_beyond(0.1 * smaller(w, 1.0))


@staged
def of_numbers(v, w, flag, out):
    for i in range(v.size):
        out[0, i], out[1, i], out[2, i], out[3, i] = all_kinds(v[i], w[i], flag)


@staged
def of_vectors(v, w, flag, out):
    for i in range(0, v.size, VECTOR):
        results = all_kinds(vector_at(v, i), vector_at(w, i), flag)
        for row in (0, 1, 2, 3):
            store_at(out[row], i, results[row])


def in_place(array, index, factor):
    """Vectors of two widths, read and written; whether any number was negative."""
    wide = array[index:][: 2 * VECTOR].copy()
    array[index:][: 2 * VECTOR] = wide * factor
    array[index + 2 * VECTOR :][:VECTOR] = 7.0
    return any_lane(wide < 0.0)


@staged
def in_place_of(array, index, factor):
    return in_place(array, index, factor)


@staged
def product_of(v, w):
    return two_product(v, w)


OF_NUMBERS = numba.njit(lambda v, w, flag, out: of_numbers(v, w, flag, out))
OF_VECTORS = numba.njit(lambda v, w, flag, out: of_vectors(v, w, flag, out))
IN_PLACE = numba.njit(lambda array, index, factor: in_place_of(array, index, factor))
PRODUCT = numba.njit(lambda v, w: product_of(v, w))


def test_numbers_and_vectors(rng):
    """Arrays are the vectors of interpreted code."""
    v, w = rng.uniform(-2, 2, SIZE), rng.uniform(0, 2, SIZE)
    v[0], w[1] = 2.0, v[1]
    for flag in (False, True):
        arrays = all_kinds(v, w, flag)
        for i in range(SIZE):
            one = all_kinds(float(v[i]), float(w[i]), flag)
            assert [float(each) for each in one] == [each[i] for each in arrays]
        for compiled in (OF_NUMBERS, OF_VECTORS):
            out = np.empty((len(arrays), SIZE))
            compiled(v, w, flag, out)
            np.testing.assert_array_equal(out, arrays)


@pytest.mark.parametrize("index", [0, 3])
def test_arrays_are_written(index):
    for lowest in (0.0, -1.0):
        given = lowest + np.arange(4.0 * VECTOR)
        interpreted, other = given.copy(), given.copy()
        assert in_place(interpreted, index, 3.0) == IN_PLACE(other, index, 3.0)
        assert in_place(given.copy(), index, 3.0) == (given[index] < 0.0)
        np.testing.assert_array_equal(interpreted, other)
        assert interpreted[index] == 3.0 * given[index]
        assert interpreted[index + 2 * VECTOR] == 7.0


def test_a_product_in_two_numbers_is_exact(rng):
    for v, w in rng.uniform(-1, 1, (200, 2)) * 2.0 ** rng.integers(-400, 400, (200, 1)):
        for product in (two_product(float(v), float(w)), PRODUCT(v, w)):
            assert sum(map(Fraction, map(float, product))) == Fraction(float(v)) * Fraction(
                float(w)
            )


def test_the_second_of_two_where_one_is_not_a_number():
    for pick in (larger, smaller):
        assert pick(math.nan, 1.0) == 1.0
        assert math.isnan(pick(1.0, math.nan))
