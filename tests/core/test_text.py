"""Texts as formulas: what operators, arrays, conditions and loops compute as machine code."""

import numpy as np
import pytest

from suslov_fast.core.llvm.compiler import call, compiled
from suslov_fast.core.llvm.text import Carried, Code, Integers

WIDTHS = pytest.mark.parametrize("W", [1, 2, 8])
NUMBERS = np.random.default_rng(1).normal(size=(7, 8))


def computed(body, W, x, rows):
    """Return rows (rows, W) that `body(text, x, result, integers)` writes, and three integers."""

    def text_of(name):
        text = Code(W)
        text.begin(name, "plan")
        plan = Integers(text, "%plan")
        body(text, text.array(plan[0]), text.array(plan[1]), Integers(text, plan[2]))
        text.add("  ret i64 0")
        return text.finished()

    x, result, integers = np.array(x[:, :W]), np.full((rows, W), np.nan), np.zeros(3, np.int64)
    plan = np.array([x.ctypes.data, result.ctypes.data, integers.ctypes.data])
    call(compiled((body, W), text_of), plan)
    return x, result, integers


@pytest.mark.compiled
@WIDTHS
def test_operators_of_numbers(W):
    def body(text, x, y, _):
        a, b = x[0], x[1]
        for k, value in enumerate([a + b, a - 2.0, 3.0 - b, a * b, 1.0 / a, abs(a), abs(b).sqrt(),
                                   a.floor()]):  # fmt: skip
            y[k] = value

    x, y, _ = computed(body, W, NUMBERS, 8)
    a, b = x[:2]
    expected = [a + b, a - 2, 3 - b, a * b, 1 / a, abs(a), np.sqrt(abs(b)), np.floor(a)]
    assert np.array_equal(y, expected)


@pytest.mark.compiled
@WIDTHS
def test_truth_values(W):
    def body(text, x, y, integers):
        a, b = x[0], x[1]
        y[0] = (a > b).select(a, b)
        y[1] = ((a >= 0.0) & ~(b < 0.0)).select(1.0, 0.0)
        y[2] = ((a <= 0.0) | (b > 0.0)).select(a, 0.0)
        y[3] = (a.equals(a) ^ a.differs(b)).select(1.0, 0.0)
        y[4] = 5.0
        y.choose(a < b, 4, a)
        integers[0] = (a > 0.0).bits()
        integers[1] = (a > 9.0).any().select(1, 2)
        integers[2] = (a < 9.0).all().select(integers[0], 7)

    x, y, integers = computed(body, W, NUMBERS, 5)
    a, b = x[:2]
    expected = [np.maximum(a, b), (a >= 0) & (b >= 0), np.where((a <= 0) | (b > 0), a, 0), 0 * a,
                np.where(a < b, a, 5)]  # fmt: skip
    assert np.array_equal(y, expected)
    bits = (a > 0) @ 2 ** np.arange(W)
    assert integers.tolist() == [bits, 2, bits]


@pytest.mark.compiled
@WIDTHS
@pytest.mark.parametrize("count", [1, 4, 7])
def test_loops(W, count):
    """Prefix sums and powers, also where a loop has one round."""

    def body(text, x, y, integers):
        sums = Carried(total=0.0, n=0)
        for i in text.each(count, sums):
            power = Carried(of=1.0)
            for _ in text.each(text.value(i) + 1, power):
                power.of = power.of * x[i]
            sums.total, sums.n = sums.total + power.of, text.value(sums.n) + 2
            y[i] = sums.total
        integers[0] = sums.n
        for now in text.rounds(Carried(n=1000)):
            now.n = now.n // 3
            now.goes_on = now.n >= count
        integers[1] = (now.n << 2 | 1) - 1
        with text.when(integers[1].equals(4 * 1000)):
            integers[2] = 9

    x, y, integers = computed(body, W, NUMBERS, count)
    total, n = np.zeros(W), 1000 // 3
    for i in range(count):
        total = total + np.prod([x[i]] * (i + 1), axis=0)
        assert np.allclose(y[i], total, rtol=1e-14)
    while n >= count:
        n //= 3
    assert integers.tolist() == [2 * count, 4 * n, 0]


def test_a_name_is_not_a_value_of_python():
    text = Code(4)
    a = text.array("%x")[0]
    for misuse in (lambda: bool(a > 1.0), lambda: 1 if a else 0, lambda: not a, lambda: a**2):
        with pytest.raises(TypeError):
            misuse()
