"""Maps: their records (`map_records`, `kahan_records`), steps (`orders`) and formulas."""

from . import kahan_records as kahan_records  # fills MAPS
