"""Progress of long work, reported to whoever watches it: a terminal, a notebook, or nobody."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

__all__ = ["Watcher", "tell", "watched"]

Watcher = Callable[[str, float, float | None, str], None]
"""Called with what is done, how much of it, of how much (None where that is not known), and in which unit."""

_WATCHER: ContextVar[Watcher | None] = ContextVar("watcher", default=None)


@contextmanager
def watched(watcher: Watcher | None) -> Iterator[None]:
    """Let a function be told how far the work within the block has come, or nobody.

    Examples
    --------
    >>> with watched(lambda what, done, total, unit: print(f"{what}: {done} of {total} {unit}")):
    ...     tell("reading", 10, 20, "rows")
    reading: 10 of 20 rows
    >>> tell("reading", 20, 20, "rows")  # nobody watches
    """
    token = _WATCHER.set(watcher)
    try:
        yield
    finally:
        _WATCHER.reset(token)


def tell(what: str, done: float, total: float | None, unit: str) -> None:
    """Say how far something has come, where somebody watches; often enough, and not for every row.

    Parameters
    ----------
    what : str
        What is done, in a few words; other words begin something else.
    done, total : float
        How much of how much; None where the whole is not known.
    unit : str
        What is counted, such as ``"rows"``.
    """
    watcher = _WATCHER.get()
    if watcher is not None:
        watcher(what, done, total, unit)
