"""What an iteration returns."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ._bodies.three import Suslov3D
from ._checks import FloatArray, integer, one_of
from ._conserved import energy, first_integral
from ._engine.arguments import Body
from ._engine.layout import first_index, spell
from ._engine.progress import Progress, check_progress
from ._engine.run import Results, Run, execute
from ._engine.threads import thread_count
from ._status import SingularStepWarning, Status

OnSingular = Literal["warn", "raise", "ignore"]


class SingularStepError(ArithmeticError):
    """Some trajectories of a batch came to an end before their last step.

    Attributes
    ----------
    trajectories : Trajectories
        The finished batch, failed trajectories included.
    """

    def __init__(self, message: str, trajectories: Trajectories) -> None:
        super().__init__(message)
        self.trajectories = trajectories

    def __reduce__(self) -> tuple[type, tuple[str, Trajectories]]:
        return type(self), (str(self), self.trajectories)


@dataclass(frozen=True, eq=False, repr=False)
class Trajectories:
    """A batch of trajectories, as :func:`iterate` returns it.

    Attributes
    ----------
    omega : ndarray(float, shape=(n_saved, ..., D))
        The saved states; NaN from the first state on that does not exist.
    n : ndarray(int, shape=(n_saved,))
        Their step numbers.
    eps : float or ndarray(float, shape=(...))
        The step size, in the unit of time that omega is measured in.
    body : Suslov3D or SuslovND
        The body.
    status : ndarray(int8, shape=(...))
        How each trajectory ended: a :class:`Status`; negative if it failed.
    final : ndarray(float, shape=(..., D))
        The state after the last step, whether saved or not; where saved, it may share memory with
        `omega`.
    failed_at : ndarray(int, shape=(...))
        The number of the first state that does not exist, or -1; read-only if nothing failed.
    """

    omega: FloatArray
    n: NDArray[np.int64]
    eps: Any
    body: Body
    status: NDArray[np.int8]
    final: FloatArray
    failed_at: NDArray[np.int64]
    attitude: FloatArray | None
    method: str
    steps: int
    save_every: int | None
    _resume: dict[str, FloatArray]

    @classmethod
    def of(cls, run: Run, results: Results) -> Trajectories:
        """The results of a run."""
        return cls(
            omega=results.omega,
            n=run.numbers,
            eps=float(run.eps) if run.eps.ndim == 0 else run.eps,
            body=run.body,
            status=results.status,
            final=results.final,
            failed_at=results.failed_at,
            attitude=results.attitude,
            method=run.method,
            steps=run.steps,
            save_every=run.save_every,
            _resume=results.resume,
        )

    def extend(
        self,
        steps: int,
        *,
        threads: int | None = None,
        on_singular: OnSingular = "warn",
        progress: Progress = None,
    ) -> Trajectories:
        """The same run, longer, bit for bit as if it had never been interrupted.

        Parameters
        ----------
        steps : int
            How many steps more, 0 or more.
        threads, on_singular, progress
            As in :func:`iterate`; trajectories that had failed before are not reported again.

        Returns
        -------
        Trajectories
            A new one, whose arrays hold the states of this one too.

        Raises
        ------
        TypeError, ValueError, MemoryError, ImportError, SingularStepError
            As :func:`iterate` does.

        Examples
        --------
        >>> from suslov_fast import Suslov3D, iterate
        >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
        >>> half = iterate(body, [1.0, 0.5], eps=0.2, steps=15)
        >>> whole = half.extend(15)
        >>> bool((whole.omega == iterate(body, [1.0, 0.5], eps=0.2, steps=30).omega).all())
        True
        """
        one_of("on_singular", on_singular, ("warn", "raise", "ignore"))
        check_progress(progress)
        resume = dict(self._resume)
        run = Run(
            body=self.body,
            batch=self.status.shape,
            omega0=resume.pop("omega0"),
            eps=np.asarray(self.eps),
            steps=self.steps + integer("steps", steps, 0, "an integer of at least 0"),
            save_every=self.save_every,
            method=self.method,
            orientation=resume.pop("R0", None),
            start=self.steps,
            resume=resume,
            threads=thread_count(threads),
            progress=progress,
        )
        longer = Trajectories.of(run, execute(run, before=(self.omega, self.attitude)))
        report(longer, on_singular, longer.failed_at > self.steps, stacklevel=2)
        return longer

    @property
    def t(self) -> FloatArray:
        """The times n eps of the saved states: (n_saved,), or (n_saved, ...) if eps varies."""
        times: FloatArray = np.multiply.outer(self.n, self.eps)
        return times

    @property
    def ok(self) -> bool:
        """Whether every trajectory finished."""
        return bool(self.status.min(initial=0) >= 0)

    def first_integral(self) -> FloatArray:
        """F of the saved states, shape (n_saved, ...); see :func:`suslov_fast.first_integral`.

        Raises
        ------
        NotIntegrableError
            If no first integral is known for the body.
        """
        return first_integral(self.body, self.omega, self.eps)

    def energy(self) -> FloatArray:
        """The energy of the saved states, shape (n_saved, ...); see :func:`suslov_fast.energy`."""
        return energy(self.body, self.omega)

    def to_xarray(self) -> Any:
        """The result as an `xarray.Dataset`, with step numbers and times as coordinates.

        Raises
        ------
        ImportError
            If xarray is not installed: ``pip install 'suslov_fast[xarray]'``.
        """
        try:
            import xarray
        except ImportError as error:
            raise ImportError(
                "to_xarray needs xarray: pip install 'suslov_fast[xarray]'"
            ) from error
        axes = self.status.ndim
        batch = ("trajectory",) if axes == 1 else tuple(f"batch_{k}" for k in range(axes))

        def over_batch(value: Any) -> Any:
            return batch, np.broadcast_to(value, self.status.shape)

        if isinstance(self.body, Suslov3D):
            names = ["Omega1", "Omega2"]
            parameters = {
                name: over_batch(getattr(self.body, name)) for name in ("I1", "I2", "I13", "I23")
            }
        else:
            names = [f"Omega{i + 1}n" for i in range(self.body.dimension)]
            parameters = {
                name: (
                    (*batch, "component"),
                    np.broadcast_to(getattr(self.body, name), self.final.shape),
                )
                for name in ("J", "I")
            }
        t = self.t if np.ndim(self.eps) == 0 else np.broadcast_to(self.t, self.omega.shape[:-1])
        return xarray.Dataset(
            {
                "omega": (("n", *batch, "component"), self.omega),
                "final": ((*batch, "component"), self.final),
                "status": over_batch(self.status),
                "failed_at": over_batch(self.failed_at),
                "eps": over_batch(self.eps),
                **parameters,
            },
            coords={"n": self.n, "t": (("n", *batch)[: t.ndim], t), "component": names},
        )

    def __repr__(self) -> str:
        failed = np.count_nonzero(self.status < 0)
        return (
            f"Trajectories(omega: {self.omega.shape}, n: {_first_and_last(self.n)}, "
            f"eps: {_range(self.eps)}, failed: {failed} of {self.status.size})"
        )


def _first_and_last(n: NDArray[np.int64]) -> str:
    return f"{n[0]}" if n.size == 1 else f"{n[0]}, {n[1]} ... {n[-1]}"


def _range(eps: Any) -> str:
    if np.size(eps) == 0:
        return "none"
    low, high = np.min(eps), np.max(eps)
    return f"{low:g}" if low == high else f"{low:g} ... {high:g}"


def report(
    trajectories: Trajectories, on_singular: str, failed: NDArray[np.bool_], stacklevel: int
) -> None:
    """Say once for the whole batch which trajectories came to an end."""
    if on_singular == "ignore" or not failed.any():
        return
    parts = []
    for code, what in ((Status.SINGULAR, "singular step"), (Status.NONFINITE, "non-finite step")):
        of_code = failed & (trajectories.status == code)
        if of_code.any():
            index = first_index(of_code)
            parts.append(
                f"{np.count_nonzero(of_code)} of {failed.size} trajectories: {what}, "
                f"first: {spell(index)} at step {trajectories.failed_at[index]}"
            )
    message = "; ".join(parts)
    if on_singular == "raise":
        raise SingularStepError(message, trajectories)
    warnings.warn(message, SingularStepWarning, stacklevel=stacklevel + 1)
