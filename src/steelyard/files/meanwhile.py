"""What the process has once, and threads change for a while: its filters of warnings, its standard output."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from threading import Lock

__all__ = ["Meanwhile", "without_warnings"]


class Meanwhile:
    """A change of what all threads share, for as long as one of them needs it.

    The first thread makes it, and the last one takes it back: would each do so, one that came second would bring back
    what it found, which is what the first one had made, for good.

    Parameters
    ----------
    change : callable
        Returns the context in which it is changed.

    Examples
    --------
    >>> import contextlib
    >>> @contextlib.contextmanager
    ... def change():
    ...     print("changed")
    ...     yield
    ...     print("as before")
    >>> meanwhile = Meanwhile(change)
    >>> with meanwhile, meanwhile:
    ...     print("so many need it:", 2)
    changed
    so many need it: 2
    as before

    A process that is forked meanwhile has none of the threads, and begins as before.
    """

    def __init__(self, change: Callable[[], AbstractContextManager[object]]) -> None:
        self._change = change
        self._lock = Lock()
        self._count = 0
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=self._forked)

    def _forked(self) -> None:
        count, self._count, self._lock = self._count, 0, Lock()
        if count:
            self._made.__exit__(None, None, None)

    def __enter__(self) -> None:
        with self._lock:
            if not self._count:
                self._made = self._change()
                self._made.__enter__()
            self._count += 1

    def __exit__(self, *error: object) -> None:
        with self._lock:
            if self._count:  # none in a forked process that leaves what its parent entered
                self._count -= 1
                if not self._count:
                    self._made.__exit__(None, None, None)


@contextmanager
def _unwarned() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


without_warnings = Meanwhile(_unwarned)
"""A context without warnings, of other packages that tell by them what we find out ourselves."""
