"""The paper: the map, its closed form, n dimensions, quantities of states and orientations."""
