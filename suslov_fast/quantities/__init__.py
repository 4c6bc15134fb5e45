"""Functions of a state: each checks its arguments and calls a formula of the map."""
