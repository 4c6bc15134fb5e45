"""Formulas: scalars in, scalars out. No loops, nothing about memory or threads."""
