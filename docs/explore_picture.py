"""Take the screenshot of the page: `PYTHONPATH=tests python docs/explore_picture.py`.

The script needs Chromium or Chrome, and Pillow.
"""

import tempfile
import threading
from pathlib import Path
from urllib.parse import urlencode

from browser import Browser
from PIL import Image

from suslov_fast._show.explore.parameters import PRESETS
from suslov_fast._show.explore.server import Server

PICTURE = Path(__file__).parent / "_static" / "explore.png"


def main():
    """Open the page, stop the motion at a state, and save a screenshot with few colours."""
    parameters = PRESETS["Long steps: t = 0.5"]
    query = urlencode(parameters._asdict() | {"show": "portrait F energy flow"})
    with Server(0) as server, tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        browser = Browser(folder)
        browser.look(1280, 840)
        browser.open(f"{server.url}?{query}")
        browser.wait("typeof scene !== 'undefined' && scene !== null && !asking")
        browser.value("setMoment(5), draw()")
        browser.picture(PICTURE)
        browser.close()
        server.shutdown()
    few = Image.open(PICTURE).convert("RGB").quantize(256, dither=Image.Dither.NONE)
    few.save(PICTURE, optimize=True)


if __name__ == "__main__":
    main()
