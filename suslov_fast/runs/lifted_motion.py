"""The motion of a field at given times, to a tolerance: `flow` of fields."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from .. import checks
from ..checks import FloatArray, first_index, require, spell, wrong
from ..core.flow import Motion, flow_kernel
from ..core.single_motion import motion_of_one
from ..core.tolerance import MOST_STEPS, stage_of
from ..engine.arguments import ALL, alike, by_field, flat_arrays, lift_of, words_of
from ..engine.problem import Problem, part_of
from ..engine.status import PoleWarning
from ..engine.stretches import Progress, Report, reporter
from ..engine.threads import available, call_kernel

DEFAULT, LEAST, MOST = 1e-9, 1e-13, 1e-2
# Trajectories of a `Motion`, and steps of the map for one, by which threads are chosen.
_CHUNK, _USUAL = 2**12, 600
# An added variable above it is worth a word if steps become ever shorter; the part of the time up
# to there at which it is computed; and the most words of a field for which it is.
_STEEP, _SHORTLY_BEFORE, _FEW_WORDS = 1e6, 1 - 1e-6, 50


def checked_tolerance(rtol: Any) -> float:
    """Return `rtol`, or its default for None."""
    if rtol is None:
        return DEFAULT
    number = checks.real_number("rtol", rtol)
    if not isinstance(number, float) or not LEAST <= number <= MOST:
        raise wrong("rtol", f"a number from {LEAST:g} to {MOST:g}", checks.short(rtol))
    return number


def motion(problem: Problem, times: FloatArray, rtol: float, progress: Progress) -> FloatArray:
    """Return the states (N, ..., D) at times (N,), NaN where a solution has ended."""
    x0, D = flat_arrays(problem.omega, problem.batch), problem.body.dimension
    require(8 * (len(times) + 8) * x0.size, "compute fewer states at a time")
    if len(x0) == 1 and not progress:
        one: FloatArray | None = _of_one(problem, x0[0].tolist(), times.tolist(), rtol)
        if one is not None:
            return one.reshape(len(times), *problem.batch, D)
    states = np.full((len(times), *x0.shape), np.nan)
    undefined = np.asarray(np.isnan(x0).any(axis=1))
    ended, ends, are_long = _no_ends(len(x0))
    done = int(np.count_nonzero(times == 0.0))
    if done:
        states[times == 0.0] = np.where(undefined[:, np.newaxis], np.nan, x0)
    goes_on = True

    def told(count: int) -> bool:
        """Report that so many more times are done; return whether to go on."""
        nonlocal done, goes_on
        done += count
        goes_on = report is None or report(done)
        return goes_on

    with reporter(progress, len(times)) as report:
        for direction in (1, -1):
            rows = np.flatnonzero(direction * times > 0.0)
            if not rows.size or not goes_on:
                continue
            where: Any = slice(None)
            later, counts = abs(times[rows]), [1] * len(rows) if report else []
            if (later[1:] <= later[:-1]).any():
                later, where, number = np.unique(later, return_inverse=True, return_counts=True)
                counts = number.tolist() if report else []
            arguments = problem, x0, later, direction, rtol
            found, now_ended, at, now_long = _in_direction(*arguments, counts, told)
            states[rows] = found[where]
            ends = np.where(now_ended & ~ended, direction * at, ends)
            are_long |= now_long & ~ended
            ended |= now_ended
    if ended.any():
        last = float(times[np.argmax(abs(times))])
        _warn_of_ends(problem, last, rtol, ended & ~undefined, ends, are_long)
    return states.reshape(len(times), *problem.batch, D)


def _of_one(problem: Problem, x: list[float], times: list[float], rtol: float) -> FloatArray | None:
    """Return the states (N, D) of one trajectory at ascending times, None for other times."""
    if lift_of(problem.body) or not times or times[0] <= 0.0 or any(map(math.isnan, x)):
        return None
    if any(later <= time for time, later in itertools.pairwise(times)):
        return None
    indices, values, _ = by_field(problem.body, 1.0, problem.batch)
    step = stage_of(indices, len(x))
    found = motion_of_one(step, values[0], x, rtol, 1, times) if len(values) == 1 else None
    if found is None:
        return None
    states, (ended, end, is_long) = found
    if ended:
        _warn_of_ends(problem, times[-1], rtol, *map(np.atleast_1d, (ended, end, is_long)))
    return np.frombuffer(states).copy()


def _in_direction(
    problem: Problem,
    x0: FloatArray,
    times: FloatArray,
    direction: int,
    rtol: float,
    counts: Sequence[int],
    told: Report,
) -> tuple[FloatArray, Any, FloatArray, Any]:
    """Return states at ascending moduli of times, and those of `Motion.ends`.

    With `counts`, all trajectories reach a time before the next one, and `told` takes its count; if
    it returns False, states at later times are NaN.
    """
    indices, values, eps = by_field(problem.body, 1.0, problem.batch)
    out, groups = np.full((len(times), *x0.shape), np.nan), []
    motions: list[Any] = []
    outs: list[FloatArray] = []
    threads = problem.threads or available()
    words, lift = words_of(problem.body), lift_of(problem.body)
    for where, own, v, _ in alike(indices, values, eps):
        step, x = stage_of(own, words, lift), x0[where]
        states = out if where is ALL else np.full((len(times), *x.shape), np.nan)
        size = min(max(-(-len(x) // (8 * threads)) * 8, 8), _CHUNK)
        parts = [slice(first, min(first + size, len(x))) for first in range(0, len(x), size)]
        for part in parts:
            of_part = v[part] if len(v) > 1 else v
            motions.append(Motion(step, of_part, x[part], rtol, direction, times[-1]))
            outs.append(states[:, part])
        groups.append((where, states, len(parts)))
    cost = sum(m.B * max(len(m.step.usual), m.step.D**3) for m in motions) // 10
    if not counts:
        call_kernel(flow_kernel, cost * _USUAL, problem.threads, motions, times, outs)
    else:
        for k, count in enumerate(counts):
            at_once, work = [each[k : k + 1] for each in outs], cost * _USUAL // len(times)
            call_kernel(flow_kernel, work, problem.threads, motions, times[k : k + 1], at_once)
            if not told(count):
                break
    all_ends = _no_ends(len(x0))
    left = iter(motions)
    for where, states, count in groups:
        of_parts = [next(left).ends() for _ in range(count)]
        if of_parts:
            for of_all, each in zip(all_ends, zip(*of_parts, strict=True), strict=True):
                of_all[where] = np.concatenate(each)
        if where is not ALL:
            out[:, where] = states
    return out, *all_ends


def _no_ends(count: int) -> tuple[Any, FloatArray, Any]:
    """Return what `Motion.ends` returns before the first step."""
    return np.zeros(count, bool), np.zeros(count), np.zeros(count, bool)


def _warn_of_ends(
    problem: Problem, last: float, rtol: float, ended: Any, ends: FloatArray, are_long: Any
) -> None:
    """Warn of solutions that end, and of those that take too many steps."""
    if (which := ended & ~are_long).any():
        text = _first_of(which, "end", "near", problem, ends)
        at_once = (which & (ends == 0.0)).reshape(problem.batch)
        if at_once.any():
            why = problem.body._without_value(problem.omega, at_once)
            of_first = f"at the start of trajectory {spell(first_index(at_once))}"
            why = why or f"{of_first} the field overflows, or is too fast for any step"
            text += f"; {why}"
        checks.warn(text, PoleWarning)
    if (which := ended & are_long).any():
        verb = f"take more than {MOST_STEPS:,} steps from one time to the next"
        text = _first_of(which, verb, "at", problem, ends)
        how = f"increase rtol, or pass times between: np.linspace(0, {last:g}, 101)"
        first = int(np.argmax(which))
        why = _steepness(problem, float(ends[first]), first, rtol)
        checks.warn(f"{text}; later states are NaN: {why or how}", RuntimeWarning)


def _steepness(problem: Problem, end: float, b: int, rtol: float) -> str:
    """Return which definition of a lifted field is very large where a solution ends, or "".

    It takes the motion again, which would take minutes for many words.
    """
    if lift_of(problem.body) is None or words_of(problem.body) > _FEW_WORDS:
        return ""
    place = np.unravel_index(b, problem.batch)
    one = part_of(problem, tuple(slice(int(k), int(k) + 1) for k in place))
    x0, before = flat_arrays(one.omega, one.batch), np.array([abs(end) * _SHORTLY_BEFORE])
    states, *_ = _in_direction(one, x0, before, int(np.sign(end)), rtol, [], lambda _: True)
    definition, size = problem.body._steepest(states[0, 0], place, problem.batch)
    how = "the equations are not smooth where it is infinite; pass times before that"
    return f"{definition} grows to {size:.2g}: {how}" if size > _STEEP else ""


def _first_of(which: Any, verb: str, where: str, problem: Problem, ends: FloatArray) -> str:
    """Return what so many solutions do, and where the first of them does it."""
    first, time = spell(first_index(which.reshape(problem.batch))), ends[int(np.argmax(which))]
    text = f"{np.count_nonzero(which)} of {which.size} solutions {verb}"
    return f"{text}; first: {first} {where} t = {time:.9g}"
