"""Base class of all bodies: immutable parameters, equality, text and conversion to plain data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields, replace
from functools import cached_property
from typing import Any, ClassVar, TypeVar

import numpy as np

from .._checks import FloatArray, common_shape, real_array, without_labels, wrong
from .._docs import filled

# Length of a line of text that represents a body.
_LINE = 100

Kind = TypeVar("Kind", bound="Body")


@dataclass(frozen=True, eq=False, repr=False)
class Body:
    """A body, or a batch of them; the fields of a subclass are its parameters."""

    # The number of axes of most parameters that are not axes of the batch.
    _vector_axes: ClassVar[int] = 0
    # Meanings of all parameters, and the names of those that are positive.
    _meanings: ClassVar[dict[str, str]] = {}
    _positive: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        self._set(**{name: getattr(self, name) for name in self._names()})

    @classmethod
    def _names(cls) -> list[str]:
        """Return the names of the parameters, optional ones last."""
        return [field.name for field in fields(cls)]

    @classmethod
    def _required(cls) -> list[str]:
        """Return the names of the parameters of the map, which may not be left out."""
        return [field.name for field in fields(cls) if field.default is MISSING]

    @property
    def _values(self) -> dict[str, float | FloatArray]:
        """The parameters that are set, by name."""
        named = {name: getattr(self, name) for name in self._names()}
        return {name: value for name, value in named.items() if value is not None}

    @property
    def _arrays(self) -> dict[str, FloatArray]:
        """The parameters that are set, as floats."""
        return {name: np.asarray(value, np.float64) for name, value in self._values.items()}

    @property
    def _text(self) -> str | None:
        """The body as JSON, if `_arrays` are not all of it."""
        return None

    @property
    def _besides(self) -> dict[str, Any]:
        """Plain values on which results depend besides `_arrays`, by name."""
        return {}

    @property
    def _coordinates(self) -> dict[str, FloatArray]:
        """Named parameters other than the fields of the class: coordinates of datasets."""
        return {}

    def _swept(self: Kind, name: str, values: FloatArray) -> Kind:
        """Return the body with other values of a parameter."""
        return replace(self, **{name: values})

    @cached_property
    def parameters(self) -> tuple[Any, ...]:
        """The parameters of the map, in order."""
        return tuple(getattr(self, name) for name in self._required())

    @cached_property
    def batch_of_one(self) -> tuple[FloatArray, ...]:
        """The parameters of a single body with an axis for the batch, as kernels take them."""
        return tuple(np.array(each, ndmin=1 + self._vector_axes) for each in self.parameters)

    def field(self) -> Any:
        """Return the equations of motion as a `QuadraticField`, exact for a single body."""
        raise wrong("body", "one with a quadratic vector field", type(self).__name__, TypeError)

    @property
    def dimension(self) -> int:
        """The number of components of a state."""
        return 2

    @property
    def _labels(self) -> tuple[str, ...]:
        """The labels of the components of a state."""
        return "Omega1", "Omega2"

    @classmethod
    def _axes(cls, name: str) -> int:
        """Return the number of axes of a parameter that are not axes of the batch."""
        return cls._vector_axes

    def _set(self, **values: Any) -> None:
        """Check the parameters, and set read-only copies."""
        without_labels(values)
        arrays = {
            name: real_array(name, value)
            for name, value in values.items()
            if value is not None or name in self._required()
        }
        for name, array in arrays.items():
            if name in self._positive and not (array > 0).all():
                raise wrong(name, f"a positive {self._meanings[name]}", array.min())
        common_shape({name: self._batch_of(name, array) for name, array in arrays.items()})
        for name, array in arrays.items():
            object.__setattr__(self, name, _frozen(array))

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """The batch shape of the body, () for a single one."""
        return np.broadcast_shapes(*(self._batch_of(*item) for item in self._values.items()))

    def _batch_of(self, name: str, value: float | FloatArray) -> tuple[int, ...]:
        shape = np.shape(value)
        return shape[: len(shape) - self._axes(name)]

    @property
    def _key(self) -> tuple[Any, ...]:
        """The values that equal bodies share; -0.0 becomes 0.0."""
        values = self._arrays.items()
        return tuple((name, each.shape, (each + 0.0).tobytes()) for name, each in values)

    def __eq__(self, other: object) -> bool:
        return self._key == other._key if type(other) is type(self) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key)

    @classmethod
    def _of(cls: type[Kind], values: Mapping[str, Any]) -> Kind:
        """Return a body with parameters of another, or parts of them, which are not checked."""
        self = object.__new__(cls)
        frozen = {name: _frozen(np.asarray(each)) for name, each in values.items()}
        vars(self).update(dict.fromkeys(cls._names()) | frozen)
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return self._of, (self._values,)

    def __repr__(self) -> str:
        name, values = type(self).__name__, self._values.items()
        if sum(np.size(value) for _, value in values) <= _LINE // 4:
            text = ", ".join(f"{each}={np.asarray(value).tolist()!r}" for each, value in values)
            if len(text) < _LINE:
                return f"{name}({text})"
        text = ", ".join(
            f"{each}={value if np.ndim(value) == 0 else np.shape(value)}" for each, value in values
        )
        return f"<{name} of shape {self.shape}: {text}>"

    def to_dict(self) -> dict[str, Any]:
        """Return a dictionary of the class and the parameters, without loss, for JSON.

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> Suslov3D(I1=[4, 3], I2=1, I13=-0.5, I23=-0.3).to_dict()
        {'body': 'Suslov3D', 'I1': [4.0, 3.0], 'I2': 1.0, 'I13': -0.5, 'I23': -0.3}
        """
        values = {name: np.asarray(value).tolist() for name, value in self._values.items()}
        return {"body": type(self).__name__, **values}

    @classmethod
    @filled
    def from_dict(cls: type[Kind], parameters: Mapping[str, Any]) -> Kind:
        """Return the body of this class that :meth:`to_dict` describes.

        %(Parameters: parameters)s

        Returns
        -------
        body

        %(Raises: invalid)s

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> Suslov3D.from_dict({"body": "Suslov3D", "I1": 4, "I2": 1, "I13": -0.5, "I23": -0.3})
        Suslov3D(I1=4.0, I2=1.0, I13=-0.5, I23=-0.3)
        """
        names = [field.name for field in fields(cls)]  # also those that are no coefficients
        parameters = dict(mapping(parameters))
        kind = parameters.pop("body", None)
        if kind != cls.__name__:
            raise wrong("body", repr(cls.__name__), repr(kind))
        missing = ", ".join(name for name in cls._required() if name not in parameters)
        unknown = ", ".join(str(name) for name in parameters if name not in names)
        if missing or unknown:
            what = f"missing: {missing}" if missing else f"unknown: {unknown}"
            raise ValueError(f"parameters: expected the names {names}, {what}")
        return cls(**parameters)


def mapping(parameters: Any) -> Mapping[str, Any]:
    """Return the argument of `from_dict`; TypeError if it is no dictionary."""
    if isinstance(parameters, Mapping):
        return parameters
    text = isinstance(parameters, (str, bytes))
    received = "text: pass json.loads(text)" if text else type(parameters).__name__
    raise wrong("parameters", "a dictionary, as to_dict() returns it", received, TypeError)


def _frozen(array: FloatArray) -> float | FloatArray:
    """Return a read-only copy of a parameter, or its number."""
    # Memory of a bytes object can never be made writeable.
    frozen = np.frombuffer(array.tobytes(), np.float64).reshape(array.shape)
    return frozen if array.ndim else float(array)
