"""Expression programs, which NumPy and machine code evaluate to the same bits."""
