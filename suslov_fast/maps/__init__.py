"""Maps: their records (`base`, `records`), steps (`methods`) and formulas.

Authors of further maps import everything that they need from here.
"""

from ..bodies.base import Body as Body
from ..core.numba import function as function
from ..core.one_step import slope_at as slope_at
from ..core.one_step import solve as solve
from ..engine.arguments import by_constants as by_constants
from ..engine.arguments import by_field as by_field
from ..engine.stretches import Steps as Steps
from . import records as records  # registers the maps of the package
from .base import MAPS as MAPS
from .base import Map as Map
from .base import Method as Method
from .base import map_of as map_of
from .base import methods_of as methods_of
from .base import named as named
from .base import problem as problem
from .base import register as register
from .formulas import KAHAN as KAHAN
from .formulas import Formula as Formula
from .formulas import Plane as Plane
from .methods import FIELD as FIELD
from .methods import steps_of as steps_of
