"""The loop over steps, common to all maps in three dimensions.

A block of up to LANES trajectories advances together, step by step: steps are outside, lanes
inside, and LLVM places lanes side by side in vector registers. `run_blocks` is the loop; a map is a
module (`canonical`, `printed`, `full`, `gyrostat`) with

D, STATE                            The numbers of components of omega, and of state variables.
block()                             The rows of a block, by name; `state`, (STATE, LANES), holds
                                    what is carried from step to step.
enter(parameters, omega, i, b, l)   Fill lane l of block b with trajectory i. Return its status, and
                                    1 if its steps must be guarded, else 0.
advance(b, l)                       Make one step of a trajectory that cannot meet a pole.
show(b, l, out, i)                  Write the angular velocity to out[i:].
cause(b, l)                         Return the status of a trajectory that has no next state.

A step makes state[0, l] NaN if there is no next state, and `show` then writes NaN. Lanes that are
not guarded are not tested for this: without `guarded`, `enter` returns 1 unless no step can fail.
A map with steps of several kinds also has

careful(b, l)                       Make the same step without slow subnormal numbers.
guarded(b, l)                       Make one step of any trajectory: NaN where no next state exists,
                                    else bit-identical to `advance`.
settle(b, l, rounds)                Return 1 if steps must be careful, else 0. With `rounds`,
                                    replace negligible numbers by 0.

The arithmetic of a trajectory does not depend on its block or on the division of steps into calls.
Arguments of a kernel, over a batch of B trajectories:

parameters   arrays (B,) or (1,): parameters of the body, and the step size
omega        (B, D), the states at step 0
span         begin, end, start, stop, every, first_row: trajectories begin to end are taken from
             state start to state stop, states whose index is a multiple of `every` are saved,
             starting with index first_row * every
saved        (rows, B, D); no rows if no states are saved
turning      None, or the arrays of `turning_3d`: results at the saved states, or only the last
kept         final (B, D), state `stop`; status (B,); failed_at (B,), written where a trajectory
             fails; state (B, STATE), from which a run is resumed, or (0, STATE)
"""

import numpy as np

from .._jit import Kernel, carray, formula, namespace, share, stack
from . import codes
from .lanes import LANES, whole
from .tiles import lead_of, missing_of_first_block, write_row
from .turning_3d import enter_turns, leave_turns, start_turns, turn_on, turns_block, write_turns

map = namespace("map")  # of the map that a kernel iterates

# Components of omega up to this are finite: float64 ends at 1.8e308, and a component is a sum of
# up to three products.
LARGEST = 1e307
_MOST_STATE = 4
_BEFORE, _TILE = _MOST_STATE * LANES, 3 * LANES
# Number of steps between tests for failure; after a failure the last of them are repeated.
CHECK_EVERY = 256


@formula
def blocks_of(span, saved):
    """Return how many blocks a call has, and by how much the first one is shorter."""
    shift = missing_of_first_block(lead_of(saved), saved.shape[1], saved.shape[2])
    return (span[1] - span[0] + shift + LANES - 1) // LANES, shift


@formula
def nothing_to_settle(b, l, rounds):
    """`settle` of a map whose states do not become subnormal."""
    return 0


@formula
def write_starts(omega, flat, first, width):
    """Copy the states at step 0."""
    D = omega.shape[1]
    for l in range(width):
        for k in range(D):
            flat[D * (first + l) + k] = omega[first + l, k]


def run_blocks(part, parts, parameters, omega, span, saved, turning, kept):
    """Take a part of the trajectories of a span from state `start` to state `stop`."""
    begin, end, start, stop, every, first_row = span
    final, status, failed_at, resumed = kept
    b, r = map.block(), turns_block()
    state, before = b.state, carray(stack(_BEFORE), (_MOST_STATE, LANES))
    tile = carray(stack(_TILE), (_TILE,))
    saves, lead, stride = len(saved) > 0, lead_of(saved), map.D * saved.shape[1]
    flat, flat_final = saved.reshape(saved.size), final.reshape(final.size)
    blocks, shift = blocks_of(span, saved)
    first_block, last_block = share(blocks, part, parts)
    for block in range(first_block, last_block):
        first = begin + max(block * LANES - shift, 0)
        width = min(begin + (block + 1) * LANES - shift, end) - first
        lanes = whole(width)
        to_guard = 0
        for l in range(lanes):  # lanes beyond the last trajectory repeat it
            i = first + min(l, width - 1)
            code, guards = map.enter(parameters, omega, i, b, l)
            to_guard += guards
            if start == 0 and l < width:
                status[i] = code
                if code == codes.NONFINITE:  # the state, or the step in units of the motion
                    unknown = np.isnan(omega[i, 0] + omega[i, 1] + omega[i, map.D - 1])
                    failed_at[i] = 0 if unknown else 1
        if start > 0:
            for l in range(lanes):
                for k in range(map.STATE):
                    state[k, l] = resumed[first + min(l, width - 1), k]
        elif saves:
            write_starts(omega, flat, first, width)
        if turning is not None:
            enter_turns(turning, omega, first, width, lanes, r)
            if start > 0:
                for l in range(lanes):
                    map.show(b, l, tile, 2 * l)
                start_turns(tile, r, lanes)
            elif saves:
                write_turns(turning, r, 0, first, width)

        n, next_saved = start, (start // every + 1) * every if saves else stop + 1
        place = (next_saved // every - first_row) * stride + map.D * first
        while n < stop:
            since, until = n, min(stop, (n // CHECK_EVERY + 1) * CHECK_EVERY)
            small = 0
            for l in range(lanes):
                small += map.settle(b, l, n % CHECK_EVERY == 0)
                for k in range(map.STATE):
                    before[k, l] = state[k, l]
            while n < until:
                pause = min(until, next_saved) if turning is None else n + 1
                if to_guard > 0:
                    for _ in range(n, pause):
                        for l in range(lanes):
                            map.guarded(b, l)
                elif small > 0:
                    for _ in range(n, pause):
                        for l in range(lanes):
                            map.careful(b, l)
                else:
                    for _ in range(n, pause):
                        for l in range(lanes):
                            map.advance(b, l)
                for l in range(lanes):
                    map.show(b, l, tile, map.D * l)
                n = pause
                if turning is not None:
                    turn_on(tile, r, lanes)
                if n == next_saved:
                    write_row(tile, flat, place, map.D * width, stride, lead)
                    if turning is not None:
                        write_turns(turning, r, next_saved // every - first_row, first, width)
                    next_saved, place = next_saved + every, place + stride
            if to_guard > 0:
                for l in range(width):
                    if status[first + l] >= 0 and np.isnan(state[0, l]):
                        for k in range(map.STATE):
                            state[k, l] = before[k, l]
                        code, failed_at[first + l] = codes.OK, since
                        while not np.isnan(state[0, l]):
                            code = map.cause(b, l)
                            map.guarded(b, l)
                            failed_at[first + l] += 1
                        status[first + l] = code

        if stop == 0:
            write_starts(omega, flat_final, first, width)
        else:
            for l in range(width):
                map.show(b, l, flat_final, map.D * (first + l))
        if len(resumed) > 0:
            for l in range(width):
                for k in range(map.STATE):
                    resumed[first + l, k] = state[k, l]
        if turning is not None:
            leave_turns(turning, r, first, width)
            if not saves and len(turning[3]) > 0:
                write_turns(turning, r, 0, first, width)


def map_kernel(name, module):
    """Build the kernel of a map from its module."""
    given = vars(module)
    assert given["STATE"] <= _MOST_STATE
    defaults = {
        "careful": given["advance"],
        "guarded": given["advance"],
        "settle": nothing_to_settle,
    }
    needed = ("D", "STATE", "block", "enter", "advance", "show", "cause")
    own = {each: given.get(each, defaults.get(each)) for each in (*needed, *defaults)}
    return Kernel(run_blocks, name, map=namespace(name, **own))
