"""Short runs of a few orbits of one field, with few NumPy objects: users call `step` in loops.

The code, tables and arguments of a run are kept from call to call.
"""

import functools
import math
from array import array

from ..llvm.compiler import address_of, code_of
from .driver import NOT_READY, SLOT, WIDTH, DriverArguments, text_of_steps
from .packs import PLANS, common_table, compares_signs, in_lines, plan_of

# Orbits, and steps of a short run. One prepared step takes about a fourth of the time of others.
FEW, SHORT = 8, 256


@functools.lru_cache(PLANS)
def _prepared(step, stages, eps, values, B, saves):
    """Return the code for B orbits, its arguments, W, and objects that must stay alive.

    `eps` and `values` are bytes of numbers.
    """
    W, compares = lanes_of(B), compares_signs(step)
    address = code_of(text_of_steps, step, W, False, saves, compares)
    table = common_table(step, stages, eps, values)[1]
    plan, lines = plan_of(stages, table), -(-B // W)
    numbers = DriverArguments(
        x=0, lines=lines, block=lines, steps=0, plan=plan.ctypes.data, stages=len(plan),
        trajectories=B, budget=1, first_until=-1, until=-1,
    )  # fmt: skip
    used = (B - 1) % W + 1  # lanes of the last line; the others are marked, by a byte for each line
    marks = (2**W - 2**used) << 8 * (lines - 1)
    return address, array("q", [*numbers, marks]), W, (table, plan)


def lanes_of(B):
    """Return the number W of lanes in a line for B orbits; W may exceed B."""
    return min(1 << (B - 1).bit_length(), 4) if B <= FEW else WIDTH


def take_few(arguments, states, span, saved=None):
    """Return the states (B, D) after a short run; None if another function has to take it.

    `arguments` are a `Scheme`, values and eps; `span` is (start, stop, every, row).
    """
    ((step, stages), values, eps), (start, stop, every, row), B = arguments, span, len(states)
    if not (0 < B <= FEW and 0 < stop - start <= SHORT and len(eps) == len(values) == 1):
        return None
    if not step.usual or not math.isfinite(sum(states.ravel().tolist())):
        return None  # NumPy takes the steps
    found = _prepared(step, stages, eps.tobytes(), values.tobytes(), B, every > 0)
    (address, template, W, _), count = found, len(stages.fractions)
    x = states.copy() if W == 1 else in_lines(states, W)
    numbers = template[:]
    at, _ = numbers.buffer_info()
    numbers[SLOT.x] = address_of(x)
    numbers[SLOT.ended] = numbers[SLOT.passed] = at + 8 * len(SLOT)
    numbers[SLOT.steps] = (stop - start) * count
    if compares_signs(step):
        bases = x.copy()
        numbers[SLOT.bases] = address_of(bases)
    if every:
        if start == 0:
            saved[row] = states
            row += 1
        numbers[SLOT.first_until] = numbers[SLOT.until] = (every - start % every) * count - 1
        numbers[SLOT.between] = every * count - 1
        if row < len(saved):
            numbers[SLOT.first_row] = numbers[SLOT.row] = address_of(saved[row])
            numbers[SLOT.row_bytes] = saved.strides[0]
    if address.call(at) == NOT_READY:  # a step needs `pivoting_step`
        return None
    return x if W == 1 else x.swapaxes(1, 2).reshape(-1, x.shape[1])[:B]
