"""Attributes that are computed when they are first read."""

import functools
from typing import Any, TypeVar

T = TypeVar("T")


class cached_property(functools.cached_property[T]):
    """Compute an attribute when it is first read, and keep it; without the lock of Python 3.11.

    A forked child would wait for ever for a lock that another thread of its parent had. Two
    threads may both compute the attribute.
    """

    def __get__(self, instance: Any, owner: Any = None) -> T:  # type: ignore[override]
        """Return the attribute of an instance, or this property if there is no instance."""
        if instance is None:
            return self  # type: ignore[return-value]
        value = self.func(instance)
        assert self.attrname is not None
        instance.__dict__[self.attrname] = value
        return value
