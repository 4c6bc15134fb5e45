"""Small tables in HTML, for notebooks."""

from collections.abc import Iterable, Sequence
from html import escape
from itertools import islice
from typing import Any


def html_table(caption: object, head: Sequence[str], rows: Iterable[Iterable[Any]]) -> str:
    """Return a table in HTML of the first 8 rows."""

    def line(tag: str, cells: Iterable[Any]) -> str:
        texts = (f"{each:.6g}" if isinstance(each, float) else str(each) for each in cells)
        return f"<tr>{''.join(f'<{tag}>{escape(text)}</{tag}>' for text in texts)}</tr>"

    lines = [line("th", head), *(line("td", row) for row in islice(rows, 8))]
    return f"<table><caption>{escape(str(caption))}</caption>{''.join(lines)}</table>"
