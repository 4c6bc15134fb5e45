"""Loops over the formulas for CPUs: blocks of lanes, vectors, and what drives them."""
