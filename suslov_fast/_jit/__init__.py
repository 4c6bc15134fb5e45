"""Numba: its options, the instructions that it lacks, and its cache."""

from .cache import compile_timer
from .instructions import (
    borrowed,
    expect_store,
    lane,
    put,
    rows_of,
    select,
    stack,
    stream_line,
    subtract_product,
    two_product,
)
from .kernels import Kernel, checked, kernel, namespace, share
from .llvm import LINE
from .options import for_users, formula, inlined, inner

__all__ = [
    "LINE",
    "Kernel",
    "borrowed",
    "checked",
    "compile_timer",
    "expect_store",
    "for_users",
    "formula",
    "inlined",
    "inner",
    "kernel",
    "lane",
    "namespace",
    "put",
    "rows_of",
    "select",
    "share",
    "stack",
    "stream_line",
    "subtract_product",
    "two_product",
]
