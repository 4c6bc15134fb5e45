"""The instructions that Numba lacks, their Python equivalents, and bounds checks."""

import children
import numpy as np
import pytest

# A kernel that uses all instructions; it runs compiled, interpreted and with checked indices.
KERNEL = """
import sys
import numpy as np
from suslov_fast import _jit
from suslov_fast._formulas import elementary

@_jit.inner
def fill(x, k, out):
    rows = _jit.stack(2, 16)
    for i in range(16):
        product, lost = _jit.two_product(x[i], x[i] + 1.0 / 3.0)
        rows[0, i] = _jit.select(x[i] < 0.5, product, lost)
        rows[1, i] = elementary.number_of_bits(elementary.bits_of(x[i]) + (i << 52))
    _jit.expect_store(out, 0)
    row, pair = _jit.stack(16), _jit.stack(2, 16)
    for i in range(16):
        row[i] = pair[1, i] = rows[0, i]
    for i in range(0, 16, 8):
        _jit.stream_line(out, i, row, i)
        _jit.subtract_product(pair, (1, i), rows, (0, i), x, (i,))
    for i in range(16):
        out[32 + i] = pair[1, i]
    for i in range(16):
        out[16 + i] = rows[1, i + k]

@_jit.kernel
def run(part, parts, x, k, out):
    begin, end = _jit.share(1, part, parts)
    for _ in range(begin, end):
        fill(x, k, out)

memory = np.zeros(56)
out = memory[-(memory.ctypes.data // 8) % 8:][:48]
x = np.random.default_rng(1).random(16)
run.serial(x, int(sys.argv[1]), out)
print(out.tobytes().hex())
out[:] = 0
run.parallel(2, x, int(sys.argv[1]), out)
print(out.tobytes().hex())
"""


@pytest.mark.parametrize("disable_jit", ["0", "1"])
def test_instructions(disable_jit):
    """Compiled and interpreted instructions agree with exact arithmetic, bit for bit."""
    output = children.run(KERNEL, 0, NUMBA_DISABLE_JIT=disable_jit)
    serial, parallel = (np.frombuffer(bytes.fromhex(line)) for line in output.split())
    assert serial.tobytes() == parallel.tobytes()
    x = np.random.default_rng(1).random(16)
    for i, v in enumerate(x.tolist()):
        ratios = v.as_integer_ratio(), (v + 1 / 3).as_integer_ratio()
        numerators, denominators = zip(*ratios, strict=True)
        above, below = np.prod(numerators, dtype=object), np.prod(denominators, dtype=object)
        product = v * (v + 1 / 3)
        n, d = product.as_integer_ratio()
        lost = (above * d - n * below) / (below * d)
        assert serial[i] == (product if v < 0.5 else lost)
        assert serial[16 + i] == v * 2.0**i
        assert serial[32 + i] == serial[i] - serial[i] * v


@pytest.mark.compiled
def test_a_wrong_index_is_an_error_where_bounds_are_checked():
    """With NUMBA_BOUNDSCHECK=1, all kernels check indices, including those of rows on the stack."""
    done = children.attempt(KERNEL, 1, NUMBA_BOUNDSCHECK="1", NUMBA_DISABLE_JIT="0")
    assert done.returncode == 1
    assert "IndexError" in done.stderr
