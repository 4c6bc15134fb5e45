"""The map: one step, and many steps of a batch."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._bodies.three import Suslov3D
from ._checks import FloatArray, integer, one_of
from ._core.cpu import blocks, closed_form, map_3d, map_nd
from ._engine import threads as _threads
from ._engine.arguments import Body, check
from ._engine.closed_form import scratch
from ._engine.layout import (
    apart,
    first_index,
    flat_parameter,
    flat_saved_states,
    flat_vectors,
    saved_states,
    spell,
    unflatten,
)
from ._engine.progress import Progress, check_progress, reporter
from ._status import SingularStepError, SingularStepWarning, Status
from ._trajectories import Trajectories

Method = Literal["auto", "canonical", "ds2", "gauss", "rank2"]
Order = Literal["C", "F"]
OnSingular = Literal["warn", "raise", "ignore"]

# Python looks for Ctrl-C between slices, the first of so many lane-steps: some 10 ms to 300 ms.
_SLICE = 2**27
# Slices that take less or more seconds than these are followed by longer or shorter ones.
_SHORT, _LONG = 0.05, 0.2
# What a saved state costs, in steps.
_SAVING = 8
# Orbits that may meet a pole are iterated for so many steps, those not past it for 16 times more.
_AHEAD = 256
# From so many steps on the closed form is faster than they are.
JUMP = 32


def step(body: Body, omega: ArrayLike, eps: ArrayLike) -> FloatArray:
    """One step of the discrete Suslov problem, equation (ds2), or (dsn) in n dimensions.

    Parameters
    ----------
    body : Suslov3D or SuslovND
        The body, or a batch of them.
    omega : array_like(float, shape=(..., D))
        Angular velocities: (Omega1, Omega2), or the n - 1 components Omega_in.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega; a negative one gives the inverse map.

    Returns
    -------
    ndarray(float, shape=(..., D))
        The next states; NaN, with one :class:`SingularStepWarning`, where there is none.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above; nothing is computed then.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, step
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> step(body, [1.0, 0.5], eps=0.2).round(6)
    array([1.013781, 0.372248])
    """
    return next_states(body, omega, eps, stacklevel=3)


def next_states(body: Body, omega: ArrayLike, eps: ArrayLike, stacklevel: int) -> FloatArray:
    """One step, for functions that need it; `stacklevel` says whom its warning points at."""
    trajectories = _iterate(body, "omega", omega, eps, 1, None, "auto", "C", None, None, None)
    _report(trajectories, "warn", stacklevel)
    return trajectories.final


def iterate(
    body: Body,
    omega0: ArrayLike,
    eps: ArrayLike,
    steps: int,
    *,
    save_every: int | None = 1,
    method: Method = "auto",
    order: Order = "C",
    out: FloatArray | None = None,
    threads: int | None = None,
    on_singular: OnSingular = "warn",
    progress: Progress = None,
) -> Trajectories:
    """Iterate a batch of trajectories of the discrete Suslov problem.

    The shapes of the body, of `eps` and of `omega0` without its last axis broadcast to the batch
    shape ``...``. The result for one trajectory is the same bit for bit alone, in any batch, in
    any order and on any number of threads.

    Parameters
    ----------
    body : Suslov3D or SuslovND
        The body, or a batch of them.
    omega0 : array_like(float, shape=(..., D))
        Initial angular velocities: (Omega1, Omega2), or the n - 1 components Omega_in.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega0; a negative one gives the inverse map.
    steps : int
        Number of steps, 0 or more.
    save_every : int or None
        Keep the states 0, k, 2k, ... up to `steps`; None keeps only the last, which `omega` and
        `final` of the result then share.
    method : {"auto", "canonical", "ds2"}, or {"auto", "gauss", "rank2"} in n dimensions
        In three dimensions "canonical" iterates the parameter-free form of the map, "ds2" the
        formula as the paper prints it, which is slower and less accurate. "auto" is "canonical"
        where states are saved. For the last state alone it does not iterate but evaluates the
        closed form, in a time that does not grow with `steps`, and agrees to rounding; only orbits
        that may meet a pole (they have t >= 1) are iterated until they are past it, and so are runs
        of fewer than 32 steps.
        In n dimensions "gauss" eliminates the matrix A in some n**3 / 3 operations, with partial
        pivoting; "rank2" uses that A is diagonal plus rank two and needs some 20 n. "auto" is
        "rank2", which was measured to be faster for every n where not several J_i - eps p / 2
        nearly vanish at once; there both eliminate.
    order : {"C", "F"}
        Memory order of the array that is allocated; "F" makes the batch the fastest axis.
    out : ndarray(float64, shape=(..., n_saved, D)), optional
        C- or F-contiguous array that receives the saved states, instead of a new one.
    threads : int, optional
        Number of threads; by default what Numba is set to. The setting is restored afterwards.
    on_singular : {"warn", "raise", "ignore"}
        What to do if trajectories came to an end: one :class:`SingularStepWarning` for all, a
        :class:`SingularStepError` that carries the result, or nothing.
    progress : bool or callable, optional
        True shows a bar (needs tqdm); a callable is called as ``progress(done, steps)``.

    Returns
    -------
    Trajectories

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above; nothing is computed or written then.
    ImportError
        If `progress` is True and tqdm is not installed.
    SingularStepError
        If `on_singular` is "raise" and a trajectory came to an end.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, iterate
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> orbit = iterate(body, [1.0, 0.5], eps=0.2, steps=25)
    >>> orbit.omega.shape
    (26, 2)
    >>> orbit.final.round(6)
    array([ 0.873325, -1.093093])
    """
    one_of("on_singular", on_singular, ("warn", "raise", "ignore"))
    trajectories = _iterate(
        body, "omega0", omega0, eps, steps, save_every, method, order, out, threads, progress
    )
    _report(trajectories, on_singular, stacklevel=2)
    return trajectories


@dataclass(frozen=True)
class _Problem:
    """Checked arguments of `iterate`, as flat arrays over the batch of B trajectories."""

    body: Body
    method: str
    batch: tuple[int, ...]
    order: str
    states: FloatArray  # (B, D)
    step_size: FloatArray  # (B,) or (1,)
    steps: int
    save_every: int | None
    saved: FloatArray  # what a loop fills; no states if only the last is wanted
    threads: int | None
    progress: Progress

    def slices(self, work: float) -> Iterator[tuple[int, int]]:
        """Parts (start, stop) of the run, between which Python looks for Ctrl-C.

        `work` is that of a step of one trajectory, in steps of the 3D map; where steps turn out to
        be cheaper or dearer, slices grow or shrink.
        """
        if self.save_every is not None:
            work += _SAVING / self.save_every
        # Few trajectories take as long as half a block.
        length = int(_SLICE / (work * max(len(self.states), blocks.LANES // 2)))
        if self.steps <= length and not self.progress:
            yield 0, self.steps
            return
        with reporter(self.progress, self.steps) as report:
            stop = -1
            while stop < self.steps:
                start = max(stop, 0)
                stop = min(start + max(length, 1), self.steps)
                begin = time.perf_counter()
                yield start, stop
                seconds = time.perf_counter() - begin
                if seconds < _SHORT:
                    length *= 2
                elif seconds > _LONG:
                    length //= 2
                report(stop)

    @property
    def every(self) -> int:
        """States whose number is a multiple of this are saved."""
        return self.steps + 1 if self.save_every is None else self.save_every

    @property
    def last_saved(self) -> FloatArray | None:
        """The last state, as a view (B, D) of the saved ones, if it is among them."""
        if self.save_every is None or self.steps % self.save_every:
            return None
        return self.saved[:, -1].T if self.order == "F" else self.saved[:, -1]

    def shared_work(self, lanes: int, steps: float) -> int:
        """Lane-steps that threads can share: none within one block."""
        return int(len(self.states) * steps) if len(self.states) > lanes else 0


def _iterate(
    body: Body,
    name: str,
    omega0: ArrayLike,
    eps: ArrayLike,
    steps: int,
    save_every: int | None,
    method: str,
    order: str,
    out: FloatArray | None,
    threads: int | None,
    progress: Progress,
) -> Trajectories:
    """Check everything, then iterate; failures are recorded but not yet reported."""
    (omega, step_size), batch = check(body, {name: omega0}, {"eps": eps})
    steps = integer("steps", steps, 0, "an integer of at least 0")
    if save_every is not None:
        expected = "None or an integer of at least 1"
        save_every = integer("save_every", save_every, 1, expected)
    in_3d = isinstance(body, Suslov3D)
    one_of("method", method, ("auto", "canonical", "ds2") if in_3d else ("auto", "gauss", "rank2"))
    one_of("order", order, ("C", "F"))
    threads = _threads.thread_count(threads)
    check_progress(progress)
    n_saved = 1 if save_every is None else steps // save_every + 1
    shape = (*batch, n_saved, body.dimension)
    try:
        if math.prod(shape) > 2**60:  # more than NumPy could even ask for
            raise MemoryError
        first, every = (steps, 1) if save_every is None else (0, save_every)
        n = np.arange(first, first + n_saved * every, every)
        saved = None
        if save_every is not None or order == "F" or out is not None:
            saved = saved_states(shape, order, out)
            order = "C" if saved.flags.c_contiguous else "F"
    except MemoryError as error:
        raise MemoryError(
            f"expected saved states that fit in memory, got shape {shape}; raise save_every"
        ) from error

    eps = float(step_size) if step_size.ndim == 0 else step_size.copy()
    normalised = body.normalised_eps(step_size) if isinstance(body, Suslov3D) else step_size
    states, flat_eps = flat_vectors(omega, batch, order), flat_parameter(normalised, batch, order)
    if out is not None:
        states, flat_eps = apart(states, out), apart(flat_eps, out)
    problem = _Problem(
        body=body,
        method=method,
        batch=batch,
        order=order,
        states=states,
        step_size=flat_eps,
        steps=steps,
        save_every=save_every,
        saved=(
            np.empty((0, 0, 0))
            if saved is None or save_every is None
            else flat_saved_states(saved, order)
        ),
        threads=threads,
        progress=progress,
    )
    final, status, failed_at = (_run_3d if in_3d else _run_nd)(problem)
    final = unflatten(final, batch, order)
    if saved is None:
        saved = final[..., np.newaxis, :]
    elif save_every is None:
        saved[..., 0, :] = final
    return Trajectories(
        omega=np.moveaxis(saved, -2, 0),
        n=n,
        eps=eps,
        body=body,
        status=unflatten(status, batch, order),
        final=final,
        failed_at=unflatten(failed_at, batch, order),
    )


def jumps(body: Body, method: str, save_every: int | None, steps: int) -> bool:
    """Whether `iterate` takes the last states from the closed form, where it can."""
    last_only = method == "auto" and save_every is None
    return isinstance(body, Suslov3D) and last_only and JUMP <= steps <= 2**53


_Results = tuple[FloatArray, NDArray[np.int8], NDArray[np.int64]]


def _run_3d(problem: _Problem) -> _Results:
    """Final states, statuses and first missing states; saved states are filled on the way."""
    assert isinstance(problem.body, Suslov3D)
    parameters = [*problem.body.flat_normalised(problem.batch), problem.step_size]
    if not jumps(problem.body, problem.method, problem.save_every, problem.steps):
        return _iterate_3d(problem, parameters)
    results = _jump_3d(replace(problem, progress=None), parameters)
    with reporter(problem.progress, problem.steps) as report:
        report(problem.steps)
    return results


def _jump_3d(problem: _Problem, parameters: list[FloatArray]) -> _Results:
    """The last states by the closed form.

    Orbits that may meet a pole are iterated from their start until they are past it.
    """
    final, status = _closed_form(problem, parameters)
    if status.min(initial=0) >= 0:
        return final, status, _never(len(status))
    failed_at = np.full(len(status), -1)
    left = np.flatnonzero(status < 0)
    ahead = _AHEAD
    while left.size:
        ahead = min(ahead, problem.steps)
        few = replace(problem, states=problem.states[left], steps=ahead)
        final[left], status[left], failed_at[left] = _iterate_3d(few, _of(left, parameters))
        if ahead == problem.steps:
            break
        left = left[status[left] >= 0]
        rest = replace(problem, states=final[left], steps=problem.steps - ahead)
        ends, codes = _closed_form(rest, _of(left, parameters))
        past = codes >= 0
        final[left[past]] = ends[past]
        left = left[~past]
        ahead *= 16
    return final, status, failed_at


def _closed_form(
    problem: _Problem, parameters: list[FloatArray]
) -> tuple[FloatArray, NDArray[np.int8]]:
    """Last states and statuses; a status is negative where the closed form may not be used."""
    size = len(problem.states)
    final, status = np.empty((size, 2)), np.empty(size, np.int8)
    _threads.run(
        closed_form.jump,
        problem.shared_work(closed_form.WIDTH, closed_form.WORK),
        problem.threads,
        *parameters,
        problem.states,
        float(problem.steps),
        final,
        status,
        scratch(),
    )
    return final, status


def _of(chosen: NDArray[np.intp], parameters: list[FloatArray]) -> list[FloatArray]:
    """The parameters of some trajectories."""
    return [each if each.size == 1 else each[chosen] for each in parameters]


def _iterate_3d(problem: _Problem, parameters: list[FloatArray]) -> _Results:
    size = len(problem.states)
    method = map_3d.PRINTED if problem.method == "ds2" else map_3d.CANONICAL
    last = problem.last_saved
    final = np.empty((size if last is None else 0, 2))
    status = np.empty(size, np.int8)
    resume = np.empty((2, 0))
    for start, stop in problem.slices(1.0):
        if stop < problem.steps and not resume.size:
            resume = np.empty((2, size))
        _threads.run(
            map_3d.iterate,
            problem.shared_work(blocks.LANES, stop - start),
            problem.threads,
            method,
            *parameters,
            problem.states,
            start,
            stop,
            problem.every,
            problem.saved,
            problem.order == "F",
            resume,
            final,
            status,
        )
    failed_at = _never(size)
    if status.min(initial=0) < 0:
        failed_at = failed_at.copy()
        failed = np.flatnonzero(status < 0)
        _threads.run(
            map_3d.locate_failure,
            failed.size * problem.steps,
            problem.threads,
            method,
            *parameters,
            problem.states,
            problem.steps,
            failed,
            status,
            failed_at,
        )
    return final if last is None else last, status, failed_at


def _never(size: int) -> NDArray[np.int64]:
    """`failed_at` where nothing failed: -1, read-only and in no memory."""
    return np.ndarray((size,), np.int64, b"\xff" * 8, 0, (0,))


def _run_nd(problem: _Problem) -> _Results:
    """The same in n dimensions."""
    size, m = problem.states.shape
    method = map_nd.GAUSS if problem.method == "gauss" else map_nd.RANK2
    J, I = (
        flat_vectors(np.asarray(each), problem.batch if np.ndim(each) > 1 else (1,), problem.order)
        for each in problem.body.parameters
    )
    final = np.empty((size, m))
    status, failed_at = np.full(size, Status.OK, np.int8), np.full(size, -1)
    states = problem.states
    # The O(n) step may have to eliminate each time: then the first slice takes some 0.3 s.
    work = m**3 / 3.0 if method == map_nd.GAUSS else max(8.0 * m, m**3 / 48.0)
    for start, stop in problem.slices(work):
        _threads.run(
            map_nd.iterate,
            problem.shared_work(map_nd.block_size(m), (stop - start) * work),
            problem.threads,
            method,
            J,
            I,
            problem.step_size,
            states,
            start,
            stop,
            problem.every,
            problem.saved,
            problem.order == "F",
            final,
            status,
            failed_at,
        )
        states = final
    return final, status, failed_at


def _report(trajectories: Trajectories, on_singular: str, stacklevel: int) -> None:
    """Say once for the whole batch which trajectories came to an end."""
    if trajectories.ok or on_singular == "ignore":
        return
    status = trajectories.status
    parts = []
    for code, what in ((Status.SINGULAR, "singular step"), (Status.NONFINITE, "non-finite step")):
        failed = status == code
        if failed.any():
            index = first_index(failed)
            parts.append(
                f"{np.count_nonzero(failed)} of {status.size} trajectories: {what}, "
                f"first: {spell(index)} at step {trajectories.failed_at[index]}"
            )
    message = "; ".join(parts)
    if on_singular == "raise":
        raise SingularStepError(message, trajectories)
    warnings.warn(message, SingularStepWarning, stacklevel=stacklevel + 1)
