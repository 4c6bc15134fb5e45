"""The rows of a line, by name: W trajectories that take their steps together, one in each lane.

A row has one number for each lane, so that a line is an array (rows, W). Temporary results of a
step have rows of their own. Here each part of a line has a name, a number of rows, and a meaning.
"""

from collections import namedtuple
from itertools import accumulate, pairwise

from ..hybrid.event_formulas import OF_SURFACE


class LaneState:
    """The states of a lane; plain numbers, because NumPy compares with enum members slowly."""

    EXPLICIT = 0
    IMPLICIT = 1
    DONE = 2  # the trajectory has reached the last time
    ENDED = 3  # steps have become too short
    TOO_MANY = 4  # the motion stands still, see `step_length.COUNT`
    NO_VALUE = 5  # f has no value at the start
    SLIDING = 6  # a branch of f changes back and forth
    STOPPED = 7  # an event has ended the trajectory
    ACCUMULATES = 8  # actions of events follow one another at once, without end
    AGAIN = 9  # the trajectory is to be computed again, see `growing_components`


BEGINS = -1.0  # in place of a `LaneState` before the first step
UNKEPT = 3  # rows with the results of tests of first integrals


def rows_of_trajectory(integrator):
    """Return the first row of each part of a trajectory's data, and their number, `size`."""
    f, searches = integrator.f, integrator.searches
    D, chooses = f.D, int(f.hybrid.chooses)
    return _first_rows(
        x=D,  # the state
        f_x=D + len(f.denominators),  # f(x), then denominators that may not change sign
        largest=D,  # the largest modulus of each component so far
        power_vector=D,  # the vector of the power iteration on f'
        lost=D,  # relative error of each component, or the mark RELATIVE, see `growing_components`
        # The state after a step of length `outer`, beyond a surface.
        beyond=integrator.D_of_surfaces,
        chosen_at=chooses,  # time at which branches of f changed last
        chosen_often=chooses,  # how often in a row branches of f changed again at once
        **_lasting_rows_of_events(integrator),
        levels=f.of_x.invariants_count,  # values of kept invariants, see `projected_states`
        unkept=UNKEPT * bool(f.of_x.left_out),  # see `projected_states.note`
        t=1,  # modulus of the time
        wanted=1,  # length of the next step
        best=1,  # length with which the last step would have had the allowed error; 0: not known
        longer=1,  # largest factor from the length of a step to the length of the step after it
        next=1,  # modulus of the next requested time, infinity after the last
        second=1,  # modulus of the requested time after `next`
        state=1,  # a `LaneState`
        stiff=1,  # number of steps of an explicit lane that look stiff
        easy=1,  # steps in a row that do not look stiff; if implicit: that could be explicit
        patience=1,  # number of stiff steps after which a lane becomes implicit
        trial=1,  # number of steps that are left of the trial of implicit steps
        steps=1,  # number of accepted steps
        tries=1,  # number of steps, also refused ones, actions and records, see `step_length.COUNT`
        counted_from=1,  # time at which `step_length.COUNT` last found that the motion moves on
        most_lost=1,  # the largest `lost`; infinity after an alarm, see `growing_components`
        inner=searches,  # in a search for a surface: length of a step that does not cross it
        outer=searches,  # in a search: length of a step that crosses the surface; else infinity
        weight=searches,  # Illinois rule: weight of the end at `inner`, or minus that at `outer`
        rounds=searches,  # number of lengths that a search for a surface has tried
        unlimited=searches,  # in a search for a surface: the next length if there were no surface
        place=1,  # number of the next requested time, an integer
        trajectory=1,  # number of the trajectory, an integer
    )


def _lasting_rows_of_events(integrator):
    """Return the numbers of rows of events that last from step to step, by name."""
    acts, surfaces = int(integrator.f.hybrid.acts), integrator.event_surface_count
    actions = integrator.events.count if acts else 0
    return {
        # Two rows for each surface s = 0 of an event: the side, 1 if s >= level, 0 if s < level,
        # STAYS if the state stays on the surface, `GAP` if s is NaN; then the level.
        "side": 2 * surfaces,
        "action_counts": actions,  # how often each event has acted
        "acted_at": surfaces,  # when each event on a surface has acted last
        "pause": surfaces,  # time between the last two actions of each event on a surface
        # When each surface was crossed last; -infinity if the action there led back, or if another
        # action led across it by more than rounding.
        "crossed_at": surfaces,
        "stop": acts,  # modulus of the next given time of an event, infinity after the last
        "stop_which": acts,  # number of the event at the time `stop`
        "stop_place": acts,  # place of the time `stop` in the list of given times, an integer
        "at": acts,  # time of the last action; the limit of these times if actions accumulate
        "recorded": acts,  # number of crossings that events have recorded without acting
        "often": acts,  # how often in a row an event has acted again at once
        "resting": acts,  # number of surfaces on which the state stays
    }


def rows_of_work(integrator):
    """Return the first row of each part of a step's workspace, and their number, `size`."""
    f, of_x, in_lanes = integrator.f, integrator.f.of_x, integrator.rule.lanes
    D, acts, extended = f.D, int(f.hybrid.acts), f.D + len(f.denominators)
    of_ends = len(integrator.rule.columns) * D
    return _first_rows(
        line=integrator.rows.size,  # rows of the trajectories, see `rows_of_trajectory`
        own=1,  # 1 + the number of a lane's trajectory, an integer; 0 if it has none
        table=len(f.table),  # tables of the lanes, if each lane has its own
        waiting=integrator.rows.size,  # rows of trajectories that free lanes take next, see `lanes`
        table_waiting=len(f.table),  # tables of these
        start=D,  # a state inside a step
        f_start=extended,  # f at the state `start`, then denominators that may not change sign
        a=D,  # a state of a column; after the last column its y_N
        b=extended,  # a second state of a column, or f at the state in `a`
        f_last=extended,  # f at y_N of the last column
        ends=of_ends,  # y_c - x, with the ends y_c of columns
        beside=6 * extended,  # of `second_trial`: f at a point, the point, changes of f near it
        new=D,  # the next state
        f_new=extended,  # f at the next state, then denominators that may not change sign
        error=D,  # the estimated error of the step
        inverse=D,  # 1 / allowed error
        taken=1,  # length of this step
        signed=1,  # length of this step, with the sign of time
        aside=1,  # 1 where this step is a step aside, see `step_length`
        accepted=1,  # 1 where the step is taken, else 0
        alerts=1,  # 1 where `growing_components` has to look at the step
        served=1,  # 1 where a step aside has reached its time, else 0
        began=1,  # time before the step
        at_surface=1,  # 1 where the step ends on a surface, or just before it, else 0
        f_ends=1,  # 1 where f has no value beyond the surface at the end of the step, else 0
        jumped=1,  # 1 where f may have jumped at the end of the step
        **_rows_of_surfaces(integrator),
        **_rows_of_events(integrator),
        **_rows_of_branches(f),
        tau=acts * D // of_x.D,  # how much earlier solutions along a column reach the event
        **_rows_of_invariants(of_x),
        # States and rates, see `gragg.in_lanes`.
        lanes=in_lanes * (2 * D + extended) * bool(f.products),
        **integrator.rule.rows(),
        scratch=max(each.scratch for each in integrator.functions.values())
        * (in_lanes if f.products else 1),
    )


def _rows_of_surfaces(integrator):
    """Return the numbers of rows by which `events.location` finds crossings, by name."""
    f, of_surfaces = integrator.f, integrator.D_of_surfaces
    surfaces = integrator.event_surface_count
    return {
        # Values of surfaces at the start and at POINTS, then inputs of `double_crossings`.
        "points": integrator.at_points + of_surfaces + 1,
        "point": of_surfaces,  # the state at one of the POINTS
        # Terms of degree 4 of states in a step (`QUARTIC`).
        "quartic": f.of_x.D if of_surfaces else 0,
        # Inputs of `rates`: the state at a point, its change in a step, largest moduli, rtol.
        "moving": 3 * of_surfaces + 1,
        "decision": 3,  # results of `DoubleCrossings.decision`
        # Inputs of `aim`: the next state, f there, sides of events.
        "end": 2 * (of_surfaces + surfaces),
        "aim": 3,  # results of `step_to_surface.aim_of`
        # Inputs of `watch`: values of surfaces at two points.
        "between": 2 * integrator.surface_count,
        "sides": 2 * surfaces,  # a copy of the row `side`, which `watch` reads behind `between`
        "crossings": len(f.hybrid.watch.results) if of_surfaces else 0,  # results of `watch`
    }


def _rows_of_events(integrator):
    """Return the numbers of rows of `events.actions`, by name."""
    f, of_x, surfaces = integrator.f, integrator.f.of_x, integrator.event_surface_count
    D, acts = f.D, int(f.hybrid.acts)
    sought = integrator.events.modes[1] if acts and integrator.events.modes else 0
    return {
        "changed": acts * D,  # results of functions of events
        "before": acts * D,  # the state before an action
        "f_before": acts * D,  # f before an action
        "pair": acts * (4 * of_x.D + 1),  # inputs of functions of events: states, rates, and `tau`
        "toward": OF_SURFACE * surfaces,  # numbers of each surface of events at the next state
        "ahead": OF_SURFACE * surfaces,  # numbers of each surface of events a moment after the step
        "fired": surfaces,  # 1 if an event has acted after a crossing upward, -1 downward, else 0
        "near": surfaces,  # the |s| up to which a state is on the surface s = 0
        "rate_before": surfaces,  # ds/dt before the event at s = 0 acts
        "actions_now": acts,  # number of actions at surfaces at this instant
        "trying": bool(sought) * of_x.D,  # a state with modes that `mode_search` tries
        "tried": bool(sought) * (3 * sought + 1),  # results of the part `search` of `EventSet`
        "only": sought,  # consistent modes that `mode_search` has found
    }


def _rows_of_branches(f):
    """Return the numbers of rows of `events.branch_choice`, by name."""
    of_x, chooses, has_slopes = f.of_x, int(f.hybrid.chooses), f.hybrid.jumps and f.columns
    return {
        "chooses": chooses,  # 1 where branches of f are to be chosen at the state `new`
        # Results of `branches`, and values of f's table that depend on branches.
        "chosen": len(of_x.hybrid.branch_program.results) if chooses else 0,
        "derived": len(of_x.hybrid.derived.results) if chooses else 0,
        "f_old": chooses * of_x.D,  # f before a jump
        "slopes": len(of_x.slope_places) if has_slopes else 0,  # slopes of surfaces where f jumps
        "gradient": of_x.D + f.q if has_slopes else 0,  # gradient of the surface where f jumps
    }


def _rows_of_invariants(f):
    """Return the numbers of rows of `projection`, by name."""
    invariants, tested, has_integrals = f.invariants_count, len(f.tested), int(bool(f.left_out))
    return {
        # Inputs of `project`: the state, allowed errors, and levels; of `regular` also x.
        "projecting": bool(invariants) * 3 * f.D + invariants,
        # The state after a projection, 1 where an integral was far from its level, and I - c.
        "projected": bool(invariants) * f.D + has_integrals + tested,
        "left_out": has_integrals,  # 1 where an integral is still far from its level, else 0
        "changing": bool(tested) * (f.D + 1 + tested),  # inputs of `changes`
        "changes": int(bool(tested)),  # 1 + the number of an integral that changes along f, else 0
        "invariants": invariants,  # values of invariants
    }


def _first_rows(**sizes):
    """Return the first row of each part, by name; `sizes` are the numbers of their rows."""
    return namedtuple("Rows", [*sizes, "size"])(*accumulate(sizes.values(), initial=0))


def scalars_of(rows):
    """Return the names of the parts that have one row; `rows` is a result of `_first_rows`."""
    pairs = zip(rows._fields, pairwise(rows), strict=False)
    return [name for name, (a, b) in pairs if b - a == 1]
