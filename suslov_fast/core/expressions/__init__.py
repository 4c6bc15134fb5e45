"""Lists of operations, which NumPy and machine code carry out with the same bits."""
