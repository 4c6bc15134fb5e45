# The public names and the modules that define them. A module is imported when one of its names is
# first used; type checkers read the imports below.

from .bodies.classes import body_from_dict as body_from_dict
from .bodies.fields.field import Field as Field
from .bodies.nd import NotIntegrableError as NotIntegrableError, SuslovND as SuslovND
from .bodies.rigid import Suslov3D as Suslov3D, SuslovGyrostat as SuslovGyrostat
from .engine.status import (
    IntegrationWarning as IntegrationWarning,
    Status as Status,
)
from .errors import SuslovError as SuslovError
from .plots.explore import explore as explore
from .plots.phase import plot_phase as plot_phase
from .quantities.conserved import (
    ClosedForm as ClosedForm,
    closed_form as closed_form,
    criticality as criticality,
    energy as energy,
    first_integral as first_integral,
    from_xy as from_xy,
    invariant_density as invariant_density,
    modified_energy as modified_energy,
    rotation_number as rotation_number,
    to_xy as to_xy,
)
from .quantities.derivatives import (
    jacobian as jacobian,
    matrix as matrix,
    multipliers as multipliers,
    reaction as reaction,
    vector_field as vector_field,
)
from .quantities.equilibria import Equilibria as Equilibria, equilibria as equilibria
from .runs.crossings import crossings as crossings
from .runs.ensemble import ensemble as ensemble
from .runs.event import Event as Event
from .runs.events import Events as Events
from .runs.failures import SingularStepError as SingularStepError
from .runs.flow import flow as flow
from .runs.iterate import iterate as iterate, step as step, step_full as step_full
from .runs.lyapunov import lyapunov_exponents as lyapunov_exponents
from .runs.motion import Motion as Motion
from .runs.periodic import PeriodicOrbit as PeriodicOrbit, periodic_orbit as periodic_orbit
from .runs.results import load as load
from .runs.solution import exact as exact, limits as limits
from .runs.trajectories import Trajectories as Trajectories
from .space import (
    momentum as momentum,
    scattering_angle as scattering_angle,
    to_matrix as to_matrix,
    to_vector as to_vector,
)
from .versions import show_versions as show_versions

__version__: str

_threads_are_gone: bool
