"""Solutions and their derivatives to 20 digits and more, by power series of many digits."""

import flint
import numpy as np

ORDER, DIGITS, CHANGE = 40, 60, 20  # of series; of numbers; of what differences are taken with


def _solution(f, x, time, step, parameters):
    count = int(np.ceil(time / step))
    h = flint.arb(time) / count
    for _ in range(count):
        series = [flint.arb_series([a]) for a in x]
        for known in range(ORDER):  # each time one more term is right
            flint.ctx.cap = known + 2
            rates = [flint.arb_series([0]) + a for a in f(series, **parameters)]
            series = [rate.integral() + a for a, rate in zip(x, rates, strict=True)]
        x = [_sum(each.coeffs(), h).mid() for each in series]
    return x


def _sum(coefficients, h):
    total = flint.arb(0)
    for c in reversed(coefficients):
        total = total * h + c
    return total


def solution_and_derivatives(f, x, time, step, **parameters):
    """Return the state (D,), its derivatives by x (D, D), and by each parameter (D,), by name."""
    previous = flint.ctx.dps, flint.ctx.cap
    flint.ctx.dps, flint.ctx.cap = DIGITS, ORDER + 1
    try:
        change = flint.arb(10) ** -CHANGE
        x, values = [flint.arb(a) for a in x], {n: flint.arb(a) for n, a in parameters.items()}

        def derivative(moved):
            plus, minus = (_solution(f, *moved(k * change)) for k in (1, -1))
            return [float((a - b) / (2 * change)) for a, b in zip(plus, minus, strict=True)]

        def by_start(j, c):
            return [a + c * (i == j) for i, a in enumerate(x)], time, step, values

        def by_parameter(name, c):
            return x, time, step, values | {name: values[name] + c}

        end = np.array([float(a) for a in _solution(f, x, time, step, values)])
        starts = [derivative(lambda c, j=j: by_start(j, c)) for j in range(len(x))]
        others = {
            name: np.array(derivative(lambda c, name=name: by_parameter(name, c)))
            for name in parameters
        }
        return end, np.array(starts).T, others
    finally:
        flint.ctx.dps, flint.ctx.cap = previous
