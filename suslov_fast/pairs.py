"""Complex variables as pairs of real ones, `z.real` and `z.imag`: names, values, states.

The engine computes with real numbers only. A complex variable z has two places in its states, with
the names z.real and z.imag, and a complex parameter has two values. Users see z alone.
"""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

_RE, _IM = ".real", ".imag"


def split_names(names: Sequence[str], chosen: Sequence[str]) -> tuple[str, ...]:
    """Return names in which a pair replaces each of the `chosen` ones."""
    if unknown := [name for name in chosen if name not in names]:
        raise ValueError(f"complex must be True, or names of variables, not {unknown[0]!r}")
    pairs = ((name + _RE, name + _IM) if name in chosen else (name,) for name in names)
    return tuple(part for pair in pairs for part in pair)


def has_pairs(names: Sequence[str]) -> bool:
    """Return True if some variables or parameters are complex."""
    return any(name.endswith(_IM) for name in names)


@lru_cache(64)
def whole(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return names in which z replaces the pair z.real, z.imag."""
    return tuple(each.removesuffix(_RE) for each in names if not each.endswith(_IM))


def split_values(values: Mapping[str, Any], known: Sequence[str] = ()) -> dict[str, Any]:
    """Return values by name, with pairs in place of complex ones, and of pairs that are `known`."""
    parts: dict[str, Any] = {}
    for name, value in values.items():
        if name + _RE in known or np.asarray(value).dtype.kind == "c":
            array = np.asarray(value)
            parts |= {name + _RE: array.real[()], name + _IM: array.imag[()]}
        else:
            parts[name] = value
    return parts


def split_states(name: str, value: Any, names: tuple[str, ...]) -> Any:
    """Return states (..., D) of the engine for states (..., n) with complex components."""
    known = whole(names)
    if isinstance(value, Mapping):
        if {*value} != {*known}:
            raise ValueError(f"{name} must be a value for each of {', '.join(known)}")
        value = np.stack(np.broadcast_arrays(*(value[each] for each in known)), axis=-1)
    array = np.asarray(value)
    kind, of_engine = array.dtype.kind, array.shape[-1:] == (len(names),)
    if kind not in "iufc" or (of_engine and kind != "c"):
        return value
    if len(known) == 1 and array.shape == ():
        array = array[np.newaxis]
    if array.shape[-1:] != (len(known),):
        last = f", with {', '.join(known)} on the last axis" if len(known) <= 8 else ""
        raise ValueError(f"{name} must have the shape (..., {len(known)}){last}, not {array.shape}")
    of = [known.index(each.removesuffix(_RE).removesuffix(_IM)) for each in names]
    is_imag = [each.endswith(_IM) for each in names]
    for k, each in enumerate(known):
        if each in names and np.any(array[..., k].imag):
            raise ValueError(f"{name} must be real in {each}, which is no complex variable")
    return np.where(is_imag, array.imag[..., of], array.real[..., of])


def joined(body: Any, states: Any) -> Any:
    """Return states (..., n) with complex components for states (..., D) of the engine."""
    names, known = body._labels, body._shown
    if len(known) == len(names):
        return states
    if len(names) == 2 * len(known):
        return np.ascontiguousarray(states).view(complex)
    real = [k for k, each in enumerate(names) if not each.endswith(_IM)]
    result = states[..., real].astype(complex)
    pairs = [k for k, each in enumerate(known) if each not in names]
    result.imag[..., pairs] = states[..., [real[k] + 1 for k in pairs]]
    return result


def of_parts(run: Any, names: Sequence[Any]) -> tuple[Any, Sequence[Any]]:
    """Return a run with the states of the engine, and names of components to draw."""
    body = run.body
    if len(body._shown) == len(body._labels):
        return run, names
    pairs = {a: (a + _RE, a + _IM) for a in body._shown if a not in body._labels}
    lists = [a for name in names if isinstance(name, (list, tuple)) for a in name]
    if len(names) == 1 and names[0] in pairs:
        names = pairs[names[0]]  # the complex plane
    elif lists or {*names} & {*pairs}:
        parts = [part for a in lists or names[1:] for part in pairs.get(a, (a,))]
        names = names[0], parts
    states = split_states("states", run.states, body._labels)
    return type(run)._of({**vars(run), "states": states}), names
