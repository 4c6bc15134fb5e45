"""Write the tables of the page "A zoo of Kahan maps": `python docs/zoo_table.py`."""

import re
from pathlib import Path

from suslov_fast.integrability import report, zoo

PAGE = Path(__file__).parent / "theory" / "zoo.md"
TABLE = re.compile(r"(?<=\| --- \|\n)(\|.*\|\n)+")
INTEGRABLE = 15  # the first fields
ZOO = zoo()


def row(name):
    """Return a row of the table in Markdown."""
    map, eps = ZOO[name]
    found = report(map, eps=eps, degree={2: 6, 3: 4, 4: 3}.get(map.dimension, 2))
    own = ", ".join(str(each.degree) for each in found.integrals)
    integrals = f"{len(found.integrals)} of degree {own}" if own else f"none to {found.degree}"
    if found.implicit:
        others = ", ".join(str(each.degree) for each in found.implicit)
        integrals += f"; {len(found.implicit)} too long to write, of degree {others}"
    cells = (
        name,
        map.dimension,
        "" if eps is None else eps,
        ", ".join(str(each) for each in found.degrees[:6]),
        growth_of(found),
        integrals,
        f"degree {found.measures[0].degree}" if found.measures else f"none to {found.degree}",
    )
    return f"| {' | '.join(str(cell) for cell in cells)} |"


def growth_of(found):
    """Return the kind of growth, the entropy if it is known and not 0, and whether it is proved."""
    kind, entropy, _ = found.growth
    rate = f", {entropy:.3f}" if entropy > 0 else ""
    return f"{kind}{rate}" + ", proved" * (found.proved_entropy is not None)


def lines():
    """Return the rows that the page has, in the order of the zoo."""
    text = PAGE.read_text(encoding="utf-8")
    return "".join(found[0] for found in TABLE.finditer(text)).splitlines()


if __name__ == "__main__":
    rows = {name: row(name) + "\n" for name in ZOO}
    fields = [name for name, (_, eps) in ZOO.items() if eps is not None]
    groups = fields[:INTEGRABLE], fields[INTEGRABLE:], [name for name in ZOO if name not in fields]
    tables = iter(["".join(rows[name] for name in group) for group in groups])
    PAGE.write_text(TABLE.sub(lambda _: next(tables), PAGE.read_text("utf-8")), encoding="utf-8")
