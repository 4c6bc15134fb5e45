"""`PeriodicOrbit`, the result of `periodic_orbit`, and how the orbits of a batch are joined."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray, spell, warn
from ..errors import NoConvergence
from ..fields.html import html_table
from ..keywords import lacking
from .events import Derivatives


class OrbitDerivatives(NamedTuple):
    """Derivatives of a periodic orbit with respect to a parameter."""

    period: float | Any
    """The derivative of the period, shape (...); 0 if the period is that of a force."""
    state: FloatArray
    """The derivative of the state, shape (..., D), as a change perpendicular to f."""


class PeriodicOrbit(NamedTuple):
    """A periodic orbit, or a batch of them: the result of :func:`periodic_orbit`.

    For a batch of the shape (...) the arrays have these axes first, and NaN where no orbit was
    found.

    Examples
    --------
    >>> from suslov_fast import Field, flow, periodic_orbit
    >>> field = Field.from_hamiltonian(lambda x: (x[0]**2 + x[1]**2) / 2 + x[0]**3, "q p")
    >>> orbit = periodic_orbit(field, [0.1, 0.0], period=6.3)
    >>> motion = flow(field, orbit.state, time=orbit.period, rtol=1e-12)
    >>> bool(abs(motion.states[-1] - orbit.state).max() < 1e-11)
    True
    """

    state: FloatArray
    """A state of the orbit, shape (..., D)."""
    period: float | Any
    """The period, shape (...)."""
    multipliers: NDArray[np.complex128]
    """Floquet multipliers: eigenvalues of the derivative of the motion over a period.

    They are sorted by decreasing modulus; in conjugate pairs Im > 0 comes first. The shape is
    (..., D), or less if variables have constant rates, or with constraints, as for
    :func:`lyapunov_exponents`."""
    residual: float | Any
    """The largest distance from the end of the orbit, or of an arc, to the start of the next arc.

    Distances are moduli of components, divided by the largest modulus in the states."""
    stable: bool | Any
    """True if the orbit attracts: all nontrivial multipliers have moduli below 1 - 1e-6.

    A trivial multiplier is 1 for any motion: one for the direction of the flow, unless the
    equations depend on time, and one for each known integral. With events that change states no
    integral is known."""
    derivatives: dict[str, OrbitDerivatives] = Derivatives()
    """For each parameter in the argument `derivatives`: the derivatives of period and state."""

    def __getattr__(self, name: str) -> NoReturn:
        times = "np.linspace(0, orbit.period, 200)"
        here = f"flow(system, orbit.state, time={times}).states" if name == "states" else ""
        raise lacking(self, name, here)

    def _repr_html_(self) -> str:
        return html_table("PeriodicOrbit", ["", "value"], self._asdict().items())


def each_of(
    batch: tuple[int, ...], member: Callable[[tuple[int, ...]], PeriodicOrbit | None]
) -> Iterator[PeriodicOrbit | None]:
    """Yield the orbits of members, or None; warn once of those without one, once of warnings."""
    failed, warned = [], []
    for index in np.ndindex(batch):
        orbit = None
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            try:
                orbit = member(index)
            except NoConvergence as error:
                failed.append((index, str(error)))
        warned += [(index, str(each.message)) for each in told[:1]]
        yield orbit
    for found in (failed, warned):
        if found:
            index, text = found[0]
            text = text.removeprefix("periodic_orbit").removeprefix(":").strip()
            what = "have no orbit" if found is failed else "have warnings"
            count = f"{len(found)} of {math.prod(batch)} starts {what}"
            warn(f"periodic_orbit: {count}, first: trajectory {spell(index)}: {text}")


def joined(
    batch: tuple[int, ...], each: list[PeriodicOrbit | None], layout: Any, names: tuple[str, ...]
) -> PeriodicOrbit:
    """Return one result for orbits of a batch; None has NaN."""
    first = next((orbit for orbit in each if orbit), None)
    count = 0 if first is None else len(first.multipliers)
    state = np.full(layout.n, np.nan, complex if layout.has_pairs else float)
    nothing = PeriodicOrbit(
        state,
        np.nan,
        np.full(count, np.nan + 0j),
        np.nan,
        False,
        Derivatives((name, OrbitDerivatives(np.nan, state)) for name in names),
    )
    orbits = [orbit or nothing for orbit in each]

    def of(values: Sequence[Any]) -> Any:
        array = np.array(values)
        return array.reshape(*batch, *array.shape[1:])

    by = {
        name: [of([each.derivatives[name][k] for each in orbits]) for k in range(2)]
        for name in names
    }
    return PeriodicOrbit(
        of([each.state for each in orbits]),
        of([each.period for each in orbits]),
        of([each.multipliers for each in orbits]),
        of([each.residual for each in orbits]),
        of([each.stable for each in orbits]),
        Derivatives((name, OrbitDerivatives(*values)) for name, values in by.items()),
    )
