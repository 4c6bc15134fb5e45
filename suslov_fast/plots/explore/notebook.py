"""The page as a widget of a notebook (extra `notebook`), which asks the kernel, not a server."""

import json
from typing import Any
from urllib.parse import quote

import anywidget
import traitlets

from .fields import FieldScene
from .scene import PAGE, answer

_POLICY = """<head>
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:;
script-src 'unsafe-inline' data:; style-src 'unsafe-inline'">"""


def page_in_one_file(name: str, main: str) -> str:
    """Return a page as one document that holds its style and modules, and may load nothing."""
    html, style = ((PAGE / each).read_text("utf-8") for each in (name, "style.css"))
    modules = {}
    for file in PAGE.iterdir():
        if not file.name.endswith(".js"):
            continue
        # A module in a data URL has no folder, so an import map gives it a name.
        text = file.read_text("utf-8").replace('from "./', 'from "')
        modules[file.name] = f"data:text/javascript,{quote(text)}"
    names = f'<script type="importmap">{json.dumps({"imports": modules})}</script>\n'
    for tag, text in {
        '<link rel="stylesheet" href="/style.css">': f"<style>\n{style}</style>",
        f'<script type="module" src="/{main}"></script>': (
            f'{names}<script type="module">import "{main}";</script>'
        ),
        "<head>": _POLICY,
    }.items():
        html = html.replace(tag, text)
    return html


class Widget(anywidget.AnyWidget):  # type: ignore[misc]
    """The page; `query` holds its parameters, as in the address of `suslov-fast explore`."""

    _esm = (PAGE / "widget.js").read_text("utf-8")
    _html = traitlets.Unicode().tag(sync=True)
    # Seconds after which the page says that no kernel answers.
    _patience = traitlets.Int(10).tag(sync=True)
    query = traitlets.Unicode().tag(sync=True)

    def __init__(self, query: str, field: FieldScene | None) -> None:
        page = ("field.html", "field.js") if field else ("index.html", "main.js")
        super().__init__(query=query, _html=page_in_one_file(*page))
        self._answer_to = field.answer if field else answer
        self.on_msg(self._answer)

    def __repr__(self) -> str:
        """Return the text that a notebook shows if it cannot show the widget."""
        return "The page of explore: run this cell in a notebook that shows widgets"

    def _answer(self, widget: Any, message: dict[str, Any], buffers: Any) -> None:
        """Confirm a message of the page, then send the numbers that it asks for."""
        self.send({"id": message["id"], "heard": True})
        self.send({"id": message["id"], "value": self._answer_to(message["query"])})
