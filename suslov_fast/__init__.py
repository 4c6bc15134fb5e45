"""The Hirota-Kimura (Kahan) discretization of the nonholonomic Suslov problem.

A body and a batch of angular velocities go in, trajectories come out::

    from suslov_fast import Suslov3D, iterate

    body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    trajectories = iterate(body, [[1.0, 0.5], [0.2, -0.7]], eps=0.2, steps=1000)

The system is that of V. Dragovic and B. Gajic, arXiv:0807.2966; docstrings cite its equations by
the labels of its source.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from ._bodies.nd import SuslovND
from ._bodies.reduction import NotIntegrableError
from ._bodies.three import Suslov3D
from ._map import iterate, step
from ._solution import exact, flow, limits
from ._status import SingularStepWarning, Status
from ._trajectories import SingularStepError, Trajectories

if TYPE_CHECKING:
    from ._attitude import attitude
    from ._conserved import (
        criticality,
        energy,
        first_integral,
        invariant_density,
        modified_energy,
    )
    from ._continuous import reaction, vector_field
    from ._coordinates import from_xy, to_xy
    from ._ensemble.api import ensemble, open_ensemble
    from ._ensemble.starts import RandomStarts
    from ._full import iterate_full, step_full
    from ._linearised import jacobian, matrix, multipliers
    from ._lyapunov import lyapunov_exponents
    from ._plots import (
        animate_body,
        plot_convergence,
        plot_four_dimensions,
        plot_phase,
        plot_regimes,
        plot_scattering,
    )
    from ._scattering import scattering_angle
    from ._section4 import ClosedForm, closed_form
    from ._spatial import from_matrix, from_vector, momentum, to_matrix, to_vector

__version__ = "0.2.0"

__all__ = [
    "ClosedForm",
    "NotIntegrableError",
    "RandomStarts",
    "SingularStepError",
    "SingularStepWarning",
    "Status",
    "Suslov3D",
    "SuslovND",
    "Trajectories",
    "animate_body",
    "attitude",
    "closed_form",
    "criticality",
    "energy",
    "ensemble",
    "exact",
    "first_integral",
    "flow",
    "from_matrix",
    "from_vector",
    "from_xy",
    "invariant_density",
    "iterate",
    "iterate_full",
    "jacobian",
    "limits",
    "lyapunov_exponents",
    "matrix",
    "modified_energy",
    "momentum",
    "multipliers",
    "open_ensemble",
    "plot_convergence",
    "plot_four_dimensions",
    "plot_phase",
    "plot_regimes",
    "plot_scattering",
    "reaction",
    "scattering_angle",
    "step",
    "step_full",
    "to_matrix",
    "to_vector",
    "to_xy",
    "vector_field",
]

# The modules of all other names, imported when one of theirs is asked for.
_LATER = {
    "_attitude": ("attitude",),
    "_conserved": (
        "criticality",
        "energy",
        "first_integral",
        "invariant_density",
        "modified_energy",
    ),
    "_continuous": ("reaction", "vector_field"),
    "_coordinates": ("from_xy", "to_xy"),
    "_ensemble.api": ("ensemble", "open_ensemble"),
    "_ensemble.starts": ("RandomStarts",),
    "_full": ("iterate_full", "step_full"),
    "_linearised": ("jacobian", "matrix", "multipliers"),
    "_lyapunov": ("lyapunov_exponents",),
    "_plots": (
        "animate_body",
        "plot_convergence",
        "plot_four_dimensions",
        "plot_phase",
        "plot_regimes",
        "plot_scattering",
    ),
    "_scattering": ("scattering_angle",),
    "_section4": ("ClosedForm", "closed_form"),
    "_spatial": ("from_matrix", "from_vector", "momentum", "to_matrix", "to_vector"),
}

if not TYPE_CHECKING:  # which would take any name for one of the package

    def __getattr__(name):
        """A name of a module that is not imported yet."""
        for module, names in _LATER.items():
            if name in names:
                value = globals()[name] = getattr(import_module(f".{module}", __name__), name)
                return value
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
