"""Motions: `flow`, events, crossings, exponents, periodic orbits and equilibria."""
