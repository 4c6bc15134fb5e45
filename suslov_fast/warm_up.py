"""Calls that compile all functions, so that later processes read them from the cache on disk."""

import inspect
import os
import warnings
from contextlib import suppress
from itertools import product
from typing import Any

import numpy as np

import suslov_fast as sf

from .compiled import step
from .core.cache import folder_of
from .core.steps_3d import steps
from .maps import MAPS

# Numbers of states: the first is computed in one thread, the second in parallel.
COUNTS = (3, 2**15)
_STATES = "omega", "omega0", "xy", "x"  # names of the second argument, which are positional only
_NO_KERNELS = "animate_body", "compiled", "explore", "integrability"


def call_all() -> None:
    warnings.simplefilter("ignore")
    public = [getattr(sf, name) for name in dir(sf) if name not in _NO_KERNELS]
    rng = np.random.default_rng(0)
    problems: list[Any] = [
        (map, *map.pole, n) for map, n in product(MAPS.values(), COUNTS) if map.pole
    ]
    for map in MAPS.values():
        problems += [(map, make(rng, ()), 0.5, COUNTS[0]) for make in map.random]
    for map, body, pole, count in problems:
        states = rng.uniform(0.1, 1.0, (count, body.dimension))
        states[1::2] = pole
        known = {"body": body, "eps": 1.0, "steps": 40, "n": 40, "time": 0.5}
        known["surface"] = lambda x: x[..., 0] - 0.5
        known |= {"omega": states, "omega0": states, "xy": states, "x": 0.0 * states}
        variants: list[dict[str, Any]] = [{"method": name} for name in map.methods]
        variants += [{}, {"save_every": None}, {"attitude": True}, {"n": [0, 40]}]
        for function, more in product(filter(inspect.isfunction, public), variants):
            wanted = inspect.signature(function).parameters
            if wanted.keys() >= more.keys():
                given = {name: (known | more)[name] for name in wanted if name in known | more}
                first = [given.pop(name) for name in ("body", *_STATES) if name in given]
                if "I3" in wanted:  # the scheme in three components
                    first[1] = np.pad(states, [(0, 0), (0, 1)], constant_values=0.5)
                with suppress(ValueError, TypeError):  # not of this body
                    function(*first, **given)


def where_code_is_kept() -> str:
    """Return a line for users: the folder of the cache, or that there is none."""
    folders = [folder_of(compiled) for compiled in (steps.compiled, step)]
    paths = [path for path, _ in folders if path is not None]
    if len(paths) < len(folders):
        return (
            "nothing is kept: no folder can be written (NUMBA_CACHE_DIR names another one), or "
            "NUMBA_DISABLE_JIT or NUMBA_BOUNDSCHECK is set"
        )
    text = f"compiled code is kept in {os.path.commonpath(paths)}"
    return text if all(can for _, can in folders) else f"{text}, which cannot be written"
