"""Maps: their records (`map_records`, `kahan_records`), steps (`orders`) and formulas."""

from . import kahan_records as kahan_records  # fills MAPS
from .map_records import (
    MAPS as MAPS,
    Discretization as Discretization,
    Method as Method,
    eps_and_steps as eps_and_steps,
    eps_of as eps_of,
    map_of as map_of,
    named as named,
)
