"""The loop over steps of every map of two or three components whose step is a formula.

A block of up to LANES trajectories advances together, step by step: steps are outside, lanes
inside, and LLVM places lanes side by side in vector registers. `run_blocks` is the loop; a map is a
module (`map_canonical`, `map_printed`, `map_full`, `map_gyrostat`) of formulas with

D                                 The number of components of omega.
State, Constants                  namedtuples of the numbers s that a step changes, and of the
                                  numbers k that it does not.
enter(parameters, omega, i)       Return the status of trajectory i, True if one of its steps may
                                  fail, its State and its Constants.
advance(k, s)                     Make one step; with `guarded`, of a trajectory that cannot fail.
show(k, s)                        Return the angular velocity.
cause(k, s)                       Return the status of a trajectory whose next state may not exist;
                                  it is not used for one that has a next state.

The first number of a state is NaN if there is none, and `show` then returns NaN. Blocks are tested
for this, and take all steps by `guarded`, only if `enter` returns True for one of their lanes.
Optional, by default `advance`, and no change (other functions of the module begin with "_"):

guarded(k, s)                     Make one step of any trajectory: NaN where no next state exists,
                                  else bit-identical to `advance`.
settle(k, s)                      Replace negligible numbers by 0, every CHECK_EVERY steps.

The arithmetic of a trajectory does not depend on its block or on the division of steps into calls.
Arguments of a kernel, over a batch of B trajectories:

parameters   arrays (B,) or (1,): parameters of the body, and the step size
omega        (B, D), the states at step 0
stretch      begin, end, start, stop, every, first_row: trajectories begin to end are taken from
             state start to state stop, states whose index is a multiple of `every` are saved,
             starting with index first_row * every
saved        (rows, B, D); no rows if no states are saved
turning      None, or the arrays of `turning_3d`: results at the saved states, or only the last
results      final (B, D), state `stop`; status (B,); failed_at (B,), written where a trajectory
             fails; the numbers of State (B, ...), from which a run is resumed, or (0, ...)
"""

import numpy as np

from .._jit import Kernel, checked, formula, lane, namespace, put, rows_of, select, share, stack
from . import codes, map_canonical, map_full, map_gyrostat, map_printed
from .lanes import LANES, whole
from .tiles import lead_of, shortening_of_first_block, write_row
from .turning_3d import enter_turns, leave_turns, start_turns, turn_on, turns_block, write_turns

map = namespace("map")  # of the map that a kernel iterates

# The arguments of the functions of a map.
_FUNCTIONS = {"enter": "parameters omega i"}
_FUNCTIONS |= dict.fromkeys(("advance", "show", "cause", "guarded", "settle"), "k s")
_TILE = 3 * LANES
# Number of steps between tests for failure; after a failure the last of them are repeated.
CHECK_EVERY = 256


@formula
def unchanged(k, s):
    """`settle` of a map whose states do not become negligible."""
    return s


@formula
def write_starts(omega, flat, first, width):
    """Copy the states at step 0."""
    D = omega.shape[1]
    for l in range(width):
        for k in range(D):
            flat[D * (first + l) + k] = omega[first + l, k]


def run_blocks(part, parts, parameters, omega, stretch, saved, turning, results):
    """Take a part of the trajectories of a stretch from state `start` to state `stop`."""
    begin, end, start, stop, every, first_row = stretch
    final, status, failed_at, resumed = results
    constants, state = rows_of(map.Constants, LANES), rows_of(map.State, LANES)
    before, r, tile = rows_of(map.State, LANES), turns_block(), stack(_TILE)
    code_of = stack(LANES)
    saves, lead, stride = len(saved) > 0, lead_of(saved), map.D * saved.shape[1]
    flat, flat_final = saved.reshape(saved.size), final.reshape(final.size)
    shift = shortening_of_first_block(lead, saved.shape[1], map.D)
    blocks = (end - begin + shift + LANES - 1) // LANES
    first_block, last_block = share(blocks, part, parts)
    for block in range(first_block, last_block):
        first = begin + max(block * LANES - shift, 0)
        width = min(begin + (block + 1) * LANES - shift, end) - first
        lanes = whole(width)
        to_guard = 0
        for l in range(lanes):  # lanes beyond the last trajectory repeat it
            code, guards, s, k = map.enter(parameters, omega, first + min(l, width - 1))
            put(state, l, s)
            put(constants, l, k)
            code_of[l] = code
            to_guard += select(guards, 1, 0)
        for l in range(width if start == 0 else 0):
            status[first + l], total = int(code_of[l]), 0.0
            for j in range(map.D):
                total += omega[first + l, j]
            if code_of[l] == codes.NONFINITE:  # the state is NaN, or the step is out of range
                failed_at[first + l] = 0 if np.isnan(total) else 1
        if start > 0:
            for l in range(lanes):
                for j in range(len(state)):
                    state[j][l] = resumed[first + min(l, width - 1), j]
        elif saves:
            write_starts(omega, flat, first, width)
        if turning is not None:
            enter_turns(turning, omega, first, width, lanes, r)
            if start > 0:
                for l in range(lanes):
                    put(tile, 2 * l, map.show(lane(constants, l), lane(state, l)))
                start_turns(tile, r, lanes)
            elif saves:
                write_turns(turning, r, start, first, width)

        n, row, next_saved = start, 0, stop + 1
        if saves:
            row, next_saved = start // every + 1 - first_row, (start // every + 1) * every
        place = row * stride + map.D * first
        while n < stop:
            since, until = n, min(stop, (n // CHECK_EVERY + 1) * CHECK_EVERY)
            for l in range(lanes):
                if n % CHECK_EVERY == 0:
                    put(state, l, map.settle(lane(constants, l), lane(state, l)))
                put(before, l, lane(state, l))
            while n < until:
                pause = min(until, next_saved) if turning is None else n + 1
                if to_guard > 0:
                    for _ in range(n, pause):
                        for l in range(lanes):
                            put(state, l, map.guarded(lane(constants, l), lane(state, l)))
                else:
                    for _ in range(n, pause):
                        for l in range(lanes):
                            put(state, l, map.advance(lane(constants, l), lane(state, l)))
                for l in range(lanes):
                    put(tile, map.D * l, map.show(lane(constants, l), lane(state, l)))
                n = pause
                if turning is not None:
                    turn_on(tile, r, lanes)
                if n == next_saved:
                    write_row(tile, 0, flat, place, map.D * width, stride, lead)
                    if turning is not None:
                        write_turns(turning, r, row, first, width)
                    row, next_saved, place = row + 1, next_saved + every, place + stride
            if to_guard > 0:
                for l in range(width):
                    if status[first + l] >= 0 and np.isnan(state[0][l]):
                        put(state, l, lane(before, l))
                        code, failed_at[first + l] = codes.OK, since
                        while not np.isnan(state[0][l]):
                            k, s = lane(constants, l), lane(state, l)
                            code = map.cause(k, s)
                            put(state, l, map.guarded(k, s))
                            failed_at[first + l] += 1
                        status[first + l] = code

        if stop == 0:
            write_starts(omega, flat_final, first, width)
        else:
            for l in range(width):
                put(flat_final, map.D * (first + l), map.show(lane(constants, l), lane(state, l)))
        if len(resumed) > 0:
            for l in range(width):
                for j in range(len(state)):
                    resumed[first + l, j] = state[j][l]
        if turning is not None:
            leave_turns(turning, r, first, width)
            _, _, _, turns = turning
            if not saves and len(turns) > 0:
                write_turns(turning, r, row, first, width)


def map_kernel(name, module):
    """Build the kernel of a map from its module."""
    optional = {"guarded": getattr(module, "advance", None), "settle": unchanged}
    return Kernel(run_blocks, name, map=namespace(name, **checked(module, _FUNCTIONS, optional)))


canonical = map_kernel("canonical", map_canonical)
printed = map_kernel("printed", map_printed)
full = map_kernel("full", map_full)
gyrostat = map_kernel("gyrostat", map_gyrostat)
