"""Write the table "Which function for which body" of the reference: `python docs/features.py`.

Methods and orientations are those of the record of a map; in the other cells the functions have
been called for samples of the bodies, and what they return compared before and after steps.
"""

import re
import warnings
from inspect import signature
from operator import attrgetter
from pathlib import Path

import numpy as np

import suslov_fast as sf
from suslov_fast.maps import MAPS, map_of

PAGE = Path(__file__).parent / "api.md"
TABLE = re.compile(
    r"(?<=<!-- begin of the features -->\n\n).*?(?=\n\n<!-- end of the features)", re.S
)
J, I = [1.3, 2.1, 3.7], [0.4, -0.7, 0.5]
BODIES = {
    "`Field`, with H": [
        sf.Field.from_hamiltonian(lambda x: x[0] ** 2 + x[1] ** 2 - x[0] * x[1] ** 2, 2)
    ],
    "`Field`, other": [sf.Field(lambda x: (x[0] - x[0] * x[1], x[0] * x[1] - x[1]), 2)],
    "`Suslov3D`": [sf.Suslov3D(4, 2, -0.5, -0.3)],
    "`SuslovGyrostat`": [sf.SuslovGyrostat(4, 2, -0.5, -0.3, 0.4)],
    "`SuslovND`, integrable": [sf.SuslovND([2, 2, 2], I), sf.SuslovND([2, 2, 3], [0, 0, 0.5])],
    "`SuslovND`, other": [sf.SuslovND(J, I), sf.SuslovND(J, [0.4, 0, 0])],
}
# Title of a row, and its functions, which exist for the same bodies.
ROWS = (
    (
        "",
        (
            "step",
            "jacobian",
            "multipliers",
        ),
    ),
    ("", ("vector_field",)),
    ("", ("lyapunov_exponents",)),
    ("", ("matrix",)),
    ("the motion: to a tolerance for fields, in closed form for bodies", ("flow",)),
    ("state n, limits and regime in closed form", ("exact", "limits", "criticality")),
    ("", ("energy",)),
    ("", ("modified_energy",)),
    ("", ("first_integral",)),
    ("an invariant measure", ("invariant_density",)),
    ("revolutions per step of a periodic orbit", ("rotation_number",)),
    ("", ("reaction", "momentum", "to_matrix")),
    ("", ("to_vector", "plot_phase")),
    ("coordinates and constants of the closed form", ("to_xy", "closed_form")),
    ("angle between the limits of the angular velocity in space", ("scattering_angle",)),
    ("your own Numba loops", ("compiled.system",)),
)
CONSERVED = {"energy", "modified_energy", "first_integral"}
GIVEN = {"eps": 0.1, "n": 3, "time": 3.0, "steps": 3, "extent": 1.0}
GIVEN["surface"] = lambda states: states[..., 0]


def call(name, body, state):
    """Call a function of the package; None if it does not exist for this body."""
    function = attrgetter(name)(sf)
    _, *parameters = signature(function).parameters.values()
    needed = [each.name for each in parameters if each.default is each.empty]
    keywords = {each.name: GIVEN["time"] for each in parameters if each.name == "time"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            given = (GIVEN.get(each, state) for each in needed if each != "time")
            return function(body, *given, **keywords)
        except (TypeError, ValueError):
            return None


def answer(name, body):
    """Cell of a function and a body."""
    # Multipliers are those of a fixed point; the state 0 is one of all these bodies.
    state = np.array([0.3, 0.9, -0.6])[: body.dimension] * (name != "multipliers")
    first = call(name, body, state)
    if first is None or name not in CONSERVED:
        return "no" if first is None else "yes"
    last = call(name, body, sf.iterate(body, state, GIVEN["eps"], 20).final)
    return "yes" if abs(last / first - 1) < 1e-13 else "varies"


def table():
    """The table of all bodies, and the methods of each, in Markdown."""
    lines = [["", *BODIES], ["---"] * (1 + len(BODIES))]
    for title, names in ROWS:
        cells = []
        for bodies in BODIES.values():
            found = [{answer(name, body) for name in names} for body in bodies]
            assert all(len(each) == 1 for each in found), (title, found)
            found = [each.pop() for each in found]
            cells.append(found[0] if len({*found}) == 1 else "some")
        functions = ", ".join(f"`{name}`" for name in names)
        lines.append([f"{title}: {functions}" if title else functions, *cells])
    records = [map_of(body) for body, *_ in BODIES.values()]
    lines.append(["`attitude=True`", *("yes" if each.attitude else "no" for each in records)])
    methods = {}
    for name in dict.fromkeys(record.body.__name__ for record in records):
        maps = [map for map in MAPS.values() if map.body.__name__ == name]
        own = ", ".join(f'`"{method}"`' for map in maps for method in map.methods)
        methods.setdefault(own, []).append(f"`{name}`")
    rows = [f"| {' | '.join(line)} |" for line in lines]
    rows += ["", "Methods of `iterate`:", ""]
    return "\n".join(rows + [f"- {', '.join(names)}: {own}" for own, names in methods.items()])


if __name__ == "__main__":
    page = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(TABLE.sub(lambda _: table(), page), encoding="utf-8")
