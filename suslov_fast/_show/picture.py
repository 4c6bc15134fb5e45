"""The figure class of all pictures; importing it imports Matplotlib."""

from typing import Any

from matplotlib.figure import Figure

from .figures import style


class Picture(Figure):
    """A figure that is saved in the style it was drawn in."""

    def savefig(self, *arguments: Any, **keywords: Any) -> None:
        """Save the figure, as `matplotlib.figure.Figure.savefig` does."""
        with style():
            super().savefig(*arguments, **keywords)
