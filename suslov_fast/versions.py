"""Versions of the package and of its dependencies, and the machine, for reports of problems."""

import os
import platform
import sys
from importlib.metadata import PackageNotFoundError, version

from .keywords import public

_REQUIRED = "numpy", "numba", "llvmlite"
_OPTIONAL = (
    *("scipy", "matplotlib", "xarray", "zarr", "dask", "distributed"),
    *("python-flint", "sympy"),
)


@public
def show_versions() -> None:
    """Print the versions of this package, Python and other packages, and the processor.

    Packages of extras are left out if they are not installed.

    Examples
    --------
    >>> import suslov_fast
    >>> suslov_fast.show_versions()  # doctest: +ELLIPSIS
    suslov_fast ...
    """
    from . import __version__

    print(f"suslov_fast {__version__}")
    print(f"python {sys.version.split()[0]}")
    print(f"system {platform.platform()}, {platform.machine()}, {os.cpu_count()} processors")
    for name in (*_REQUIRED, *_OPTIONAL):
        try:
            print(name, version(name))
        except PackageNotFoundError:
            continue
