"""Numbers only: the maps, their closed form and functions of states, as Numba compiles them.

Nothing here checks an argument or imports another part of the package.
"""
