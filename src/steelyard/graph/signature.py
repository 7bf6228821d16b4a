"""What a kernel must know of its function: sizes of arguments and outputs, and which elements are computed."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .function import Argument, Function

__all__ = ["Signature"]


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
