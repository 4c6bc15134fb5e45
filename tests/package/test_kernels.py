"""The contract of kernels of steps: what each writes, from any state on and in any pieces.

    steps(part, parts, arguments, omega0, span, output)

A kernel is decorated with `core.numba.decorators.kernel`. Its span and its output are a `Span` and
an `Output` of `core.numba.span`, which explains their fields. A kernel neither validates nor
raises, and allocates nothing inside loops over steps. No error shows if it writes too much.

1. `arguments` is the tuple of arrays that `StepMethod.arguments(body, eps, batch)` returned, once
   for a run; a kernel only reads it. An array has one row if all B trajectories share it, else B
   rows: ``array[i % len(array)]`` belongs to trajectory i. A negative eps steps back.
2. A thread takes part number `part` of `parts` of the trajectories begin <= i < end, which
   `core.numba.decorators.share` returns, from state `start` to state `stop`.
3. State 0 is `omega0` (B, D), read only if start = 0. It counts as a saved state and, if it is NaN,
   as a failure at step 0: status NONFINITE. Calls with start = stop = 0 do nothing else.
4. A run can be cut into calls anywhere, in time and in the batch, and all cuts give the same bits:
   a step must not depend on n. Steps continue from `final` and from `carry`, whose contents the
   kernel chooses. Both are read if start > 0, and written at `stop`.
5. If every > 0, states n with start < n <= stop, and n = 0 if start = 0, are saved if n is a
   multiple of `every`: the first to saved[row], the next to saved[row + 1], and so on.
6. A trajectory that fails at state n gets status[i] < 0 (SINGULAR, or NONFINITE beyond float64),
   failed_at[i] = n, and NaN from there on, in `saved` and `final`, also in later calls. The bits of
   a trajectory depend neither on others, nor on the batch, its order, or `parts`. With
   `StepMethod.notes_poles`, the first step from det A < 0 sets PASSED_POLE, and both failed_at[i]
   and carry[0, i], which is 0 before, to the number of the state after it; a failure later leaves
   carry[0, i] as it is.
"""

import math

import numpy as np
import pytest
from promises import KINDS, RECORDS, hard

import suslov_fast as sf
from suslov_fast.core.numba.span import Output, Span
from suslov_fast.maps.problem import check

STEPS, GUARD = 6, -99
# Runs from these states have the bits of a run from state 0; they pass state 64, and a round number
# beyond 32 bits. On the way the kernel of `core/suslov/steps.py` restores no R.
LATE = 61, 43 * 10**8 - 3


def guarded(shape, fill, kind=np.float64):
    """Return an array, and all of the memory in which it lies between guards."""
    size = math.prod(shape)
    memory = np.full(size + 1024, GUARD, kind)
    array = memory[512 : 512 + size].reshape(shape)
    array[...] = fill
    return array, memory


def try_kernel(record, method, body, omega, eps):
    """Call a kernel for pieces of the batch and of time; compare with the run that it makes."""
    given = () if isinstance(body, sf.Map) else (eps,)
    expected = sf.iterate(body, omega, *given, steps=STEPS, method=method, on_singular="ignore")
    problem, steps = check(record, body, omega, *(given or (1.0,))), record.methods[method]
    B, D = omega.shape
    omega = np.array(expected.states[0])  # all of a start is NaN if a component is
    arguments = steps.arguments(problem.body, problem.eps, (B,))
    read = [each for each in arguments if isinstance(each, np.ndarray)]
    before = [each.copy() for each in read]
    for late in LATE:
        arrays = [
            guarded((STEPS + 1, B, D), 7.0),
            guarded((B, D), 7.0),
            guarded((steps.carried, B), 0.0),
            guarded((B,), 0, np.int8),
            guarded((B,), -1, np.int64),
        ]
        saved, final, carry, status, failed_at = (each for each, _ in arrays)
        for start, stop in ((-late, -late), (0, 2), (2, 3), (3, 3), (3, STEPS)):
            row = start + 1 if start >= 0 else 0
            for begin, end, part in ((0, 3, 0), (0, 3, 1), (3, B, 0), (3, B, 1)):
                span = Span(begin, end, start + late, stop + late, 1, row)
                output = Output(saved, final, carry, status, failed_at)
                steps.kernel(part, 2, arguments, omega, span, output)
        for array, memory in arrays:
            assert (memory[:512] == GUARD).all()
            assert (memory[512 + array.size :] == GUARD).all()
        for one, other in zip(read, before, strict=True):
            np.testing.assert_array_equal(one, other)
        failed_at[failed_at > 0] -= late
        found = saved, final, status, failed_at
        wanted = expected.states, expected.final, expected.status, expected.failed_at
        for one, other in zip(found, wanted, strict=True):
            np.testing.assert_array_equal(one, other)


@pytest.mark.sampled(5)
@pytest.mark.parametrize("kind", KINDS)
def test_kernels_keep_the_contract(rng, kind):
    for method in RECORDS[kind].methods:
        try_kernel(RECORDS[kind], method, *hard(rng, kind))
