"""The page in a notebook (extra `notebook`): messages to the kernel in place of HTTP."""

import re
from typing import Any

import anywidget
import traitlets

from .scene import PAGE, answer

_IMPORT = re.compile(r'^import \{([^}]*)\} from "\./(\w+)\.js";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:async )?(?:function|const|class) (\w+))", re.MULTILINE)


def page_in_one_file() -> str:
    """Return the page with its style and its modules, which may load nothing at all."""
    html, style = ((PAGE / name).read_text("utf-8") for name in ("index.html", "style.css"))
    modules: dict[str, str] = {}
    _collect("main", modules)
    _collect("transport", modules)
    script = "".join(modules.values()) + "$main.begin($transport.overMessages());\n"
    policy = (
        "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:"
    )
    for tag, text in {
        '<link rel="stylesheet" href="/style.css">': f"<style>\n{style}</style>",
        ' src="/http.js">': f">\n{script}",
        "<head>": f'<head>\n<meta http-equiv="Content-Security-Policy" content="{policy}">',
    }.items():
        html = html.replace(tag, text)
    return html


def _collect(name: str, modules: dict[str, str]) -> None:
    """Add a module to a dict, after those that it imports, as a constant with its exports."""
    text = (PAGE / f"{name}.js").read_text("utf-8")
    for _, other in _IMPORT.findall(text):
        if other not in modules:
            _collect(other, modules)
    names = ", ".join(_EXPORT.findall(text))
    text = _EXPORT.sub("", _IMPORT.sub(r"const {\1} = $\2;\n", text))
    modules[name] = f"const ${name} = (() => {{\n{text}return {{ {names} }};\n}})();\n"


class Widget(anywidget.AnyWidget):  # type: ignore[misc]
    """The page; `query` holds its values, as in the address of `suslov-fast explore`."""

    _esm = (PAGE / "widget.js").read_text("utf-8")
    _html = traitlets.Unicode(page_in_one_file()).tag(sync=True)
    # Seconds until the page says that no kernel answers.
    _patience = traitlets.Int(10).tag(sync=True)
    query = traitlets.Unicode().tag(sync=True)

    def __init__(self, query: str) -> None:
        super().__init__(query=query)
        self.on_msg(self._answer)

    def __repr__(self) -> str:
        """Return what notebooks show that have no widgets, or not their state."""
        return "The page of explore: run this cell in a notebook that shows widgets"

    def _answer(self, widget: Any, message: dict[str, Any], buffers: Any) -> None:
        self.send({"id": message["id"], "heard": True})
        self.send({"id": message["id"], "value": answer(message["query"])})
