"""Values of options, checked as they are read."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from decimal import Decimal, InvalidOperation


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
    """Make a reader of integers of at least `minimum`, which may be written as 1e6."""

    def read(text: str) -> int:
        try:
            value = Decimal(text)
        except InvalidOperation:
            value = Decimal("NaN")
        # Huge exponents are sorted out before they become digits.
        large = value.is_finite() and value.adjusted() > 19 and value > 0
        if not large and not (value.is_finite() and value >= minimum and value == int(value)):
            raise argparse.ArgumentTypeError(
                f"expected an integer of at least {minimum}, got {text!r}"
            )
        if large or value >= 2**62:
            raise argparse.ArgumentTypeError(f"expected an integer below 2**62, got {text!r}")
        return int(value)

    return read
