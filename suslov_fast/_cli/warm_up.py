"""`suslov-fast warm-up`: compile all kernels."""

from __future__ import annotations

import argparse
import inspect
import itertools
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np

import suslov_fast as sf

from .._maps import MAPS, map_of
from .terminal import progress_bar

# Calls with few trajectories are serial, those with many parallel.
_COUNTS = (3, 2**15)
_WARM_STEPS = 40
# Functions that call others.
_WITHOUT = ("plot", "animate", "ensemble", "open", "explore")


def warm_up(options: argparse.Namespace) -> str:
    """Call all functions, and return the time that it took."""
    begin = time.perf_counter()
    jobs = list(_jobs())
    with progress_bar("compiling") as progress, warnings.catch_warnings():
        warnings.simplefilter("ignore", sf.SingularStepWarning)
        for k, (_, job) in enumerate(jobs):
            job()
            progress(k + 1, len(jobs))
    return f"compiled in {time.perf_counter() - begin:.1f} s"


def _jobs() -> Iterator[tuple[str, Callable[[], int]]]:
    """Yield calls of every public function, each with its name."""
    maps = MAPS.values()
    samples = [each for record in maps for each in record.samples if map_of(each[0]) is record]
    for count, (body, pole), name in itertools.product(_COUNTS, samples, dir(sf)):
        function = getattr(sf, name)
        if inspect.isfunction(function) and not name.startswith(_WITHOUT):
            yield name, partial(_call, function, body, pole, count)
        if name == "iterate":  # in n dimensions batches of bodies have kernels of their own
            parameters = {key: np.stack([each] * count) for key, each in body._arrays.items()}
            yield name, partial(_call, function, body._of(parameters), pole, count)


def _call(function: Callable[..., Any], body: Any, pole: Any, count: int) -> int:
    """Call a function in all variants that apply to the body, and return the number of calls."""
    parameters = inspect.signature(function).parameters
    known = _arguments(body, pole, count, function.__name__.endswith("_full"))
    names = [name for name, each in parameters.items() if each.default is each.empty]
    if not known.keys() >= set(names):
        return 0
    arguments = {name: known[name] for name in names}
    choices = {
        "method": map_of(body).methods,
        "save_every": (1, None),
        "attitude": (False, True),
        "eps": (None, 1.0),
        "n": (_WARM_STEPS, [0, 1, _WARM_STEPS]),
        "time": (0.5, [0.0, 0.5]),
    }
    # A parameter of the same name may have another meaning and default.
    varied = [
        [(name, value) for value in values]
        for name, values in choices.items()
        if name in parameters and parameters[name].default in (values[0], inspect.Parameter.empty)
    ]
    calls = 0
    for chosen in itertools.product(*varied):
        with suppress(ValueError, TypeError):  # not of this body
            function(**arguments | dict(chosen))
            calls += 1
    return calls


def _arguments(body: Any, pole: Any, count: int, full: bool) -> dict[str, Any]:
    starts = np.random.default_rng(0).uniform(0.1, 1.0, (count, body.dimension + full))
    # Half of the states are poles, where orbits end.
    starts[1::2, : len(pole)] = pole
    states = starts
    if not full:
        states = sf.iterate(body, starts, 1.0, 8, on_singular="ignore").states
    common = {"body": body, "eps": 1.0, "steps": _WARM_STEPS, "n": _WARM_STEPS, "time": 0.5}
    return {**common, "omega": states, "omega0": starts, "xy": states, "x": 0 * starts}
