"""`Motion`, the result of `flow`: states at the times that were asked for, and how motions end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..bodies.classes import BodyOrField
from ..checks import FloatArray
from ..keywords import public, unchanging
from .results import INSTEAD_IN_MOTIONS, QUANTITIES, States

if TYPE_CHECKING:
    import xarray

# Quantities that take a step size, which is 0 along the motion.
_OF_STEPS = {"first_integral"}


@unchanging
@dataclass(frozen=True, eq=False, repr=False)
class Motion(States):
    """Solutions of the equations of motion at given times: the result of :func:`flow`.

    Attributes
    ----------
    states : ndarray(float, shape=(n, ..., D))
        The states at the n times, in the order of `time`; NaN after the end of a solution.
        ``motion.x`` for a field, or ``motion.omega`` for a body, and ``np.asarray(motion)`` are the
        same array.
    time : ndarray(float, shape=(n,))
        The times.
    names : tuple of str
        Names of the components.
    status : ndarray(int8, shape=(...))
        The :class:`Status` of each trajectory: OK, or negative if it has no state at the last time.
    end : ndarray(float, shape=(...))
        The time at which a solution ends, or up to which it was computed; NaN if it reaches the
        last time.
    steps : ndarray(int, shape=(...))
        Number of steps that were taken; 0 where the solution is exact.
    ok : bool
        True if all solutions reach the last time.
    body, rtol, atol, max_step, stiff
        The arguments of :func:`flow`.

    Notes
    -----
    ``len(motion)``, ``motion[k]`` and iteration are those of `states`. Two motions are equal if all
    attributes are equal; NaN equals NaN. Arrays are read-only: change a copy.

    Examples
    --------
    An orbit in a cubic potential, along which the energy is constant:

    >>> import numpy as np
    >>> from suslov_fast import QuadraticField, flow
    >>> well = QuadraticField.from_hamiltonian(lambda x: x[1] ** 2 / 2 - x[0] + x[0] ** 3, "q p")
    >>> motion = flow(well, [0.9, 0.0], time=np.linspace(0, 20, 101))
    >>> motion
    Motion(x: (101, 2), time: 0 to 20, rtol: 1e-09, ended: 0 of 1)
    >>> motion.x[-1].round(6), bool(np.ptp(motion.energy()) < 1e-8)
    (array([0.325746, 0.490267]), True)
    """

    _table = INSTEAD_IN_MOTIONS

    states: FloatArray
    time: FloatArray
    body: BodyOrField
    status: NDArray[np.int8]
    end: FloatArray
    steps: NDArray[np.int64]
    rtol: float
    atol: float | tuple[float, ...] | None
    max_step: float | None
    stiff: bool | None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the components of a state."""
        return tuple(self.body._labels)

    @property
    def _variable(self) -> str:
        return variable_of(self.body)

    @property
    def _functions(self) -> list[str]:
        from ..maps import map_of, methods_of

        if methods_of(type(self.body)):
            return [name for name in map_of(self.body).functions(self.body) if name in QUANTITIES]
        return ["energy"] if getattr(self.body, "H", None) is not None else []

    @property
    def _conserved(self) -> str | None:
        return "energy" if "energy" in self._functions else None

    @property
    def _is_whole(self) -> bool:
        return True

    @property
    def _heading(self) -> tuple[str, str, int]:
        last = max(self.time, key=abs, default=0.0)
        return f"Motion of a {type(self.body).__name__}", f"to t = {last:g}", len(self.time)

    def _value(self, name: str, states: FloatArray) -> FloatArray:
        """Return the values of a public function for states of this motion."""
        function = getattr(import_module("suslov_fast"), name)
        values: FloatArray = function(self.body, states, *[0.0] * (name in _OF_STEPS))
        return values

    @public
    def plot(
        self,
        *names: int | str | Sequence[int | str],
        components: Sequence[int | str] = (0, 1),
        lines: bool | None = None,
        color: Any = None,
        title: str | bool | None = True,
        ax: Any = None,
    ) -> Any:
        """Draw the states over two components, over time, or in space (extra `plots`).

        Parameters
        ----------
        *names, components, lines, color, title, ax
            As in :meth:`Trajectories.plot`. States are joined in the order of time.

        Returns
        -------
        matplotlib.axes.Axes

        Raises
        ------
        TypeError, ValueError
            If there is no such component or colour, or `ax` has the wrong kind.

        Examples
        --------
        >>> import numpy as np
        >>> from suslov_fast import QuadraticField, flow
        >>> predators = lambda x: (x[0] - x[0] * x[1], x[0] * x[1] - x[1])
        >>> field = QuadraticField.from_function(predators, "prey predator")
        >>> motion = flow(field, [1.0, 0.5], time=np.linspace(0, 20, 401))
        >>> motion.plot("time", "prey").figure.savefig("prey.png")  # doctest: +SKIP
        """
        from . import plot  # which imports Matplotlib

        order = np.argsort(self.time, kind="stable")
        drawn = replace(self, states=self.states[order], time=self.time[order])
        chosen = names[0] if len(names) == 1 else names or components
        return plot.plot_run(drawn, chosen, lines, color, title, ax)

    @public
    def to_xarray(
        self, dims: str | Sequence[str] | None = None, coords: Mapping[Any, Any] | None = None
    ) -> xarray.Dataset:
        """Return the motion as a labelled `xarray.Dataset` (extra `xarray`).

        Parameters
        ----------
        dims, coords
            As in :meth:`Trajectories.to_xarray`.

        Returns
        -------
        xarray.Dataset
            Dimensions: "time", those of the batch, and "component".

        Raises
        ------
        ValueError
            If the number of names is not that of the axes, or a name is taken.

        Examples
        --------
        >>> from suslov_fast import QuadraticField, flow
        >>> field = QuadraticField.from_function(lambda x: (x[1], -x[0]), "q p")
        >>> data = flow(field, [1.0, 0.0], time=[0.0, 1.0, 2.0]).to_xarray()
        >>> data.x.sel(time=1.0, component="q").round(6).item()
        0.540302
        """
        from .files.datasets import motion_to_xarray

        return motion_to_xarray(self, dims, coords)

    def __repr__(self) -> str:
        time = self.time
        times = (
            f"{time[0]:g} to {time[-1]:g}" if len(time) > 1 else " ".join(f"{t:g}" for t in time)
        )
        states = f"{self._variable}: {self.states.shape}"
        ended = f"{np.count_nonzero(self.status < 0)} of {self.status.size}"
        return f"Motion({states}, time: {times}, rtol: {self.rtol:g}, ended: {ended})"


def variable_of(body: Any) -> str:
    """Return the name of the states of a system, "omega" or "x"."""
    from ..maps import methods_of

    records = methods_of(type(body))
    return next(iter(records.values())).variable if records else "x"
