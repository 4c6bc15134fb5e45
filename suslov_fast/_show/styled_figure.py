"""The class of all figures; importing it imports Matplotlib."""

from typing import Any

from matplotlib.figure import Figure

from .style import style


class StyledFigure(Figure):
    """A figure that is saved in the style it was drawn in."""

    def savefig(self, *arguments: Any, **keywords: Any) -> None:
        """Save the figure, as `matplotlib.figure.Figure.savefig` does."""
        with style():
            super().savefig(*arguments, **keywords)
