"""Draw the figures of the pages into docs/images: `python docs/draw.py [NAME ...]`.

A name is that of a script in docs/examples, or of a page whose Python blocks draw. Every figure
that is open at the end becomes NAME_1.png, NAME_2.png and so on; an animation, its middle frame.
"""

import argparse
import linecache
import os
import re
import sys
import tempfile
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
from PIL import Image

DOCS = Path(__file__).resolve().parent
IMAGES = DOCS / "images"
SCRIPTS = {path.stem: path for path in sorted((DOCS / "examples").glob("*.py"))}
_PAGES = "equations runs stability crossings diagrams families first_ode events piecewise maps"
_MORE = "report", "side_by_side"
PAGES = {name: DOCS / "howto" / f"{name}.md" for name in (*_PAGES.split(), *_MORE)}
PAGES["index"] = DOCS / "index.md"
DPI = 200  # pages show figures at half their size: sharp on dense screens
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def run(name, replaced=()):
    """Run a script, or the blocks of a page, and return the names that it defines.

    `replaced` are pairs of texts: the second takes the place of the first, which must be there.
    """
    names = {"__name__": "__main__"}
    path = SCRIPTS.get(name) or PAGES[name]
    text = path.read_text(encoding="utf-8")
    for old, new in replaced:
        assert old in text, (name, old)
        text = text.replace(old, new)
    for number, code in enumerate([text] if path.suffix == ".py" else BLOCK.findall(text)):
        block = f"{path} [{number}]"
        # The source of a function is part of the identity of a store.
        linecache.cache[block] = len(code), None, code.splitlines(keepends=True), block
        exec(compile(code, block, "exec"), names)
    return names


def draw(name, folder=IMAGES):
    """Write the figures of a script or of a page, with at most 256 colours."""
    plt.close("all")
    with plt.rc_context():  # what a page sets is for its own figures
        return _draw(name, folder)


def figures_of(names):
    """Return the open figures of a script that defined these names."""
    if "animation" in names:
        animation = names["animation"]
        frames = list(animation.new_frame_seq())
        animation._draw_next_frame(frames[len(frames) // 2], blit=False)
        return [animation._fig]
    return [plt.figure(number) for number in plt.get_fignums()]


def _draw(name, folder):
    figures = figures_of(run(name))
    for number, figure in enumerate(figures, start=1):
        path = folder / f"{name}_{number}.png"
        figure.savefig(path, dpi=DPI)
        Image.open(path).convert("RGB").quantize(256, dither=Image.Dither.NONE).save(
            path, optimize=True
        )
    plt.close("all")
    return len(figures)


def main():
    """Draw the figures that are named, or all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    matplotlib.use("Agg")
    IMAGES.mkdir(exist_ok=True)
    for name in parser.parse_args().names or (*SCRIPTS, *PAGES):
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)  # for files that blocks write
            count = draw(name)
            os.chdir(DOCS)
        print(f"{name}: {count}", file=sys.stderr)


if __name__ == "__main__":
    main()
