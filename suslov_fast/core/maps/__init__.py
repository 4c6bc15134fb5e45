"""Kahan's map of quadratic fields: steps, derivatives, and elimination with pivoting."""
