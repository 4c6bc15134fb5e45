"""The arguments of the code of an integrator: addresses, and numbers of all lanes."""

from math import inf
from typing import Any, NamedTuple


class CodeArguments(NamedTuple):
    """The integers that are the arguments of an integrator's code: addresses and counts."""

    rows: int  # address of the rows of trajectories (count, rows)
    count: int
    following: int  # number of the trajectory that the next free lane takes; the code changes it
    budget: int  # steps of all lanes, after which the code returns
    table: int  # address of the table (n,) or (count, n)
    table_bytes: int  # from trajectory to trajectory
    work: int  # address of the workspace, see `memory.rows_of_work`
    numbers: int  # address of `SharedNumbers`
    components: int  # address of the rows of `ComponentNumbers` (6, D)
    times: int = 0  # address of the moduli of times, ascending, and two infinite ones
    states: int = 0  # address of the states at these times (count, trajectories, D)
    state_bytes: int = 0  # of one time
    event_times: int = 0  # address of times and numbers of events (count or 1, n + 1, 2)
    event_time_bytes: int = 0  # from trajectory to trajectory
    records: int = 0  # address of records of events (-, `event_records.size_of`)
    recorded: int = 0  # how many there are; the code changes it
    full: int = 0  # the number of records after which the code returns


class ComponentNumbers(NamedTuple):
    """Numbers of a component that all lanes share: for its allowed error, its sign, its rate."""

    extra: float  # added to the allowed error: atol, infinity for clocks
    counts: float  # 1, for clocks 0
    steady: float  # 1 for components of a constant rate, else 0
    keeps: float  # 1 for components that keep their sign, else 0
    some: float  # the least error beside it that counts, see `growing_components.some_of`
    seeds: float  # added to the vector of the power iteration


class SharedNumbers(NamedTuple):
    """Numbers that all lanes share: tolerance, last time, limits of steps and of crossings."""

    rtol: float
    floor: float  # of allowed errors in explicit steps, see `tolerance.floors_of`
    floor_implicit: float  # in implicit steps
    last: float  # modulus of the last time
    sign: float  # 1 or -1, forward or backward in time
    part: float  # see `step_length.first_part`
    longest: float  # step
    limit: float  # see `step_length.limit_of`
    switches: float  # 1 if lanes may change to the other integrator, else 0
    first_state: float  # `LaneState.EXPLICIT` or `LaneState.IMPLICIT`
    most: float  # steps, also refused ones, from one time to the next
    many: float  # see `growing_components`
    acts: float  # 1 if trajectories with an alarm are to be computed again, 0 if atol is 0
    enough: float = inf  # crossings of surfaces of records, after which a trajectory stops
    since: float = -1.0  # modulus of the time after which they count


SLOT = CodeArguments(*range(len(CodeArguments._fields)))
NUMBER: Any = SharedNumbers(*range(len(SharedNumbers._fields)))  # places, which are integers
COMPONENT = ComponentNumbers(*range(len(ComponentNumbers._fields)))
