"""Parameters, errors and other paragraphs that the docstrings of several public functions share.

A docstring holds only what is particular to its function; `filled` completes it.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from textwrap import indent
from typing import Any, TypeVar, get_args

F = TypeVar("F", bound=Callable[..., Any])

# Type and text of parameters, by name.
PARAMETERS = {
    "omega": """array_like(float, shape=(..., D))
    Angular velocities: (Omega1, Omega2), or the n - 1 components Omega_in; or states of a field.
    The result is NaN for states that are NaN.""",
    "omega0": """array_like(float, shape=(..., D))
    State 0, or in continuous time that at time 0. The result is NaN where it is NaN.""",
    "eps": """array_like(float, shape=(...))
    Step size, in the unit of time of the angular velocities; a negative one is that of the
    inverse map.""",
    "steps": """int
    Number of steps, 0 or more.""",
    "I3": """array_like(float, shape=(...)), optional
    The third moment of inertia, positive; by default that of the body.""",
    "save_every": """int or None
    Save the states 0, k, 2k, ... up to `steps`; None saves only the last.""",
    "out": """ndarray(float64, shape=(n_saved, ..., D)), optional
    C-contiguous array that receives the saved states, instead of a new one.""",
    "on_singular": """{"warn", "raise", "ignore"}
    Action if trajectories fail: one :class:`SingularStepWarning` for all, a
    :class:`SingularStepError` that holds the result, or none.""",
    "progress": """bool or callable, optional
    True shows a bar (needs tqdm); a callable is called as ``progress(done, steps)``.""",
    "dims": """str or sequence of str, optional
    Names for the axes of the batch; by default "trajectory", or "batch_0", "batch_1", ... The
    name of a parameter that varies along this axis alone, such as "eps" or "I13", makes it the
    coordinate: ``data.sel(eps=0.2)``.""",
    "coords": """mapping, optional
    Coordinates along them, as `xarray.Dataset.assign_coords` takes them.""",
    "threads": """int, optional
    Number of threads, by default Numba's. Results do not depend on it.""",
    "rotation": """array_like(float, shape=(..., n, n)), optional
    The matrix that `from_inertia` or `from_mass_tensor` returned with the body. With it, vectors
    and matrices are in the basis in which the inertia was given, else in the adapted basis.""",
    "attitude": """array_like(float, shape=(..., n, n)), optional
    Orientations, as :func:`suslov_fast.attitude` returns them, in place of `rotation`. With them
    the result is in space.""",
    "letter": """str, optional
    Letter of the panel, written above it.""",
    "ax": """matplotlib.axes.Axes, optional
    Axes to draw on; by default those of a new figure.""",
    "map": """KahanMap
    Made by `kahan`.""",
    "parameters": """mapping
    Numbers and nested lists by name, and, as "body", the name of the class.""",
    "path": """str or path-like
    A name that ends in .npz.""",
    "dimension": """int
    The number of variables, D.""",
    "seed": """int, optional
    Seed of the random primes, points and lines.""",
}

# Lines ``%(name)s`` of docstrings.
PARAGRAPHS = {
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

# Of every public function.
INVALID = """TypeError, ValueError
    If an argument has a wrong type, shape or value; before any work.
"""


def filled(function: F) -> F:
    """Complete a docstring: lines ``%(name)s``, and what its sections leave out.

    Parameters and the class of the result follow the signature. The errors raised include `INVALID`
    unless the section Raises has its own ValueError.
    """
    if not function.__doc__:  # None with `python -OO`
        return function
    text = re.sub(
        r"^( *)%\((\w+)\)s$",
        lambda found: indent(PARAGRAPHS[found[2]], found[1]),
        inspect.cleandoc(function.__doc__),
        flags=re.MULTILINE,
    )
    summary, *parts = re.split(r"^(\w+)\n-+\n", text, flags=re.MULTILINE)
    sections = {"Parameters": "", "Returns": "", "Raises": ""}
    sections |= dict(zip(parts[::2], parts[1::2], strict=True))
    given = re.split(r"\n(?=\w)", sections["Parameters"].strip())
    own = {name: each for each in given for name in each.partition(" :")[0].split(", ")}
    signature, paragraphs = inspect.signature(function), []
    for name, parameter in signature.parameters.items():
        if name == "body" and name not in own:
            kind = eval(parameter.annotation, function.__globals__)  # a class, or a union
            *others, last = (each.__name__ for each in get_args(kind) or [kind])
            kinds = f"{', '.join(others)} or {last}" if others else last
            own[name] = f"body : {kinds}\n    A single one, or a batch."
        if name not in ("self", "cls"):
            paragraphs.append(own.get(name) or f"{name} : {PARAMETERS[name]}")
    sections["Parameters"] = "\n".join(dict.fromkeys(paragraphs))
    if signature.return_annotation != "None":
        sections["Returns"] = sections["Returns"] or signature.return_annotation
    if "ValueError" not in sections["Raises"]:
        sections["Raises"] = INVALID + sections["Raises"]
    complete = (f"{k}\n{'-' * len(k)}\n{each.strip()}" for k, each in sections.items() if each)
    function.__doc__ = "\n\n".join([summary.strip(), *complete]) + "\n"
    return function
