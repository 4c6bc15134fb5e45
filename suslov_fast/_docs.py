"""Paragraphs shared by the docstrings of several public functions."""

from __future__ import annotations

import re
from collections.abc import Callable
from textwrap import indent
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable[..., Any])

PARAGRAPHS = {
    "any_body": """\
body : Suslov3D, SuslovND, SuslovGyrostat or QuadraticField
    The body or field, or a batch of them.""",
    "body": """\
body : Suslov3D or SuslovND
    The body, or a batch of them.""",
    "body_or_gyrostat": """\
body : Suslov3D or SuslovGyrostat
    The body, or a batch of them.""",
    "body_3d": """\
body : Suslov3D
    The body, or a batch of them.""",
    "omega": """\
omega : array_like(float, shape=(..., D))
    Angular velocities. The result is NaN for states that are NaN.""",
    "omega_3d": """\
omega : array_like(float, shape=(..., 2))
    Angular velocities (Omega1, Omega2). The result is NaN for states that are NaN.""",
    "eps": """\
eps : array_like(float, shape=(...))
    Step size, in the unit of time of the angular velocities.""",
    "eps0": """\
eps : array_like(float, shape=(...))
    Step size, in the unit of time of the angular velocities; a negative one gives the inverse
    map.""",
    "steps": """\
steps : int
    Number of steps, 0 or more.""",
    "save_every": """\
save_every : int or None
    Save the states 0, k, 2k, ... up to `steps`; None saves only the last.""",
    "out": """\
out : ndarray(float64, shape=(n_saved, ..., D)), optional
    C-contiguous array that receives the saved states, instead of a new one.""",
    "on_singular": """\
on_singular : {"warn", "raise", "ignore"}
    Action if trajectories fail: one :class:`SingularStepWarning` for all, a
    :class:`SingularStepError` that holds the result, or none.""",
    "progress": """\
progress : bool or callable, optional
    True shows a bar (needs tqdm); a callable is called as ``progress(done, steps)``.""",
    "dims": """\
dims : str or sequence of str, optional
    Names for the axes of the batch; by default "trajectory", or "batch_0", "batch_1", ... The
    name of a parameter that varies along this axis alone, such as "eps" or "I13", makes it the
    coordinate: ``data.sel(eps=0.2)``.
coords : mapping, optional
    Coordinates along them, as `xarray.Dataset.assign_coords` takes them.""",
    "threads": """\
threads : int, optional
    Number of threads, by default Numba's. Results do not depend on it.""",
    "rotation": """\
rotation : array_like(float, shape=(..., n, n)), optional
    The matrix that `from_inertia` or `from_mass_tensor` returned with the body, if the input
    is in the basis in which the inertia was given; by default it is in the adapted basis.""",
    "frame": """\
rotation : array_like(float, shape=(..., n, n)), optional
    The matrix that `from_inertia` or `from_mass_tensor` returned with the body. With it the
    result is in the basis in which the inertia was given, without it in the adapted basis.
attitude : array_like(float, shape=(..., n, n)), optional
    Orientations, as :func:`suslov_fast.attitude` returns them. With them the result is in
    space.""",
    "panel": """\
letter : str, optional
    Letter of the panel, written above it.
ax : matplotlib.axes.Axes, optional
    Axes to draw on; by default those of a new figure.

Returns
-------
matplotlib.axes.Axes""",
    "invalid": """\
TypeError, ValueError
    If an argument has a wrong type or shape, or is infinite.""",
    "invalid_frame": """\
TypeError, ValueError
    If an argument has a wrong type or shape or is infinite, or if both `rotation` and
    `attitude` are given.""",
    "invalid_run": """\
TypeError, ValueError
    If an argument has a wrong type or shape, or is infinite; before any work.
MemoryError
    If the result does not fit in memory.
ImportError
    If `progress` is True and tqdm is not installed.
SingularStepError
    If `on_singular` is "raise" and a trajectory fails.""",
    "needs_xarray": """\
ImportError
    If a required library is not installed: ``pip install 'suslov_fast[xarray]'``.""",
    "needs_large": """\
ImportError
    If Dask, filelock, xarray or Zarr are not installed: ``pip install 'suslov_fast[large]'``.""",
    "not_solved": """\
NotIntegrableError
    If no closed form is known for the body; in three dimensions there always is one.""",
    "next_states": """\
The next states; NaN for states that are NaN, and, with one :class:`SingularStepWarning`, at
poles.""",
    "poles": """\
At a pole there is no next state: :func:`iterate` and :func:`step` stop there, with NaN and the
status SINGULAR. The closed form continues past the pole, as the birational map does:
:func:`exact` and :func:`limits` return the states after it, and only the state directly after
the pole is NaN.""",
    "not_integrable": """\
NotIntegrableError
    If no first integral is known for the body.""",
}


def filled(function: F) -> F:
    """Replace each line ``%(name)s`` of a docstring with the paragraph of that name."""
    if function.__doc__:  # None with `python -OO`
        function.__doc__ = re.sub(
            r"^( *)%\((\w+)\)s$",
            lambda found: indent(PARAGRAPHS[found[2]], found[1]),
            function.__doc__,
            flags=re.MULTILINE,
        )
    return function
