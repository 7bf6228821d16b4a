"""Keeps linear algebra on small blocks in one thread."""

from __future__ import annotations

import sys
from contextlib import AbstractContextManager
from functools import lru_cache
from typing import Any

__all__ = ["one_thread"]


def one_thread() -> AbstractContextManager[Any]:
    """Return a context in which BLAS works in one thread.

    The factorisation of a narrow block has hundreds of points at which threads wait for each other. On a machine that
    is busy with anything else each of them can cost a time slice: together two hundred times the work itself.
    """
    context: AbstractContextManager[Any] = _controller(len(sys.modules)).limit(limits=1, user_api="blas")
    return context


@lru_cache(maxsize=1)
def _controller(modules: int) -> Any:
    """Look for the libraries anew where more modules were imported: SciPy brings a BLAS of its own."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
