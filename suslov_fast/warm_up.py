"""Calls that compile everything: later processes read it from the cache on disk."""

import inspect
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import product
from typing import Any

import numpy as np

import suslov_fast

from .maps import MAPS

# Few states are computed in one thread, many in parallel.
COUNTS = (3, 2**15)
_WITHOUT = "ensemble open_ensemble explore animate_body plot_phase compiled integrability".split()


def call_all() -> None:
    """Call all public functions, with all bodies."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for function, arguments in calls():
            with suppress(ValueError, TypeError):  # not of this body
                function(**arguments)


def calls() -> Iterator[tuple[Callable[..., Any], dict[str, Any]]]:
    """Yield public functions with their arguments; half of the states are at a pole."""
    names = [name for name in dir(suslov_fast) if name not in _WITHOUT]
    public = [getattr(suslov_fast, name) for name in names]
    for record, count in product(MAPS, COUNTS):
        variants: list[dict[str, Any]] = [{"method": name} for name in record.methods]
        variants += [{}, {"save_every": None}, {"attitude": True}, {"n": [0, 40]}]
        body, pole = record.sample
        states = np.random.default_rng(0).uniform(0.1, 1.0, (count, body.dimension))
        states[1::2] = pole
        known = {"body": body, "eps": 1.0, "steps": 40, "n": 40, "time": 0.5}
        known |= {"omega": states, "omega0": states, "xy": states, "x": 0.0 * states}
        for function, more in product(filter(inspect.isfunction, public), variants):
            wanted = inspect.signature(function).parameters
            if wanted.keys() >= more.keys():
                yield function, {k: v for k, v in (known | more).items() if k in wanted}
