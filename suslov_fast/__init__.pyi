# The public names and the modules that define them. A module is imported when one of its names is
# first used; type checkers read the imports below.

from .bodies.formulas_nd import NotIntegrableError as NotIntegrableError
from .bodies.n_dimensions import SuslovND as SuslovND
from .bodies.rigid import Suslov3D as Suslov3D
from .ensembles import ensemble as ensemble
from .errors import NoConvergence as NoConvergence, SuslovError as SuslovError
from .fields.field import Field as Field
from .fields.map import Map as Map
from .motions.crossings import crossings as crossings
from .motions.equilibria import Equilibria as Equilibria, equilibria as equilibria
from .motions.event import Event as Event
from .motions.events import Events as Events
from .motions.exponents import lyapunov_exponents as lyapunov_exponents
from .motions.flow import flow as flow
from .motions.motion import Motion as Motion
from .motions.periodic_orbit_results import PeriodicOrbit as PeriodicOrbit
from .motions.periodic_orbits import periodic_orbit as periodic_orbit
from .orbits.iterate import iterate as iterate, step as step
from .orbits.trajectories import Trajectories as Trajectories
from .plots.explore import explore as explore
from .plots.phase import plot_phase as plot_phase
from .results.failures import SingularStepError as SingularStepError
from .results.result import load as load
from .status import (
    IntegrationWarning as IntegrationWarning,
    Status as Status,
)
from .versions import show_versions as show_versions

__version__: str

_threads_are_gone: bool
