"""Crossings of a surface on the steps of a method itself, where a chord is not enough.

The chord between two states has an error of O(eps**2), whatever the method. A point of the orbit
between them is the state after a step of the length tau from the state before, 0 <= tau <= eps, and
s has different signs at both ends. Chandrupatla's method keeps such a bracket: it takes a step of
inverse quadratic interpolation where that is safe, and halves the bracket elsewhere (T. R.
Chandrupatla, Adv. Eng. Software 28 (1997)).
"""

import numpy as np

_ROUNDS = 80  # of halves at worst
_WIDTH = 2.0**-50  # of a bracket, relative to the step, at which a crossing is found
# Interpolation has found a crossing where the product of its last two changes is below _PRODUCT,
# because the next change is smaller than that: if the last is a small part of the one before it, so
# that s is smooth there, or if it is rounding.
_PRODUCT, _SMALL, _ROUNDING = 2.0**-54, 2.0**-8, 2.0**-46


def crossing_fractions(values_at, first, at_start, at_end):
    """Return the fractions of a step at which crossings (K,) meet the surface, and where none does.

    A step with a pole within its length changes the sign of s through infinity: where the values
    beside the change exceed those at both ends, the fraction stays `first`.

    ``values_at(which, fractions)`` returns the values of the surface at these fractions of the
    steps of some crossings, `first` is where they are asked first, and `at_start` and `at_end` are
    the values at both ends of the steps. A value that is NaN counts as one beyond the crossing.
    """
    is_beyond = (at_start >= 0.0) != (at_end >= 0.0)
    largest, over_pole = np.maximum(abs(at_start), abs(at_end)), np.zeros(len(first), bool)
    k, fractions = np.flatnonzero(is_beyond), np.zeros(len(first))
    # a is the newest point, b the other end of the bracket, c the point before: rows x and s(x).
    x, (start, end) = first[k], (at_start[k], at_end[k])
    a = c = np.array([np.ones(len(k)), end])
    b = np.array([np.zeros(len(k)), start])
    with np.errstate(all="ignore"):
        for _ in range(_ROUNDS):
            if not k.size:
                break
            values = values_at(k, x)
            values = np.where(np.isnan(values), np.copysign(np.inf, end), values)
            is_same = (values >= 0.0) == (a[1] >= 0.0)
            c, b = np.where(is_same, a, b), np.where(is_same, b, a)
            a, x = np.array([x, values]), _next((x, values), b, c)
            change, before = abs(x - a[0]), abs(a[0] - c[0])
            is_smooth = (change <= _SMALL * before) | (change <= _ROUNDING)
            is_there = (change * before <= _PRODUCT) & is_smooth & (values != 0.0)
            best = np.where(abs(a[1]) <= abs(b[1]), a[0], b[0])
            fractions[k] = np.where(is_there, x, best)
            over_pole[k] = np.minimum(abs(a[1]), abs(b[1])) > largest[k]
            left = ~is_there & (abs(a[0] - b[0]) > _WIDTH)
            if not left.all():
                k, x, end = k[left], x[left], end[left]
                a, b, c = a[:, left], b[:, left], c[:, left]
    return np.where(over_pole, first, fractions), over_pole


def _next(a, b, c):
    """Return where to ask next in the brackets from a to b: by interpolation, or in the middle."""
    (xa, fa), (xb, fb), (xc, fc) = a, b, c
    xi, phi = (xa - xb) / (xc - xb), (fa - fb) / (fc - fb)
    is_safe = (phi**2 < xi) & ((1.0 - phi) ** 2 < 1.0 - xi)
    t = fa / (fb - fa) * fc / (fb - fc) + (xc - xa) / (xb - xa) * fa / (fc - fa) * fb / (fc - fb)
    least = np.minimum(0.5 * _WIDTH / abs(xb - xa), 0.5)
    t = np.clip(np.where(is_safe & np.isfinite(t), t, 0.5), least, 1.0 - least)
    return xa + t * (xb - xa)
