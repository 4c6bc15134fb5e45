"""No loop reads or writes a byte beyond its arguments, at either end."""

import signal
import sys
from pathlib import Path

import children
import pytest

pytestmark = [
    pytest.mark.compiled,
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="protects pages of Linux"),
]
GUARD = Path(__file__).with_name("guard.py")


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("end", ["begin", "end"])
def test_all_loops(end, count):
    children.run_file(GUARD, end, count, timeout=1800, NUMBA_NUM_THREADS="2")


@pytest.mark.parametrize(("at_end", "offset"), [(False, -8), (True, 64)])
def test_the_guards_bite(at_end, offset):
    process = children.start(
        """
        import ctypes, sys
        sys.path.insert(0, sys.argv[1])
        import guard
        array = guard.empty((8,), at_end=sys.argv[2] == "True")
        assert array.sum() == 0
        print("alive", flush=True)
        ctypes.c_double.from_address(array.ctypes.data + int(sys.argv[3])).value
        """,
        GUARD.parent,
        at_end,
        offset,
    )
    output, _ = children.finish(process)
    assert output == "alive\n"
    assert process.returncode == -signal.SIGSEGV
