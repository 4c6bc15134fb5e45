"""The loop over steps of the maps in any dimension: the n-dimensional one, and of quadratic fields.

A block of trajectories advances together: a lane is a trajectory, and each of the D components of a
state is an array over the lanes. The arithmetic of a lane never depends on the others. A map is a
module (`map_nd`, `map_field`) of functions of components c and numbers b of lanes, NamedTuples:

block(parameters, memory, task)
    Return the c and b of blocks, c in the memory of a task.
enter(c, b, parameters, start, results, begin, end)
    Enter trajectories begin to end at state `start`; lanes beyond the last repeat it.
advance(c, b, begin)
    Make a step; return False if a lane may need `settle`.
settle(c, b, n, results, begin, end)
    Complete the step to state n, and end lanes without such a state.
write(c, b, parameters, begin, end, n, target)
    Write the states n in the unit of the input; states 0 are copies of it.
leave(c, b, results, begin, end)
    Write the states in the units of the lanes, and what else is carried on.
"""

from .._jit import Kernel, checked, namespace, share
from . import map_field, map_nd
from .turning_nd import turn_lanes, write_turns

map = namespace("map")  # of the map that a kernel iterates

# The arguments of the functions of a map.
_FUNCTIONS = {
    "block": "parameters memory task",
    "enter": "c b parameters start results begin end",
    "advance": "c b begin",
    "settle": "c b n results begin end",
    "write": "c b parameters begin end n target",
    "leave": "c b results begin end",
}


def run_blocks(part, parts, parameters, stretch, saved, turning, results, memory):
    """Iterate the trajectories of a part of the tasks.

    parameters   those of the map
    stretch      of trajectories and steps, as in `blocks`
    saved        (rows, B, D)
    turning      None, or the arrays of `turning_nd`
    results      final (B, D); status, failed_at (B,); the states in the units of lanes (B, D); and
                 what else the map carries on; all but `final` are read if start is not 0
    memory       that of the map; its second array is (tasks, ..., lanes)
    """
    first, last, start, stop, every, first_row = stretch
    tasks, lanes = len(memory[1]), memory[1].shape[-1]
    blocks = (last - first + lanes - 1) // lanes
    first_task, last_task = share(tasks, part, parts)
    for task in range(first_task, last_task):
        c, b = map.block(parameters, memory, task)
        for number in range(task * blocks // tasks, (task + 1) * blocks // tasks):
            begin = first + number * lanes
            end = min(begin + lanes, last)
            map.enter(c, b, parameters, start, results, begin, end)
            n, row, next_saved = start, 0, stop + 1
            if len(saved) > 0:
                row = start // every + 1 - first_row if start > 0 else 0
                next_saved = (start // every + 1) * every if start > 0 else 0
            while True:
                if turning is not None:
                    turn_lanes(c, b, turning, task, begin, end, n, start)
                if n == next_saved:
                    map.write(c, b, parameters, begin, end, n, saved[row])
                    if turning is not None:
                        write_turns(turning, begin, end, row)
                    row, next_saved = row + 1, next_saved + every
                if n == stop:
                    break
                pause = min(next_saved, stop) if turning is None else n + 1
                while n < pause:
                    n += 1
                    # Without further arrays, whose references the call would count.
                    if not map.advance(c, b, begin):
                        map.settle(c, b, n, results, begin, end)
            map.write(c, b, parameters, begin, end, stop, results[0])
            map.leave(c, b, results, begin, end)


def map_kernel(name, module, **others):
    """Build the kernel of a map from its module, with other functions in place of some."""
    return Kernel(run_blocks, name, map=namespace(name, **checked(module, _FUNCTIONS) | others))


field = map_kernel("field", map_field)
rank2 = map_kernel("rank2", map_nd)
gauss = map_kernel("gauss", map_nd, advance=map_nd.advance_by_elimination)
