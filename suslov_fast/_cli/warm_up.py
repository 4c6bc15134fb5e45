"""`suslov-fast warm-up`: compile everything ahead."""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import suslov_fast as sf

from .._checks import FloatArray
from .._engine.arguments import Body
from .phases import Phases

# Few trajectories are served by one thread, many by all. The steps of a few, and of the many,
# are such that all ways through the code are taken.
_FEW, _MANY = 3, 2**18
_STEPS = 40
_SAVED = 8
# Trajectories whose turns or equations are worth all threads.
_HEAVY = 2**14


def add_to(commands: Any) -> None:
    """Add the command to a parser."""
    parser = commands.add_parser(
        "warm-up",
        help="compile everything ahead, so that no later run has to",
        description=(
            "Compile everything, in three and in n dimensions, for one thread and for all, into "
            "the cache that later processes read."
        ),
    )
    parser.set_defaults(command=warm_up)


def warm_up(options: argparse.Namespace) -> str:
    """Carry out the command."""
    begin = time.perf_counter()
    phases = Phases(None)
    with phases, warnings.catch_warnings():
        warnings.simplefilter("ignore", sf.SingularStepWarning)
        for name, job in _jobs():
            phases.enter(f"compiling {name}")
            job()
    return f"compiled in {time.perf_counter() - begin:.1f} s"


def _jobs() -> Iterator[tuple[str, Callable[[], object]]]:
    """Calls that between them compile everything."""
    three = sf.Suslov3D(1.0, 1.0, 1.0, 0.0)
    four = sf.SuslovND([1.0, 1.5, 2.0], [0.4, -0.7, 0.5])
    alike = sf.SuslovND([1.0, 1.0, 1.0], [0.4, -0.7, 0.5])
    for threads, count in (("one thread", _FEW), ("all threads", _MANY)):
        for body, methods in ((three, ("canonical", "ds2")), (four, ("rank2", "gauss"))):
            kind = f"{body.dimension + 1} dimensions for {threads}"
            starts = _starts(count, body)
            yield f"the map in {kind}", _iterations(body, starts, methods)
            yield f"functions of states in {kind}", _functions(body, starts)
        kind = f"the closed form for {threads}"
        yield kind, _closed_forms(three, _starts(count, three))
        yield kind, _closed_forms(alike, _starts(count, alike))
        yield kind, _iterations(alike, _starts(count, alike), ())


def _starts(count: int, body: Body) -> FloatArray:
    starts = np.random.default_rng(0).uniform(0.1, 1.0, (count, body.dimension))
    # Half of them lie on a pole of the body in three dimensions, whose orbits end there.
    starts[1::2, :2] = 1.0, -3.0
    return starts


def _iterations(body: Body, starts: FloatArray, methods: tuple[str, ...]) -> Callable[[], None]:
    quiet: dict[str, Any] = {"on_singular": "ignore"}

    def job() -> None:
        for method in ("auto", *methods):
            settings = {"method": method, **quiet}
            sf.iterate(body, starts, 1.0, _STEPS, save_every=None, **settings)
            sf.iterate(body, starts, 1.0, _SAVED, **settings)
            sf.iterate(body, starts[:_HEAVY], 1.0, _SAVED, **settings, attitude=True)

    return job


def _functions(body: Body, starts: FloatArray) -> Callable[[], None]:
    def job() -> None:
        states = sf.iterate(body, starts, 0.1, _SAVED, on_singular="ignore").omega
        sf.step(body, starts, 0.1)
        sf.energy(body, states)
        sf.modified_energy(body, states, 0.1)
        sf.vector_field(body, states)
        sf.matrix(body, states[-1, :_HEAVY], 0.1)
        sf.lyapunov_exponents(body, starts[:_HEAVY], 0.1, _SAVED)
        sf.reaction(body, states)
        sf.reaction(body, states, 0.1)
        sf.jacobian(body, states[-1, :_HEAVY], 0.1)
        sf.multipliers(body, np.linspace(0.1, 1.0, _FEW), 0.1)
        sf.attitude(body, states[:, :_HEAVY], 0.1)
        if isinstance(body, sf.Suslov3D):
            sf.first_integral(body, states, 0.1)
            sf.criticality(body, states, 0.1)
            sf.from_xy(body, sf.to_xy(body, states))
            sf.invariant_density(body, states, 0.1)
            sf.closed_form(body, states, 0.1)
            full = np.ones((len(starts), 3))
            sf.step_full(body, full, 0.1, 2.0)
            sf.iterate_full(body, full, 0.1, _SAVED, 2.0, on_singular="ignore")
            many = np.linspace(1.0, 2.0, len(starts))
            sf.scattering_angle(sf.Suslov3D(many, 1.0, 1.0, 0.5))

    return job


def _closed_forms(body: Body, starts: FloatArray) -> Callable[[], None]:
    def job() -> None:
        for n in (_STEPS, [0, 1, _STEPS]):
            sf.exact(body, starts, 0.1, n)
            sf.flow(body, starts, n)
        sf.limits(body, starts, 0.1)

    return job
