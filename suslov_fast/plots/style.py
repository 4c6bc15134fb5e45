"""The style of all pictures (extra `plots`), and the axes that they are drawn on."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import wraps
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


def style() -> AbstractContextManager[None]:
    """Context with the settings of all pictures, which does not change the user's rcParams.

    PDF and PostScript get TrueType fonts, as journals ask, and mathematics the font of the text.
    """
    try:
        from matplotlib import rc_context, rcParams, rcParamsDefault
    except ImportError as error:
        install = "pip install '.[plots]' in a copy of the repository"
        raise ImportError(f"plots need matplotlib: {install}") from error
    settings: dict[Any, Any] = {"pdf.fonttype": 42, "ps.fonttype": 42}
    fontset = "mathtext.fontset"
    if rcParams["font.family"][0] == "serif" and rcParams[fontset] == rcParamsDefault[fontset]:
        same = rcParams["font.serif"][0] == rcParamsDefault["font.serif"][0]
        settings[fontset] = "dejavuserif" if same else "stix"
    return rc_context(settings)


def styled(draw: Callable[P, T]) -> Callable[P, T]:
    """Apply the style of all pictures to a function."""

    @wraps(draw)
    def drawn(*arguments: P.args, **keywords: P.kwargs) -> T:
        with style():
            return draw(*arguments, **keywords)

    return drawn
