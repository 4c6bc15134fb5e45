"""Print the first line of each file of the package, as tables: `python docs/files.py`."""

import ast
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1] / "suslov_fast"


def tables():
    """Return a table in Markdown for each folder, with a row for each file."""
    parts = []
    for folder in [PACKAGE, *sorted(path for path in PACKAGE.rglob("*") if path.is_dir())]:
        rows = [
            f"| `{path.name}` | {first_line(path)} |"
            for path in sorted(folder.glob("*.py"))
            if first_line(path)
        ]
        if rows:
            name = folder.relative_to(PACKAGE.parent).as_posix()
            parts.append("\n".join([f"**{name}/**\n", "| file | subject |", "|---|---|", *rows]))
    return "\n\n".join(parts)


def first_line(path):
    """Return the first line of the docstring of a file, as Markdown."""
    text = ast.get_docstring(ast.parse(path.read_text("utf-8"))) or ""
    return text.partition("\n")[0].replace("|", "\\|").replace("*", "\\*")


if __name__ == "__main__":
    print(tables())
