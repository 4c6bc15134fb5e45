"""
An afternoon with a field
=========================

The pictures of the page of this name, drawn by its own blocks: a portrait, multipliers, a section,
an orbit diagram, exponents, a periodic orbit, two basins, a forced oscillator, a stored quantity.
"""

import linecache
import os
import re
import tempfile
from pathlib import Path

page = Path("../howto/afternoon.md").resolve()
blocks = re.findall(r"^```python\n(.*?)^```$", page.read_text("utf-8"), re.MULTILINE | re.DOTALL)
names = {"__name__": "__main__"}
home = os.getcwd()
with tempfile.TemporaryDirectory() as folder:
    os.chdir(folder)  # for the store
    for number, code in enumerate(blocks):
        # The source of functions is part of the identity of a store.
        name = f"block {number}"
        linecache.cache[name] = len(code), None, code.splitlines(True), name
        exec(compile(code, name, "exec"), names)
    os.chdir(home)
