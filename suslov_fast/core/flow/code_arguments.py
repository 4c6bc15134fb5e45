"""The arguments of the code of an integrator: addresses, and numbers of all lanes."""

from math import inf
from typing import Any, NamedTuple


class CodeArguments(NamedTuple):
    """The arguments of an integrator's code, which are integers: addresses and counts."""

    rows: int  # address of the rows of trajectories (count, rows)
    count: int  # number of these trajectories
    following: int  # number of the trajectory that the next free lane takes; the code changes it
    budget: int  # number of steps, each of all lanes, after which the code returns
    table: int  # address of the table of f, numbers that f reads: (n,) or (count, n)
    table_bytes: int  # bytes between the tables of successive trajectories
    work: int  # address of the workspace, see `memory.rows_of_work`
    numbers: int  # address of `SharedNumbers`
    components: int  # address of the rows of `ComponentNumbers`, D numbers each
    times: int = 0  # address of the moduli of requested times, ascending, then two infinities
    states: int = 0  # address of states at requested times (times, trajectories of the batch, D)
    state_bytes: int = 0  # bytes of the saved states at one time
    event_times: int = 0  # address of pairs (time, event), an array (count or 1, n + 1, 2)
    event_time_bytes: int = 0  # bytes between the pairs of successive trajectories; 0 if shared
    records: int = 0  # address of records of events, rows of `events.records.size_of` numbers
    recorded: int = 0  # number of records so far; the code changes it
    full: int = 0  # number of records above which the code returns


class ComponentNumbers(NamedTuple):
    """Numbers of one component, the same in all lanes: for its allowed error, sign and rate."""

    extra: float  # added to the allowed error: `atol`, or infinity for clocks
    counts: float  # 0 for clocks, whose values do not count in tolerances; 1 for others
    steady: float  # 1 for components of a constant rate, else 0
    keeps: float  # 1 for components that keep their sign, else 0
    floor: float  # for allowed errors of explicit steps, see `allowed_errors.floors_of`
    floor_implicit: float  # for allowed errors of implicit steps, see `allowed_errors.floors_of`
    some: float  # least relative error that may cost digits, see `growing_components.some_of`
    seeds: float  # seed of the power iteration, see `linearly_implicit`


class SharedNumbers(NamedTuple):
    """Numbers that all lanes share: tolerance, last time, limits of steps and of crossings."""

    rtol: float
    last: float  # modulus of the last time
    sign: float  # 1 or -1, forward or backward in time
    part: float  # relative change of x in the first step, see `step_length.first_part`
    longest: float  # length of the longest step
    limit: float  # h |mu| above which a step looks stiff, see `step_length.limit_of`
    switches: float  # 1 if lanes may change to the other integrator, else 0
    first_state: float  # the `LaneState` of the first steps, EXPLICIT or IMPLICIT
    most: float  # the most `tries` that do not move a motion on, see `step_length.COUNT`
    many: float  # error / allowed error that raises the alarm, see `growing_components`
    acts: float  # 1 if lost digits (`growing_components`) make a trajectory begin again, else 0
    enough: float = inf  # number of recorded crossings after which a trajectory stops
    since: float = -1.0  # modulus of the time after which crossings count


SLOT = CodeArguments(*range(len(CodeArguments._fields)))
NUMBER: Any = SharedNumbers(*range(len(SharedNumbers._fields)))  # the place of each number
COMPONENT = ComponentNumbers(*range(len(ComponentNumbers._fields)))
