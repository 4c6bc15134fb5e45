"""Calls of all functions for all maps, which compile them and fill the cache on disk."""

import inspect
import os
import warnings
from contextlib import suppress
from itertools import product
from typing import Any

import numpy as np

import suslov_fast as sf

from ..compiled import step
from ..core.compiling import numba as compiling
from ..core.compiling.cache import folder_of
from ..core.suslov.steps import steps
from ..engine import threads
from ..maps import MAPS

FEW, MANY = 3, 256  # states of calls in one thread, and in parallel: blocks for two threads
# Names of the second argument, which is positional only.
_STATES = "omega", "omega0", "xy", "x", "x0"
_NO_KERNELS = "compiled", "explore", "integrability", "show_versions"


def call_all() -> None:
    """Call every public function with every kind of argument for which a kernel is compiled."""
    warnings.simplefilter("ignore")
    public = [getattr(sf, name) for name in dir(sf) if name not in _NO_KERNELS]
    rng = np.random.default_rng(0)
    problems = [
        (map, body, pole, count)
        for map, count in product(MAPS.values(), (FEW, MANY))
        for body, pole in _bodies(map.body)
    ]
    crossover, patience = threads.CROSSOVER, compiling.PATIENCE
    compiling.PATIENCE = -1.0  # nothing runs as Python
    for map, body, pole, count in problems:
        threads.CROSSOVER = 0 if count == MANY else crossover
        states = rng.uniform(0.1, 1.0, (count, body.dimension))
        states[1::2] = pole
        values = {"body": body, "system": body, "eps": 1.0, "steps": 40, "n": 40, "time": 0.5}
        values["surface"] = lambda x: x[..., 0] - 0.5
        values |= {"omega": states, "omega0": states, "xy": states, "x": 0.0 * states}
        values["x0"] = states
        variants: list[dict[str, Any]] = [{"method": name} for name in map.methods]
        variants += [{}, {"save_every": None}, {"attitude": True}, {"n": [0, 40]}]
        variants += [{"x": states}]  # at poles, too; at 0 multipliers have a value
        for function, options in product(filter(inspect.isfunction, public), variants):
            names, known = inspect.signature(function).parameters, values | options
            if "steps" in names:  # along the map, not along the motion
                del known["time"]
            if options.keys() <= names.keys():
                keywords = {name: known[name] for name in names if name in known}
                positional = [
                    keywords.pop(k) for k in ("body", "system", *_STATES) if k in keywords
                ]
                if "I3" in names:  # `step_full`, whose states have three components
                    positional[1] = np.pad(states, [(0, 0), (0, 1)], constant_values=0.5)
                # Some functions do not take this body; drawings need an extra.
                with suppress(ValueError, TypeError, ImportError):
                    function(*positional, **keywords)
    threads.CROSSOVER, compiling.PATIENCE = crossover, patience


def _bodies(kind: type[Any]) -> list[tuple[Any, Any]]:
    """Return bodies of a class, each with a state; the first has no next one for eps = 1."""
    if kind is sf.Suslov3D:
        return [
            (sf.Suslov3D(1, 1, 0.25, 0, 1.5), (4.0, -12.0)),
            (sf.Suslov3D(4, 2, -0.5, -0.3), 0.5),
        ]
    if kind is sf.SuslovGyrostat:
        gyrostat = sf.SuslovGyrostat(4, 2, -0.5, -0.3, 0.7)
        return [(sf.SuslovGyrostat(1, 1, 1, 0, 0.5), (1.0, -3.875)), (gyrostat, 0.5)]
    if kind is sf.SuslovND:
        return [
            (sf.SuslovND([4.0, 1.0, 1.0], [0.5, 0.25, -0.25]), (-2.0, 6.0, -6.0)),
            (sf.SuslovND([1.3, 2.1, 3.7, 1.9], [0.4, -0.7, 0.5, 0.2]), 0.5),
            (sf.SuslovND([2.0, 2.0, 2.0], [0.4, -0.7, 0.5]), 0.5),
        ]
    dense = sf.QuadraticField(*(np.full((5,) * axes, 0.1) for axes in (3, 2, 1)))
    return [(sf.QuadraticField([[[1]]]), 1.0), (dense, 0.5)]


def where_code_is_kept() -> str:
    """Return a line for users: the folder of the cache, or why nothing is kept."""
    folders = [folder_of(compiled) for compiled in (steps.compiled, step)]
    if None in folders:
        return (
            "nothing is kept: no folder can be written (NUMBA_CACHE_DIR names another one), or "
            "NUMBA_DISABLE_JIT or NUMBA_BOUNDSCHECK is set"
        )
    text = f"compiled code is kept in {os.path.commonpath(folders)}"
    is_writable = all(os.access(folder, os.W_OK) for folder in folders)
    return text if is_writable else f"{text}, which cannot be written"
