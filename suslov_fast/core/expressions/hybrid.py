"""What happens to a motion at surfaces and at given times, as a part of its right-hand side."""

from typing import Any, NamedTuple

from .programs import Program


class Hybrid(NamedTuple):
    """What happens to a motion of f at surfaces and at given times; nothing if f is smooth.

    Properties answer questions:

    acts         True if events act on motions, or record them
    event_surface_count  how many surfaces events have
    chooses      True if f has branches, which are chosen when a motion begins and where it crosses
                 a surface
    jumps        True if f jumps at some of these surfaces; at `kinks`, by their kinds, it bends
    ends_steps   True if steps end at surfaces

    Data:

    events       `EventSet` of actions along the motion, or None
    branches     `Branches` of f, or None
    branch_program  `Program` that finds the branches at a state, see `branches._choices`
    derived      `Program` of the numbers of f's table that depend on branches
    surfaces     `Program` of the functions s of surfaces with crossings that end steps
    watch, double_crossings, aim  programs that find crossings, see the functions of these names
    offsets      {clock: number of the parameter that is its start}, see `ElapsedTime`
    """

    events: Any = None
    branches: Any = None
    branch_program: Program | None = None
    derived: Program | None = None
    surfaces: Program | None = None
    watch: Program | None = None
    double_crossings: Any = None
    aim: Any = None
    offsets: Any = {}  # noqa: RUF012  (never changed)

    acts = property(lambda self: self.events is not None)
    event_surface_count = property(lambda self: self.events.surface_count if self.acts else 0)
    chooses = property(lambda self: self.branches is not None)
    jumps = property(lambda self: self.chooses and self.branches.jumps > 0)
    ends_steps = property(lambda self: self.watch is not None)

    @property
    def kinks(self):
        surfaces = self.branches.conditions if self.chooses else ()
        return [surface.kind for surface in surfaces if not surface.jumps]

    def parameters(self, P):
        """Return how many of the P parameters of f hold no branches; they come first."""
        return self.branches.P if self.chooses else P
