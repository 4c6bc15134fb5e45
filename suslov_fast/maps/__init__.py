"""Maps: their records (`map_records`), steps (`orders`) and formulas."""
