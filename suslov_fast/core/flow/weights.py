"""The columns of an extrapolated step, and their weights.

Column c divides a step of length h from x into N_c equal sub-steps, and ends at y_c. Its error has
an expansion in (h / N_c)**p. Weights that cancel the first terms (Aitken and Neville) give

x_next = x + sum_c w_c (y_c - x),     w_c = prod_{b != c} N_c**p / (N_c**p - N_b**p).

The explicit integrator has p = 2 and the order ORDER (`gragg`). The implicit integrator has p = 1;
its seven columns have order 7 and R(inf) = 0, and are stable in a sector of 89.9 degrees
(`linearly_implicit`). The sum of the moduli of their weights, which multiplies rounding errors, is
121. With N_c = 2, 3, ..., 9 it would be 9851.
"""

from math import prod

IMPLICIT = 2, 3, 4, 6, 8, 12, 16
QUARTERS = 4, 8, 12, 16  # implicit columns with sub-steps that end at 1/4, 1/2 and 3/4 of a step

EXPLICIT = 2, 4, 6, 8, 10
ORDER = 2 * len(EXPLICIT)


def weights(columns, p):
    """Return weights w_c of columns with N_c in `columns`, for errors in powers of (h / N)**p."""
    return [  # integers are exact, so each weight is rounded once
        n ** (p * (len(columns) - 1)) / prod(n**p - m**p for m in columns if m != n)
        for n in columns
    ]


def weights_of_errors(columns, p):
    """Return error weights w_c - v_c; v_c are `weights` without the first of `columns`."""
    without = [0.0, *weights(columns[1:], p)]
    return [w - v for w, v in zip(weights(columns, p), without, strict=True)]
