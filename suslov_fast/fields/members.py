"""Members of batches: selected by an index, or by the values of parameters."""

from collections.abc import Iterator
from typing import Any, ClassVar, Self

import numpy as np

from .. import checks
from ..checks import FloatArray, wrong
from ..keywords import public
from .layout import parts_of_name

_FAMILY = "for a family pass an array as a parameter"


class Members:
    """A batch of bodies; an index or the values of parameters select members."""

    _axes: ClassVar[dict[str, int]]
    _parts: Any
    shape: Any
    _with_parts: Any

    def __len__(self) -> int:
        if not self.shape:
            text = f"this body is a single {type(self).__name__}, without members to count or index"
            raise TypeError(f"{text}: {_FAMILY}")
        return int(self.shape[0])

    def __bool__(self) -> bool:
        return True

    def __iter__(self) -> Iterator[Self]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, index: Any) -> Self:
        """Return a member of a batch, or the members that slices, lists or masks select."""
        len(self)  # `len` raises an error for a single body
        body, axis = self, 0
        for entry in index if isinstance(index, tuple) else (index,):
            try:
                selection = place_in(body.shape[axis:], entry)
            except (IndexError, TypeError) as error:
                text = f"index {checks.short(index)} does not fit a batch of shape {self.shape}"
                how = "pass an integer, a slice or a mask for each of its first axes"
                if isinstance(entry, str):
                    how = f"its parameters are parameters[{entry!r}], its members sel(...)"
                raise type(error)(f"{text}: {how}") from None
            body = body._part(axis, selection)
            axis += 1 if isinstance(selection, slice) else np.ndim(selection)
        return body

    @public
    def sel(self, /, **values: Any) -> Self:
        """Return the members of a batch with given values of parameters.

        Parameters
        ----------
        **values : float
            Each parameter must vary along exactly one axis. The member with this value is selected,
            and the axis is removed. For ranges use a mask: ``family[(2 < a) & (a < 3)]``.

        Returns
        -------
        body
            The selected members, of the same class.

        Raises
        ------
        KeyError
            If no member has the value.
        TypeError, ValueError
            If a parameter does not vary along exactly one axis, or a value is no number.

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> bodies = Suslov3D(I1=[2, 3, 4], I2=1, I13=-0.5, I23=-0.3)
        >>> bodies.sel(I1=3)
        Suslov3D(I1=3.0, I2=1.0, I13=-0.5, I23=-0.3)
        >>> bodies[bodies.I1 > 2.5].I1
        array([3., 4.])
        """
        for name, value in values.items():
            pair = parts_of_name(name)
            is_complex = pair[0] in self._scalars
            column, *imag = map(self._column, pair if is_complex else [name])
            column = column + 1j * imag[0] if imag else column
            axis = len(self.shape) - column.ndim + int(np.argmax(column.shape))
            choices = column.ravel()
            wanted = value if is_complex else checks.real_number(name, value)
            if np.ndim(wanted):
                raise wrong(name, "a number", checks.short(value))
            places = np.flatnonzero(choices == wanted)
            if not places.size:
                raise KeyError(f"no member has {name} = {wanted}")
            self = self._part(axis, int(places[0]))
        return self

    @property
    def _scalars(self) -> dict[str, Any]:
        """The parameters that are a number for each member, not a vector."""
        return {name: each for name, each in self._parts.items() if name not in self._axes}

    def _of_member(self, i: int | tuple[int, ...]) -> str:
        """Return " of member i (a=1.0)" for messages, "" for a single body."""
        if not self.shape:
            return ""
        values = ", ".join(f"{name}={value}" for name, value in self[i]._scalars.items())
        return f" of member {i}" + (f" ({values})" if values else "")

    def _column(self, name: str) -> FloatArray:
        """Return the values of a parameter; raise an error unless it varies along just one axis."""
        values = {n: np.asarray(a, np.float64) for n, a in self._scalars.items()}
        columns = {
            n: a
            for n, a in values.items()
            if 0 < a.size == max(a.shape, default=0) == self.shape[np.argmax(a.shape) - a.ndim]
        }
        if name in columns:
            return columns[name]
        if not self.shape:
            what = f"this is a single {type(self).__name__}, and sel is for families: {_FAMILY}"
            raise ValueError(f"sel: {what}")
        known = ", ".join(columns) or "none: select members by index"
        raise ValueError(f"sel: {name} must vary along one axis; those that do are {known}")

    def _part(self, axis: int, index: Any) -> Self:
        """Return the members that an integer, a slice or indices select along one axis."""
        # The index for parameters that all members share: their length is 1 on this axis.
        common = slice(None) if isinstance(index, slice) or np.ndim(index) else 0
        parts = {}
        for name, value in self._parts.items():
            array = np.asarray(value)
            its_axis = axis - len(self.shape) + array.ndim - self._axes.get(name, 0)
            if its_axis >= 0:
                selected = index if array.shape[its_axis] == self.shape[axis] else common
                array = array[(slice(None),) * its_axis + (selected,)]
            parts[name] = array
        return self._with_parts(parts)


def place_in(shape: tuple[int, ...], entry: Any) -> Any:
    """Check an `entry` that indexes the first axis; return an integer, a slice or indices."""
    if not shape:
        raise IndexError
    if isinstance(entry, slice):
        return entry
    array = np.asarray(entry)
    if array.dtype.kind not in "biu":
        raise TypeError
    if array.ndim > 1 or (array.dtype == bool and array.shape != shape[:1]):
        raise IndexError
    return np.arange(shape[0])[array]
