"""The motion of any equations to a tolerance, by standard extrapolation in lanes."""
