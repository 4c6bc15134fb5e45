"""Orbits of maps, and motions: steps, closed form, crossings, results, files, stores, figures."""
