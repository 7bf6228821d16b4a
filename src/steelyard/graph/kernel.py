"""Compiled functions: a batch of samples in vector registers, or one sample."""

from __future__ import annotations

import ctypes
import hashlib
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError

from .cache import ObjectCache
from .expression import Node
from .function import Argument, Function, Output
from .llvm import llvm_source
from .signature import Signature

__all__ = ["Kernel"]

LANES = 8
_LARGE = 60_000


class Kernel:
    """A function of the expression graph as machine code for this processor.

    Compilation happens at the first call and is kept in the object cache.

    Parameters
    ----------
    function : Function or callable
        Or what returns it, called only when the function is needed.
    layout : {"rows", "columns"}
        Whether the outputs of one sample, or the samples of one output, are neighbours in memory.
    compact : bool
        Compute only the elements that are not the constant 0; see `places`.
    identity : str, optional
        Text that determines the function together with this package's code. With it, what is in the cache is used
        without building the function.
    cache : ObjectCache or None
        None takes the user's.

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
        function: Function | Callable[[], Function] | Sequence[Argument],
        nodes: Sequence[Node] | None = None,
        *,
        layout: str = "rows",
        compact: bool = False,
        identity: str | None = None,
        cache: ObjectCache | None = None,
    ) -> None:
        if nodes is not None:
            function = Function("kernel", tuple(function), (Output("values", (len(nodes),), tuple(nodes)),))  # type: ignore[arg-type]
        self._given: Any = function
        self.layout = layout
        self.compact = compact
        self.identity = identity
        self._cache = cache
        self._keep: list[Any] = []  # engines own the code, so they live as long as the kernel

    def __repr__(self) -> str:
        inputs = ", ".join(f"{g.name}[{g.width}]" for g in self.arguments)
        return f"Kernel({inputs} -> {self.width}, {self.layout})"

    @cached_property
    def function(self) -> Function:
        """The function, built at the first use."""
        return self._given if isinstance(self._given, Function) else self._given()

    @cached_property
    def signature(self) -> Signature:
        """Sizes of arguments and outputs."""
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
    def outputs(self) -> tuple[Node, ...]:
        nodes = self.function.nodes
        return tuple(nodes[k] for k in self.places)

    @property
    def operation_count(self) -> dict[str, int]:
        """Operations a sample, see :func:`steelyard.graph.operation_count`."""
        return self.function.operation_count

    @cached_property
    def batch_function(self) -> Any:
        """The compiled function for multiples of 8 samples: ``(count, pointers…, out, stride)``."""
        return self._compile(LANES)

    @cached_property
    def single_function(self) -> Any:
        """The compiled function for samples one by one, with the same arguments."""
        return self._compile(1)

    def __call__(
        self, *arrays: NDArray[np.float64], out: NDArray[np.float64] | None = None, threads: int = 1
    ) -> NDArray[np.float64]:
        """Compute the outputs of every sample.

        Parameters
        ----------
        *arrays : ndarray
            One for each argument: (S, width), or (width,) where the argument is uniform.
        out : ndarray, optional
            C-contiguous, (S, n) for ``"rows"``, (n, S) for ``"columns"``.
        threads : int

        Returns
        -------
        ndarray
            (S, n) or (n, S) with n the number of computed elements.
        """
        inputs = [self._checked(group, array) for group, array in zip(self.arguments, arrays, strict=True)]
        count = next((len(a) for g, a in zip(self.arguments, inputs, strict=True) if not g.uniform), 1)
        width = self.width
        shape = (count, width) if self.layout == "rows" else (width, count)
        if out is None:
            out = np.empty(shape)
        elif out.shape != shape or not out.flags.c_contiguous or out.dtype != np.float64:
            raise InputError(f"out must be a C-contiguous float64 array of shape {shape}, got {out.dtype} {out.shape}.")
        if count == 0 or width == 0:
            return out
        if count == 1:
            self._run(self.single_function, 1, inputs, out, 1)
            return out
        whole = count - count % LANES
        if whole:
            self._run(self.batch_function, whole, inputs, out, count)
        if whole < count:
            self._remainder(whole, count, inputs, out)
        return out

    def _remainder(self, start: int, count: int, inputs: list[NDArray[np.float64]], out: NDArray[np.float64]) -> None:
        """Compute the last samples, fewer than the lanes, in a padded block."""
        rest = count - start
        padded = []
        for group, array in zip(self.arguments, inputs, strict=True):
            if group.uniform:
                padded.append(array)
            else:
                block = np.repeat(array[-1:], LANES, axis=0)
                block[:rest] = array[start:]
                padded.append(block)
        width = self.width
        last = np.empty((LANES, width) if self.layout == "rows" else (width, LANES))
        self._run(self.batch_function, LANES, padded, last, LANES)
        if self.layout == "rows":
            out[start:] = last[:rest]
        else:
            out[:, start:] = last[:, :rest]

    @staticmethod
    def _run(
        function: Any, count: int, inputs: list[NDArray[np.float64]], out: NDArray[np.float64], stride: int
    ) -> None:
        function(count, *(a.ctypes.data for a in inputs), out.ctypes.data, stride)

    @staticmethod
    def _checked(group: Argument, array: NDArray[np.float64]) -> NDArray[np.float64]:
        array = np.ascontiguousarray(array, dtype=np.float64)
        expected = 1 if group.uniform else 2
        if array.ndim != expected or array.shape[-1] != group.width:
            form = f"({group.width},)" if group.uniform else f"(S, {group.width})"
            raise InputError(f"{group.name} must have shape {form}, got {array.shape}.")
        return array

    def _compile(self, lanes: int) -> Any:
        import llvmlite.binding as llvm

        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        triple = llvm.get_process_triple()
        processor, features = llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
        if lanes == LANES:  # full-width registers where the processor has them
            features += ",-prefer-256-bit"
        source = llvm_source(self.arguments, self.outputs, lanes=lanes, layout=self.layout, triple=triple)
        level = 1 if source.count("\n") < _LARGE else 0  # optimising a very long function takes minutes
        version = ".".join(map(str, llvm.llvm_version_info))
        material = "\n".join((version, triple, processor, features, str(level), source))
        key = hashlib.sha256(material.encode()).hexdigest()
        cache = self._cache if self._cache is not None else ObjectCache.default()
        target = llvm.Target.from_triple(triple).create_target_machine(
            cpu=processor, features=features, opt=level, reloc="pic", codemodel="default", jit=True
        )
        code = cache.read(key)
        if code is None:
            module = llvm.parse_assembly(source)
            code = target.emit_object(module)
            cache.write(key, code)
        engine = llvm.create_mcjit_compiler(llvm.parse_assembly(f'target triple = "{triple}"\n'), target)
        engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        engine.finalize_object()
        self._keep.append(engine)
        pointers = [ctypes.c_void_p] * (len(self.arguments) + 1)
        prototype = ctypes.CFUNCTYPE(None, ctypes.c_int64, *pointers, ctypes.c_int64)
        return prototype(engine.get_function_address("kernel"))
