"""`Motion`, the result of `flow`: states at the times that were asked for, and how motions end."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bodies.classes import BodyOrField
from ..checks import FloatArray, one_of, short, wrong
from ..engine.status import ended_in_words
from ..keywords import public
from .change import Change
from .changes import changes_of
from .columns import CHANGES
from .events import Events
from .results import QUANTITIES, OfMotion, States


@dataclass(frozen=True, eq=False, repr=False)
class Motion(States, OfMotion):
    """Solutions of the equations of motion at given times: the result of :func:`flow`.

    Attributes
    ----------
    states : ndarray(float, shape=(n, ..., D))
        The states at the n times, in the order of `time`; NaN after the end of a solution.
        ``motion.x`` for a field, or ``motion.omega`` for a body, and ``np.asarray(motion)`` are the
        same array.
    time : ndarray(float, shape=(n,))
        The times.
    final : ndarray(float, shape=(..., D))
        The states at the last of them.
    names : tuple of str
        Names of the components.
    status : ndarray(int8, shape=(...))
        The :class:`Status` of each trajectory: OK, or negative if it has no state at the last time.
    end : ndarray(float, shape=(...))
        The time at which a solution ends, or up to which it was computed; NaN if it reaches the
        last time.
    steps : ndarray(int, shape=(...))
        Number of steps that were taken; 0 where the solution is exact.
    changes : Events or None
        What changes of the state did, in the order of trajectories and times.
    by : tuple of str
        What derivatives are with respect to: the argument `derivatives` of :func:`flow`.
    derivatives : dict of str to ndarray
        Them all: ``motion.derivatives["x0"]`` is ``motion.derivative("x0")``.
    body, rtol, atol, max_step, stiff
        The arguments of :func:`flow`.

    Notes
    -----
    ``motion.ok`` is True if all solutions reach the last time. ``len(motion)``, ``motion[k]`` and
    iteration are those of `states`: k is the number of a time, ``motion[:, k]`` the array of
    trajectory k. Two motions are equal if all attributes are equal; NaN equals
    NaN. Arrays are read-only, so that a motion stays what was computed: change a copy.

    Examples
    --------
    An orbit in a cubic potential, along which the energy is constant:

    >>> import numpy as np
    >>> from suslov_fast import QuadraticField, flow
    >>> well = QuadraticField.from_hamiltonian(lambda x: x[1] ** 2 / 2 - x[0] + x[0] ** 3, "q p")
    >>> motion = flow(well, [0.9, 0.0], time=np.linspace(0, 20, 101))
    >>> motion
    Motion(x: (101, 2), time: 0 to 20, rtol: 1e-09)
    >>> motion.x[-1].round(6), bool(np.ptp(motion.energy()) < 1e-8)
    (array([0.325746, 0.490267]), True)
    """

    states: FloatArray
    time: FloatArray
    body: BodyOrField
    status: NDArray[np.int8]
    end: FloatArray
    steps: NDArray[np.int64]
    by: tuple[str, ...] = ()
    _derivatives: FloatArray | None = None  # (n, ..., D, C) those by x0 first
    changes: Events | None = None

    @classmethod
    def _restored(cls, attributes: dict[str, Any], about: dict[str, Any]) -> Motion:
        parts = {each.name: attributes.pop(f"changes.{each.name}") for each in CHANGES}
        count = attributes.pop("changes.count")
        given = tuple(Change.from_dict(each) for each in about.get("changes", ()))
        changes = None
        if given or count is not None:
            changes = changes_of(parts, attributes["body"], given, attributes["status"].shape)
            if not np.array_equal(changes.count, count):
                raise wrong("count", "that of the changes", short(count.tolist()))
        return cls._of(attributes | {"changes": changes})

    def __call__(self, *_: Any) -> Any:
        raise TypeError("a motion cannot be called: pass the times t to flow(system, x0, time=t)")

    @public
    def derivative(self, by: str) -> FloatArray:
        """Return the derivatives of the states with respect to the starts, or to a parameter.

        Parameters
        ----------
        by : str
            "x0", or the name of a parameter: one of `by`, see :func:`flow`.

        Returns
        -------
        ndarray(float, shape=(n, ..., D, D) or (n, ..., D))
            At [..., i, j] that of component i with respect to component j of x0; for a parameter,
            at [..., i] that of component i.

        Examples
        --------
        How does a decay depend on its rate, and on its start?

        >>> from suslov_fast import Field, flow
        >>> decay = Field.from_function(lambda x, k: (-k * x[0],), "c", k=0.5)
        >>> motion = flow(decay, [3.0], time=[0.0, 2.0], derivatives=("x0", "k"))
        >>> motion.derivative("k").round(6), motion.derivative("x0").round(6).tolist()
        (array([[ 0.      ],
               [-2.207277]]), [[[1.0]], [[0.367879]]])
        """
        if not self.by:
            how = "a name in derivatives: flow(..., derivatives=('x0',))"
            raise wrong("by", how, short(by))
        by, D = one_of("by", by, self.by), self.body.dimension
        assert self._derivatives is not None
        if by == "x0":
            return np.ascontiguousarray(self._derivatives[..., :D])
        parameters = [name for name in self.by if name != "x0"]
        k = parameters.index(by) + D * ("x0" in self.by)
        return np.ascontiguousarray(self._derivatives[..., k])

    @property
    def derivatives(self) -> dict[str, FloatArray]:
        """The derivatives of the states, by what they are with respect to."""
        return {name: self.derivative(name) for name in self.by}

    @property
    def final(self) -> FloatArray:
        """The states at the last of the times, shape (..., D)."""
        if not len(self.time):
            raise IndexError("a motion at no times has no final state: pass time=T to flow")
        return self.states[-1]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the components of a state."""
        return tuple(self.body.labels)

    @property
    def _functions(self) -> list[str]:
        from ..maps import map_of, methods_of

        if methods_of(type(self.body)):
            return [name for name in map_of(self.body).functions(self.body) if name in QUANTITIES]
        return ["energy"] if getattr(self.body, "H", None) is not None else []

    _is_whole = True

    @property
    def _heading(self) -> tuple[str, str, int]:
        last = max(self.time, key=abs, default=0.0)
        return self._titles["title"], f"to t = {last:g}", len(self.time)

    def _in_order(self) -> Motion:
        order = np.argsort(self.time, kind="stable")
        return replace(self, states=self.states[order], time=self.time[order])

    def __repr__(self) -> str:
        time = self.time
        times = (
            f"{time[0]:g} to {time[-1]:g}" if len(time) > 1 else " ".join(f"{t:g}" for t in time)
        )
        states = f"{self._variable}: {self.states.shape}"
        ended = ended_in_words(self.status)
        return f"Motion({states}, time: {times or 'none'}, rtol: {self.rtol:g}{ended})"
