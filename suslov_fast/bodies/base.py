"""Base class of all bodies: immutable parameters, batches, equality, text and dictionaries."""

import inspect
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, ClassVar, TypeVar

import numpy as np

from .. import checks
from ..checks import FloatArray, wrong
from .polynomials import from_lists, to_lists

Kind = TypeVar("Kind", bound="Body")


@dataclass(frozen=True, eq=False, repr=False)
class Body:
    """A body, or a batch of them; the fields of a subclass are its parameters."""

    _axes: ClassVar[dict[str, int]] = {}  # of parameters with axes besides those of the batch
    _positive: ClassVar[dict[str, int]] = {}  # parameters, with the exponents of their range
    _called: ClassVar[str] = "a body or a field"  # in messages
    # The number of components of a state and their labels, and the parts that are coordinates of
    # datasets, which equal bodies need not share.
    dimension: ClassVar[Any] = 2
    _labels: ClassVar[Any] = "Omega1", "Omega2"
    _coordinates: ClassVar[Any] = ()
    _field: ClassVar[Any]
    _read: ClassVar[Any] = None  # makes a body from its dictionary, if the class does not

    def __post_init__(self) -> None:
        for field in fields(self):
            name, value = field.name, getattr(self, field.name)
            if value is None and field.default is None:
                continue
            array = checks.real_array(name, value)
            checks.within(name, array, self._positive.get(name, checks.OTHERS))
            if name in self._positive and not (array > 0).all():
                raise wrong(name, "positive numbers", array.min())
            vars(self)[name] = frozen(array)
        _ = self.shape  # an error unless there is one

    @cached_property
    def _parts(self) -> dict[str, Any]:
        """The parameters by name: numbers and arrays, which are exact for a single field."""
        named = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in named.items() if value is not None}

    def _take(self, parts: Mapping[str, Any]) -> None:
        """Store the parts of another body, or members of them, without checks."""
        vars(self).update({name: frozen(each) for name, each in parts.items()})

    @classmethod
    def _of(cls: type[Kind], parts: Mapping[str, Any]) -> Kind:
        self = object.__new__(cls)
        self._take(parts)
        return self

    @property
    def _arrays(self) -> dict[str, FloatArray]:
        return {name: np.asarray(each, np.float64) for name, each in self._parts.items()}

    def field(self) -> Any:
        """Return the equations of motion as a `QuadraticField`, exact for a single body."""
        return self._field

    @property
    def terms(self) -> Any:
        """The terms v x_j x_k of the components i: indices i, j <= k (3, T), values v (..., T)."""
        return self.field().terms

    @property
    def parameters(self) -> Any:
        """The parameters of the map, in order."""
        return tuple(self._arrays.values())

    @cached_property
    def batch_of_one(self) -> tuple[Any, ...]:
        """The parameters of a single body with an axis for the batch."""
        return tuple(np.array(each)[np.newaxis] for each in self.parameters)

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """The batch shape of the body, () for a single one."""
        axes, parts = self._axes, self._parts
        shapes = {n: np.shape(a)[: np.ndim(a) - axes.get(n, 0)] for n, a in parts.items()}
        return checks.common_shape(shapes)

    def __len__(self) -> int:
        if not self.shape:
            raise wrong("body", "a batch", f"a single {type(self).__name__}", TypeError)
        return self.shape[0]

    def __iter__(self: Kind) -> Iterator[Kind]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self: Kind, index: int | slice) -> Kind:
        """Return a member, or a slice, of a batch along its first axis."""
        size = len(self)
        try:
            place = index if isinstance(index, slice) else range(size)[index]
        except (IndexError, TypeError) as error:
            expected = f"an integer from {-size} to {size - 1}, or a slice"
            raise wrong("index", expected, checks.short(index), type(error)) from None
        return self._part(0, place)

    def sel(self: Kind, *, method: str | None = None, **values: float) -> Kind:
        """Return the members of a batch that have given values of named parameters.

        Parameters
        ----------
        method : {None, "nearest"}
            "nearest" selects the nearest value in the batch; None requires an equal one.
        **values : float
            Values of parameters, each of which varies along a single axis of the batch. The result
            lacks these axes.

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> bodies = Suslov3D(I1=[2, 3, 4], I2=1, I13=-0.5, I23=-0.3)
        >>> bodies.sel(I1=3)
        Suslov3D(I1=3.0, I2=1.0, I13=-0.5, I23=-0.3)
        >>> bodies.sel(I1=3.8, method="nearest").I1
        4.0
        """
        if method is not None:
            checks.one_of("method", method, ["nearest"])
        for name, value in values.items():
            scalars = {n: each for n, each in self._parts.items() if n not in self._axes}
            column = np.asarray(scalars.get(name, []), np.float64)
            if not 0 < column.size == max(column.shape, default=0):
                names = ", ".join(scalars) or "none"
                raise wrong("sel", f"a parameter that varies along one axis, of {names}", name)
            wanted = checks.real_number(name, value)
            if type(wanted) is not float:
                raise wrong(name, "a number", checks.short(value))
            i = int(np.argmin(abs(column - wanted)))
            nearest = column.flat[i]
            if method is None and nearest != wanted:
                raise wrong(name, f"one of its {column.size} values, as {nearest}", wanted)
            axis = len(self.shape) - column.ndim + int(np.argmax(column.shape))
            self = self._part(axis, i)
        return self

    def _part(self: Kind, axis: int, index: int | slice) -> Kind:
        """Return the members with an index along one axis of the batch."""
        common = slice(None) if isinstance(index, slice) else 0  # of what all members share
        parts = {}
        for name, each in self._parts.items():
            array = np.asarray(each)
            place = axis - len(self.shape) + array.ndim - self._axes.get(name, 0)
            if place >= 0:
                own = index if array.shape[place] == self.shape[axis] else common
                array = array[(slice(None),) * place + (own,)]
            parts[name] = array
        return self._of(parts)

    @property
    def _key(self) -> tuple[Any, ...]:
        """The values that equal bodies share."""
        own = {name: each for name, each in self._parts.items() if name not in self._coordinates}
        return tuple((name, np.shape(a), *np.ravel(a).tolist()) for name, a in own.items())

    def __eq__(self, other: object) -> bool:
        return self._key == other._key if type(other) is type(self) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key)

    def __reduce__(self) -> tuple[Any, ...]:
        return self._of, (self._parts,)

    def __repr__(self) -> str:
        name, arrays = type(self).__name__, self._arrays.items()
        if sum(a.size for _, a in arrays) <= 25:
            text = ", ".join(f"{each}={a.tolist()}" for each, a in arrays)
            if len(text) < 100:
                return f"{name}({text})"
        text = ", ".join(f"{each}={a.shape or a}" for each, a in arrays)
        return f"<{name} of shape {self.shape}: {text}>"

    def to_dict(self) -> dict[str, Any]:
        """Return the class and the exact parameters as a dictionary for JSON.

        Numbers of a field that no float equals are strings "p/q". In place of coefficients, a field
        with a Hamiltonian has K and H, which is a symmetric tensor in (x1, ..., xD, 1).

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> Suslov3D(I1=[4, 3], I2=1, I13=-0.5, I23=-0.3).to_dict()
        {'body': 'Suslov3D', 'I1': [4.0, 3.0], 'I2': 1.0, 'I13': -0.5, 'I23': -0.3}
        """
        return {"body": type(self).__name__, **to_lists(self._parts)}

    @classmethod
    def from_dict(cls: type[Kind], parameters: Mapping[str, Any]) -> Kind:
        """Return the body of a dictionary from :meth:`to_dict` of this class."""
        checks.instance("parameters", parameters, Mapping)
        given = dict(parameters)
        checks.one_of("body", given.pop("body", None), [cls.__name__])
        read = cls._read or cls
        try:
            inspect.signature(read).bind(**given)
        except TypeError as error:
            expected = f"those of {cls.__name__} ({error})"
            raise wrong("parameters", expected, ", ".join(map(str, given))) from None
        return read(**from_lists("parameters", given))


def frozen(part: Any) -> Any:
    """Return a read-only copy of an array, or the number of one without axes."""
    array = np.array(part, order="C")
    array.flags.writeable = False
    return array if array.ndim else array.item()
