"""The numbers that the page draws for a field: orbits of its map, or motions, in a plane."""

from typing import Any, NamedTuple
from urllib.parse import urlencode

import numpy as np

from ... import __version__
from ...checks import FloatArray, one_number, one_of, short, states, wrong
from ...engine.starts import checked_settings
from ...engine.status import Status
from ...maps import methods_of
from ...runs.flow import flow
from ...runs.iterate import iterate
from .scene import MOST_STEPS, as_answer, checked_steps, number_in, values_in

# Most orbits, and the number of times at which a motion is drawn.
_MOST_STARTS, _TIMES = 20, 2001


class View(NamedTuple):
    """The parts of the page; names and texts as in its address. Those of the other kind are None.

    The kinds are orbits of a map, with eps, steps and method, and motions, with time and rtol.
    """

    x: str  # names of the components of the plane
    y: str
    starts: FloatArray  # (B, D)
    eps: float | None = None
    steps: int | None = None
    method: str | None = None
    time: float | None = None  # the last one
    rtol: float | None = None
    member: tuple[int, ...] = ()  # of a family
    numbers: tuple[float, ...] = ()  # named parameters of a single field
    box: str = ""  # ends of the axes, which only the page reads; without them all states fit

    @property
    def parts(self) -> dict[str, Any]:
        """The parts of this kind, by name."""
        return {name: value for name, value in self._asdict().items() if value is not None}

    @property
    def query(self) -> str:
        """The view in an address."""
        starts = ";".join(",".join(map(repr, row)) for row in self.starts.tolist())
        lists = {name: ",".join(map(str, getattr(self, name))) for name in ("member", "numbers")}
        return urlencode(self.parts | {"starts": starts} | lists, safe=",;")


class FieldScene:
    """A field or a family, or a body that no other page shows, and the first view of it.

    `asked` are eps, steps and method of its map, or time and rtol of its motion.
    """

    def __init__(self, field: Any, start: Any, **asked: Any) -> None:
        self.field = field
        self.names = field.labels
        self.methods = [*methods_of(type(field))] if "method" in asked else []
        D = field.dimension
        if start is None:
            start = [1.0] + [0.5] * (D - 1)
        starts = np.atleast_2d(states("x0", start, self.names))
        if starts.ndim > 2:
            raise wrong("x0", f"a state or a list of them, (..., {D})", f"of shape {starts.shape}")
        # A field keeps the function that made it in the process that called the function.
        single = field.remake is not None and not field.shape
        given = field.parameters if single else {}
        self.numbers = {name: float(value) for name, value in given.items()}
        values = {"x": self.names[0], "y": self.names[min(1, D - 1)], "starts": starts, **asked}
        values |= {"member": (0,) * len(field.shape), "numbers": (*self.numbers.values(),)}
        self.first = self._checked(values)

    def view(self, query: str) -> View:
        """Return the view in a query, checked; what is missing is that of the first one."""
        values = values_in(query, [*self.first.parts])
        for name in values.keys() & {"eps", "steps", "time", "rtol"}:
            values[name] = number_in(name, values[name])
        if "starts" in values:
            rows = [row.split(",") for row in values["starts"].split(";")]
            D = len(self.names)
            if {*map(len, rows)} != {D}:
                raise wrong("starts", f"{D} numbers for each start", values["starts"])
            values["starts"] = np.array(
                [[number_in(*each) for each in zip(self.names, row, strict=True)] for row in rows]
            )
        if "member" in values:
            texts = [text for text in values["member"].split(",") if text]
            values["member"] = tuple(int(number_in("member", text)) for text in texts)
        if "numbers" in values:
            texts = values["numbers"].split(",") if values["numbers"] or self.numbers else []
            if len(texts) != len(self.numbers):
                raise wrong("numbers", f"{len(self.numbers)} numbers", values["numbers"])
            values["numbers"] = tuple(map(number_in, self.numbers, texts))
        return self._checked(self.first.parts | values)

    def _checked(self, values: dict[str, Any]) -> View:
        view = View(**values)
        for name in ("x", "y"):
            one_of(name, values[name], self.names)
        if view.time is not None:
            checked_settings(self.field, view.rtol)
            view = view._replace(time=one_number("time", view.time))
        else:
            one_of("method", view.method, self.methods)
            eps = one_number("eps", view.eps)
            steps = checked_steps(one_number("steps", view.steps))
            view = view._replace(eps=eps, steps=steps)
        if len(view.starts) > _MOST_STARTS:
            raise wrong("starts", f"at most {_MOST_STARTS} states", len(view.starts))
        shape = self.field.shape
        if len(view.member) != len(shape) or not all(
            0 <= k < size for k, size in zip(view.member, shape, strict=True)
        ):
            raise wrong("member", f"the index of one of shape {shape}", short(view.member))
        return view

    def answer(self, query: str) -> Any:
        """Return the numbers for a query; for a wrong one, a message and its fields."""
        names = *self.first.parts, *self.names, *self.numbers
        return as_answer(lambda: self._scene(self.view(query)), names) | {"field": self._about()}

    def _about(self) -> dict[str, Any]:
        """Return what the controls of the page show."""
        return {
            "names": self.names,
            "methods": self.methods,  # none for a motion
            "numbers": self.numbers,
            "axes": [self._axis(k) for k in range(len(self.field.shape))],
            "most": {"steps": MOST_STEPS, "starts": _MOST_STARTS},
        }

    def _axis(self, axis: int) -> dict[str, Any]:
        """Return the named parameters that vary along an axis of a family, and their values."""
        shape = self.field.shape
        found = {}
        for name, value in self.field.parameters.items():
            array = np.asarray(value)
            k = axis - len(shape) + array.ndim
            if array.dtype.kind in "iuf" and 0 <= k < array.ndim and array.shape[k] > 1:
                index = [0] * array.ndim
                index[k] = slice(None)  # type: ignore[call-overload]
                found[name] = array[tuple(index)].astype(float).tolist()
        return {"count": shape[axis], "parameters": found}

    def _with(self, numbers: tuple[float, ...]) -> Any:
        """Return the single field with these numbers as its named parameters."""
        if numbers == (*self.numbers.values(),):
            return self.field
        try:
            return self.field.remake(**dict(zip(self.numbers, numbers, strict=True)))
        except TypeError as error:  # its function refuses a number
            raise ValueError(str(error)) from error

    def _scene(self, view: View) -> dict[str, Any]:
        """Return the orbits of the starts, with their statuses and numbers."""
        field = self.field[view.member] if self.field.shape else self._with(view.numbers)
        plane = [self.names.index(view.x), self.names.index(view.y)]
        if view.time is None:
            options: dict[str, Any] = {"eps": view.eps, "steps": view.steps, "method": view.method}
            run: Any = iterate(field, view.starts, **options, on_singular="ignore", threads=1)
            orbits = _orbits(run, run.valid, run.first_pole, run.failed_at)
            call = f"iterate(field, {view.starts.tolist()}, eps={view.eps}, steps={view.steps}"
            call += f", method={view.method!r})"
            said = {"ε": view.eps, "N": view.steps}
        else:
            times = np.linspace(0.0, view.time, _TIMES)
            run = flow(field, view.starts, time=times, rtol=view.rtol or 0.0, threads=1)
            exists = ~np.isnan(run.states[..., 0])
            orbits = _orbits(run, exists, np.full(len(view.starts), -1), exists.sum(axis=0))
            for orbit, end in zip(orbits, run.end.tolist(), strict=True):
                orbit["end"] = end
            call = f"flow(field, {view.starts.tolist()}, "
            call += f"time=np.linspace(0.0, {view.time}, {_TIMES}), rtol={view.rtol})"
            said = {"T": view.time, "rtol": view.rtol}
        for orbit in orbits:
            orbit["states"] = orbit["states"][:, plane]
        if "energy" in run._functions:
            for orbit, H in zip(orbits, run.energy().T, strict=True):
                valid = H[: orbit["valid"]]
                orbit["energy"], orbit["change"] = valid[0], np.ptp(valid)
        kept = {name: np.asarray(a) for name, a in field.parameters.items()}
        numpy = "" if view.time is None else "import numpy as np\n"
        return {
            "version": __version__,
            "parameters": view.parts,
            "said": said,
            "time": run.time,
            "values": {name: float(a) for name, a in kept.items() if a.shape == ()},
            "equations": repr(field),
            "orbits": orbits,
            "python": (
                f"{numpy}from suslov_fast import body_from_dict, {call.partition('(')[0]}\n\n"
                f"field = body_from_dict({field.to_dict()!r})\n"
                f"run = {call}\n"
            ),
        }


def _orbits(run: Any, valid: Any, first_pole: Any, failed_at: Any) -> list[dict[str, Any]]:
    """Return the orbits of a run for JSON: all states (n, D), and what became of each."""
    return [
        {
            "states": run.states[:, k],
            "final": run.states[-1, k],
            "valid": int(np.count_nonzero(valid[:, k])),
            "first_pole": int(first_pole[k]),
            "failed_at": int(failed_at[k]) if run.status[k] < 0 else None,
            "status": Status(int(run.status[k])).name,
            "message": Status(int(run.status[k])).message,
        }
        for k in range(len(run.status))
    ]
