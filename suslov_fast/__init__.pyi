# The public names and the modules that define them. Each module is imported when one of its
# names is first used; type checkers read this file as it is.

from ._bodies.body_3d import Suslov3D as Suslov3D
from ._bodies.body_3d import SuslovGyrostat as SuslovGyrostat
from ._bodies.body_nd import NotIntegrableError as NotIntegrableError
from ._bodies.body_nd import SuslovND as SuslovND
from ._bodies.field import QuadraticField as QuadraticField
from ._engine.random_starts import RandomStarts as RandomStarts
from ._engine.status import SingularStepWarning as SingularStepWarning
from ._engine.status import Status as Status
from ._ensemble.api import ensemble as ensemble
from ._ensemble.api import open_ensemble as open_ensemble
from ._maps import body_from_dict as body_from_dict
from ._runs.iterate import iterate as iterate
from ._runs.iterate import iterate_full as iterate_full
from ._runs.iterate import step as step
from ._runs.iterate import step_full as step_full
from ._runs.running import SingularStepError as SingularStepError
from ._runs.solution import exact as exact
from ._runs.solution import flow as flow
from ._runs.solution import limits as limits
from ._runs.trajectories import Trajectories as Trajectories
from ._show.explore.server import explore as explore
from ._show.plots import animate_body as animate_body
from ._show.plots import plot_phase as plot_phase
from ._space.attitude import attitude as attitude
from ._space.scattering import scattering_angle as scattering_angle
from ._space.vectors import from_matrix as from_matrix
from ._space.vectors import from_vector as from_vector
from ._space.vectors import momentum as momentum
from ._space.vectors import to_matrix as to_matrix
from ._space.vectors import to_vector as to_vector
from ._states.conserved import criticality as criticality
from ._states.conserved import energy as energy
from ._states.conserved import first_integral as first_integral
from ._states.conserved import invariant_density as invariant_density
from ._states.conserved import modified_energy as modified_energy
from ._states.conserved import rotation_number as rotation_number
from ._states.derivatives import jacobian as jacobian
from ._states.derivatives import matrix as matrix
from ._states.derivatives import multipliers as multipliers
from ._states.derivatives import reaction as reaction
from ._states.derivatives import vector_field as vector_field
from ._states.fixed_points import fixed_points as fixed_points
from ._states.lyapunov import lyapunov_exponents as lyapunov_exponents
from ._states.paper_coordinates import ClosedForm as ClosedForm
from ._states.paper_coordinates import closed_form as closed_form
from ._states.paper_coordinates import from_xy as from_xy
from ._states.paper_coordinates import to_xy as to_xy

__version__: str
