"""Surfaces at which steps end: branches of f change there, or events act."""

from typing import NamedTuple

from .tables import Table, is_table


class Surface(NamedTuple):
    """A surface; its function of the state is a result of `RightHandSide.watched`.

    kind    "event", or the condition of the branch that changes there: a comparison, "floor" or a
            `Table`. The function is the difference of the compared numbers, or the argument
    number  the number of the first parameter that holds the branch, or the number of the event
    jumps   True if f jumps there; False for events and kinks, where f only bends
    """

    kind: str
    number: int
    jumps: bool = False

    @property
    def parameters(self):
        """The number of parameters that hold the branch: 4 for a `Table`, else 1."""
        return Table.ROWS if is_table(self.kind) else 1

    def interval(self, number, places):
        """Return the ends (low, high) of the interval of a "floor" or table, else None.

        The branch stays the same between these `Number`s. `places` is {number of a parameter: its
        operand}; `number` makes a `Number` of an operand.
        """
        if self.kind != "floor" and not is_table(self.kind):
            return None
        low = number(places[self.number])
        return low, number(places[self.number + 1]) if is_table(self.kind) else low + 1.0
