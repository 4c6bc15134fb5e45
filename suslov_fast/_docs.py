"""Paragraphs that the docstrings of several public functions share."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable[..., Any])

_SHARED = {
    # Parameters
    "body": """body : Suslov3D, SuslovND, SuslovGyrostat or QuadraticField
    A single one, or a batch.""",
    "rigid_body": """body : Suslov3D, SuslovND or SuslovGyrostat
    A single one, or a batch.""",
    "body_in_3d": """body : Suslov3D or SuslovGyrostat
    A single one, or a batch.""",
    "body_3d": """body : Suslov3D
    A single one, or a batch.""",
    "omega": """omega : array_like(float, shape=(..., D))
    Angular velocities: (Omega1, Omega2), or the n - 1 components Omega_in; or states of a field.
    The result is NaN for states that are NaN.""",
    "omega0": """omega0 : array_like(float, shape=(..., D))
    State 0, or in continuous time that at time 0. The result is NaN where it is NaN.""",
    "eps": """eps : array_like(float, shape=(...))
    Step size, in the unit of time of the angular velocities; a negative one is that of the
    inverse map.""",
    "steps": """steps : int
    Number of steps, 0 or more.""",
    "I3": """I3 : array_like(float, shape=(...)), optional
    The third moment of inertia, positive; by default that of the body.""",
    "save_every": """save_every : int or None
    Save the states 0, k, 2k, ... up to `steps`; None saves only the last.""",
    "out": """out : ndarray(float64, shape=(n_saved, ..., D)), optional
    C-contiguous array that receives the saved states, instead of a new one.""",
    "on_singular": """on_singular : {"warn", "raise", "ignore"}
    Action if trajectories fail: one :class:`SingularStepWarning` for all, a
    :class:`SingularStepError` that holds the result, or none.""",
    "progress": """progress : bool or callable, optional
    True shows a bar (needs tqdm); a callable is called as ``progress(done, steps)``.""",
    "dims": """dims : str or sequence of str, optional
    Names for the axes of the batch; by default those of named parameters of a field, each along
    the axis along which it varies alone, and "trajectory", or "batch_0", "batch_1", ... The
    name of a parameter that varies along this axis alone, such as "eps" or "I13", makes it the
    coordinate: ``data.sel(eps=0.2)``.""",
    "coords": """coords : mapping, optional
    Coordinates along them, as `xarray.Dataset.assign_coords` takes them.""",
    "threads": """threads : int, optional
    Number of threads, by default Numba's. Results do not depend on it.""",
    "rotation": """rotation : array_like(float, shape=(..., n, n)), optional
    The matrix that `from_inertia` or `from_mass_tensor` returned with the body. With it, vectors
    and matrices are in the basis in which the inertia was given, else in the adapted basis.""",
    "attitude": """attitude : array_like(float, shape=(..., n, n)), optional
    Orientations, as :func:`suslov_fast.attitude` returns them, in place of `rotation`. With them
    the result is in space.""",
    "letter": """letter : str, optional
    Letter of the panel, written above it.""",
    "ax": """ax : matplotlib.axes.Axes, optional
    Axes to draw on; by default those of a new figure.""",
    "map": """map : KahanMap
    Made by `kahan`.""",
    "parameters": """parameters : mapping
    Numbers and nested lists by name, and, as "body", the name of the class.""",
    "path": """path : str or path-like
    A name that ends in .npz.""",
    "dimension": """dimension : int
    The number of variables, D.""",
    "named": """**parameters : float or array_like(float, shape=(...))
    Named parameters, passed to the function. Arrays broadcast, and make a batch of fields; single
    numbers remain exact.""",
    "seed": """seed : int, optional
    Seed of the random primes, points and lines.""",
    # Errors
    "invalid": """TypeError, ValueError
    If an argument has a wrong type, shape or value; before any work.""",
    "needs_xarray": """ImportError
    If a required library is not installed (extra `xarray`).""",
    "needs_large": """ImportError
    If Dask, filelock, xarray or Zarr are not installed (extra `large`).""",
    "errors_of_runs": """MemoryError
    If the result does not fit in memory.
ImportError
    If `progress` is True and tqdm is not installed.
SingularStepError
    If `on_singular` is "raise" and a trajectory fails.""",
    "not_solved": """NotIntegrableError
    If no closed form is known for the body; in three dimensions there always is one.""",
    "not_integrable": """NotIntegrableError
    If no first integral is known for the body.""",
    "next_states": """The next states; NaN for states that are NaN, and, with one
    :class:`SingularStepWarning`, at poles.""",
    "poles": """At a pole there is no next state: :func:`iterate` and :func:`step` stop there, with
NaN and the status SINGULAR. The closed form continues past the pole, as the birational map does:
:func:`exact` and :func:`limits` return the states after it, and only the state directly after the
pole is NaN.""",
}


class _Paragraphs:
    """Paragraphs by name, several by "omega, eps", and those of a section by "Raises: invalid"."""

    def __init__(self, given: dict[str, str]) -> None:
        self.known = _SHARED | given

    def __getitem__(self, key: str) -> str:
        title, _, names = key.rpartition(": ")
        text = "\n".join(self.known[name] for name in names.split(", "))
        return f"{title}\n{'-' * len(title)}\n{text}" if title else text


def filled(function: F, **given: str) -> F:
    """Replace each ``%(name)s`` of a docstring by a shared paragraph, or one that is given."""
    if function.__doc__:  # None with `python -OO`
        function.__doc__ = inspect.cleandoc(function.__doc__) % _Paragraphs(given)
    return function
