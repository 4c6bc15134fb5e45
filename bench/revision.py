"""The package that is measured, in the shapes of this version.

`compare.py` runs the benchmarks against older versions too. Version 0.1 had the time axis before
the components, (..., n_saved, D), and was fastest into memory of order "F", which is (D, n_saved,
...) to C. Its public functions are called through this module where that matters.
"""

import inspect

import numpy as np
from limits import aligned

import suslov_fast

TIME_FIRST = "order" not in inspect.signature(suslov_fast.iterate).parameters


def iterate(body, omega0, eps, steps, **options):
    """`iterate`, into the order of memory in which the version is fastest."""
    if not TIME_FIRST and options.get("save_every", 1) is not None and np.ndim(omega0) > 1:
        options["order"] = "F"
    return suslov_fast.iterate(body, omega0, eps, steps, **options)


def saved_memory(n_saved, batch, D=2):
    """Memory for `out`, for a batch of trajectories or, with None, one.

    Touched, and aligned as the streaming stores of C are.
    """
    if batch is None:
        return aligned((n_saved, D))
    return aligned((n_saved, batch, D)) if TIME_FIRST else aligned((D, n_saved, batch)).T


def time_first(states):
    """Saved states (..., D) with the time on the first axis."""
    return states if TIME_FIRST else np.moveaxis(states, -2, 0)


def supports(name):
    """Whether the version has that public function."""
    return hasattr(suslov_fast, name)
