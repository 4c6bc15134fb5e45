"""Orbits of maps: `step`, `iterate`, and their result."""
