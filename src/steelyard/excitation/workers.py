"""Runs the starts of a search in parallel: in forked processes where the system allows it, otherwise in threads.

A forked process has all data and compiled code of the search already, so that only the arguments of a task are sent to
it, and only the result is sent back.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from itertools import count
from typing import Any

from steelyard.files import without_warnings

__all__ = ["Flag", "Pool", "Shares", "pool_of"]

Task = Callable[..., Any]
_TASKS: dict[int, Task] = {}
_NUMBERS = count()


class Flag:
    """A flag that processes share."""

    def __init__(self) -> None:
        self._value = multiprocessing.RawValue("b", 0)

    def set(self) -> None:
        """Set the flag; it cannot be cleared."""
        self._value.value = 1

    def is_set(self) -> bool:
        """Return whether the flag is set."""
        return bool(self._value.value)


class Shares:
    """Progress of each task, from 0 to 1, in memory that processes share; each task belongs to one of them."""

    def __init__(self, count: int) -> None:
        self._values = multiprocessing.RawArray("d", count)

    def put(self, task: int, share: float) -> None:
        """Write down how much of a task is done."""
        self._values[task] = share

    def get(self, task: int) -> float:
        """Return how much of a task is done."""
        return float(self._values[task])


def _run(number: int, arguments: tuple[Any, ...]) -> Any:
    return _TASKS[number](*arguments)


def _can_fork() -> bool:
    """Return whether processes may be forked: not with JAX, whose threads may hold locks for ever in the child."""
    return sys.platform == "linux" and "jax" not in sys.modules and not multiprocessing.current_process().daemon


def _begin(parent_lives: int, parent_holds: int) -> None:
    """Prepare a forked process, so that it leaves interrupts to its parent and ends when its parent ends.

    A pipe shows the end of the parent, whatever caused it: only the parent holds the writing end, so that reading ends
    when the parent is gone. The signal PR_SET_PDEATHSIG would also come at the end of the thread that forked the
    process, and exists on Linux only.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.close(parent_holds)
    threading.Thread(target=_end_with_parent, args=(parent_lives,), daemon=True).start()


def _end_with_parent(parent_lives: int) -> None:
    os.read(parent_lives, 1)
    os._exit(1)


class Pool:
    """A pool of workers that call one function."""

    def __init__(self, executor: Executor, number: int) -> None:
        self._executor = executor
        self._number = number

    def submit(self, *arguments: Any) -> Future[Any]:
        """Call the function in a worker."""
        # Later versions of Python warn of forking a process with threads; our threads hold no locks at that time.
        with without_warnings:
            return self._executor.submit(_run, self._number, arguments)


@contextmanager
def pool_of(task: Task, workers: int) -> Iterator[Pool]:
    """Return a pool of workers that call a function; leaving the context waits for running calls."""
    number = next(_NUMBERS)
    _TASKS[number] = task
    executor: Executor
    pipe: tuple[int, ...] = ()
    if workers > 1 and _can_fork():
        pipe = os.pipe()
        executor = ProcessPoolExecutor(workers, multiprocessing.get_context("fork"), _begin, pipe)
    else:
        executor = ThreadPoolExecutor(workers, "excitation")
    try:
        with executor:
            yield Pool(executor, number)
    finally:
        del _TASKS[number]
        for end in pipe:
            os.close(end)
