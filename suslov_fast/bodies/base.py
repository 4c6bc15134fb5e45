"""Base class of all bodies: immutable parameters, batches, equality, text and dictionaries."""

import inspect
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from functools import cached_property, partial
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import numpy as np

from .. import checks
from ..checks import FloatArray, wrong
from ..keywords import INSTEAD_IN_BODIES
from .polynomials import from_lists, to_lists

Kind = TypeVar("Kind", bound="Body")

# Names of other packages for functions of this one.
_ELSEWHERE = {
    "trajectory": "iterate",
    "lyapunov": "lyapunov_exponents",
    "poincare_section": "crossings",
}
# Attributes for other modules of the package; `dir` hides them.
_FOR_KERNELS = {"batch_of_one", "constants"}


@dataclass(frozen=True, eq=False, repr=False)
class Body:
    """A body or a field, or a batch of them; dataclass fields of a subclass are its parameters."""

    _axes: ClassVar[dict[str, int]] = {}  # number of axes of vector parameters
    _positive: ClassVar[dict[str, int]] = {}  # range of positive parameters, for `within`
    _called: ClassVar[str] = "a body or a field"  # the name of the class in messages
    # What messages advise where a function does not accept this class.
    _instead: ClassVar[str] = ""
    _steady: ClassVar[str] = ""  # formula of the steady states, for messages
    dimension: ClassVar[Any] = 2  # number of components of a state
    _labels: ClassVar[Any] = "Omega1", "Omega2"  # their names
    # Named parameters: coordinates of datasets, which == does not compare.
    _coordinates: ClassVar[Any] = ()
    _field: ClassVar[Any]  # the equations of motion, a QuadraticField
    _read: ClassVar[Any] = None  # makes a body from its dictionary; None: the class itself does
    _texts: ClassVar[tuple[str, ...]] = ()  # entries of the dictionary that hold no numbers
    _lists_terms: ClassVar[bool] = False  # whether datasets hold the terms, and not the parameters
    _remake: ClassVar[Any] = None  # makes the field with other named parameters, if its f is there

    def _made_by(self: Kind, maker: Any, *arguments: Any) -> Kind:
        """Keep what made this field from a function; copies, members and files do without it."""
        vars(self)["_remake"] = partial(maker, *arguments)
        return self

    def __post_init__(self) -> None:
        for field in fields(self):
            name, value = field.name, getattr(self, field.name)
            if value is None and field.default is None:
                continue
            array = checks.real_array(name, value)
            checks.within(name, array, self._positive.get(name, checks.OTHERS))
            if name in self._positive and not (array > 0).all():
                raise wrong(name, "positive", array.min())
            vars(self)[name] = frozen(array)
        _ = self.shape  # raises if the parameters do not broadcast

    @cached_property
    def _parts(self) -> dict[str, Any]:
        """The parameters that are not None, by name; those of a single field are exact."""
        named = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in named.items() if value is not None}

    def _take(self, parts: Mapping[str, Any]) -> None:
        """Store parameters that were checked before, such as those of members of a batch."""
        vars(self).update({name: frozen(value) for name, value in parts.items()})

    @classmethod
    def _of(cls: type[Kind], parts: Mapping[str, Any]) -> Kind:
        """Return the body with these parameters, which were checked before."""
        self = object.__new__(cls)
        self._take(parts)
        return self

    def _with(self: Kind, parts: Mapping[str, Any]) -> Kind:
        """Return a copy of the body with these parameters, checked before."""
        return self._of(parts)

    @property
    def _arrays(self) -> dict[str, FloatArray]:
        return {name: np.asarray(each, np.float64) for name, each in self._parts.items()}

    @property
    def _described(self) -> dict[str, Any]:
        """The attributes that identify the body in a store: texts and arrays, by name."""
        return self._arrays

    # True if motions may escape to infinity. Those of bodies cannot: their energy is constant.
    _may_escape = False

    def _without_value(self, x: Any, which: Any) -> str:
        """Return why the equations have no value at the first of some states (...), or nothing."""
        return ""

    def field(self) -> Any:
        """Return the equations of motion as a `QuadraticField`, exact for a single body."""
        return self._field

    @property
    def _terms(self) -> Any:
        """The terms v x_j x_k of all f_i for kernels, in the order in which they add them up."""
        field = self.field()
        checks.instance("field()", field, Body)
        if field.dimension != self.dimension:
            expected = f"have {self.dimension} components, the dimension of {type(self).__name__}"
            raise wrong("field()", expected, field.dimension)
        if np.broadcast_shapes(field.shape, self.shape) != self.shape:
            raise wrong("field()", f"have the shape {self.shape} of the body", field.shape)
        return field._terms

    @property
    def parameters(self) -> dict[str, Any]:
        """The parameters by name; for a field, the named parameters of its function."""
        return dict(self._parts)

    @property
    def constants(self) -> tuple[Any, ...]:
        """The parameters in the order in which formulas and kernels of the map take them."""
        return tuple(self._arrays.values())

    @cached_property
    def batch_of_one(self) -> tuple[Any, ...]:
        """The constants of a single body, with a batch axis of length 1."""
        return tuple(np.array(each)[np.newaxis] for each in self.constants)

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """The batch shape of the body, () for a single one."""
        axes, parts = self._axes, self._parts
        shapes = {n: np.shape(a)[: np.ndim(a) - axes.get(n, 0)] for n, a in parts.items()}
        return checks.common_shape(shapes)

    def __dir__(self) -> list[str]:
        return [name for name in super().__dir__() if name not in _FOR_KERNELS]

    if not TYPE_CHECKING:  # type checkers know the attributes

        def __getattr__(self, name: str) -> Any:
            """Raise an AttributeError that says where a public name is found instead."""
            kind, instead = type(self).__name__, ""
            if name in vars(self).get("_coordinates", ()):
                instead = f"parameters[{name!r}]"
            elif name in import_module("suslov_fast").__all__ or name in _ELSEWHERE:
                instead = f"suslov_fast.{_ELSEWHERE.get(name, name)}(body, ...)"
            instead = instead or INSTEAD_IN_BODIES.get(name, "")
            if instead:
                raise AttributeError(f"{kind!r} object has no attribute {name!r}: use {instead}")
            raise AttributeError(f"{kind!r} object has no attribute {name!r}", name=name, obj=self)

    def __len__(self) -> int:
        if not self.shape:
            text = f"this body is a single {type(self).__name__}, without members to count or index"
            raise TypeError(text)
        return self.shape[0]

    def __iter__(self: Kind) -> Iterator[Kind]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self: Kind, index: Any) -> Kind:
        """Return one member of a batch, or the members that slices, lists or masks select.

        Each entry of the index is for the next axis of the batch: an integer, a slice, a list of
        integers, or a mask of booleans. A mask with several axes merges them into one.
        """
        len(self)  # raises for a single body
        body, axis = self, 0
        for entry in index if isinstance(index, tuple) else (index,):
            try:
                selection, axes = place_in(body.shape[axis:], entry)
            except (IndexError, TypeError) as error:
                text = f"index {checks.short(index)} does not fit a batch of shape {self.shape}"
                how = "pass an integer, a slice or a mask for each of its first axes"
                if isinstance(entry, str):
                    how = f"its parameters are parameters[{entry!r}], its members sel(...)"
                raise type(error)(f"{text}: {how}") from None
            body = body._merged(axis, axes)._part(axis, selection)
            axis += 1 if isinstance(selection, slice) else np.ndim(selection)
        return body

    def sel(self: Kind, /, *, method: str | None = None, **values: Any) -> Kind:
        """Return the members of a batch with given values of parameters.

        Parameters
        ----------
        method : {None, "nearest"}
            "nearest" selects the nearest value in the batch; None requires an equal one.
        **values : float or slice of float
            A number selects along the one axis on which its parameter varies, and removes that
            axis. A slice selects all values between its two ends, both included.

        Raises
        ------
        ValueError
            If no member has the value, or the parameter does not vary along exactly one axis.

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> bodies = Suslov3D(I1=[2, 3, 4], I2=1, I13=-0.5, I23=-0.3)
        >>> bodies.sel(I1=3)
        Suslov3D(I1=3.0, I2=1.0, I13=-0.5, I23=-0.3)
        >>> bodies.sel(I1=3.8, method="nearest").I1
        4.0
        >>> bodies.sel(I1=slice(2.5, None)).I1
        array([3., 4.])
        """
        if method is not None:
            checks.one_of("method", method, ["nearest"])
        for name, value in values.items():
            column = self._column(name)
            axis = len(self.shape) - column.ndim + int(np.argmax(column.shape))
            choices = column.ravel()
            if isinstance(value, slice):
                if value.step is not None or method is not None:
                    received = f"{value} and method {method}"
                    raise wrong(name, "a slice without step and method", received)
                low = -np.inf if value.start is None else value_to_select(name, value.start)
                high = np.inf if value.stop is None else value_to_select(name, value.stop)
                index: Any = np.flatnonzero((low <= choices) & (choices <= high))
            else:
                wanted = value_to_select(name, value)
                index = int(np.argmin(abs(choices - wanted)))
                nearest = choices[index]
                if method is None and nearest != wanted:
                    advice = f'pass one of them, such as {nearest}, or method="nearest"'
                    raise ValueError(
                        f"{name}: {wanted} is not one of its {choices.size} values: {advice}"
                    )
            self = self._part(axis, index)
        return self

    @property
    def _scalars(self) -> dict[str, Any]:
        """The parameters that are a number, not a vector, for each member."""
        return {name: each for name, each in self._parts.items() if name not in self._axes}

    def _of_member(self, i: int | tuple[int, ...]) -> str:
        """Return " of member i (a=1.0)" for messages, "" for a single body."""
        if not self.shape:
            return ""
        values = ", ".join(f"{name}={value}" for name, value in self[i]._scalars.items())
        return f" of member {i}" + (f" ({values})" if values else "")

    def _column(self, name: str) -> FloatArray:
        """Return the values of a parameter that varies along exactly one axis, else raise."""
        values = {n: np.asarray(a, np.float64) for n, a in self._scalars.items()}
        columns = {n: a for n, a in values.items() if 0 < a.size == max(a.shape, default=0)}
        if name in columns:
            return columns[name]
        if not self.shape:
            raise ValueError(
                f"sel: this is a single {type(self).__name__}, and sel is for families"
            )
        how = f"choose from: {', '.join(columns)}"
        if not columns:
            first = ", ".join("0" * len(self.shape))
            how = f"no parameter varies along one axis; select members by index, such as [{first}]"
        if name not in values:
            raise ValueError(f"sel: there is no parameter {name!r}; {how}")
        a = values[name]
        shape = f"has the shape {a.shape}"
        reason = f"is {a.flat[0]} for all members" if a.size == 1 else shape
        raise ValueError(f"sel: {name} {reason}; {how}")

    def _merged(self: Kind, axis: int, axes: int) -> Kind:
        """Return the batch with `axes` of its axes, from `axis` on, merged into one."""
        if axes == 1:
            return self
        parts, end = {}, axis + axes
        for name, value in self._parts.items():
            array = np.asarray(value)
            inner = array.shape[array.ndim - self._axes.get(name, 0) :]
            batch = array.shape[: array.ndim - len(inner)]
            if len(batch) > len(self.shape) - end:  # the parameter has some of these axes
                batch = (1,) * (len(self.shape) - len(batch)) + batch
                array = array.reshape(batch + inner)
                if max(batch[axis:end]) > 1:
                    batch = batch[:axis] + self.shape[axis:end] + batch[end:]
                    array = np.broadcast_to(array, batch + inner)
                length = math.prod(batch[axis:end])
                array = array.reshape((*batch[:axis], length, *batch[end:], *inner))
            parts[name] = array
        return self._with(parts)

    def _part(self: Kind, axis: int, index: Any) -> Kind:
        """Return the members that an integer, a slice or indices select along one axis."""
        # The index for parameters that all members share, whose length is 1 on this axis.
        common = slice(None) if isinstance(index, slice) or np.ndim(index) else 0
        parts = {}
        for name, value in self._parts.items():
            array = np.asarray(value)
            its_axis = axis - len(self.shape) + array.ndim - self._axes.get(name, 0)
            if its_axis >= 0:
                selected = index if array.shape[its_axis] == self.shape[axis] else common
                array = array[(slice(None),) * its_axis + (selected,)]
            parts[name] = array
        return self._with(parts)

    @property
    def _key(self) -> tuple[Any, ...]:
        """The values that == and hash compare."""
        compared = {n: a for n, a in self._parts.items() if n not in self._coordinates}
        return tuple((name, np.shape(a), *np.ravel(a).tolist()) for name, a in compared.items())

    def __eq__(self, other: object) -> bool:
        return self._key == other._key if type(other) is type(self) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key)

    def __reduce__(self) -> tuple[Any, ...]:
        return self._of, (self._parts,)

    def __repr__(self) -> str:
        name, arrays = type(self).__name__, self._arrays.items()
        text = ", ".join(
            f"{each}={a.tolist()}" for each, a in arrays if a.size <= 25 or not self.shape
        )
        if not self.shape or (sum(a.size for _, a in arrays) <= 25 and len(text) < 100):
            return f"{name}({text})"
        text = ", ".join(summary(each, a) for each, a in arrays)
        return f"<{name} of shape {self.shape}: {text}>"

    def to_dict(self) -> dict[str, Any]:
        """Return the class and the exact parameters as a dictionary for JSON.

        A coefficient that no float equals becomes a string "p/q". A field has its terms, or with a
        Hamiltonian those of H and the entries of K, as lists of indices and of values.

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> Suslov3D(I1=[4, 3], I2=1, I13=-0.5, I23=-0.3).to_dict()
        {'body': 'Suslov3D', 'I1': [4.0, 3.0], 'I2': 1.0, 'I13': -0.5, 'I23': -0.3}
        """
        return {"body": type(self).__name__, **to_lists(self._parts)}

    @classmethod
    def from_dict(cls: type[Kind], parameters: Mapping[str, Any]) -> Kind:
        """Return the body that a dictionary from :meth:`to_dict` of this class describes.

        Raises
        ------
        ValueError
            If the dictionary is that of another class, or its parameters are not those of this one.

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
        >>> Suslov3D.from_dict(body.to_dict()) == body
        True
        """
        checks.instance("parameters", parameters, Mapping)
        given = dict(parameters)
        checks.one_of("body", given.pop("body", None), [cls.__name__])
        read = cls._read or cls
        try:
            inspect.signature(read).bind(**given)
        except TypeError as error:
            names = ", ".join(map(str, given)) or "none"
            text = f"these are not the parameters of {cls.__name__}: {names} ({error})"
            raise ValueError(text) from None
        texts = {name: given.pop(name) for name in cls._texts if name in given}
        return read(**from_lists("parameters", given), **texts)


def summary(name: str, values: Any) -> str:
    """Return a parameter in a few words: "I1=4.0", or "rho: 11 values from 20 to 30"."""
    if not np.ndim(values):
        return f"{name}={values}"
    if np.size(values) == 0:
        return f"{name}: no values"
    return f"{name}: {np.size(values)} values from {np.min(values):g} to {np.max(values):g}"


def frozen(part: Any) -> Any:
    """Return a read-only copy of an array; a plain number if it has no axes."""
    array = np.array(part, order="C")
    array.flags.writeable = False
    return array if array.ndim else array.item()


def place_in(shape: tuple[int, ...], entry: Any) -> tuple[Any, int]:
    """Return an entry of an index as an integer, a slice or indices, and its number of axes."""
    if not shape:
        raise IndexError
    if isinstance(entry, slice):
        return entry, 1
    array = np.asarray(entry)
    if array.dtype.kind not in "biu":
        raise TypeError
    if array.dtype == bool:
        if array.ndim == 0 or array.shape != shape[: array.ndim]:
            raise IndexError
        return np.flatnonzero(array), array.ndim
    if array.ndim > 1:
        raise IndexError
    return np.arange(shape[0])[array], 1


def value_to_select(name: str, value: Any) -> float:
    """Return a finite number from the arguments of `sel`."""
    number = checks.real_number(name, value)
    if type(number) is not float:
        expected = "a number, or a slice of values, such as slice(1, 2)"
        raise wrong(name, expected, checks.short(value))
    return number
