# The public names and the modules that define them. A module is imported when one of its names is
# first used; type checkers read the imports below.

from .bodies.classes import body_from_dict as body_from_dict
from .bodies.field import QuadraticField as QuadraticField
from .bodies.general import Field as Field
from .bodies.nd import NotIntegrableError as NotIntegrableError
from .bodies.nd import SuslovND as SuslovND
from .bodies.rigid import Suslov3D as Suslov3D
from .bodies.rigid import SuslovGyrostat as SuslovGyrostat
from .engine.random_starts import RandomStarts as RandomStarts
from .engine.status import PoleWarning as PoleWarning
from .engine.status import SingularStepWarning as SingularStepWarning
from .engine.status import Status as Status
from .errors import SuslovError as SuslovError
from .plots.animation import animate_body as animate_body
from .plots.explore.server import explore as explore
from .plots.phase import plot_phase as plot_phase
from .quantities.conserved import ClosedForm as ClosedForm
from .quantities.conserved import closed_form as closed_form
from .quantities.conserved import criticality as criticality
from .quantities.conserved import energy as energy
from .quantities.conserved import first_integral as first_integral
from .quantities.conserved import from_xy as from_xy
from .quantities.conserved import invariant_density as invariant_density
from .quantities.conserved import modified_energy as modified_energy
from .quantities.conserved import rotation_number as rotation_number
from .quantities.conserved import to_xy as to_xy
from .quantities.derivatives import jacobian as jacobian
from .quantities.derivatives import matrix as matrix
from .quantities.derivatives import multipliers as multipliers
from .quantities.derivatives import reaction as reaction
from .quantities.derivatives import vector_field as vector_field
from .quantities.fixed_points import fixed_points as fixed_points
from .quantities.lyapunov import lyapunov_exponents as lyapunov_exponents
from .runs.crossings import Crossings as Crossings
from .runs.ensemble import ensemble as ensemble
from .runs.ensemble import open_ensemble as open_ensemble
from .runs.failures import SingularStepError as SingularStepError
from .runs.find_crossings import crossings as crossings
from .runs.flow import flow as flow
from .runs.iterate import iterate as iterate
from .runs.iterate import step as step
from .runs.iterate import step_full as step_full
from .runs.motion import Motion as Motion
from .runs.periodic import PeriodicOrbit as PeriodicOrbit
from .runs.periodic import periodic_orbit as periodic_orbit
from .runs.solution import exact as exact
from .runs.solution import limits as limits
from .runs.trajectories import Trajectories as Trajectories
from .space import attitude as attitude
from .space import momentum as momentum
from .space import scattering_angle as scattering_angle
from .space import to_matrix as to_matrix
from .space import to_vector as to_vector
from .versions import show_versions as show_versions

__version__: str

_threads_are_gone: bool

def _here(name: str) -> str: ...
