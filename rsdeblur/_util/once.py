"""Attributes that are computed at their first use."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

Value = TypeVar("Value")


def once(compute: Callable[[Any], Value]) -> Callable[[Any], Value]:
    """Return a getter that computes the value of each object at its first call and keeps it: `@property @once`.

    It takes no lock. `functools.cached_property` of Python 3.11 has one for all objects of a class, so that threads
    compute one after another, and a process that is forked meanwhile waits for ever.
    """
    name = f"_{compute.__name__}_kept"

    @wraps(compute)
    def kept(self: Any) -> Value:
        values = vars(self)
        value: Value = values[name] if name in values else values.setdefault(name, compute(self))
        return value

    return kept
