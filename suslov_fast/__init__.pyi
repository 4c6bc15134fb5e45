# The public names and the modules that define them. A module is imported when one of its names is
# first used; type checkers read the imports below.

from .bodies.fields.field import Field as Field
from .bodies.fields.map import Map as Map
from .bodies.formulas_nd import NotIntegrableError as NotIntegrableError
from .bodies.nd import SuslovND as SuslovND
from .bodies.rigid import Suslov3D as Suslov3D
from .engine.status import (
    IntegrationWarning as IntegrationWarning,
    Status as Status,
)
from .errors import NoConvergence as NoConvergence, SuslovError as SuslovError
from .plots.explore import explore as explore
from .plots.phase import plot_phase as plot_phase
from .quantities.equilibria import Equilibria as Equilibria, equilibria as equilibria
from .runs.crossings import crossings as crossings
from .runs.ensemble import ensemble as ensemble
from .runs.event import Event as Event
from .runs.events import Events as Events
from .runs.failures import SingularStepError as SingularStepError
from .runs.flow import flow as flow
from .runs.iterate import iterate as iterate, step as step
from .runs.lyapunov import lyapunov_exponents as lyapunov_exponents
from .runs.motion import Motion as Motion
from .runs.periodic import PeriodicOrbit as PeriodicOrbit, periodic_orbit as periodic_orbit
from .runs.results import load as load
from .runs.trajectories import Trajectories as Trajectories
from .versions import show_versions as show_versions

__version__: str

_threads_are_gone: bool
