"""Changes of the state, as lists of operations on a state and parameters.

A change acts on a surface, where a function of the state is 0, or at given times; it may make a new
state, and it may end the trajectory.
"""

from typing import NamedTuple

from .right_hand_side import List, needed_for


class Act(NamedTuple):
    """What a change does. The first values of its lists are x (D), then the parameters (P).

    surface    `List` of the function that is 0 where it acts, or None if it acts at times
    to         `List` of the new state, or None if the state stays
    direction  1 or -1, in which the surface is crossed along the motion, or 0
    most       how often it acts before it ends the trajectory, infinity if it does not
    """

    surface: List | None
    to: List | None
    direction: int
    most: float

    @staticmethod
    def list_of(values, results):
        """Return the `List` of operands that are values of `Expressions`, with a hash."""
        return List(tuple(needed_for(values.operations, results)), tuple(results))


class Part(NamedTuple):
    """A `List` whose first values are so many rows, then the parameters, then scales of columns."""

    list_: List
    rows: int


class Changes(NamedTuple):
    """What the code needs of changes; those on surfaces come first.

    directions   of the changes on surfaces
    most         of all changes
    parts        `Part`s by name: `to{k}`, the components of change k that differ from x
    components   the numbers of these components, for each change
    P            number of parameters
    """

    directions: tuple
    most: tuple
    parts: dict
    components: tuple
    P: int

    surfaces = property(lambda self: len(self.directions))
    at_times = property(lambda self: len(self.most) - len(self.directions))


def in_order_of_code(acts):
    """Return the numbers of changes in the order of `Changes`."""
    return sorted(range(len(acts)), key=lambda k: acts[k].surface is None)


def changes_of(acts, D, P):
    """Return the `Changes` of acts in the order of code."""
    parts, components = {}, []
    for k, act in enumerate(acts):
        results = range(D) if act.to is None else act.to.results
        own = tuple(i for i, a in enumerate(results) if not (type(a) is int and a == i))
        components.append(own)
        if own:
            results = [act.to.results[i] for i in own]
            parts[f"to{k}"] = Part(List(needed_for(act.to.operations, results), results), D)
    directions = tuple(act.direction for act in acts if act.surface is not None)
    most = tuple(act.most for act in acts)
    return Changes(directions, most, parts, tuple(components), P)
