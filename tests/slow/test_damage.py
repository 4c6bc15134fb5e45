"""Files of compiled code with flipped bits and zeroed blocks, many of them."""

import os
import shutil
from pathlib import Path

import children
import damage
import pytest

import suslov_fast

pytestmark = pytest.mark.compiled

RUN = """
import sys
sys.path.insert(0, sys.argv[1])
import suslov_fast as sf
assert sf.__file__.startswith(sys.argv[1])
body = sf.Suslov3D(4, 1, -0.5, -0.3)
# The attitude is what compiles fastest.
print("result", sf.attitude(body, [[1.0, 0.5], [0.9, 0.4]], 0.2).tolist())
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A copy of the package, with the code that it has compiled."""
    folder = tmp_path_factory.mktemp("copy")
    source = Path(suslov_fast.__file__).parent
    shutil.copytree(source, folder / "suslov_fast", ignore=shutil.ignore_patterns("__pycache__"))
    expected = run(folder)
    (path,) = folder.rglob("*.nbc")
    return folder, path, path.read_bytes(), expected


def run(folder, **environment):
    # An empty setting is none: the cache is that beside the source.
    return children.run(RUN, folder, NUMBA_CACHE_DIR="", **environment)


@pytest.mark.parametrize("seed", range(60))
def test_damage(place, seed):
    folder, path, sound, expected = place
    path.write_bytes(damage.damaged(sound, seed))
    told = run(folder, NUMBA_DEBUG_CACHE="1")
    assert expected in told
    assert "data loaded" not in told
    assert "data saved" in told
    assert os.path.getsize(path) > 1000
