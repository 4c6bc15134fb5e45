"""Numbers only: formulas as scalars in and scalars out, and the loops over them.

Nothing here validates, raises or knows about bodies. Files of formulas hold no loops, `loops`
holds no formulas, and `jit` alone chooses options of Numba.
"""
