"""Write the table of the page "A zoo of Kahan maps": `python docs/zoo_table.py`."""

import re
from pathlib import Path

DOCS = Path(__file__).parent
PAGE = DOCS / "theory" / "zoo.md"
TABLE = re.compile(r"(?<=\| ---: \|\n)(\|.*\|\n)+")


def rows():
    """Names of the fields, and the function that computes a row of the table."""
    script = (DOCS / "examples" / "zoo.py").read_text(encoding="utf-8")
    names = {"__name__": "zoo"}
    exec(compile(script.partition("# %%\n")[0], "zoo.py", "exec"), names)
    return names["ZOO"], names["row"]


if __name__ == "__main__":
    fields, row = rows()
    table = "".join(f"{row(name)}\n" for name in fields)
    PAGE.write_text(TABLE.sub(lambda _: table, PAGE.read_text("utf-8")), encoding="utf-8")
