"""The numbers that the page draws for a field: orbits in a plane of two of its components."""

from typing import Any, NamedTuple
from urllib.parse import parse_qsl, urlencode

import numpy as np

from ... import __version__
from ...checks import FloatArray, one_of, real_number, short, states, wrong
from ...engine.status import Status
from ...maps import map_of, methods_of
from ...quantities.conserved import energy
from ...runs.iterate import iterate
from .scene import MOST_STEPS, as_answer, number_in

_MOST_STARTS = 20


class View(NamedTuple):
    """The parts of the page; names and texts as in its address."""

    x: str  # names of the components of the plane
    y: str
    starts: FloatArray  # (B, D)
    eps: float
    steps: int
    method: str
    member: tuple[int, ...]  # of a family
    numbers: tuple[float, ...]  # named parameters of a single field
    box: str = ""  # ends of the axes, which only the page reads; without them all states fit

    @property
    def query(self) -> str:
        """The view in an address."""
        starts = ";".join(",".join(map(repr, row)) for row in self.starts.tolist())
        lists = {name: ",".join(map(str, getattr(self, name))) for name in ("member", "numbers")}
        return urlencode(self._asdict() | {"starts": starts} | lists, safe=",;")


class FieldScene:
    """A field or a family, or a body that no other page shows, and the first view of it."""

    def __init__(self, field: Any, start: Any, eps: float, steps: int, method: str) -> None:
        self.field = field
        self.names = field.labels
        self.methods = [*methods_of(type(field))]
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
        parameters = (0,) * len(field.shape), (*self.numbers.values(),)
        first = View(self.names[0], self.names[min(1, D - 1)], starts, 0.0, 1, method, *parameters)
        self.first = self._checked(first._asdict() | {"eps": eps, "steps": steps})

    @property
    def query(self) -> str:
        """The first view in an address."""
        return self.first.query

    def view(self, query: str) -> View:
        """Return the view in a query, checked; what is missing is that of the first one."""
        pairs = parse_qsl(query, keep_blank_values=True)
        values: dict[str, Any] = dict(pairs)
        if len(values) < len(pairs) or not values.keys() <= {*View._fields}:
            names = ", ".join(name for name, _ in pairs)
            raise wrong("parameters", f"each of {', '.join(View._fields)} once", names)
        for name in values.keys() & {"eps", "steps"}:
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
        return self._checked(self.first._asdict() | values)

    def _checked(self, values: dict[str, Any]) -> View:
        view = View(**values)
        for name in ("x", "y"):
            one_of(name, values[name], self.names)
        one_of("method", view.method, self.methods)
        eps, steps = float(real_number("eps", view.eps)), view.steps
        if steps not in range(1, MOST_STEPS + 1):
            raise wrong("steps", f"an integer from 1 to {MOST_STEPS}", short(steps))
        if len(view.starts) > _MOST_STARTS:
            raise wrong("starts", f"at most {_MOST_STARTS} states", len(view.starts))
        shape = self.field.shape
        if len(view.member) != len(shape) or not all(
            0 <= k < size for k, size in zip(view.member, shape, strict=True)
        ):
            raise wrong("member", f"the index of one of shape {shape}", short(view.member))
        return view._replace(eps=eps, steps=int(steps))

    def answer(self, query: str) -> Any:
        """Return the numbers for a query; for a wrong one, a message and its fields."""
        names = *View._fields, *self.names, *self.numbers
        return as_answer(lambda: self._scene(self.view(query)), names) | {"field": self._about()}

    def _about(self) -> dict[str, Any]:
        """Return what the controls of the page show."""
        return {
            "names": self.names,
            "methods": self.methods,
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
        arguments: dict[str, Any] = {"eps": view.eps, "steps": view.steps, "method": view.method}
        run = iterate(field, view.starts, **arguments, on_singular="ignore", threads=1)
        plane = [self.names.index(view.x), self.names.index(view.y)]
        orbits = [
            {
                "states": run.states[:, k, plane],
                "final": run.final[k],
                "valid": int(np.count_nonzero(run.valid[:, k])),
                "first_pole": int(run.first_pole[k]),
                "failed_at": int(run.failed_at[k]) if run.status[k] < 0 else None,
                "status": Status(int(run.status[k])).name,
                "message": Status(int(run.status[k])).message,
            }
            for k in range(len(view.starts))
        ]
        if "energy" in map_of(field).functions(field):
            for orbit, H in zip(orbits, energy(field, run.states).T, strict=True):
                valid = H[: orbit["valid"]]
                orbit["energy"], orbit["change"] = valid[0], np.ptp(valid)
        kept = {name: np.asarray(a) for name, a in field.parameters.items()}
        return {
            "version": __version__,
            "parameters": view._asdict(),
            "values": {name: float(a) for name, a in kept.items() if a.shape == ()},
            "equations": repr(field),
            "orbits": orbits,
            "python": (
                "from suslov_fast import body_from_dict, iterate\n\n"
                f"field = body_from_dict({field.to_dict()!r})\n"
                f"run = iterate(field, {view.starts.tolist()}, "
                f"eps={view.eps}, steps={view.steps}, method={view.method!r})\n"
            ),
        }
