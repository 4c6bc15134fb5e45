"""The rows of a line of lanes along a motion, by name.

A row has one number of each lane: in memory a line is (rows, W). Temporary results of a step have
rows of their own, which all lines share. Each part of a line is named here, with its number of rows
and its meaning.
"""

from collections import namedtuple
from itertools import accumulate, pairwise

from ..expressions.event_formulas import OF_SURFACE


class LaneState:
    """The state of a lane, in its row `state`, which decides its next action.

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
    AGAIN = 9  # it is to be computed again, see `growing_components`


BEGINS = -1.0  # in place of a `LaneState` before the first step


def rows_of_trajectory(integrator):
    """Return the first row of each part of a trajectory's data, and `size`, the number of rows.

    The counts are attributes of the integrator, or of its right-hand side f.
    """
    f, watched, events = integrator.f, integrator.watched, integrator.events
    D, chooses, acts = f.D, int(bool(f.branches)), int(bool(events))
    surfaces, actions = integrator.event_surfaces, events.count if acts else 0
    return _first_rows(
        x=D,  # the state
        f=D + len(f.denominators),  # f(x), and its denominators of clocks
        largest=D,  # moduli of components so far
        power_vector=D,  # of the power iteration on f'
        lost=D,  # relative errors of components, or RELATIVE, see `growing_components`
        beyond=watched,  # the state after a step of length `outer`, beyond a surface
        chosen_at=chooses,  # time at which branches of f changed last
        chosen_often=chooses,  # how often in a row they changed at once
        # Of surfaces of events: 1 where the state is at the level or above, 0 below, between both
        # where it stays on it, `GAP` where it has no value. And the level, 0 or a rounding error.
        side=2 * surfaces,
        counts=actions,  # how often each event has acted
        acted_at=surfaces,  # when each event at a surface has acted last
        pause=surfaces,  # and how much later than the time before
        # When each surface was crossed last; -infinity if the state has turned back there, or was
        # beyond it by more than rounding.
        crossed_at=surfaces,
        stop=acts,  # modulus of the next time of an event, infinity after the last
        stop_which=acts,  # number of that event
        stop_place=acts,  # the place of the time, an integer
        at=acts,  # time of the last action; of actions that accumulate their limit
        recorded=acts,  # crossings of surfaces where nothing acts
        often=acts,  # how often in a row an event has acted again at once
        resting=acts,  # number of surfaces on which the state stays
        actions=acts,  # since the last requested time
        t=1,  # modulus of the time
        wanted=1,  # length of the next step
        longer=1,  # the largest factor between this length and the one after it
        next=1,  # modulus of the next requested time, infinity after the last
        second=1,  # and of the requested time after it
        state=1,  # a `LaneState`
        stiff=1,  # steps of an explicit lane that look stiff
        easy=1,  # steps in a row that do not look stiff
        patience=1,  # how many stiff steps it takes to become implicit
        trial=1,  # implicit steps that are left of the first ones
        steps=1,  # that were taken
        tries=1,  # steps, also refused steps, since the last requested time
        watches=1,  # more than 0 while a component has lost digits; infinity for an alarm
        inner=1,  # length of a step that crosses no surface, in a search for one
        outer=1,  # length of a step that crosses it, infinity without a search
        weight=1,  # of the Illinois rule, see `event_location.SEARCH`
        rounds=1,  # how many lengths the search has tried
        whole=1,  # length of the next step after a search
        place=1,  # number of the next time, an integer
        trajectory=1,  # number of the trajectory, an integer
    )


def rows_of_work(integrator):
    """Return the first row of each part of a step's workspace, and `size`, the number of rows.

    The counts are attributes of the integrator, or of its right-hand side f.
    """
    f, of_x, watched, events = integrator.f, integrator.f.of, integrator.watched, integrator.events
    D, chooses, acts = f.D, int(bool(f.branches)), int(bool(events))
    extended, surfaces = D + len(f.denominators), integrator.event_surfaces
    of_ends, is_implicit = len(integrator.columns) * D, integrator.is_implicit
    has_slopes = chooses and f.branches.jumps and f.columns
    return _first_rows(
        line=integrator.rows.size,  # rows of the trajectories
        own=1,  # their numbers, integers
        table=len(f.table),  # their tables, if each has one
        start=D,  # a state inside a step
        f=extended,  # f there, and its denominators of clocks
        a=D,  # states of a column, and y_N after it
        b=extended,  # another one, or f of it
        f_last=extended,  # f(y_N)
        ends=of_ends,  # y_c - x at the ends of columns
        # What shows false steps, of each explicit column or of all implicit ones.
        apart=D if is_implicit else of_ends,
        # States at the ends of the first three quarters of an explicit step, and f. Those of an
        # implicit step are less x, and states of the last columns follow.
        nodes=6 * D,
        beside=6 * extended,  # f at a point of the step, the point, and changes of f beside it
        new=D,  # the next state
        f_new=extended,  # f there
        error=D,  # the estimated error of the step
        inverse=D,  # 1 / allowed error
        jacobian=f.entries + 1 if is_implicit else 0,  # entries of f', and s
        factors=integrator.factors,  # of 1 - s f'
        right=D,  # the right side, after the factors
        of_end=integrator.factors,  # factors with f' at the end of a step
        at_end=D if is_implicit else 0,  # the right side, after them
        taken=1,  # length of this step
        signed=1,  # the same with the sign of time
        aside=1,  # 1 where it is a step aside
        accepted=1,  # 1 where the step is taken, else 0
        alerts=1,  # 1 where `growing_components` has to look at the step
        served=1,  # 1 where a step aside has reached its time, else 0
        t=1,  # time before the step
        at_surface=1,  # 1 where the step ends on a surface, or just before it, else 0
        f_ends=1,  # 1 where f has no value beyond that surface, else 0
        jumped=1,  # 1 where f may have jumped there
        # Surfaces at the start and at POINTS, and inputs of `double_crossings`.
        points=integrator.at_points + watched + 1,
        point=watched,  # the state at such a point
        quartic=of_x.D if watched else 0,  # what polynomials of degree 4 have there beside cubics
        moving=2 * watched + 1,  # that state, how it changes in a step, and rtol, for rates
        decision=3,  # results of `DoubleCrossings.decision`
        end=2 * (watched + surfaces),  # the state, f there, and sides of events, for `aim`
        aim=3,  # results of `step_to_surface.aim_of`
        between=2 * integrator.surfaces,  # surfaces at two points, between which they are crossed
        sides=2 * surfaces,  # what the row `side` of the trajectory holds
        crossings=len(f.watch.results) if watched else 0,  # results of `watch` there
        changed=acts * D,  # what functions of events return
        before=acts * D,  # the state before an action
        f_before=acts * D,  # f there
        pair=acts * (4 * of_x.D + 1),  # a state and f there, and what columns need beside them
        toward=OF_SURFACE * surfaces,  # `OF_SURFACE` numbers of surfaces of events at that state
        ahead=OF_SURFACE * surfaces,  # the same a moment later
        fired=surfaces,  # 1 if an event acts after a crossing upward at this instant, -1 downward
        near=surfaces,  # |s|, up to which a state is on the surface
        rate_before=surfaces,  # ds/dt before the event acts
        actions_now=acts,  # number of actions at surfaces at this instant
        chooses=chooses,  # 1 where branches are chosen
        chosen=len(of_x.branch_program.results) if chooses else 0,  # results of `branches`
        derived=len(of_x.derived.results) if chooses else 0,  # numbers of the table, by branches
        f_old=chooses * of_x.D,  # f before a jump
        slopes=len(of_x.slope_places) if has_slopes else 0,  # of surfaces where f jumps
        gradient=of_x.D + f.q if has_slopes else 0,  # of a surface, for x and parameters
        tau=acts * D // of_x.D,  # how much earlier displaced solutions reach this instant
        lanes=4 * (2 * D + extended) * bool(f.products),  # states and rates of columns in lanes
        scratch=max(each.scratch for each in integrator.functions.values())
        * (4 if f.products else 1),
    )


def _first_rows(**sizes):
    """Return the first rows of parts with these numbers of rows, one after the other."""
    return namedtuple("Rows", [*sizes, "size"])(*accumulate(sizes.values(), initial=0))


def scalars_of(rows):
    """Return the names of the parts that have one row; `rows` is a result of `_first_rows`."""
    pairs = zip(rows._fields, pairwise(rows), strict=False)
    return [name for name, (a, b) in pairs if b - a == 1]
