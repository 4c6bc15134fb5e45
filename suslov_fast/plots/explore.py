"""Sliders for a body or a field in the browser: `explore`. Its page imports Bokeh."""

from __future__ import annotations

import html
import math
import sys
import warnings
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..bodies.systems import AnyBody, MapOrField
from ..checks import FloatArray
from ..keywords import public
from ..motions.flow import flow
from ..orbits.iterate import iterate
from ..status import Status

_MOST = 20  # the most initial values with a slider
_WIDTH = 290  # width of sliders, in pixels
_DARK, _BLUE, _RED = "#404040", "#2c6da4", "#c0392b"


class Quantity(NamedTuple):
    """A quantity with a slider: a component of a parameter, an option, or an initial value."""

    name: str
    value: float
    low: float
    high: float


def _around(name: str, value: float, least: float = 0.0) -> Quantity:
    """Return a quantity between `least` and 2 times its value, or between -1 and 1 if it is 0."""
    low, high = sorted((least * value, 2.0 * value)) if value else (-1.0, 1.0)
    return Quantity(name, value, low, high)


class Page:
    """The page of `explore` for a system: a call adds sliders and figures to a Bokeh document.

    `options` are `eps` and `steps` of the map, or `time` of the motion.
    """

    def __init__(self, system: Any, x0: FloatArray, options: dict[str, float]) -> None:
        self.system, self.x0, self.options = system, x0.tolist(), options
        self.layout = system._layout
        self.names = [*map(str, self.layout.parts)]
        self.parameters = {
            name: self._of_parameter(name, np.asarray(values, float))
            for name, values in system._arrays.items()
        }
        self.quantities = [each for parts in self.parameters.values() for each in parts]
        self.quantities += [_around(name, value, 0.05) for name, value in options.items()]
        for name, value in zip(self.names[:_MOST], self.x0, strict=False):
            reach = 2.0 * (abs(value) or max(map(abs, self.x0)) or 1.0)
            self.quantities.append(Quantity(f"{name}(0)", value, -reach, reach))

    def _of_parameter(self, name: str, values: FloatArray) -> list[Quantity]:
        """Return a `Quantity` for each component of a parameter, with its range in a family."""
        axes = self.system._axes.get(name, 0)
        components = values.reshape(-1, math.prod(values.shape[values.ndim - axes :])).T.tolist()
        least, quantities = 0.05 * (name in self.system._positive), []
        for k, column in enumerate(components, 1):
            label, low, high = f"{name}{k}" if axes else name, min(column), max(column)
            family = Quantity(label, column[0], low, high)
            quantities.append(family if low < high else _around(label, low, least))
        return quantities

    def run(self, values: list[float]) -> Any:
        """Return the trajectory for values of `quantities`."""
        left, parameters = iter(values), {}
        for name, parts in self.parameters.items():
            components = [next(left) for _ in parts]
            parameters[name] = components if self.system._axes.get(name) else components[0]
        options = {name: next(left) for name in self.options}
        system = self.system
        x0 = self.layout.leave(np.array([*left, *self.x0[_MOST:]]))
        if isinstance(system, AnyBody):
            system = type(system)(**parameters)
        elif parameters:
            system = system.with_parameters(**parameters)
        if "time" in options:
            return flow(system, x0, time=np.linspace(0.0, options["time"], 2001))
        return iterate(system, x0, options.get("eps"), round(options["steps"]))

    def shown(self, values: list[float], pair: list[str]) -> tuple[dict[str, Any], str, str]:
        """Return the times and two components of the trajectory, the system, and a message."""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                run = self.run(values)
            except Exception as error:
                return dict.fromkeys("txy", ()), "", str(error)
        parts = self.layout.of_parts(run.states)
        columns = run.time, *(parts[:, self.names.index(name)] for name in pair)
        text = " ".join(str(each.message) for each in caught) or Status(int(run.status)).message
        return dict(zip("txy", columns, strict=True)), str(run.body), text

    def __call__(self, document: Any) -> None:
        from bokeh.layouts import column, row
        from bokeh.models import Button, ColumnDataSource, Div, Legend, LegendItem, Select, Slider
        from bokeh.plotting import figure

        sliders = []
        for each in self.quantities:
            digits = math.floor(math.log10((each.high - each.low) / 100.0))
            form: dict[str, Any] = {"step": 10.0**digits, "format": "0[.]" + "0" * max(0, -digits)}
            form |= {"title": each.name, "value": each.value, "width": _WIDTH}
            sliders.append(Slider(start=each.low, end=each.high, **form))
        choices = [
            Select(title=title, value=name, options=self.names, width=_WIDTH // 2 - 5)
            for title, name in zip(("First", "Second"), (self.names * 2)[:2], strict=True)
        ]
        states, start = ColumnDataSource(name="states"), ColumnDataSource()
        equations, message = Div(sizing_mode="stretch_width"), Div(name="message", width=_WIDTH)
        reset = Button(label="Reset", name="reset", width=_WIDTH)
        form = {"height": 440, "min_width": 340, "toolbar_location": "above"}
        plane, over_time = (figure(sizing_mode="stretch_width", **form) for _ in range(2))
        if "time" in self.options:
            plane.line("x", "y", source=states, color=_DARK)
        else:
            plane.scatter("x", "y", source=states, size=4, color=_DARK)
        plane.scatter("x", "y", source=start, size=10, fill_color="white", line_color=_RED)
        legend = Legend(orientation="horizontal", location="center", border_line_color=None)
        over_time.add_layout(legend, "above")
        over_time.xaxis.axis_label = "t"
        colours = zip("xy", (_BLUE, _RED), strict=True)
        lines = [over_time.line("t", name, source=states, color=c) for name, c in colours]

        def show() -> None:
            pair = [each.value for each in choices]
            states.data, system, text = self.shown([each.value for each in sliders], pair)
            start.data = {name: column[:1] for name, column in states.data.items()}
            equations.text = f"<b>{html.escape(system[:300])}</b>"
            message.text = html.escape(text)

        def choose() -> None:
            plane.xaxis.axis_label, plane.yaxis.axis_label = (each.value for each in choices)
            legend.items = [
                LegendItem(label=each.value, renderers=[line])
                for each, line in zip(choices, lines, strict=True)
            ]
            show()

        def go_back() -> None:
            for slider, each in zip(sliders, self.quantities, strict=True):
                slider.value = each.value

        reset.on_click(go_back)
        for each in sliders:
            each.on_change("value", lambda attr, old, new: show())
        for each in choices:
            each.on_change("value", lambda attr, old, new: choose())
        choose()
        document.title = "suslov_fast"
        document.add_root(equations)
        controls = column(row(*choices), *sliders, reset, message, width=_WIDTH + 10)
        parts = [controls, plane, over_time]  # parts are one below the other in a narrow window
        wraps = {"flex-wrap": "wrap"}
        document.add_root(row(parts, sizing_mode="stretch_width", styles=wraps))


@public
def explore(
    system: MapOrField,
    x0: Any = None,
    /,
    *,
    eps: float | None = None,
    steps: int | None = None,
    time: float | None = None,
    port: int = 0,
) -> None:
    """Show a trajectory in the browser, with sliders for parameters, step size and initial state.

    The page shows two components in their plane and over time; menus choose the components. By
    default the trajectory of a map or a body is an orbit of the map, and the trajectory of a field
    is the solution of its equations. `time` asks for the motion of a body, and `eps` or `steps` for
    an orbit of Kahan's map of a field. In a notebook the page is the output of the cell. Elsewhere
    the call opens the browser and lasts until Ctrl-C.

    Parameters
    ----------
    system : Map, Field, Suslov3D, SuslovND
        The system. The slider of a parameter goes from 0 to twice its value. For a family it goes
        from the least to the largest value.
    x0 : array_like(float, shape=(D,)), optional
        The initial state, by default (1, 1/2, 1/3, ...). Its first 20 components have sliders.
    eps : float, optional
        Step size of Kahan's map, by default 0.2.
    steps : int, optional
        Number of steps of the map, by default 500.
    time : float, optional
        Last time of the motion, by default 20.
    port : int
        The port of this machine that serves the page, by default a free one.

    Raises
    ------
    ValueError, TypeError
        As :func:`iterate` or :func:`flow` for the first trajectory, before the page opens.
    ImportError
        If Bokeh is not installed, the extra ``explore``.

    Examples
    --------
    >>> import numpy as np
    >>> from suslov_fast import Field, explore
    >>> pendulum = Field(
    ...     lambda x, friction: (x[1], -np.sin(x[0]) - friction * x[1]), "angle velocity",
    ...     friction=0.1)
    >>> explore(pendulum, [2.5, 0.0], time=60.0)  # doctest: +SKIP
    """
    checks.extra("bokeh", "explore")
    checks.instance("system", system, MapOrField)
    layout, D = system._layout, system._layout.size
    of_map = (eps, steps) != (None, None)
    start = 1.0 / np.arange(1.0, D + 1.0)
    if x0 is not None:
        start = layout.of_parts(layout.states("x0", x0))
    if start.shape != (D,):
        raise checks.wrong("x0", f"have the shape ({D},)", start.shape)
    if of_map and time is not None:
        raise TypeError("time is for the motion, eps and steps for the map: leave out one of them")
    if time is None and (of_map or isinstance(system, AnyBody) or not system._has_eps):
        options = {"steps": float(checks.integer("steps", 500 if steps is None else steps, 1))}
        if system._has_eps or eps is not None:
            options = {"eps": 0.2 if eps is None else checks.one_number("eps", eps), **options}
    else:
        options = {"time": 20.0 if time is None else checks.one_number("time", time)}
    page = Page(system, start, options)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        page.run([each.value for each in page.quantities])
    serve(page, port)


def serve(page: Page, port: int) -> None:
    """Serve a page to this machine: in a notebook below its cell, elsewhere until Ctrl-C."""
    from bokeh.server.server import Server

    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    is_notebook = hasattr(shell, "kernel")  # with an event loop that runs already
    loop = checks.extra("tornado.ioloop", "explore").IOLoop.current() if is_notebook else None
    server = Server({"/": page}, loop, port=port, address="localhost")
    server.start()
    address = f"http://localhost:{server.port}/"
    if is_notebook:
        notebook = checks.extra("IPython.display", "explore")
        notebook.display(notebook.IFrame(address, width="100%", height=560))
    else:
        print(f"{address} until Ctrl-C", flush=True)
        server.show("/")
        server.run_until_shutdown()
