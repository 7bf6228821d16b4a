"""Attributes that are computed when they are first asked for, by several threads at once if need be."""

from __future__ import annotations

import functools
from typing import Any, Self, TypeVar, overload

__all__ = ["cached_property"]

Value = TypeVar("Value")


class cached_property(functools.cached_property[Value]):  # noqa: N801
    """As that of `functools`, but without a lock, and with one value for all threads.

    Python 3.11 holds a lock of the class while the attribute of any object is computed: threads that compute attributes
    of each other's kind wait for ever, and so does a process that was forked meanwhile. Later versions hold none, but
    two threads that ask at once get different objects, one of which is forgotten. Here both may compute it, and both
    get what the first one found.

    Examples
    --------
    >>> class Robot:
    ...     @cached_property
    ...     def mass(self) -> float:
    ...         print("weighing")
    ...         return 27.0
    >>> robot = Robot()
    >>> robot.mass + robot.mass
    weighing
    54.0
    """

    @overload
    def __get__(self, instance: None, owner: type[Any] | None = None) -> Self: ...

    @overload
    def __get__(self, instance: object, owner: type[Any] | None = None) -> Value: ...

    def __get__(self, instance: object | None, owner: type[Any] | None = None) -> Any:
        """Return the value, which then stands in the object itself, where Python looks first."""
        if instance is None:
            return self
        return instance.__dict__.setdefault(str(self.attrname), self.func(instance))
