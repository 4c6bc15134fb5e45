"""The paper: the map, its closed form, n dimensions and orientations."""
