"""The columns of an extrapolated step, and their weights.

Column c divides a step of length h from x into N_c equal sub-steps, and ends at y_c. Its error has
an expansion in (h / N_c)**p. Weights that cancel the first terms (Aitken and Neville) give

x_next = x + sum_c w_c (y_c - x),     w_c = prod_{b != c} N_c**p / (N_c**p - N_b**p).

The explicit integrator has p = 2, and with n columns the order 2 n (`gragg`). The implicit
integrator has p = 1; its k columns have order k and R(inf) = 0, and are stable in a sector of 89.9
degrees (`linearly_implicit`). The sum of the moduli of weights multiplies rounding errors. It is 13
for OF_10 and OF_12; with N_c = 2, 4, ..., 12 it would be 26. It is 121 for OF_7, 163 for OF_9, and
89 for OF_11; with N_c = 2, 3, ..., 9 it would be 9851.

A rate mu with h |mu| between 1 and 1e6 reduces the order of implicit steps to 2 in steps with
errors below a bound: 1e-6 of the solution for 7 columns, and about 9 times less for each more. So a
close rtol has more columns. In 22 stiff problems OF_11 takes 1.1 times the sub-steps of OF_9 at
rtol 1e-10, .97 at 1e-11, .77 at 1e-12; and where rounding errors limit the steps (late times of
Robertson's problem) two thirds of the steps of 2, 3, ..., 32, 48, 64.
"""

from math import prod

from .tolerances import RTOL_OF_9, RTOL_OF_11, RTOL_OF_12

QUARTERS = 4, 8, 12, 16  # implicit columns with sub-steps that end at 1/4, 1/2 and 3/4 of a step

OF_10, OF_12 = (2, 4, 6, 8, 10), (2, 4, 6, 8, 10, 14)  # explicit columns
OF_7 = 2, 3, 4, 6, 8, 12, 16  # implicit columns
OF_9, OF_11 = (*OF_7, 24, 32), (*OF_7, 24, 36, 56, 80)


def explicit_columns(rtol, has_surfaces):
    """Return the numbers N of sub-steps in explicit columns: OF_10, or OF_12 if rtol is small.

    At equal errors OF_12 takes 5 to 25 percent fewer evaluations of f below 1e-11, but up to 20
    percent more above 1e-9. If steps may end on surfaces, the order is 10, for which the search for
    hidden crossings was measured: it needs steps that are not longer.
    """
    return OF_12 if rtol <= RTOL_OF_12 and not has_surfaces else OF_10


def implicit_columns(rtol, has_surfaces):
    """Return the numbers N of sub-steps in implicit columns: more of them if rtol is small."""
    if rtol >= RTOL_OF_9:
        return OF_7
    return OF_9 if rtol >= RTOL_OF_11 else OF_11


def lanes_of(columns):
    """Return the columns that each lane takes in turn, by their numbers N of sub-steps.

    The numbers in a lane have the largest N as their sum: (10,), (8, 2), (6, 4) for five columns. A
    lane may repeat a column, and further lanes repeat the longest, to fill the register.
    """
    last, lanes, left = max(columns), [], sorted(columns, reverse=True)
    while left:
        rest, own = last, []
        while rest:
            fits = [N for N in left if rest >= N] or [N for N in columns if rest >= N]
            own.append(max(fits))
            rest, left = rest - own[-1], [N for N in left if own[-1] != N]
        lanes.append(tuple(own))
    return *lanes, *[(last,)] * (-len(lanes) % 4)


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
