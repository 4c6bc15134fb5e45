"""Bodies, and quadratic vector fields such as their equations of motion."""
