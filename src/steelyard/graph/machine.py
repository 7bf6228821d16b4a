"""The processor of this computer: compiles LLVM assembly for it and loads the machine code."""

from __future__ import annotations

import ctypes
import hashlib
import itertools
import os
import sys
import threading
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any

from steelyard.once import cached_property

from .cache import ObjectCache, pack, unpack
from .instructions import SUPPORT, support_source

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .loops import Code

__all__ = ["LOCK", "LoadedCode", "Machine", "address_of", "batch_lanes", "host_machine"]

LOCK = threading.RLock()
"""Held by the thread that compiles or loads code."""
if hasattr(os, "register_at_fork"):  # a process that is forked meanwhile would wait for ever for a thread it has not
    os.register_at_fork(before=LOCK.acquire, after_in_parent=LOCK.release, after_in_child=LOCK.release)

_NUMBERS = itertools.count()

# Machine code reaches its constants and what it calls by distances of 32 bits, and LLVM's older linker aborts the
# process where the allocator put them more than 2 GiB apart. Its newer one reserves one piece of memory for all that
# an object brings and calls farther ones by way of a table. LLVM does not trust that one with Windows's object
# format, where code therefore holds whole addresses, which is a few percent slower.
_WHOLE_ADDRESSES = sys.platform == "win32"


class LoadedCode:
    """Machine code in memory, for as long as this object lives.

    Parameters
    ----------
    tracker : llvmlite ResourceTracker
    called : LoadedCode, optional
        Other code that this one calls, which therefore stays in memory with it.

    Attributes
    ----------
    addresses : dict of str to int
    size : int
        Bytes of the object code.
    """

    def __init__(self, tracker: Any, symbols: tuple[str, ...], size: int, called: LoadedCode | None = None) -> None:
        self._tracker = tracker
        self._called = called
        self.addresses = {name: int(tracker[name]) for name in symbols}
        self.size = size

    def function(self, name: str, *kinds: type) -> Callable[..., None]:
        """Return a function of arguments of some kinds of ctypes, with which the code stays in memory."""
        function = ctypes.CFUNCTYPE(None, *kinds)(self.addresses[name])

        def call(*arguments: int, _kept: LoadedCode = self) -> None:
            function(*arguments)

        return call


class Machine:
    """This computer's processor, computing a number of samples side by side; see :func:`host_machine`.

    Attributes
    ----------
    triple : str
        LLVM's name of the processor, its vendor and the operating system.
    description : str
        Everything that machine code depends on, except its source.
    """

    def __init__(self, lanes: int) -> None:
        import llvmlite.binding as llvm

        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        self.lanes = lanes
        self.triple: str = llvm.get_process_triple()
        self._processor: str = llvm.get_host_cpu_name()
        self._features: str = llvm.get_host_cpu_features().flatten()
        if lanes == 8:  # registers of the full width
            self._features += ",-prefer-256-bit"
        version = ".".join(map(str, llvm.llvm_version_info))
        self._model = "large" if _WHOLE_ADDRESSES else "default"
        self.description = "\n".join((version, self.triple, self._processor, self._features, self._model, str(lanes)))

    @cached_property
    def _target(self) -> Any:
        import llvmlite.binding as llvm

        return llvm.Target.from_triple(self.triple).create_target_machine(
            cpu=self._processor, features=self._features, opt=1, reloc="pic", codemodel=self._model, jit=True
        )

    def compile(self, source: str) -> bytes:
        """Return the object code of LLVM assembly."""
        import llvmlite.binding as llvm

        with LOCK:
            return bytes(self._target.emit_object(llvm.parse_assembly(source)))

    def load(self, code: bytes) -> LoadedCode | None:
        """Bring the object code of a kernel into memory; None where it is not such code."""
        support = self.support
        return _link(code, ("kernel",), support.addresses, support)

    @cached_property
    def support(self) -> LoadedCode:
        """The functions that kernels import, in memory and in the user's object cache."""
        if self.lanes == 1:  # a kernel for single samples clears many numbers at once, too, and has several angles
            return host_machine(batch_lanes()).support
        return self.load_source(support_source(self.lanes, self.triple), tuple(SUPPORT), {})

    def load_source(
        self,
        source: str | Callable[[], str],
        symbols: tuple[str, ...],
        imports: dict[str, int],
        identity: str | None = None,
    ) -> LoadedCode:
        """Bring the functions of LLVM assembly into memory, from the user's object cache where it has them.

        Where an identity is given that determines the source, this is only written where the cache does not have them.
        """
        with LOCK:
            if identity is None:
                identity = source = source if isinstance(source, str) else source()
            key = hashlib.sha256(f"{self.description}\n{identity}".encode()).hexdigest()
            objects = ObjectCache.default()
            entry = unpack(objects.read(key))
            loaded = None if entry is None else _link(entry[1], symbols, imports)
            if loaded is None:
                code = self.compile(source if isinstance(source, str) else source())
                objects.write(key, pack("", code))
                loaded = _link(code, symbols, imports)
            if loaded is None:
                raise RuntimeError("machine code that was just compiled cannot be loaded")
            return loaded

    def load_code(
        self, write: Callable[[Code], object], symbols: tuple[str, ...], identity: str | None = None
    ) -> LoadedCode:
        """Bring functions into memory that are written with :class:`Code`, see `load_source`."""

        def source() -> str:
            from .loops import Code

            code = Code(self.lanes, self.triple)
            write(code)
            return code.text

        return self.load_source(source, symbols, {}, identity)


@cache
def host_machine(lanes: int) -> Machine:
    """Return this computer's processor with 1 or :func:`batch_lanes` lanes."""
    with LOCK:
        return Machine(lanes)


@cache
def batch_lanes() -> int:
    """Return how many samples are worth computing side by side: registers of 512 bits take 8, smaller ones share 4."""
    import llvmlite.binding as llvm

    return 8 if llvm.get_host_cpu_features().get("avx512f", False) else 4


@cache
def _linker() -> Any:
    import llvmlite.binding as llvm

    return llvm.create_lljit_compiler(use_jit_link=not _WHOLE_ADDRESSES, suppress_errors=True)


def _link(
    code: bytes, symbols: tuple[str, ...], imports: dict[str, int], called: LoadedCode | None = None
) -> LoadedCode | None:
    import llvmlite.binding as llvm

    # Some targets call functions of the C library, for a fused multiplication or a check of the stack; this process
    # has them.
    builder = llvm.JITLibraryBuilder().add_object_img(code).add_current_process()
    for name in symbols:
        builder.export_symbol(name)
    for name, address in imports.items():
        builder.import_symbol(name, address)
    with LOCK:
        try:
            tracker = builder.link(_linker(), f"steelyard-{next(_NUMBERS)}")
        except RuntimeError:
            return None
    return LoadedCode(tracker, symbols, len(code), called)


def address_of(array: NDArray[Any]) -> int:
    """Return the address in memory of the first number of a contiguous array."""
    try:
        return ctypes.addressof(ctypes.c_char.from_buffer(array))  # type: ignore[arg-type]
    except (TypeError, ValueError, BufferError):  # an array that may not be written, or an empty one
        return int(array.ctypes.data)
