"""Maps: their records (`base`, `records`), steps (`methods`) and formulas.

Authors of further maps import everything that they need from here.
"""

from ..bodies.base import Body as Body
from ..core.compiling.numba import function as function
from ..core.users.own_map import slope_at as slope_at, solve as solve
from ..engine.arguments import by_constants as by_constants, by_field as by_field
from ..engine.stretches import Steps as Steps
from . import records as records  # registers the maps of the package
from .base import (
    MAPS as MAPS,
    Map as Map,
    Method as Method,
    map_of as map_of,
    methods_of as methods_of,
    named as named,
    problem as problem,
    register as register,
)
from .formulas import KAHAN as KAHAN, Formula as Formula, Plane as Plane
from .methods import FIELD as FIELD, steps_of as steps_of
