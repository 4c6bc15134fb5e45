"""Maps: their records (`base`, `records`), steps (`methods`) and formulas."""

from . import records as records  # fills MAPS
from .base import (
    MAPS as MAPS,
    Map as Map,
    Method as Method,
    map_of as map_of,
    methods_of as methods_of,
    named as named,
)
