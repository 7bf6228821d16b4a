"""Runs the starts of a search side by side: in processes where the system can branch them off, otherwise in threads.

A process that is branched off has all that the search needs already, compiled code included, so that nothing but the
number of a start goes to it and a candidate comes back.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from functools import wraps
from itertools import count
from typing import Any, ParamSpec, TypeVar

from steelyard.dynamics.threads import one_thread

__all__ = ["Flag", "Pool", "pool_of", "single_threaded"]

Task = Callable[..., Any]
Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
_TASKS: dict[int, Task] = {}
_NUMBERS = count()


def single_threaded(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Let a function run with linear algebra in one thread, that of SciPy too, which has its own library."""

    @wraps(function)
    def call(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        import scipy.optimize  # noqa: F401 - brings the library, which can be held to one thread only once it is there

        with one_thread():
            return function(*args, **kwargs)

    return call


class Flag:
    """A yes or no that processes share."""

    def __init__(self) -> None:
        self._value = multiprocessing.RawValue("b", 0)

    def set(self) -> None:
        """Make it a yes, for good."""
        self._value.value = 1

    def is_set(self) -> bool:
        """Return it."""
        return bool(self._value.value)


def _run(number: int, arguments: tuple[Any, ...]) -> Any:
    return _TASKS[number](*arguments)


def _can_branch() -> bool:
    """Tell whether processes may be branched off: not where JAX has threads, whose locks would stay held."""
    return sys.platform == "linux" and "jax" not in sys.modules and not multiprocessing.current_process().daemon


def _begin(parent_lives: int, parent_holds: int) -> None:
    """Make a branched process that leaves interrupts to its parent, and that ends when its parent does.

    A pipe tells of the end of the parent, whatever ended it: the parent alone holds the end that is written to, so
    that reading ends when the parent is gone. A signal at the death of the parent (PR_SET_PDEATHSIG) would come at
    the end of the thread that branched the process off, too, and only on Linux.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.close(parent_holds)
    threading.Thread(target=_end_with_parent, args=(parent_lives,), daemon=True).start()


def _end_with_parent(parent_lives: int) -> None:
    os.read(parent_lives, 1)
    os._exit(1)


class Pool:
    """Workers for one function."""

    def __init__(self, executor: Executor, number: int) -> None:
        self._executor = executor
        self._number = number

    def submit(self, *arguments: Any) -> Future[Any]:
        """Let a worker call the function."""
        with warnings.catch_warnings():
            # Later versions of Python warn of branching off a process that has threads; ours hold no locks then.
            warnings.filterwarnings("ignore", message=".*fork.*", category=DeprecationWarning)
            return self._executor.submit(_run, self._number, arguments)


@contextmanager
def pool_of(task: Task, workers: int) -> Iterator[Pool]:
    """Return workers that call a function; leaving the context waits for those that are at work.

    Parameters
    ----------
    task : callable
    workers : int
    """
    number = next(_NUMBERS)
    _TASKS[number] = task
    executor: Executor
    pipe: tuple[int, ...] = ()
    if workers > 1 and _can_branch():
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
