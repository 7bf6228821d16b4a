"""Keeps linear algebra on small blocks in one thread, and shares large work among as many threads as it may use."""

from __future__ import annotations

import os
import sys
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar, copy_context
from functools import cache, lru_cache, wraps
from threading import Event, Lock
from typing import Any, ParamSpec, TypeVar

from steelyard.files.advance import watched

__all__ = ["TOGETHER", "in_one_thread", "in_threads", "in_turns", "one_thread", "require_wanted", "serial"]

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
Item = TypeVar("Item")

_ALLOWED: ContextVar[int | None] = ContextVar("allowed", default=None)
"""How many threads BLAS had before it was limited to one."""


@contextmanager
def one_thread() -> Iterator[int]:
    """Return a context in which BLAS works in one thread; it tells how many there may be outside of all such contexts.

    The factorisation of a narrow block has hundreds of points at which threads wait for each other. On a machine that
    is busy with anything else each of them can cost a time slice: together two hundred times the work itself.
    """
    outside = _ALLOWED.get()
    if outside is not None:  # to set the limit again takes as long as the work on a small block
        yield outside
        return
    with _LIMIT as allowed:
        token = _ALLOWED.set(allowed)
        try:
            yield allowed
        finally:
            _ALLOWED.reset(token)


@contextmanager
def serial() -> Iterator[None]:
    """Return a context in which :func:`in_threads` works in the thread that calls it, as others use the processors.

    Threads that each hand their work to others wait for those and, above all, for the interpreter.
    """
    with one_thread():
        token = _ALLOWED.set(1)
        try:
            yield
        finally:
            _ALLOWED.reset(token)


def in_one_thread(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Return the function with all its linear algebra in one thread, see :func:`one_thread`."""

    @wraps(function)
    def call(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        with one_thread():
            return function(*args, **kwargs)

    return call


def in_threads(function: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
    """Return the results of a function for all items, from several threads with linear algebra in one each.

    There are as many threads as BLAS may use where none of it is limited by :func:`one_thread`, so that what the user
    allows it (`OPENBLAS_NUM_THREADS`, `threadpoolctl`) holds for these, too. The calling thread is one of them; calls
    from the others are serial.
    """
    with one_thread() as allowed:
        threads = min(allowed, len(items))
        if threads < 2:
            return [function(item) for item in items]
        # Each takes the next item that nobody has taken: to hand over one at a time would cost 50 µs of each, more than
        # most of the QR factorisations of a short log take.
        waiting, found = deque(enumerate(items)), dict[int, Result]()

        def some() -> None:
            while True:
                try:
                    place, item = waiting.popleft()
                except IndexError:
                    return
                try:
                    found[place] = function(item)
                except BaseException:
                    waiting.clear()  # nobody begins another one
                    raise

        others = [_pool(os.getpid(), threads).submit(serial()(some)) for _ in range(threads - 1)]
        try:
            some()
        finally:
            # One that has not begun would find nothing to do; on a busy machine it would be waited for all the same.
            others = [other for other in others if not other.cancel()]
            wait(others)  # after an error, too, nobody still works on what the caller holds
        for other in others:
            other.result()
        return [found[place] for place in range(len(items))]


TOGETHER = 2
"""Of what :func:`in_turns` works on at a time, at most: sections of long logs take some 150 MB each."""
_UNWANTED: ContextVar[Event | None] = ContextVar("unwanted", default=None)


def in_turns(function: Callable[[int], Result], count: int, most: int = TOGETHER) -> Generator[Result, None, None]:
    """Yield the results of a function for 0, 1, ... `count` - 1 in this order, from several threads where there may be.

    Threads that share one work wait for each other, above all at its ends; of two works each has a thread of its own,
    and is serial in it. The last of an odd number is alone, and may use all threads. There are as many as in
    :func:`in_threads`, but `most` at most, and no more numbers are begun beyond the one that is asked for. How far one
    of those at work has come is told, see `steelyard.files.tell`. What takes long asks :func:`require_wanted` often.
    """
    with one_thread() as allowed:
        threads = min(allowed, most, count)
    if threads < 2:
        yield from map(function, range(count))
        return
    unwanted, interrupted = Event(), Event()

    def found(number: int) -> Result:
        _UNWANTED.set(unwanted)  # in a context of its own
        require_wanted()
        try:
            with ExitStack() as contexts:
                if number % threads:
                    contexts.enter_context(watched(None))
                if number ^ 1 < count:
                    contexts.enter_context(serial())
                return function(number)
        except KeyboardInterrupt:  # which Polars raises in the thread that it works for
            interrupted.set()
            unwanted.set()
            raise

    waiting: deque[Future[Result]] = deque()
    with ThreadPoolExecutor(threads, "steelyard-in-turns") as pool:
        try:
            for number in range(count + threads):
                if number < count:
                    waiting.append(pool.submit(copy_context().run, found, number))
                if number >= threads:
                    try:
                        yield waiting.popleft().result()
                    except RuntimeError:
                        if interrupted.is_set():  # another one was
                            raise KeyboardInterrupt from None
                        raise
        finally:
            unwanted.set()


def require_wanted() -> None:
    """End the work on a number of :func:`in_turns` for which nobody waits any more.

    Raises
    ------
    RuntimeError
        If the consumer has stopped, or another number was interrupted.
    """
    unwanted = _UNWANTED.get()
    if unwanted is not None and unwanted.is_set():
        raise RuntimeError("nobody waits for this any more")


class _Limit:
    """The limit of BLAS, which all threads share: the first one sets it, and the last one lifts it.

    A forked process has none of the other threads: it keeps the limit only where it was forked within it.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._count, self._allowed = 0, 1
        self._controller: Any = None
        self._limits = ExitStack()

    def __enter__(self) -> int:
        with self._lock:
            controller = _controller(len(sys.modules))
            if not self._count:
                self._allowed = _allowed(controller)
            if controller is not self._controller:  # there are more libraries by now
                # Its limit is no context here: as such it would belong to the thread that entered it.
                self._limits.callback(controller.limit(limits=1, user_api="blas").restore_original_limits)
                self._controller = controller
                _let_go(controller)
            self._count += 1
            return self._allowed

    def __exit__(self, *error: object) -> None:
        with self._lock:
            self._count -= 1
            if not self._count:
                self._lift()

    def _lift(self) -> None:
        self._limits.close()
        _let_go(self._controller)
        self._controller = None

    def forked(self) -> None:
        """Go on in a forked process."""
        self._lock = Lock()
        if _ALLOWED.get() is not None:
            self._count = 1
        elif self._count:
            self._count = 0
            self._lift()


_LIMIT = _Limit()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_LIMIT.forked)


def _let_go(controller: Any) -> None:
    """Let other threads lift the limit, which from version 3.8 of threadpoolctl on one thread alone may."""
    for library in controller.lib_controllers:
        if hasattr(library, "clear_controlling_thread"):
            library.clear_controlling_thread()


def _allowed(controller: Any) -> int:
    """Return how many threads BLAS may use where there is no limit of ours."""
    counts = [library["num_threads"] for library in controller.info() if library["user_api"] == "blas"]
    return max(counts, default=1)


@cache
def _pool(process: int, threads: int) -> ThreadPoolExecutor:
    """Return threads that are kept for later calls; a forked process gets its own."""
    return ThreadPoolExecutor(threads, f"steelyard-algebra-{process}")


@lru_cache(maxsize=1)
def _controller(modules: int) -> Any:
    """Look for the libraries anew where more modules were imported: SciPy brings a BLAS of its own."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
