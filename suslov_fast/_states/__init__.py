"""Quantities of a state."""
