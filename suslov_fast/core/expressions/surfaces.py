"""Surfaces at which steps end: there branches of f change, or events act."""

from typing import NamedTuple

from .tables import Table, is_table


class Surface(NamedTuple):
    """A surface; its function of the state is a result of `RightHandSide.watched`.

    kind    the condition of the branch that changes at it. The function is the difference of the
            numbers of a comparison, or the argument of "floor" or a `Table`. "event" for events
    number  the number of the first parameter that holds the branch; for events their number
    jumps   True if f jumps there; False at kinks, where f only bends, and for events
    """

    kind: str
    number: int
    jumps: bool = False

    @property
    def parameters(self):
        """The number of parameters that hold the branch: 4 for a `Table`, else 1."""
        return Table.ROWS if is_table(self.kind) else 1

    def interval(self, number, places):
        """Return `Number`s low and high: the branch holds between them; None for other kinds.

        `places` is {number of a parameter: its operand}; the function `number` makes a `Number` of
        an operand.
        """
        if self.kind != "floor" and not is_table(self.kind):
            return None
        low = number(places[self.number])
        return low, number(places[self.number + 1]) if is_table(self.kind) else low + 1.0
