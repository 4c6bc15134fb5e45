"""The base class of bodies, fields and maps: parameters, batches, equality, text, dictionaries."""

import inspect
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from .. import checks
from ..checks import FloatArray, wrong
from ..core.cached import cached_property
from ..keywords import Answering, lacking, public
from .exact_numbers import from_lists, to_lists
from .latex import equations, symbol
from .layout import Layout, layout_of, parts_of_name
from .members import Members


class Parameters(dict[str, Any]):
    """Parameters by name: a copy, so setting a value, which would not reach the body, raises."""

    def __setitem__(self, name: str, value: Any) -> None:
        how = f"make it again with {name}={checks.short(value)}"
        raise TypeError(f"parameters of a body or field cannot be changed: {how}")

    def __missing__(self, name: str) -> Any:
        real, imag = parts_of_name(name)
        if real not in self:
            raise KeyError(name)
        return self[real] + 1j * self[imag]

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, (dict(self),)


@dataclass(frozen=True, eq=False, repr=False)
class Body(Members, metaclass=Answering):
    """A body, field or map, or a batch; dataclass fields of a body are its parameters."""

    _axes: ClassVar[dict[str, int]] = {}  # {parameter: 1 if it is a vector, 2 if it is a matrix}
    _positive: ClassVar[dict[str, int]] = {}  # {positive parameter: exponent of `checks.within`}
    _called: ClassVar[str] = "a body or a field"
    _variable: ClassVar[str] = "omega"  # the name of states, in messages
    _left: ClassVar[str] = r"\dot{%s}"  # the left side of an equation in LaTeX, for a variable
    _has_eps: ClassVar[bool] = True  # False for a `Map`
    # The direction (..., D) of the line of steady states through 0; NaN for members without one.
    _steady_line: ClassVar[Any] = None
    _meaning: ClassVar[str] = ""  # meaning of the parameters, in messages
    if TYPE_CHECKING:

        @property
        def dimension(self) -> int: ...

    else:
        dimension = 2
    _is_solved: ClassVar[Any] = False  # True if the motion has a closed form
    _field: ClassVar[Any]  # the equations of motion; TypeError for a `Map`, which has none
    _labels: ClassVar[Any] = "Omega1", "Omega2"  # names of the components of states
    _coordinates: ClassVar[Any] = ()  # parameters that are coordinates of datasets
    _shared: ClassVar[Any] = {}  # what all members of a batch share besides parameters
    _read: ClassVar[Any] = None  # makes a body from its dictionary; None: the class does
    _texts: ClassVar[tuple[str, ...]] = ()  # entries of the dictionary that are texts, not numbers
    _may_escape: ClassVar[Any] = False  # no body escapes: its energy is constant
    # How many values the functions of the state have that belong to the equations, by name.
    _quantities: ClassVar[Any] = {}
    _clocks: ClassVar[Any] = ()  # numbers of components with the rate 1, of which one may be t

    def __post_init__(self) -> None:
        for field in fields(self):
            name, value = field.name, getattr(self, field.name)
            if value is None and field.default is None:
                continue
            value, fractions = checks.without_fractions(value)
            if fractions is not None:
                self._exact_parts[name] = fractions
            array = checks.real_array(name, value)
            checks.within(name, array, self._positive.get(name, checks.OTHERS))
            if name in self._positive and not (array > 0).all():
                names = ", ".join(each.name for each in fields(self) if each.init)
                how = f": the order is {names}{self._meaning}"
                raise wrong(name, "positive", f"{array.min()}{how}")
            vars(self)[name] = frozen(array)
        _ = self.shape  # raises if the parameters do not broadcast

    @cached_property
    def _exact_parts(self) -> dict[str, Any]:
        """The parameters that contain fractions, by name, as they were given; copies have none."""
        return {}

    @cached_property
    def _parts(self) -> dict[str, Any]:
        """The parameters by name; a parameter with its default value is left out."""
        named = {field.name: (getattr(self, field.name), field.default) for field in fields(self)}
        return {
            name: value
            for name, (value, default) in named.items()
            if value is not None and not (type(value) is float and value == default)
        }

    def _take(self, parts: Mapping[str, Any]) -> None:
        """Store parameters that were checked before, such as the parameters of a member."""
        vars(self).update({name: frozen(value) for name, value in parts.items()})

    @classmethod
    def _of(cls, parts: Mapping[str, Any]) -> Self:
        """Return the body with these parameters, which were checked before."""
        self = object.__new__(cls)
        self._take(parts)
        return self

    def _with_parts(self, parts: Mapping[str, Any]) -> Self:
        """Return a copy of the body with these parameters, which were checked before."""
        return self._of({**parts, **self._shared})

    @property
    def _autonomous(self) -> Any:
        return self

    @cached_property
    def _layout(self) -> Layout:
        """The variables that users see, and the components of the engine."""
        return layout_of(self._labels)

    @property
    def _arrays(self) -> dict[str, FloatArray]:
        """The parameters by name, as arrays of floats."""
        return {name: np.asarray(each, np.float64) for name, each in self.parameters.items()}

    @property
    def _terms(self) -> Any:
        """The terms v x_j x_k of all f_i, for kernels."""
        return self._field._terms

    @property
    def parameters(self) -> dict[str, Any]:
        """The parameters by name."""
        return Parameters(self._parts)

    @property
    def _constants(self) -> tuple[Any, ...]:
        """The parameters, in the order in which formulas and kernels of the map take them."""
        return tuple(self._arrays.values())

    @cached_property
    def _batch_of_one(self) -> tuple[Any, ...]:
        """The constants of a single body, with a batch axis of length 1."""
        return tuple(np.array(each)[np.newaxis] for each in self._constants)

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """The batch shape of the body, () for a single one."""
        axes = self._axes
        arrays = {n: a for n, a in self._parts.items() if type(a) is not float}
        shapes = {n: np.shape(a)[: np.ndim(a) - axes.get(n, 0)] for n, a in arrays.items()}
        return checks.common_shape(shapes)

    if not TYPE_CHECKING:  # type checkers would accept every attribute

        def __getattr__(self, name: str) -> Any:
            """Raise an AttributeError that says where a public name is found instead."""
            is_parameter = name in vars(self).get("_coordinates", ())
            here = f"parameters[{name!r}]" if is_parameter else ""
            raise lacking(self, name, here)

    @property
    def _key(self) -> tuple[Any, ...]:
        """The values that == and hash compare."""
        return tuple((name, a.shape, *a.ravel().tolist()) for name, a in self._arrays.items())

    def __eq__(self, other: object) -> bool:
        return self._key == other._key if type(other) is type(self) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key)

    def __reduce__(self) -> tuple[Any, ...]:
        return self._of, ({**self._parts, **self._shared},)

    def __repr__(self) -> str:
        name, arrays = type(self).__name__, self._arrays.items()
        text = ", ".join(
            f"{each}={a.tolist()}" for each, a in arrays if a.size <= 25 or not self.shape
        )
        if not self.shape or (sum(a.size for _, a in arrays) <= 25 and len(text) < 100):
            return f"{name}({text})"
        text = ", ".join(summary(each, a) for each, a in arrays)
        return f"<{name} of shape {self.shape}: {text}>"

    @property
    def _formulas(self) -> Iterator[str]:
        """The right sides of the equations of a single body as texts."""
        return self._field._formulas

    @property
    def _numbers(self) -> list[tuple[str, Any]]:
        """The parameters of a single body that are numbers, by name."""
        return [(name, a) for name, a in self._arrays.items() if not np.ndim(a)]

    def _repr_latex_(self) -> str | None:
        """Return the equations of a single body for notebooks, which show a batch as a text."""
        if self.shape:
            return None
        parts = (self._left % symbol(a) for a in self._layout.parts)
        rows = zip(parts, self._formulas, strict=True)
        return equations([*rows, *((symbol(name), str(a)) for name, a in self._numbers)])

    @public
    def to_dict(self) -> dict[str, Any]:
        """Return the class and the exact parameters as a dictionary for JSON.

        A number that no float equals becomes a string "p/q". A field has its equations as texts, or
        the text of its Hamiltonian H, or its terms as lists of indices and of values.

        Returns
        -------
        dict
            The name of the class under "body", and the parameters. :meth:`from_dict` makes an equal
            body or field of it.

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> Suslov3D(I1=[4, 3], I2=1, I13=-0.5, I23=-0.3).to_dict()
        {'body': 'Suslov3D', 'I1': [4.0, 3.0], 'I2': 1.0, 'I13': -0.5, 'I23': -0.3}
        """
        return {"body": type(self).__name__, **to_lists(self._parts)}

    @classmethod
    @public
    def from_dict(cls, parameters: Mapping[str, Any]) -> Self:
        """Return the body or field of this class that :meth:`to_dict` described.

        Parameters
        ----------
        parameters : mapping
            The dictionary from :meth:`to_dict`, or after a round trip through JSON.

        Returns
        -------
        body
            A body that is equal to the one that was described.

        Raises
        ------
        ValueError
            If the dictionary is of another class, or has other parameters.

        Examples
        --------
        >>> import json
        >>> from suslov_fast import SuslovND
        >>> text = json.dumps(SuslovND(J=[1.3, 2.1], I=[0.4, -0.7]).to_dict())
        >>> SuslovND.from_dict(json.loads(text))
        SuslovND(J=[1.3, 2.1], I=[0.4, -0.7])
        """
        checks.instance("parameters", parameters, Mapping)
        return cls._from_dict(dict(parameters))

    @classmethod
    def _from_dict(cls, given: dict[str, Any]) -> Self:
        """Return the body that the dictionary `given` describes; remove entries that are read."""
        how = ": it is the name of the class that has from_dict"
        checks.one_of("body", given.pop("body", None), [cls.__name__], how)
        read = cls._read or cls
        try:
            inspect.signature(read).bind(**given)
        except TypeError as error:
            names = ", ".join(map(str, given)) or "none"
            text = f"these are not the parameters of {cls.__name__}: {names} ({error})"
            raise ValueError(text) from None
        texts = {name: given.pop(name) for name in cls._texts if name in given}
        try:
            return read(**from_lists("parameters", given), **texts)
        except RecursionError:
            raise wrong("parameters", "lists of few axes", "lists deep inside each other") from None


def summary(name: str, values: Any) -> str:
    """Return a parameter and its value, or its range: "rho: 11 values from 20 to 30"."""
    if not np.ndim(values):
        return f"{name}={values}"
    if np.size(values) == 0:
        return f"{name}: no values"
    return f"{name}: {np.size(values)} values from {np.min(values):g} to {np.max(values):g}"


def frozen(part: Any) -> Any:
    """Return a read-only copy of an array; a plain number if it has no axes."""
    if type(part) is float:
        return part
    array = np.array(part, order="C")
    array.flags.writeable = False
    return array if array.ndim else array.item()
