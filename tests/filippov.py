"""Filippov's solutions by SciPy: modes of surfaces by enumeration of all that are consistent.

Nothing here comes from the package. f(x, sides) is the right-hand side with the sides (1 or -1) of
the surfaces s(x), and slopes(x) their gradients (n, D). A mode is 1, -1, or 0 for a surface along
which the solution slides. There f moves by w (f above - f below), with the w at which ds/dt = 0.
"""

import itertools

import numpy as np
from scipy.integrate import solve_ivp

ON, BESIDE = 1e-9, 1e-12  # the largest s on a surface; w this far beyond [0, 1] is rounding


class Undecided(ArithmeticError):
    """No modes are consistent, or several are."""


def rates(f, slopes, x, modes):
    """Return Filippov's right-hand side (D), and w of the surfaces that slide, in their order."""
    base = np.where(np.equal(modes, 0), -1, modes)
    slides = np.flatnonzero(np.equal(modes, 0))
    below = np.asarray(f(x, base), float)
    if not len(slides):
        return below, np.empty(0)
    jumps = []
    for g in slides:
        above = base.copy()
        above[g] = 1
        jumps.append(np.asarray(f(x, above), float) - below)
    jumps, normals = np.array(jumps), np.asarray(slopes(x), float)[slides]
    w = np.linalg.solve(normals @ jumps.T, -normals @ below)
    return below + w @ jumps, w


def _leads_there(f, slopes, x, modes, places):
    """Return True if the solution with these modes stays on the side, or slides in [0, 1]."""
    try:
        rate, w = rates(f, slopes, x, modes)
    except np.linalg.LinAlgError:
        return False
    if ((w < -BESIDE) | (w > 1 + BESIDE)).any():
        return False
    away = np.asarray(slopes(x), float) @ rate
    if any(modes[g] and modes[g] * away[g] < -ON for g in places):
        return False
    for g in places:  # both sides have to lead to a surface along which it slides
        if not modes[g]:
            for side in (1, -1):
                own = np.array(modes)
                own[g] = side
                try:
                    rate, _ = rates(f, slopes, x, own)
                except np.linalg.LinAlgError:
                    return False
                if side * (np.asarray(slopes(x), float)[g] @ rate) > ON:
                    return False
    return True


def _decided(f, slopes, x, modes, places):
    found = []
    for own in itertools.product((1, -1, 0), repeat=len(places)):
        new = np.array(modes)
        new[places] = own
        if _leads_there(f, slopes, x, new, places):
            found.append(new)
    if len(found) > 1:  # a surface that is just left counts as left
        found = [new for new in found if not _is_tangent(f, slopes, x, new)] or found[:1]
    if len(found) != 1:
        raise Undecided(f"{len(found)} modes at {x}")
    return found[0]


def _is_tangent(f, slopes, x, modes):
    """Return True if a surface that slides is just left: its w is 0 or 1."""
    w = rates(f, slopes, x, modes)[1]
    return bool((np.minimum(abs(w), abs(w - 1)) < 1e-8).any())


def _ending(f, s, slopes, modes, g, upper):
    """Return SciPy's event where the mode of surface g ends; if `upper`, slides end at w = 1."""
    place = np.count_nonzero(modes[:g] == 0)

    def event(_, x):
        if modes[g]:
            return modes[g] * s(x)[g]
        w = rates(f, slopes, x, modes)[1][place]
        return 1 - w if upper else w

    event.terminal, event.direction = True, -1
    return event


def solution(f, s, x, time, most=400, rtol=1e-11, atol=1e-13, max_step=0.1):
    """Return the state at the last time, and the list of changes (time, surface, mode).

    SciPy misses two crossings within one step, so `max_step` bounds the steps.
    """
    x, t, changes = np.array(x, float), 0.0, []

    def slopes(x):  # by a complex step
        return np.imag([s(x + step) for step in 1e-30j * np.eye(len(x))]).T / 1e-30

    values = np.asarray(s(x), float)
    modes = np.where(values > 0, 1, -1)
    on = np.flatnonzero(abs(values) <= ON)
    modes = _decided(f, slopes, x, modes, on) if len(on) else modes
    for _ in range(most):
        ends = [
            (g, upper) for g, mode in enumerate(modes) for upper in (False, True)[: 2 - abs(mode)]
        ]
        events = [_ending(f, s, slopes, modes, *end) for end in ends]
        run = solve_ivp(
            lambda _, x, own=modes: rates(f, slopes, x, own)[0], (t, time), x,
            method="DOP853", rtol=rtol, atol=atol, events=events, max_step=max_step,
        )  # fmt: skip
        t, x = run.t[-1], run.y[:, -1]
        if run.status == 0:
            return x, changes
        hit = next(g for (g, _), times in zip(ends, run.t_events, strict=True) if len(times))
        values = np.asarray(s(x), float)
        places = [g for g in range(len(modes)) if g == hit or abs(values[g]) <= ON]
        before = modes
        modes = _decided(f, slopes, x, modes, places)
        if (modes == before).all():
            raise Undecided(f"nothing changes at {x}")
        changes += [(t, g, int(modes[g])) for g in np.flatnonzero(modes != before)]
    raise Undecided("too many changes")
