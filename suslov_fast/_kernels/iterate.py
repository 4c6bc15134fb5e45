"""The loop over steps, common to all maps in three dimensions.

A block of up to LANES trajectories advances together, step by step: steps are outside, lanes
inside, and LLVM places lanes side by side in vector registers. The constants of each trajectory
are in the rows of `c`, its state in those of `s`. `run_blocks` is the loop; `map_kernel` makes the
kernel of a map of it, with formulas for one lane l:

enter(parameters, omega, b, c, s, l)   Fill the lane with trajectory b. Return its status, and 1 if
                                       its steps must be guarded, else 0.
advance(c, s, l)                       Make one step of a trajectory that cannot meet a pole.
show(c, s, l, out, i)                  Write the angular velocity to out[i:].
cause(c, s, l)                         Return the status of a trajectory that has no next state.

A step makes s[0, l] NaN if there is no next state, and `show` then writes NaN. Lanes that are not
guarded are not tested for this: without `guarded`, `enter` returns 1 unless no step can fail.

and, for maps with steps of several kinds,

careful(c, s, l)                       Make the same step without slow subnormal numbers.
guarded(c, s, l)                       Make one step of any trajectory: NaN where no next state
                                       exists, else bit-identical to `advance`.
settle(c, s, l, rounds)                Return 1 if steps must be careful, else 0. With `rounds`,
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
             fails; state (B, S), from which a run is resumed, or (0, S)
"""

import numpy as np

from .._jit import Kernel, carray, formula, share, stack
from . import codes
from .lanes import LANES, whole
from .tiles import lead_of, missing_of_first_block, write_row
from .turning_3d import BEFORE, TURNING, enter_turns, leave_turns, turn_on, write_turns

# Rows of `c` and of `s`: a map has at most so many constants and state variables.
CONSTANTS, STATE = 12, 4
# Components of omega up to this are finite: float64 ends at 1.8e308, and a component is a sum of
# up to three products.
LARGEST = 1e307
_C, _S, _TILE, _TURN = CONSTANTS * LANES, STATE * LANES, 3 * LANES, TURNING * LANES
# Number of steps between tests for failure; after a failure the last of them are repeated.
CHECK_EVERY = 256


@formula
def blocks_of(span, saved):
    """Return how many blocks a call has, and by how much the first one is shorter."""
    shift = missing_of_first_block(lead_of(saved), saved.shape[1], saved.shape[2])
    return (span[1] - span[0] + shift + LANES - 1) // LANES, shift


@formula
def nothing_to_settle(c, s, l, rounds):
    """`settle` of a map whose states do not become subnormal."""
    return 0


def run_blocks(part, parts, parameters, omega, span, saved, turning, kept):
    """Take a part of the trajectories of a span from state `start` to state `stop`."""
    begin, end, start, stop, every, first_row = span
    final, status, failed_at, state = kept
    c, s = carray(stack(_C), (CONSTANTS, LANES)), carray(stack(_S), (STATE, LANES))
    before, tile = carray(stack(_S), (STATE, LANES)), carray(stack(_TILE), (_TILE,))
    r = carray(stack(_TURN), (TURNING, LANES))
    saves, lead, stride = len(saved) > 0, lead_of(saved), D * saved.shape[1]
    flat, flat_final = saved.reshape(saved.size), final.reshape(final.size)
    blocks, shift = blocks_of(span, saved)
    first_block, last_block = share(blocks, part, parts)
    for block in range(first_block, last_block):
        first = begin + max(block * LANES - shift, 0)
        width = min(begin + (block + 1) * LANES - shift, end) - first
        lanes = whole(width)
        to_guard = 0
        for l in range(lanes):  # lanes beyond the last trajectory repeat it
            b = first + min(l, width - 1)
            code, guards = enter(parameters, omega, b, c, s, l)
            to_guard += guards
            if start == 0 and l < width:
                status[b] = code
                if code == codes.NONFINITE:
                    failed_at[b] = 0
        if start > 0:
            for l in range(lanes):
                for k in range(numbers):
                    s[k, l] = state[first + min(l, width - 1), k]
        elif saves:
            write_starts(omega, flat, first, width)
        if turning is not None:
            enter_turns(turning, omega, first, width, lanes, r)
            if start > 0:
                for l in range(lanes):
                    show(c, s, l, tile, 2 * l)
                for l in range(lanes):
                    r[BEFORE, l], r[BEFORE + 1, l] = tile[2 * l], tile[2 * l + 1]
            elif saves:
                write_turns(turning, r, 0, first, width)

        n, next_saved = start, (start // every + 1) * every if saves else stop + 1
        place = (next_saved // every - first_row) * stride + D * first
        while n < stop:
            since, until = n, min(stop, (n // CHECK_EVERY + 1) * CHECK_EVERY)
            small = 0
            for l in range(lanes):
                small += settle(c, s, l, n % CHECK_EVERY == 0)
                for k in range(numbers):
                    before[k, l] = s[k, l]
            while n < until:
                pause = min(until, next_saved) if turning is None else n + 1
                if to_guard > 0:
                    for _ in range(n, pause):
                        for l in range(lanes):
                            guarded(c, s, l)
                elif small > 0:
                    for _ in range(n, pause):
                        for l in range(lanes):
                            careful(c, s, l)
                else:
                    for _ in range(n, pause):
                        for l in range(lanes):
                            advance(c, s, l)
                for l in range(lanes):
                    show(c, s, l, tile, D * l)
                n = pause
                if turning is not None:
                    turn_on(tile, r, lanes)
                if n == next_saved:
                    write_row(tile, flat, place, D * width, stride, lead)
                    if turning is not None:
                        write_turns(turning, r, next_saved // every - first_row, first, width)
                    next_saved, place = next_saved + every, place + stride
            if to_guard > 0:
                for l in range(width):
                    if status[first + l] >= 0 and np.isnan(s[0, l]):
                        for k in range(numbers):
                            s[k, l] = before[k, l]
                        code, failed_at[first + l] = codes.OK, since
                        while not np.isnan(s[0, l]):
                            code = cause(c, s, l)
                            guarded(c, s, l)
                            failed_at[first + l] += 1
                        status[first + l] = code

        if stop == 0:
            write_starts(omega, flat_final, first, width)
        else:
            for l in range(width):
                show(c, s, l, flat_final, D * (first + l))
        if len(state) > 0:
            for l in range(width):
                for k in range(numbers):
                    state[first + l, k] = s[k, l]
        if turning is not None:
            leave_turns(turning, r, first, width)
            if not saves and len(turning[3]) > 0:
                write_turns(turning, r, 0, first, width)


def map_kernel(
    name, D, numbers, enter, advance, show, cause, careful=None, guarded=None, settle=None
):
    """Build the kernel of a map whose states have D components, stored as `numbers` variables."""
    assert numbers <= STATE, "the rows of a block are too few"
    return Kernel(
        run_blocks,
        name,
        D=D,
        numbers=numbers,
        enter=enter,
        advance=advance,
        careful=careful or advance,
        guarded=guarded or advance,
        settle=settle or nothing_to_settle,
        show=show,
        cause=cause,
    )


@formula
def write_starts(omega, flat, first, width):
    """Copy the states at step 0."""
    D = omega.shape[1]
    for l in range(width):
        for k in range(D):
            flat[D * (first + l) + k] = omega[first + l, k]
