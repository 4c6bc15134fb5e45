"""The rows of a line of lanes along a motion, by name.

A row has one number of each lane: in memory a line is (rows, W). Temporary results of a step have
rows of their own, which all lines share (`WorkRows`).
"""

from itertools import accumulate, pairwise
from typing import NamedTuple


class LaneState:
    """The state of a lane, in `TrajectoryRows.state`, which decides its next action.

    The states are plain numbers: NumPy compares with enum members ten times as slowly.
    """

    EXPLICIT = 0
    IMPLICIT = 1
    DONE = 2  # it has reached the last time
    ENDED = 3  # steps become too short
    TOO_MANY = 4  # steps from one time to the next
    NO_VALUE = 5  # f has no value at the start
    SLIDING = 6  # a branch of f changes back and forth
    STOPPED = 7  # an event ends it
    ACCUMULATES = 8  # actions follow one another at once, without end
    AGAIN = 9  # it is to be computed with atol = 0, see `growing_components`


BEGINS = -1.0  # in place of a `LaneState` before the first step


class TrajectoryRows(NamedTuple):
    """The first row of each part of a trajectory's data. Parts have one row unless noted: (D)."""

    x: int  # the state (D)
    f: int  # f(x), and its denominators of clocks (D + denominators)
    largest: int  # moduli of components so far (D)
    mode: int  # a vector of the power iteration on f' (D)
    lost: int  # errors of components beside their sizes, see `growing_components` (those of x)
    far: int  # the state after a step of length `outer` (watched)
    chosen_at: int  # time at which branches of f changed last (1 if f has branches)
    chosen_often: int  # how often in a row they changed at once (1 if f has branches)
    side: int  # of surfaces of events: 1 where the state is at the level or above, 0 below,
    #            between both where it stays on it, `GAP` where it has no value; and the level,
    #            0 but for rounding (2 surfaces)
    counts: int  # how often each event has acted (events)
    acted: int  # when each event at a surface has acted last, and how much later than the time
    #             before (2 surfaces)
    # These exist if there are events, see OF_EVENTS.
    stop: int  # modulus of the next time of an event, infinity after the last
    stop_which: int  # number of that event
    stop_place: int  # the place of the time, an integer
    at: int  # time of the last action; of actions that accumulate their limit
    recorded: int  # crossings of surfaces where nothing acts
    often: int  # how often in a row an event has acted again at once
    resting: int  # number of surfaces on which the state stays
    actions: int  # since the last requested time

    t: int  # modulus of the time
    wanted: int  # length of the next step
    longer: int  # the largest factor between this length and the one after it
    next: int  # modulus of the next requested time, infinity after the last
    second: int  # of the one after it
    state: int  # a `LaneState`
    stiff: int  # steps that look stiff; explicit steps that would do, of an implicit lane
    easy: int  # steps in a row that do not look stiff
    patience: int  # how many stiff steps it takes to become implicit
    trial: int  # implicit steps that are left of the first ones
    steps: int  # that were taken
    tries: int  # steps, also refused ones, since the last time that was asked for
    watches: int  # more than 0 while a component has lost digits; infinity for an alarm
    inner: int  # length of a step that crosses no surface, while one is looked for
    outer: int  # and of one that does, infinity if none is looked for
    weight: int  # of the last guess where it is crossed, see `event_location.CUT`
    rounds: int  # how many lengths have been tried
    whole: int  # length of the next step after that to the surface
    place: int  # number of the next time, an integer
    trajectory: int  # number of the trajectory, an integer
    size: int  # number of all rows


OF_EVENTS = "stop stop_which stop_place at recorded often resting actions".split()


def firsts_of(kind, sizes):
    """Return first rows of parts as a `kind` (`WorkRows` ...); part p has sizes[p] rows, or one."""
    counts = [sizes.get(name, 1) for name in kind._fields[:-1]]
    return kind(*accumulate(counts, initial=0))


def scalars_of(firsts):
    """Return the names of the parts that have one row; `firsts` is a result of `firsts_of`."""
    return [
        name for name, (a, b) in zip(firsts._fields, pairwise(firsts), strict=False) if b - a == 1
    ]


class WorkRows(NamedTuple):
    """The first row of each part of a step's workspace: a line of lanes, temporary results."""

    line: int  # `TrajectoryRows` of the trajectories
    own: int  # their numbers, integers
    table: int  # their tables, if each has one

    start: int  # a state inside a step (D)
    f: int  # f there (D + denominators)
    a: int  # states of a column, and y_N after it (D)
    b: int  # another one, or f of it (D + denominators)
    f_last: int  # f(y_N) (D + denominators)
    ends: int  # y_c - x at the ends of columns (columns D)
    apart: int  # what shows false steps, of each explicit column or of all implicit ones (- D)
    nodes: int  # states at the ends of the first three quarters of an explicit step, and f; of an
    # implicit one they are less x, and those of the last columns follow (6 D)
    beside: int  # f at a point of the step, the point, and changes of f beside it (6 of f)
    new: int  # the next state (D)
    f_new: int  # f there (D + denominators)
    error: int  # (D)
    jacobian: int  # entries of f', s, and a vector (D)
    factors: int  # of 1 - s f'
    right: int  # (D), after the factors
    taken: int  # length of this step
    signed: int  # the same with the sign of time
    aside: int  # 1 where it is a step aside
    accepted: int  # 1 where the step is taken, else 0
    served: int  # 1 where a step aside has reached its time, else 0
    t: int  # time before the step
    at_surface: int  # 1 where the step ends on a surface, 2 where it arrives at one, else 0
    jumped: int  # 1 where f may have jumped there
    points: int  # surfaces at the start and at POINTS, and inputs of `double_crossings`
    point: int  # the state at such a point (watched)
    quartic: int  # what polynomials of degree 4 have there beside cubics (D if they are needed)
    moving: int  # that state, how it changes in a step, and rtol, for rates (2 watched + 1)
    told: int  # what `DoubleCrossings` tells of them (3)
    end: int  # the state, f there, and sides, for `aim` (2 watched + 2 surfaces of events)
    aim: int  # when surfaces are crossed, see `event_location` (5)
    between: int  # surfaces at two points, between which they are crossed or not
    sides: int  # what `TrajectoryRows.side` holds (2 surfaces)
    seen: int  # what `watch` finds there (4 + kinks)
    changed: int  # what functions of events return (D)
    before: int  # the state before an action (D)
    f_before: int  # f there (D)
    pair: int  # a state and f there, and what columns need beside them (4 D + 1)
    toward: int  # `OF_SURFACE` of surfaces of events at that state (5 surfaces)
    ahead: int  # the same a moment later (5 surfaces)
    fired: int  # 1 where an event acts after a crossing upward at this instant, -1 downward, else
    #             0; and before it how near the surface was, and its rate (3 surfaces)
    noted: int  # number of actions at surfaces at this instant, if there are events
    chooses: int  # 1 where branches are chosen
    chosen: int  # what `branches` returns (2 + surfaces of f)
    derived: int  # numbers of the table that depend on branches
    f_old: int  # f before a jump (D)
    slopes: int  # of surfaces where f jumps, if there are columns
    gradient: int  # of the surface that is crossed, by x and parameters (D + parameters)
    tau: int  # how much earlier solutions displaced by columns reach this instant (columns)
    scratch: int  # rows that functions need
    size: int
