"""Maps: their records (`base`, `records`), steps (`methods`) and formulas."""

from . import records as records  # fills MAPS
from .base import (
    MAPS as MAPS,
    Discretization as Discretization,
    Method as Method,
    eps_and_steps as eps_and_steps,
    eps_of as eps_of,
    map_of as map_of,
    methods_of as methods_of,
    named as named,
)
