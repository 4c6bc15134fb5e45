"""The four pictures of the paper (end of Section 4), as files."""

from __future__ import annotations

from pathlib import Path

from ..bodies.paper import PICTURES
from .phase import plot_phase


def paths(directory: str | Path) -> list[Path]:
    """Return the names of the files that `draw` writes."""
    return [Path(directory) / f"picture{number}.png" for number in PICTURES]


def draw(directory: str | Path) -> list[Path]:
    """Draw the pictures into a directory, made if need be, and return the names of the files."""
    from .figures import plt

    Path(directory).mkdir(parents=True, exist_ok=True)
    for path, picture in zip(paths(directory), PICTURES.values(), strict=True):
        figure = plot_phase(*picture).figure
        figure.savefig(path, dpi=150)
        plt.close(figure)
    return paths(directory)
