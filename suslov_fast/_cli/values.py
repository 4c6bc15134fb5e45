"""Values of options, checked as they are read."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable


def number(text: str) -> float:
    """Read a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"expected a finite number, got {text!r}")
    return value


def positive(text: str) -> float:
    """Read a positive number."""
    try:
        value = number(text)
    except argparse.ArgumentTypeError:
        value = -1.0
    if value <= 0:
        raise argparse.ArgumentTypeError(f"expected a positive number, got {text!r}")
    return value


def numbers(text: str) -> list[float]:
    """Read finite numbers separated by commas."""
    return [number(part) for part in text.split(",")]


def integer(minimum: int) -> Callable[[str], int]:
    """Make a reader of integers of at least `minimum`."""

    def read(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = minimum - 1
        if value < minimum:
            raise argparse.ArgumentTypeError(
                f"expected an integer of at least {minimum}, got {text!r}"
            )
        if value >= 2**62:
            raise argparse.ArgumentTypeError(f"expected an integer below 2**62, got {text!r}")
        return value

    return read
