"""Versions of the package and of its dependencies, and the machine, for reports of problems."""

import os
import platform
import sys
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version

from .keywords import public

_PACKAGES = "numpy numba llvmlite scipy matplotlib xarray zarr dask distributed python-flint sympy"


@public
def show_versions() -> None:
    """Print the versions of this package, Python and other packages, and the processor.

    Packages that are not installed are left out.

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
    for name in _PACKAGES.split():
        with suppress(PackageNotFoundError):
            print(name, version(name))
