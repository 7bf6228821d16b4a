"""Keeps linear algebra on small blocks in one thread."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import lru_cache, wraps
from typing import Any, ParamSpec, TypeVar

__all__ = ["in_one_thread", "one_thread"]

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def one_thread() -> AbstractContextManager[Any]:
    """Return a context in which BLAS works in one thread.

    The factorisation of a narrow block has hundreds of points at which threads wait for each other. On a machine that
    is busy with anything else each of them can cost a time slice: together two hundred times the work itself.
    """
    context: AbstractContextManager[Any] = _controller(len(sys.modules)).limit(limits=1, user_api="blas")
    return context


def in_one_thread(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Return the function with all its linear algebra in one thread, see :func:`one_thread`."""

    @wraps(function)
    def call(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        with one_thread():
            return function(*args, **kwargs)

    return call


@lru_cache(maxsize=1)
def _controller(modules: int) -> Any:
    """Look for the libraries anew where more modules were imported: SciPy brings a BLAS of its own."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
