"""Figures and animations of bodies (extra `plots`), and the page of `explore`."""
