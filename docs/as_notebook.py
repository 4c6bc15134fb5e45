"""The tutorial as a Jupyter notebook, and as scripts for a type checker.

`python docs/as_notebook.py FILE.ipynb` writes the notebook, `--scripts FOLDER` a script for each
page. The script needs only Python.
"""

import argparse
import json
import re
from itertools import zip_longest
from pathlib import Path

TUTORIAL = Path(__file__).parent / "tutorial"
BLOCK = re.compile(r"^```python\n(.*?)^```\n", re.MULTILINE | re.DOTALL)
# Directives for pages only: figures and tables of contents.
DIRECTIVE = re.compile(r"^(:::+|```)\{.*?^\1\n", re.MULTILINE | re.DOTALL)
ROLE = re.compile(r"\{\w+\}`(?:([^`<]*?) *<[^`>]*>|~?([^`]*))`")
DEFINITION = re.compile(r"^(\S.*)\n: ", re.MULTILINE)
NEXT = re.compile(r"(?:^|(?<= ))Next: \[.*?\]\(.*?\)\.$", re.MULTILINE)
LINK = re.compile(r"\[([^\]]*)\]\((?!https?:)[^)]*\)")


def pages():
    """Names of the tutorial pages, in order."""
    (names,) = re.findall(r"```\{toctree\}.*?\n\n(.*?)```", _text("index"), re.DOTALL)
    return names.split()


def code(name):
    """Python blocks of a page."""
    return BLOCK.findall(_text(name))


def notebook():
    """Return the whole tutorial in the format of Jupyter."""
    install = "`pip install '.[algebra,xarray]'` in a copy of the repository"
    cells = [_cell("markdown", f"# The tutorial of suslov_fast\n\nIt needs {install}.")]
    for name in pages():
        texts, codes = BLOCK.split(_text(name))[::2], code(name)
        for text, block in zip_longest(map(_plain, texts), codes, fillvalue=""):
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


def write(path):
    """Write the notebook."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(notebook(), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def _text(name):
    return (TUTORIAL / f"{name}.md").read_text(encoding="utf-8")


def _plain(text):
    """Convert to Markdown for a notebook: no roles, no directives, no links between pages."""
    text = DIRECTIVE.sub("", text)
    text = DEFINITION.sub(r"- \1: ", ROLE.sub(_named, text))
    return LINK.sub(r"\1", NEXT.sub("", text)).strip()


def _named(match):
    """Title of a role, or the name of its target."""
    title, target = match.groups()
    return title if title else f"`{target.rpartition('.')[2]}`"


def _cell(kind, text):
    shared = {"cell_type": kind, "metadata": {}, "source": text}
    return shared if kind == "markdown" else shared | {"execution_count": None, "outputs": []}


def main():
    """Write the requested files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("notebook", nargs="?", type=Path)
    parser.add_argument("--scripts", type=Path, metavar="FOLDER")
    options = parser.parse_args()
    if options.notebook:
        write(options.notebook)
    if options.scripts:
        options.scripts.mkdir(parents=True, exist_ok=True)
        for name in pages():
            script = options.scripts / f"{name}.py"
            script.write_text("\n".join(code(name)), encoding="utf-8")


if __name__ == "__main__":
    main()
