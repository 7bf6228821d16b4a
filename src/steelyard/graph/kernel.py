"""Compiled functions: kernels that are called with arrays, their signatures, and the digest of what made them."""

from __future__ import annotations

import ctypes
import gc
import hashlib
import json
import math
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.once import cached_property

from .cache import ObjectCache, pack, unpack
from .expression import operation_count
from .function import Argument, Function
from .instructions import support_source
from .llvm import kernel_source
from .machine import LOCK, LoadedCode, address_of, batch_lanes, host_machine

__all__ = ["DOUBLE", "Kernel", "Signature", "addresses_of", "source_digest"]

DOUBLE = np.dtype(np.float64)
_ROOMS = ("robot", "graph", "dynamics")


@cache
def source_digest(*others: str) -> str | None:
    """Return a digest of the rooms that turn a description into machine code, or None where they cannot be read.

    Files of other rooms that compose functions by themselves may be added.
    """
    package = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256()
    try:
        rooms = [sorted((package / room).rglob("*.py")) for room in _ROOMS]
        if not all(rooms):
            return None
        for path in [*chain(*rooms), *(Path(other).resolve() for other in others)]:
            content = path.read_bytes()
            digest.update(f"{path.relative_to(package).as_posix()} {len(content)}\n".encode() + content)
    except OSError:
        return None
    return digest.hexdigest()


# What a kernel must know of its function: sizes of arguments and outputs, and which elements are computed.


@dataclass(frozen=True)
class Signature:
    """The sizes of a compiled function, which stand beside its machine code in the object cache.

    Attributes
    ----------
    arguments : tuple of Argument
        Names and widths, without descriptions.
    outputs : tuple of (str, tuple of int)
        Name and shape of each output.
    computed : tuple of int or None
        Flat indices of the computed elements in the concatenated outputs, ascending; None where all are.

    Examples
    --------
    >>> signature = Signature((Argument("q", 2),), (("M", (2, 2)),), (0, 3))
    >>> signature.size, signature.places.tolist()
    (4, [0, 3])
    """

    arguments: tuple[Argument, ...]
    outputs: tuple[tuple[str, tuple[int, ...]], ...]
    computed: tuple[int, ...] | None = None

    @classmethod
    def of(cls, function: Function, *, compact: bool) -> Signature:
        """Return the signature of a function, without the elements that are the constant 0 where it is compact."""
        arguments = tuple(Argument(a.name, a.width, a.uniform) for a in function.arguments)
        outputs = tuple((o.name, o.shape) for o in function.outputs)
        if not compact:
            return cls(arguments, outputs)
        zero = [node.operation == "constant" and node.value == 0.0 for node in function.nodes]
        return cls(arguments, outputs, tuple(k for k, flag in enumerate(zero) if not flag))

    @property
    def size(self) -> int:
        """Number of elements of all the outputs."""
        return sum(math.prod(shape) for _, shape in self.outputs)

    @cached_property
    def width(self) -> int:
        """Number of computed elements."""
        return self.size if self.computed is None else len(self.computed)

    @cached_property
    def places(self) -> NDArray[np.intp]:
        """Flat indices (width,) of the computed elements in the concatenated outputs."""
        indices = np.arange(self.size) if self.computed is None else np.array(self.computed, dtype=np.intp)
        indices.flags.writeable = False
        return indices

    def to_json(self) -> str:
        """Return the signature as JSON text."""
        return json.dumps(
            {
                "arguments": [[a.name, a.width, a.uniform] for a in self.arguments],
                "outputs": [[name, list(shape)] for name, shape in self.outputs],
                "computed": None if self.computed is None else list(self.computed),
            },
            separators=(",", ":"),
        )

    @classmethod
    def from_json(cls, text: str | bytes) -> Signature | None:
        """Return the signature that the text describes, or None where the text is not one."""
        try:
            data = json.loads(text)
            arguments = tuple(Argument(name, _size(width), bool(uniform)) for name, width, uniform in data["arguments"])
            outputs = tuple((str(name), tuple(map(_size, shape))) for name, shape in data["outputs"])
            computed = None if data["computed"] is None else tuple(map(_size, data["computed"]))
        except (ValueError, TypeError, KeyError):  # InputError is a ValueError
            return None
        signature = cls(arguments, outputs, computed)
        if computed is not None:
            ascending = all(a < b for a, b in pairwise(computed))
            if not ascending or (computed and computed[-1] >= signature.size):
                return None
        return signature


def _size(value: Any) -> int:
    if type(value) is not int or not 0 <= value < 2**31:
        raise ValueError("a size is a non-negative integer")
    return value


# Compiled functions: batches of samples in vector registers, on one thread or several, and single samples.

Array = NDArray[np.float64]

# ns of work that are worth a thread: to hand work to a waiting thread and to learn that it is done takes about 90 µs.
_WORTHWHILE = 250_000.0

# Bytes of a result from which on it is written past the cache, because memory otherwise reads each line before it is
# written. How large the cache is that a process may fill is not known. Measured (32 MiB, shared), in ns a sample
# through the cache and past it: the regressor of the WAM, 3920 bytes, 155 and 209 at 3 MiB, 163 and 220 at 7, 249 and
# 224 at 15, 316 and 224 at 61; of the Puma 560, 2880 bytes, 93 and 134 at 1 MiB, 105 and 94 at 5, 227 and 96 at 45.
_LARGE = 4 << 20

# Bytes of a result from which on it goes into memory that an earlier one used, which takes 3 µs to find. What is larger
# than that the allocator of the C library may fetch from the system at every call: 60 µs for 256 KiB.
_RECYCLED = 1 << 18

# Bytes of a result up to which `direct` makes an array for it. It keeps the last two, which a loop gets in turn: of 320
# KiB, four samples of a humanoid's regressor, a call takes 14 µs with them and 26 in memory that `empty` finds.
_MADE = 1 << 20

# ns of work that may be done while other threads of Python wait, see `direct`; Python lets them wait for 5 ms. A call
# that lets them go on takes 10 µs longer.
_SHORT = 200_000.0


class Kernel:
    """A function as machine code for this processor.

    It is compiled at the first call, for batches and for single samples apart, and kept in the object cache.

    Parameters
    ----------
    function : Function or callable
        Or what returns it, called only where the function is needed.
    compact : bool
        Compute only the elements that are not the constant 0; see `places`.
    identity : str, optional
        Text that determines the function, together with the code of this package. What is in the cache under it is
        used without building the function.
    cache : ObjectCache, optional
        The user's by default.

    Examples
    --------
    >>> import numpy as np
    >>> from steelyard.graph import Function, Graph, Output, sin
    >>> x = Graph().inputs("x", 2)
    >>> kernel = Kernel(Function("f", (Argument("x", 2),), (Output("y", (), (sin(x[0]) * x[1],)),)))
    >>> bool(np.allclose(kernel(np.array([[0.5, 2.0]])), np.sin(0.5) * 2.0))
    True
    """

    def __init__(
        self,
        function: Function | Callable[[], Function],
        *,
        compact: bool = False,
        identity: str | None = None,
        cache: ObjectCache | None = None,
    ) -> None:
        self._given = function
        self.compact = compact
        self.identity = identity
        self._cache = cache
        self._loaded: dict[int, LoadedCode] = {}
        self._direct: dict[tuple[tuple[int, ...], bool], Callable[..., Any] | None] = {}

    def __repr__(self) -> str:
        inputs = ", ".join(f"{a.name}[{a.width}]" for a in self.arguments)
        return f"Kernel({inputs} -> {self.width})"

    # What it computes

    @cached_property
    def function(self) -> Function:
        """The function, built at the first use."""
        return self._given if isinstance(self._given, Function) else self._given()

    @cached_property
    def signature(self) -> Signature:
        """The sizes of arguments and outputs, from the object cache where it knows them."""
        for lanes in (batch_lanes(), 1) if self.identity is not None else ():
            entry = self._entry(self._key(lanes))
            if entry is not None:
                return entry[0]
        return Signature.of(self.function, compact=self.compact)

    @property
    def arguments(self) -> tuple[Argument, ...]:
        """Names and widths of the arguments, without descriptions."""
        return self.signature.arguments

    @property
    def places(self) -> NDArray[np.intp]:
        """Flat row-major indices (n,) of the computed elements in the concatenated outputs."""
        return self.signature.places

    @property
    def width(self) -> int:
        """Number n of computed elements."""
        return self.signature.width

    @property
    def operation_count(self) -> dict[str, int]:
        """Operations a sample, see :func:`steelyard.graph.operation_count`."""
        return operation_count(self.function.nodes)

    # Machine code

    @cached_property
    def batch_function(self) -> Any:
        """The compiled function ``(count, pointers…, out, cached)`` for batches.

        In C ``void kernel(int64_t count, const double *argument…, double *out, int64_t cached)``: an argument has
        `count` rows, or one where it is uniform; element j of sample s goes to ``out[s * n + j]``, past the cache where
        `cached` is negative. It keeps no state, so that threads may share it, and lives as long as the kernel.
        """
        return self._prototype(self.batch_address)

    @property
    def batch_address(self) -> int:
        """The address of `batch_function`, for compiled loops."""
        return self._code(batch_lanes()).addresses["kernel"]

    @cached_property
    def single_function(self) -> Any:
        """The compiled function for few samples, one by one, with the same arguments as `batch_function`."""
        return self._prototype(self.function_pointer)

    @property
    def function_pointer(self) -> int:
        """The address of `single_function`, for control loops in C."""
        return self._code(1).addresses["kernel"]

    @cached_property
    def _prototype(self) -> Any:
        pointers = [ctypes.c_void_p] * (len(self.arguments) + 1)
        return ctypes.CFUNCTYPE(None, ctypes.c_int64, *pointers, ctypes.c_int64)

    def _code(self, lanes: int) -> LoadedCode:
        with LOCK:
            if lanes not in self._loaded:
                self._loaded[lanes] = self._load(lanes)
            return self._loaded[lanes]

    def _load(self, lanes: int) -> LoadedCode:
        machine = host_machine(lanes)
        signature, key = self.signature, self._key(lanes)
        source = None
        if key is None:
            with _without_collector():
                source = self._source(lanes)
            key = _digest(machine.description, support_source(batch_lanes()), source)
        entry = self._entry(key)
        loaded = machine.load(entry[1]) if entry is not None and entry[0] == signature else None
        if loaded is not None:
            return loaded
        with _without_collector():
            code = machine.compile(self._source(lanes) if source is None else source)
        self._objects.write(str(key), pack(signature.to_json(), code))
        loaded = machine.load(code)
        if loaded is None:
            raise RuntimeError("machine code that was just compiled cannot be loaded")
        return loaded

    def _source(self, lanes: int) -> str:
        function, signature = self.function, self.signature
        if Signature.of(function, compact=self.compact) != signature:
            raise RuntimeError(f"the identity of the kernel of {function.name} does not determine it")
        nodes = function.nodes
        computed = nodes if signature.computed is None else [nodes[k] for k in signature.computed]
        triple = host_machine(lanes).triple
        return kernel_source(signature.arguments, computed, lanes=lanes, triple=triple)

    @cached_property
    def _objects(self) -> ObjectCache:
        return self._cache if self._cache is not None else ObjectCache.default()

    def _key(self, lanes: int) -> str | None:
        """Return the name of the cache entry, or None where only the source gives it."""
        sources = None if self.identity is None else source_digest()
        if self.identity is None or sources is None:
            return None
        return _digest(host_machine(lanes).description, sources, str(self.compact), self.identity)

    def _entry(self, key: str | None) -> tuple[Signature, bytes] | None:
        """Return what the cache has under the key, where it can be used."""
        content = None if key is None else unpack(self._objects.read(key))
        signature = None if content is None else Signature.from_json(content[0])
        return None if content is None or signature is None else (signature, content[1])

    # Calls

    def __call__(self, *arrays: Array, out: Array | None = None, threads: int = 1) -> Array:
        """Compute the outputs of every sample.

        Parameters
        ----------
        *arrays : ndarray
            One for each argument: (S, width), or (width,) where the argument is uniform.
        out : ndarray, optional
            C-contiguous, (S, n); may not overlap the arguments.
        threads : int
            How many share a large batch; the result is the same.

        Returns
        -------
        ndarray
            (S, n) with n the number of computed elements.

        Raises
        ------
        InputError
            If an array or the number of threads does not fit.
        """
        signature = self.signature
        addresses, count, kept = addresses_of(signature.arguments, arrays)
        shape = (count, signature.width)
        if out is None:
            out = self.empty(shape)
        elif out.shape != shape or not out.flags.carray or out.dtype != DOUBLE:
            raise InputError(f"out must be a C-contiguous float64 array of shape {shape}, got {out.dtype} {out.shape}.")
        if not isinstance(threads, int) or threads < 1:
            raise InputError(f"threads must be a positive integer, got {threads!r}.")
        if out.size == 0:
            return out
        target = address_of(out)
        if count == 1:
            self.single_function(1, *addresses, target, 1)
        elif (pieces := 1 if threads == 1 else self._pieces(threads, count)) < 2:
            self.batch_function(count, *addresses, target, self._cached(count))
        else:
            self._share(pieces, threads, count, addresses, target, (arrays, kept, out))
        del kept
        return out

    @staticmethod
    def empty(shape: tuple[int, ...]) -> Array:
        """Return an array for a result; a large one in memory that an earlier result used, where there is some."""
        if 8 * math.prod(shape) < _RECYCLED:
            return np.empty(shape)
        from .large_arrays import large_array

        return large_array(shape)

    def _cached(self, count: int) -> int:
        """Return the last argument of a compiled function for a batch."""
        return -1 if 8 * count * self._width >= _LARGE else 1

    def bound(self, *arrays: Array) -> Callable[[], None]:
        """Return a call that reads and writes the memory of these arrays, with nothing to do around it.

        Parameters
        ----------
        *arrays : ndarray
            One for each argument and one for the outputs, all C-contiguous doubles that are not replaced: (S, width),
            or (width,) where an argument is uniform.
        """
        count = len(arrays[-1])
        function = self.single_function if count == 1 else self.batch_function
        pointers = (ctypes.c_void_p(address_of(array)) for array in arrays)
        bound = partial(function, ctypes.c_int64(count), *pointers, ctypes.c_int64(1))
        bound.memory = (self, arrays)  # type: ignore[attr-defined]  # which addresses do not keep
        return bound

    def direct(
        self, shape: tuple[int, ...], *, several: bool = False, otherwise: Callable[..., Any] | None = None
    ) -> Callable[..., Any] | None:
        """Return a built-in function for a few samples, which does in a fraction of a microsecond what it can do.

        It takes the arguments, (..., width) or (width,) each, and an array (..., *shape) for the outputs, and returns
        that array, or a new one where None was given; or None, having done nothing, where one of them is not a
        C-contiguous array of doubles, does not fit, or has memory in common with the outputs, and where there are too
        many samples, or for a new array more than `most_small`.

        Parameters
        ----------
        shape : tuple of int
            Of the outputs of one sample, in which they stand one after the other.
        several : bool
            For small batches; for one sample otherwise.
        otherwise : callable, optional
            A method whose place the function takes: `out` then has to be given by its name or not at all, and where
            there is nothing that the function can do, it returns what the method does.

        Returns
        -------
        callable or None
            None where Python or NumPy keep arrays in a way that is not known.
        """
        key = (shape, several)
        if otherwise is None and key in self._direct:
            return self._direct[key]
        from .direct_call import direct_call  # only where small batches are computed

        single = self._code(1)
        batch, few = single, 1
        if several:
            batch = self._code(batch_lanes())
            # A register that is not full takes as long as 2 single samples, or half its lanes where most of the
            # time goes into writing. Where nearly all outputs are zero, which is where there is little code for each
            # of them, single samples are always as fast: ns for one of 2, 4, 8 and 16 samples one by one and side by
            # side, regressor of a quadruped (7 bytes of code for an output) 242, 249, 279, 252 and 710, 410, 412, 320;
            # of two arms (20 bytes) 1316, 1265, 1271, 1298 and 1892, 1107, 983, 925.
            if batch.size < 12 * self._width:
                few = self.most
            else:
                few = batch_lanes() // 2 if self._width > 8 / 3 * self._cost else 2
        found = direct_call(
            self.arguments,
            shape,
            single=single,
            batch=batch,
            few=few,
            most=self.most if several else 1,
            made=self.most_small,
            otherwise=otherwise,
        )
        if otherwise is None:
            self._direct[key] = found
        return found

    @cached_property
    def most(self) -> int:
        """How many samples `direct` computes at once: little work, and a result that a cache holds."""
        return max(batch_lanes(), min(int(_SHORT / self._cost), _LARGE // (8 * max(1, self._width))))

    @property
    def most_small(self) -> int:
        """How many samples have a result that `direct` makes an array for."""
        return _MADE // (8 * max(1, self._width))

    def sample(self, *arrays: Array, out: Array | None = None) -> Array:
        """Compute the outputs of one sample, with less to do around it than a batch of one.

        Parameters
        ----------
        *arrays : array_like
            (width,) for each argument.
        out : ndarray, optional
            (n,).

        Returns
        -------
        ndarray
            (n,), the computed elements.

        Raises
        ------
        InputError
            If an array does not fit.
        """
        width = self._width
        if out is not None and (out.shape != (width,) or out.dtype is not DOUBLE):
            raise InputError(f"out must be a float64 array of shape ({width},), got {out.dtype} {out.shape}.")
        direct = self.direct((width,))
        result: Array | None = None if direct is None else direct(*arrays, out)
        if result is not None and result.ndim == 1:
            return result
        result = np.empty(width) if out is None else out
        rows = [np.asarray(a, dtype=np.float64) for a in arrays]
        for argument, row in zip(self.arguments, rows, strict=False):
            if row.shape != (argument.width,):
                raise InputError(f"{argument.name} must have shape ({argument.width},), got {row.shape}.")
        uniform = {k for k, argument in enumerate(self.arguments) if argument.uniform}
        result[...] = self(*(row if k in uniform else row[np.newaxis] for k, row in enumerate(rows))).ravel()
        return result

    @cached_property
    def _width(self) -> int:
        return self.signature.width

    def _pieces(self, threads: int, count: int) -> int:
        """Return how many threads a batch is worth."""
        return min(threads, int(count * self._cost / _WORTHWHILE), -(-count // batch_lanes()))

    @cached_property
    def _cost(self) -> float:
        """What a sample of a batch may take, in ns: 1 ns for 500 bytes of code or 4 outputs."""
        return self._code(batch_lanes()).size / 500 + self._width / 4

    def _share(
        self, pieces: int, threads: int, count: int, addresses: Sequence[int], target: int, held: object
    ) -> None:
        """Let threads compute blocks of samples."""
        lanes, function, signature = batch_lanes(), self.batch_function, self.signature
        groups = -(-count // lanes)
        bounds = [min(count, lanes * (groups * k // pieces)) for k in range(pieces + 1)]
        steps = [0 if a.uniform else 8 * a.width for a in signature.arguments]
        step = 8 * signature.width
        cached = self._cached(count)

        # Ctrl-C may end the wait below: what a thread reads and writes lives as long as its work.
        def work(start: int, end: int, _held: object = held) -> None:
            inputs = [address + start * size for address, size in zip(addresses, steps, strict=True)]
            function(end - start, *inputs, target + start * step, cached)

        pool = _pool(os.getpid(), threads)
        others = [pool.submit(work, *piece) for piece in pairwise(bounds[1:])]
        try:
            work(bounds[0], bounds[1])
        finally:  # after an error, too, no thread may still write into an array that has been freed
            wait(others)
        for other in others:
            other.result()


@cache
def _pool(process: int, threads: int) -> ThreadPoolExecutor:
    """Return a pool of threads, which is kept for later calls; a forked process gets a pool of its own."""
    return ThreadPoolExecutor(threads - 1, f"steelyard-{process}")


@contextmanager
def _without_collector() -> Iterator[None]:
    """Switch the garbage collector off meanwhile: a graph has many objects, none of which becomes garbage."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _digest(*texts: str) -> str:
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()


# Where the arrays that a compiled function reads and writes stand in memory.


def addresses_of(arguments: tuple[Argument, ...], arrays: tuple[Array, ...]) -> tuple[list[int], int, list[Array]]:
    """Return the addresses of the arrays, the number of samples, and arrays that must live until they are used."""
    if len(arrays) != len(arguments):
        names = ", ".join(a.name for a in arguments)
        raise InputError(f"the kernel reads {len(arguments)} arrays ({names}), got {len(arrays)}.")
    addresses, kept, count = [], [], None
    for argument, array in zip(arguments, arrays, strict=True):
        if type(array) is not np.ndarray or array.dtype is not DOUBLE or not array.flags.carray:
            array = np.require(array, np.float64, ["C", "A"])
            kept.append(array)
        shape = array.shape
        if shape != (argument.width,) if argument.uniform else len(shape) != 2 or shape[1] != argument.width:
            form = f"({argument.width},)" if argument.uniform else f"(S, {argument.width})"
            raise InputError(f"{argument.name} must have shape {form}, got {shape}.")
        if not argument.uniform:
            if count is None:
                count = shape[0]
            elif shape[0] != count:
                raise InputError(
                    f"{argument.name} must have as many rows as the arrays before it, {count}, got {shape[0]}."
                )
        addresses.append(address_of(array))
    return addresses, 1 if count is None else count, kept
