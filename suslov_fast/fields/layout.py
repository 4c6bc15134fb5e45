"""The layout of states: the variables that users see, and the components of the engine.

The engine computes with real numbers only, and has no time: a complex variable z has two
components, z.real and z.imag, and the time t of a function f(t, y) is the last component, with the
rate 1. Users see z, and no t. This file alone knows both; names with suffixes are read here only.
If nothing reads the time, there is no such component, and the time at a start changes nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from .. import checks
from ..checks import FloatArray, short, wrong

_RE, _IM = ".real", ".imag"
CLOCK = "t"  # the component for the time of a function f(t, y)
TIME = {"t", "time"}  # names of the time, as an argument of f


class Layout:
    """The variables of users, and the components that hold them; it does not change.

    names       the n variables of users: "z", "g"
    parts       the real numbers that hold them: "z.real", "z.imag", "g"
    components  the D components of the engine: the parts, then "t" if there is a hidden time
    clock       the number of the component that is the hidden time, or None
    is_plain    True if users and the engine have the same states
    """

    def __init__(self, parts: Sequence[str], has_time: bool = False) -> None:
        self.parts = tuple(parts)
        self.components = (*self.parts, CLOCK) if has_time else self.parts
        self.D, self.size = len(self.components), len(self.parts)
        self.clock = self.size if has_time else None
        self._first = [i for i, name in enumerate(self.parts) if not name.endswith(_IM)]
        self.names = tuple(self.parts[i].removesuffix(_RE) for i in self._first)
        self._is_pair = [self.parts[i].endswith(_RE) for i in self._first]
        self._second = [i for i, name in enumerate(self.parts) if name.endswith(_IM)]
        self.n, self.has_pairs = len(self.names), any(self._is_pair)
        self.is_plain = not (has_time or self.has_pairs)

    @property
    def key(self) -> tuple[Any, ...]:
        """What == of fields compares: kinds of variables, without their names."""
        return self.D, self.clock, self.has_pairs and tuple(self._is_pair)

    @property
    def entries(self) -> dict[str, Any]:
        """What files say of the components, see `layout_read`."""
        return {"names": [*self.components], **({} if self.clock is None else {"time": CLOCK})}

    def __reduce__(self) -> Any:
        return layout_of, (self.parts, self.clock is not None)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Layout) and self.__reduce__() == other.__reduce__()

    def __hash__(self) -> int:
        return hash(self.__reduce__()[1])

    @property
    def time_variable(self) -> str:
        """The name of a variable of users that is the time; "" if there is none."""
        return next((name for name in self.names if name in TIME), "")

    @property
    def timed(self) -> Layout:
        """The layout with a hidden time."""
        return self if self.clock is not None else layout_of(self.parts, True)

    @property
    def untimed(self) -> Layout:
        """The layout without a hidden time."""
        return self if self.clock is None else layout_of(self.parts)

    # ------------------------------------------------------------------------------ states
    def states(self, name: str, value: Any) -> Any:
        """Return checked states of users (..., n); a state with any NaN becomes all NaN."""
        if not self.has_pairs:
            return checks.states(name, value, self.names)
        value = checks.unlabelled(name, value, self.names, lambda _, each: np.asarray(each))
        array = np.asarray(value)
        if array.dtype.kind != "c":
            return checks.states(name, value, self.names).astype(complex)
        x = checks.states(name, np.array(array.real), self.names).astype(complex)
        x.imag = checks.states(name, np.array(array.imag), self.names)
        for k, each in enumerate(self.names):
            if not self._is_pair[k] and (abs(x[..., k].imag) > 0.0).any():  # NaN may have any
                raise wrong(name, f"real in {each}, which is no complex variable", short(value))
        return np.where(np.isnan(x).any(axis=-1, keepdims=True), complex(np.nan, np.nan), x)

    def enter(self, name: str, value: Any, time: Any = None, called: str = "t0") -> FloatArray:
        """Return states of the engine (..., D) for states of users at a time, by default 0."""
        if type(value) not in checks.PLAIN:
            value, time = checks.start_of(value, time)
        if time is None and self.is_plain:  # for speed in small calls
            return checks.states(name, value, self.names)
        x = self.states(name, value)
        if time is None:
            return self._components(x)
        if own := self.time_variable:
            raise wrong(called, f"left out, because {own} is a variable in {name}", error=TypeError)
        t = np.asarray(checks.real_number(called, time))
        batch = checks.common_shape({name: x.shape[:-1], called: t.shape})
        x = np.broadcast_to(x, (*batch, self.n))
        return np.array(x) if self.is_plain else self._components(x, t)

    def of_parts(self, x: Any) -> FloatArray:
        """Return the parts (..., size) of checked states of users."""
        return self._components(x)[..., : self.size] if self.has_pairs else x

    def _components(self, x: Any, t: Any = 0.0) -> FloatArray:
        result = np.empty((*x.shape[:-1], self.D))
        if self.has_pairs:
            result[..., self._first] = x.real
            result[..., self._second] = x.imag[..., self._is_pair]
        else:
            result[..., : self.size] = x
        if self.clock is not None:
            result[..., self.clock] = t + 0.0 * x[..., 0].real  # NaN for states with NaN
        return result

    def times(self, states: FloatArray) -> Any:
        """Return the hidden time (...) of states of the engine; 0 if there is none."""
        return 0.0 if self.clock is None else states[..., self.clock]

    def leave(self, states: Any) -> Any:
        """Return states of users (..., n) for states of the engine (..., D)."""
        if self.is_plain:
            return states
        states = np.ascontiguousarray(states[..., : self.size])
        if not self.has_pairs:
            return states
        if all(self._is_pair):
            return states.view(complex)
        x = states[..., self._first].astype(complex)
        x.imag[..., self._is_pair] = states[..., self._second]
        return x

    def leave_rows(self, columns: Any) -> Any:
        """Return derivatives (..., size, C) of parts for those of components (..., D, C)."""
        if self.clock is None:
            return columns
        return np.ascontiguousarray(columns[..., : self.size, :])

    def leave_slopes(self, slopes: FloatArray) -> FloatArray:
        """Return f' (..., size, size) of parts for that of components (..., D, D)."""
        return slopes[..., : self.size, : self.size]

    def atol(self, given: tuple[float, ...]) -> tuple[float, ...]:
        """Return n absolute tolerances of variables as D of components."""
        each = self.split(given, lambda a: (a, a))
        return (*each, *[0.0] * (self.D - self.size))

    def leave_atol(self, given: tuple[float, ...]) -> tuple[float, ...]:
        """Return D absolute tolerances of components as n of variables."""
        return tuple(given[i] for i in self._first)

    def only(self, names: Sequence[str]) -> tuple[Layout, list[int]]:
        """Return the layout of some variables, and their components here; a hidden time stays."""
        parts = [each for name in names for each in self.parts if without_suffix(each) == name]
        layout = layout_of(tuple(parts), self.clock is not None)
        if layout.n < len(names):
            raise wrong("names", f"variables of the field, {', '.join(self.names)}", short(names))
        return layout, [self.components.index(each) for each in layout.components]

    # ------------------------------------------------------------------------------ values by place
    def joined(self, values: Sequence[Any], pair: Callable[[Any, Any], Any]) -> list[Any]:
        """Return one value for each variable: pair(a, b) for a complex one."""
        places = zip(self._first, self._is_pair, strict=True)
        return [pair(values[i], values[i + 1]) if both else values[i] for i, both in places]

    def split(self, values: Sequence[Any], parts: Callable[[Any], tuple[Any, Any]]) -> list[Any]:
        """Return one value for each part: the two of parts(a) for a complex variable."""
        found: list[Any] = []
        for value, is_pair in zip(values, self._is_pair, strict=True):
            found += parts(value) if is_pair else (value,)
        return found

    def blocks(self, entries: Sequence[Any], parts: Callable[[Any], tuple[Any, Any]]) -> list[Any]:
        """Return a matrix for all parts, by rows, for the n x n entries of one for variables.

        A complex entry a + i b is [[a, -b], [b, a]]; the row of a real variable is real.
        """
        rows: list[Any] = []
        for j, is_row_pair in enumerate(self._is_pair):
            real, imag = [], []
            for k, is_pair in enumerate(self._is_pair):
                a, b = parts(entries[j * self.n + k])
                if not is_row_pair and (_is_not_0(b) or (is_pair and _is_not_0(a))):
                    how = f"real in the row of {self.names[j]}, without complex variables"
                    raise wrong("mass", how, short(entries[j * self.n + k]))
                real += [a, -b] if is_pair else [a]
                imag += [b, a] if is_pair else [b]
            rows += real + imag * is_row_pair
        return rows

    def completed(self, parts: Sequence[Any], of_time: Any) -> list[Any]:
        """Return values of components: those of parts, then `of_time` for a hidden time."""
        return [*parts, *[of_time] * (self.D - self.size)]

    def drawn(self, names: Sequence[Any]) -> tuple[Any, ...]:
        """Return names of components to draw, with the parts of complex variables."""
        if not self.has_pairs:
            return tuple(names)
        pairs = {z: (z + _RE, z + _IM) for z in self.names if z not in self.parts}
        lists = [a for name in names if isinstance(name, (list, tuple)) for a in name]
        if names and isinstance(names[0], str) and names[0] in pairs and not lists:
            others = [part for a in names[1:] for part in pairs.get(a, (a,))]
            return *pairs[names[0]], *others  # the complex plane, and a third axis
        if not lists and not {*names} & {*pairs}:
            return tuple(names)
        return names[0], [part for a in lists or names[1:] for part in pairs.get(a, (a,))]


def _is_not_0(a: Any) -> bool:
    return not isinstance(a, (int, float)) or a != 0


@lru_cache(256)
def layout_of(parts: tuple[str, ...], has_time: bool = False) -> Layout:
    """Return the layout of these parts, such as "z.real", "z.imag", "g", and of a hidden time."""
    return Layout(parts, has_time)


def layout_read(components: tuple[str, ...], time: Any) -> Layout:
    """Return the layout of components in a file; `time` is the name of the last if it is hidden."""
    if time is None:
        return layout_of(components)
    if not time == components[-1] == CLOCK:
        raise wrong("time", f"{CLOCK!r}, the last of the names", short(time))
    return layout_of(components[:-1], True)


def with_complex(names: Sequence[str], chosen: Sequence[str]) -> tuple[str, ...]:
    """Return parts: names in which a pair replaces each of the `chosen` ones."""
    if unknown := [name for name in chosen if name not in names]:
        raise ValueError(f"complex must be True, or names of variables, not {unknown[0]!r}")
    pairs = ((name + _RE, name + _IM) if name in chosen else (name,) for name in names)
    return tuple(part for pair in pairs for part in pair)


def split_values(values: Mapping[str, Any], known: Sequence[str] = ()) -> dict[str, Any]:
    """Return parameters by name, with pairs in place of complex ones, and of `known` pairs."""
    parts: dict[str, Any] = {}
    for name, value in values.items():
        if type(value) is float and name + _RE not in known:  # for speed
            parts[name] = value
            continue
        array = np.asarray(value)
        if name + _RE in known or (array.dtype.kind == "c" and name not in known):
            parts |= {name + _RE: array.real[()], name + _IM: array.imag[()]}
        else:
            parts[name] = value
    return parts


def parts_of_name(name: str) -> tuple[str, str]:
    """Return the names of the parts of a complex variable or parameter."""
    return name + _RE, name + _IM


def without_suffix(name: str) -> str:
    """Return "z" for "z.real" and "z.imag"; other names as they are."""
    return name.removesuffix(_RE).removesuffix(_IM)


def unpaired(names: Sequence[str]) -> str:
    """Return a name such as "z.real" without its neighbour "z.imag"; "" if there is none."""
    for a, b in zip(["", *names], [*names, ""], strict=True):
        if (a.endswith(_RE) or b.endswith(_IM)) and b != a.removesuffix(_RE) + _IM:
            return a or b
    return ""
