"""All benchmarks, from the modules that have them: calls of the public API, peers, the machine.

Peers are named "module.function" of the folder `peers`, and imported when they run; without their
library they are skipped. Errors of peers that iterate the map are relative to its orbit, those of
integrators relative to the continuous motion at the same time.
"""

import importlib
from functools import cache, partial

from work import Case

MODULES = "of_bodies", "of_fields", "of_calls", "motions", "events", "inside"


@cache
def of(module):
    """Return the cases of one module by name, which needs no other one."""
    cases = {}

    def add(table, key, whose, label, kind, *arguments, **more):
        """Add a case of a kind of work, a function whose last argument is `size`."""
        case = Case(table, key, whose, label, partial(kind, *arguments), **more)
        assert case.name not in cases, f"two cases are {case.name}"
        cases[case.name] = case

    importlib.import_module(module).add_cases(add)
    return cases


def places():
    """Return the module of each case, by the name of the case."""
    return {name: module for module in MODULES for name in of(module)}


def every():
    """Return all cases."""
    return [case for module in MODULES for case in of(module).values()]
