"""Paragraphs that the docstrings of several public functions share."""

from __future__ import annotations

import re
from collections.abc import Callable
from textwrap import indent
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable[..., Any])

PARAGRAPHS = {
    "any_body": """\
body : Suslov3D, SuslovND or SuslovGyrostat
    The body, or a batch of them.""",
    "body": """\
body : Suslov3D or SuslovND
    The body, or a batch of them.""",
    "body_3d": """\
body : Suslov3D
    The body, or a batch of them.""",
    "omega": """\
omega : array_like(float, shape=(..., D))
    Angular velocities. Where one is NaN, so is the result.""",
    "omega_3d": """\
omega : array_like(float, shape=(..., 2))
    Angular velocities (Omega1, Omega2). Where one is NaN, so is the result.""",
    "eps": """\
eps : array_like(float, shape=(...))
    Step size, in the unit of time of the angular velocities.""",
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
    Axes to draw on; by default those of a new figure.""",
    "panels": """\
letters : sequence of str, optional
    Letters of the panels, written above them.
ax : sequence of matplotlib.axes.Axes, optional
    Axes to draw on, one for each panel; by default those of a new figure.""",
    "invalid": """\
TypeError, ValueError
    If an argument has a wrong type or shape, or is infinite.""",
    "invalid_frame": """\
TypeError, ValueError
    If an argument has a wrong type or shape or is infinite, or if both `rotation` and
    `attitude` are given.""",
    "not_integrable": """\
NotIntegrableError
    If no first integral is known for the body.""",
}


def filled(function: F) -> F:
    """Replace each line ``%(name)s`` of a docstring by the paragraph of that name."""
    if function.__doc__:  # None with `python -OO`
        function.__doc__ = re.sub(
            r"^( *)%\((\w+)\)s$",
            lambda found: indent(PARAGRAPHS[found[2]], found[1]),
            function.__doc__,
            flags=re.MULTILINE,
        )
    return function
