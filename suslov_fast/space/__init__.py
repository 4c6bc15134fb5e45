"""The motion of the body in space."""
