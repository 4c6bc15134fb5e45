"""Kahan (Hirota-Kimura) maps of quadratic fields and of the nonholonomic Suslov problem.

Iterate a batch of initial angular velocities of a body::

    from suslov_fast import Suslov3D, iterate

    body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    trajectories = iterate(body, [[1.0, 0.5], [0.2, -0.7]], eps=0.2, steps=1000)

The map of the Suslov problem is that of V. Dragovic and B. Gajic, arXiv:0807.2966.
"""

import ast
import sys
from importlib import import_module
from pathlib import Path

__version__ = "0.7.0"

# The imports in `__init__.pyi` list the public names.
_MODULE_OF = {
    alias.name: f".{node.module}"
    for node in ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body
    if isinstance(node, ast.ImportFrom)
    for alias in node.names
}
__all__ = sorted(_MODULE_OF)
_MODULES = ("compiled", "integrability")


def __getattr__(name: str) -> object:
    """Import the module of a public name when the name is first used."""
    if name in _MODULES:
        return import_module(f".{name}", __name__)
    if name not in _MODULE_OF:
        text = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(text, name=name, obj=sys.modules[__name__])  # Python suggests names
    value: object = getattr(import_module(_MODULE_OF[name], __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, *_MODULES, "__version__"]
