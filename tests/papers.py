"""Fields of papers that several tests of the laboratory take."""

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
