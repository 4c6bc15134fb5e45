"""Write the tables of the page "A zoo of Kahan maps": `python docs/zoo_table.py`."""

import re
from pathlib import Path

DOCS = Path(__file__).parent
PAGE = DOCS / "theory" / "zoo.md"
TABLE = re.compile(r"(?<=\| ---: \|\n)(\|.*\|\n)+")  # the integrable maps, and the others


def script():
    """The names that the script of the gallery defines before it prints."""
    text = (DOCS / "examples" / "zoo.py").read_text(encoding="utf-8")
    names = {"__name__": "zoo"}
    exec(compile(text.partition("# %%\n")[0], "zoo.py", "exec"), names)
    return names


if __name__ == "__main__":
    names = script()
    rows = [names["row"](name) + "\n" for name in names["ZOO"]]
    count = names["INTEGRABLE"]
    tables = iter(("".join(rows[:count]), "".join(rows[count:])))
    PAGE.write_text(TABLE.sub(lambda _: next(tables), PAGE.read_text("utf-8")), encoding="utf-8")
