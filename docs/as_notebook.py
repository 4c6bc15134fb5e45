"""The page of the Suslov problem as a Jupyter notebook, and as a script for a type checker.

`python docs/as_notebook.py FILE.ipynb` writes the notebook, `FILE.py` the code.
"""

import json
import re
import sys
from itertools import zip_longest
from pathlib import Path

PAGE = Path(__file__).parent / "suslov.md"
BLOCK = re.compile(r"^```python\n(.*?)^```\n", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"!?\[([^\]]*)\]\((?!https?:)[^)]*\)")  # to files of this folder


def code():
    """Return the Python blocks of the page."""
    return BLOCK.findall(PAGE.read_text(encoding="utf-8"))


def notebook():
    """Return the page in the format of Jupyter."""
    texts = [LINK.sub(r"\1", text).strip() for text in BLOCK.split(PAGE.read_text("utf-8"))[::2]]
    cells = []
    for text, block in zip_longest(texts, code(), fillvalue=""):
        cells += [_cell("markdown", text)] * bool(text)
        cells += [_cell("code", block.strip())] * bool(block)
    return {
        "nbformat": 4,
        "nbformat_minor": 5,
        "metadata": {
            "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
            "language_info": {"name": "python"},
        },
        "cells": [{"id": f"cell-{number}"} | cell for number, cell in enumerate(cells)],
    }


def _cell(kind, text):
    shared = {"cell_type": kind, "metadata": {}, "source": text}
    return shared if kind == "markdown" else shared | {"execution_count": None, "outputs": []}


if __name__ == "__main__":
    target = Path(sys.argv[1])
    if target.suffix == ".py":
        target.write_text("\n".join(code()), encoding="utf-8")
    else:
        text = json.dumps(notebook(), indent=1, ensure_ascii=False)
        target.write_text(text + "\n", encoding="utf-8")
