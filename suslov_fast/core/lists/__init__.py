"""Lists of operations on numbers: right-hand sides, derivatives, elementary functions."""
