"""Memory of large results, which is used again instead of being returned to the system and fetched anew."""

from __future__ import annotations

import ctypes
import math
import mmap
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache

import numpy as np
from numpy.typing import NDArray

__all__ = ["large_array", "return_free_memory"]

Array = NDArray[np.float64]

_HUGE_PAGE = 1 << 21
# Idle blocks that are kept: results come and go one at a time, and in loops such as ``x = f(...)`` two take turns.
_MOST_BLOCKS = 2
# Bytes from which on the system may take an idle block: to tell it takes 2 µs and more, which is much for small ones.
_OFFERED = 16 << 20


class _Block:
    """A piece of memory in huge pages: bytes that can be used, and the address of the first, where a page begins."""

    def __init__(self, size: int) -> None:
        self.size = -(-size // _HUGE_PAGE) * _HUGE_PAGE
        self._memory = mmap.mmap(-1, self.size + _HUGE_PAGE, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
        first = np.frombuffer(self._memory, dtype=np.uint8).ctypes.data
        self._start = -first % _HUGE_PAGE
        self.address = first + self._start
        self._advise("MADV_HUGEPAGE")

    def fits(self, size: int) -> bool:
        """Tell whether it is large enough for so many bytes, and not twice as large as needed."""
        return size <= self.size <= max(2 * size, _HUGE_PAGE)

    def idle(self) -> None:
        """Let the system have the memory when it needs it for something else."""
        if self.size >= _OFFERED:
            self._advise("MADV_FREE")

    def _advise(self, name: str) -> None:
        with suppress(AttributeError, OSError):  # an older system, which then does without
            self._memory.madvise(getattr(mmap, name), self._start, self.size)


# Blocks that no array uses any more, the latest last. An array may be collected at any moment, in any thread, also
# while its own thread is at work here: so blocks come and go by single operations of the list alone, without a lock.
_IDLE: list[_Block] = []


def _take(size: int) -> _Block:
    """Return an idle block that fits, or a new one."""
    others = []
    found = None
    while found is None and _IDLE:
        with suppress(IndexError):  # another thread was quicker
            block = _IDLE.pop()
            if block.fits(size):
                found = block
            else:
                others.append(block)
    _IDLE.extend(others)
    return _Block(size) if found is None else found


def _give_back(block: _Block) -> None:
    """Keep a block, and let go of older ones where there are too many."""
    most = _most_idle()
    if block.size > most:
        return
    block.idle()
    _IDLE.append(block)
    while len(_IDLE) > _MOST_BLOCKS or sum(one.size for one in list(_IDLE)) > most:
        with suppress(IndexError):
            _IDLE.pop(0)


class _Lease:
    """The object that an array and its views keep alive while they use a block."""

    __slots__ = ("__array_interface__", "_block", "_end")

    def __init__(self, block: _Block, shape: tuple[int, ...]) -> None:
        self._block = block
        self._end = _give_back
        self.__array_interface__ = {"version": 3, "shape": shape, "typestr": _KIND, "data": (block.address, False)}

    def __del__(self) -> None:
        self._end(self._block)


_KIND = np.dtype(np.float64).str


def large_array(shape: tuple[int, ...]) -> Array:
    """Return an array of doubles with any content, in memory that was used before where there is some.

    The system hands out memory a page at a time, each of which it clears first and brings in at the first write: 2 to
    8 GB/s, where a kernel writes 17. Memory that an earlier result used is there. It is kept in idle blocks, two at the
    most and 1 GiB or an eighth of the machine's memory together; the system may take the larger ones while they are
    idle.

    Examples
    --------
    >>> large_array((1000, 700)).shape
    (1000, 700)
    """
    size = 8 * math.prod(shape)
    if not 0 < size <= _most_idle():
        return np.empty(shape)
    try:
        block = _take(size)
    except OSError:  # little more than what is asked for is left; NumPy says so where that is not there either
        return np.empty(shape)
    array: Array = np.asarray(_Lease(block, shape))
    return array


@cache
def _most_idle() -> int:
    """Return how many bytes may be idle; none where this was not measured."""
    if sys.platform != "linux" or not hasattr(mmap, "MADV_FREE"):
        return 0
    return min(1 << 30, os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 8)


def return_free_memory() -> None:
    """Return memory that is free to the system, which glibc keeps in pieces for each of the threads that used it.

    While a log of 20 million rows is reduced in ten sections, each by threads of its own, what is kept grows from
    section to section: 890 MB at most, and 705 where free memory is returned in between.
    """
    trim = _trim()
    if trim is not None:
        trim(0)


@cache
def _trim() -> Callable[[int], int] | None:
    """Return glibc's function that does so; None where there is none."""
    if not sys.platform.startswith("linux"):
        return None
    try:
        trim = ctypes.CDLL(None).malloc_trim
    except (OSError, AttributeError):  # such as musl's
        return None
    trim.argtypes, trim.restype = [ctypes.c_size_t], ctypes.c_int
    return trim
