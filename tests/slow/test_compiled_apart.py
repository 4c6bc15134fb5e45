"""Kernels of the package, each compiled in a process of its own, loaded into one process."""

import shutil
from pathlib import Path

import children
import pytest

import suslov_fast

pytestmark = pytest.mark.compiled

QUANTITIES = """
import sys
folder, *names = sys.argv[1:]
sys.path.insert(0, folder)
import suslov_fast as sf
assert sf.__file__.startswith(folder)
body = sf.Suslov3D(1, 1, 1, 0)
for name in names:
    arguments = () if name in ("energy", "vector_field") else (1.0,)
    print(name, getattr(sf, name)(body, [0.3, 0.1], *arguments).tolist())
"""


@pytest.mark.parametrize(
    "names",
    [
        ["first_integral", "criticality", "modified_energy", "invariant_density"],
        ["energy", "vector_field", "jacobian", "matrix"],
    ],
    ids=["of one number", "of others"],
)
def test_they_are_not_mixed_up(tmp_path, names):
    source = Path(suslov_fast.__file__).parent
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(source, tmp_path / "suslov_fast", ignore=ignored)

    def printed(*which):
        # An empty setting is none: the cache is that beside the source.
        return children.run(QUANTITIES, tmp_path, *which, NUMBA_CACHE_DIR="").splitlines()

    alone = [line for name in names for line in printed(name)]
    assert printed(*names) == alone
    assert printed(*reversed(names)) == alone[::-1]
