"""A page as a Jupyter notebook, and its code as a script for a type checker.

`python docs/as_notebook.py NAME.ipynb` writes the notebook of a page, `NAME.py` its code. NAME is
one of PAGES.
"""

import json
import re
import sys
from itertools import zip_longest
from pathlib import Path

DOCS = Path(__file__).parent
PAGES = {"suslov": DOCS / "suslov.md"}
PAGES |= {name: DOCS / "howto" / f"{name}.md" for name in ("first_ode", "side_by_side")}
BLOCK = re.compile(r"^```python\n(.*?)^```\n", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"!?\[([^\]]*)\]\((?!https?:)[^)]*\)")  # to files of this folder


def code(page):
    """Return the Python blocks of a page."""
    return BLOCK.findall(page.read_text(encoding="utf-8"))


def notebook(page):
    """Return a page in the format of Jupyter."""
    texts = [LINK.sub(r"\1", text).strip() for text in BLOCK.split(page.read_text("utf-8"))[::2]]
    cells = []
    for text, block in zip_longest(texts, code(page), fillvalue=""):
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


def write(page, target):
    """Write a page to a file, in the format that its suffix names."""
    if target.suffix == ".py":
        target.write_text("\n".join(code(page)), encoding="utf-8")
    else:
        text = json.dumps(notebook(page), indent=1, ensure_ascii=False)
        target.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    file = Path(sys.argv[1])
    if file.stem not in PAGES:
        sys.exit(f"{file.name}: the pages are {', '.join(PAGES)}")
    write(PAGES[file.stem], file)
