"""Long work: its progress, reported to whoever watches it, and what another thread computes of it in advance."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from queue import Full, Queue
from threading import Event, Thread
from typing import TypeVar

__all__ = ["Watcher", "ahead", "tell", "watched"]

Item = TypeVar("Item")

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


def ahead(items: Iterable[Item], count: int, stop: Event | None = None) -> Generator[Item, None, None]:
    """Yield what another thread computes, at most `count` items before they are asked for; with 0 what this one does.

    So a log is decoded while rows that were decoded before are filtered, and both while others are reduced: NumPy,
    Polars and compiled kernels let go of the interpreter. An error of the other thread is raised here, where the item
    is asked for. When the consumer stops, so does the other thread, at its next item; `stop` is set then, for
    items that take long.

    Examples
    --------
    >>> list(ahead((n * n for n in range(4)), 2))
    [0, 1, 4, 9]
    """
    if not count:
        yield from items
        return
    queue: Queue[tuple[bool, Item | BaseException | None]] = Queue(count)
    stopped = Event()

    def handed_over(goes_on: bool, found: Item | BaseException | None) -> bool:
        while not stopped.is_set():
            try:
                queue.put((goes_on, found), timeout=0.1)
            except Full:
                continue
            return True
        return False

    def work() -> None:
        iterator = iter(items)
        try:
            for item in iterator:
                if not handed_over(True, item):
                    break
            else:
                handed_over(False, None)
        except BaseException as error:  # it is the consumer's
            handed_over(False, error)
        finally:
            if hasattr(iterator, "close"):
                iterator.close()

    thread = Thread(target=copy_context().run, args=(work,), name="steelyard reading ahead", daemon=True)
    thread.start()
    try:
        while True:
            goes_on, found = queue.get()
            if goes_on:
                yield found  # type: ignore[misc]
            elif isinstance(found, BaseException):
                raise found
            else:
                return
    finally:
        stopped.set()
        if stop is not None:
            stop.set()
        thread.join()
