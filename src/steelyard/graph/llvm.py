"""Writes an expression graph as LLVM assembly: one function that works through samples, several at a time."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

from .expression import Node, reachable
from .function import Argument

__all__ = ["llvm_source"]


# pi/2 as a sum of three doubles, so that reduction with fused multiply-add keeps the argument exact up to 1e9 rad.
_HALF_PI = (1.5707963267948966, 6.123233995736766e-17, -1.4973849048591833e-33)
_ROUNDER = 6755399441055744.0  # 1.5 * 2**52: adding it leaves the nearest integer in the low bits
_SINE = [(-1.0) ** n / math.factorial(2 * n + 1) for n in range(9)]
_COSINE = [(-1.0) ** n / math.factorial(2 * n) for n in range(9)]


def llvm_source(
    groups: Sequence[Argument], outputs: Sequence[Node], *, lanes: int, layout: str, triple: str = ""
) -> str:
    """Return the LLVM assembly of a function ``kernel(count, group pointers…, out, stride)``.

    Parameters
    ----------
    groups : sequence of Argument
        The arrays that the function reads; an array of samples is row-major, (count, width).
    outputs : sequence of Node
    lanes : int
        Samples computed side by side; ``count`` must be a multiple of it.
    layout : {"rows", "columns"}
        ``"rows"``: output j of sample s goes to ``out[s * len(outputs) + j]``; ``"columns"``: to
        ``out[j * stride + s]``.
    triple : str
        Target triple.

    Returns
    -------
    str
    """
    return _Writer(groups, outputs, lanes, layout, triple).text()


class _Writer:
    def __init__(
        self, groups: Sequence[Argument], outputs: Sequence[Node], lanes: int, layout: str, triple: str
    ) -> None:
        self.groups = groups
        self.outputs = outputs
        self.lanes = lanes
        self.layout = layout
        self.triple = triple
        self.lines: list[str] = []
        self.count = 0
        self.rows: dict[tuple[str, int], str] = {}
        self.type = "double" if lanes == 1 else f"<{lanes} x double>"
        self.integer = "i64" if lanes == 1 else f"<{lanes} x i64>"
        self.suffix = "f64" if lanes == 1 else f"v{lanes}f64"
        self.places = {f"{g.name}[{k}]": (number, g, k) for number, g in enumerate(groups) for k in range(g.width)}
        self.names: dict[int, str] = {}
        self.pairs: dict[str, tuple[str, str]] = {}

    def text(self) -> str:
        for node in reachable(self.outputs):
            if node.operation != "input":  # inputs are read where they are first used, to keep registers free
                self._emit(node)
        if self.layout == "rows":
            self._store_rows()
        else:
            self._store_columns()
        pointers = "".join(f"ptr noalias readonly %g{i}, " for i in range(len(self.groups)))
        head = [
            f'target triple = "{self.triple}"' if self.triple else "",
            f"declare {self.type} @llvm.fma.{self.suffix}({self.type}, {self.type}, {self.type})",
            f"define void @kernel(i64 %count, {pointers}ptr noalias %out, i64 %stride) {{",
            "entry:",
            "  %some = icmp sgt i64 %count, 0",
            "  br i1 %some, label %body, label %done",
            "body:",
            "  %s = phi i64 [ 0, %entry ], [ %following, %body ]",
        ]
        tail = [
            f"  %following = add i64 %s, {self.lanes}",
            "  %more = icmp slt i64 %following, %count",
            "  br i1 %more, label %body, label %done",
            "done:",
            "  ret void",
            "}",
        ]
        return "\n".join(head + self.lines + tail) + "\n"

    def _new(self, instruction: str) -> str:
        name = f"%t{self.count}"
        self.count += 1
        self.lines.append(f"  {name} = {instruction}")
        return name

    def _constant(self, value: float) -> str:
        number = f"0x{struct.unpack('>Q', struct.pack('>d', value))[0]:016X}"
        return number if self.lanes == 1 else "<" + ", ".join([f"double {number}"] * self.lanes) + ">"

    def _integer(self, value: int) -> str:
        return str(value) if self.lanes == 1 else "<" + ", ".join([f"i64 {value}"] * self.lanes) + ">"

    def _value(self, node: Node) -> str:
        name = self.names.get(node.index)
        if name is None:
            name = self._read(node) if node.operation == "input" else self._constant(float(node.value))
            self.names[node.index] = name
        return name

    def _read(self, node: Node) -> str:
        number, group, k = self.places[str(node.value)]
        if group.uniform:
            scalar = self._load(f"%g{number}", str(k))
            return self._splat(scalar)
        rows = [self._row(f"%g{number}", group.width, lane) for lane in range(self.lanes)]
        values = [self._load(row, str(k)) for row in rows]
        if self.lanes == 1:
            return values[0]
        vector = "undef"
        for lane, scalar in enumerate(values):
            vector = self._new(f"insertelement {self.type} {vector}, double {scalar}, i32 {lane}")
        return vector

    def _row(self, pointer: str, width: int, lane: int) -> str:
        """Return the address of a lane's row, computed once."""
        key = (pointer, lane)
        if key not in self.rows:
            sample = self._new(f"add i64 %s, {lane}")
            start = self._new(f"mul i64 {sample}, {width}")
            self.rows[key] = self._new(f"getelementptr double, ptr {pointer}, i64 {start}")
        return self.rows[key]

    def _load(self, pointer: str, index: str) -> str:
        address = self._new(f"getelementptr double, ptr {pointer}, i64 {index}")
        return self._new(f"load double, ptr {address}, align 8")

    def _splat(self, scalar: str) -> str:
        if self.lanes == 1:
            return scalar
        first = self._new(f"insertelement {self.type} undef, double {scalar}, i32 0")
        return self._new(f"shufflevector {self.type} {first}, {self.type} undef, <{self.lanes} x i32> zeroinitializer")

    def _emit(self, node: Node) -> None:
        if node.operation == "constant":
            return
        arguments = [self._value(a) for a in node.arguments]
        kind = node.operation
        if kind in ("add", "sub", "mul", "div"):
            name = self._new(f"f{kind} contract {self.type} {arguments[0]}, {arguments[1]}")
        elif kind == "neg":
            name = self._new(f"fneg {self.type} {arguments[0]}")
        elif kind == "sign":
            name = self._sign(arguments[0])
        else:
            pair = self.pairs.get(arguments[0])
            if pair is None:
                pair = self.pairs[arguments[0]] = self._sine_and_cosine(arguments[0])
            name = pair[0] if kind == "sin" else pair[1]
        self.names[node.index] = name

    def _select(self, condition: str, yes: str, no: str) -> str:
        flag = "i1" if self.lanes == 1 else f"<{self.lanes} x i1>"
        return self._new(f"select {flag} {condition}, {self.type} {yes}, {self.type} {no}")

    def _sign(self, x: str) -> str:
        zero, one = self._constant(0.0), self._constant(1.0)
        positive = self._select(self._new(f"fcmp ogt {self.type} {x}, {zero}"), one, zero)
        below = self._select(self._new(f"fcmp olt {self.type} {x}, {zero}"), self._constant(-1.0), positive)
        # A value that is not a number stays one.
        return self._select(self._new(f"fcmp uno {self.type} {x}, {x}"), x, below)

    def _fused(self, a: str, b: str, c: str) -> str:
        t = self.type
        return self._new(f"call {t} @llvm.fma.{self.suffix}({t} {a}, {t} {b}, {t} {c})")

    def _sine_and_cosine(self, x: str) -> tuple[str, str]:
        """Reduce to [-pi/4, pi/4] by quadrants, then Taylor series to order 17 and 16 (1.5 ulp)."""
        t, i = self.type, self.integer
        turns = self._new(f"fmul {t} {x}, {self._constant(2.0 / math.pi)}")
        shifted = self._new(f"fadd {t} {turns}, {self._constant(_ROUNDER)}")
        quadrant = self._new(f"bitcast {t} {shifted} to {i}")
        whole = self._new(f"fsub {t} {shifted}, {self._constant(_ROUNDER)}")
        back = self._new(f"fneg {t} {whole}")
        r = x
        for part in _HALF_PI:
            r = self._fused(back, self._constant(part), r)
        square = self._new(f"fmul {t} {r}, {r}")
        sine = self._polynomial(_SINE[1:], square)
        cosine = self._polynomial(_COSINE[2:], square)
        cube = self._new(f"fmul {t} {r}, {square}")
        sine = self._fused(cube, sine, r)
        fourth = self._new(f"fmul {t} {square}, {square}")
        # 1 - square/2 first, then what it lost, so that the cosine keeps its last bit.
        half = self._new(f"fmul {t} {square}, {self._constant(0.5)}")
        main = self._new(f"fsub {t} {self._constant(1.0)}, {half}")
        lost = self._new(f"fsub {t} {self._constant(1.0)}, {main}")
        lost = self._new(f"fsub {t} {lost}, {half}")
        cosine = self._new(f"fadd {t} {main}, {self._fused(fourth, cosine, lost)}")
        odd = self._new(f"and {i} {quadrant}, {self._integer(1)}")
        swapped = self._new(f"icmp ne {i} {odd}, {self._integer(0)}")
        sine, cosine = self._select(swapped, cosine, sine), self._select(swapped, sine, cosine)
        following = self._new(f"add {i} {quadrant}, {self._integer(1)}")
        return self._flip(sine, quadrant), self._flip(cosine, following)

    def _polynomial(self, coefficients: Sequence[float], x: str) -> str:
        value = self._constant(coefficients[-1])
        for coefficient in reversed(coefficients[:-1]):
            value = self._fused(value, x, self._constant(coefficient))
        return value

    def _flip(self, value: str, quadrant: str) -> str:
        """Change the sign of `value` in quadrants 2 and 3."""
        t, i = self.type, self.integer
        bit = self._new(f"and {i} {quadrant}, {self._integer(2)}")
        mask = self._new(f"shl {i} {bit}, {self._integer(62)}")
        bits = self._new(f"bitcast {t} {value} to {i}")
        flipped = self._new(f"xor {i} {bits}, {mask}")
        return self._new(f"bitcast {i} {flipped} to {t}")

    def _store(self, value: str, pointer: str, index: str) -> None:
        address = self._new(f"getelementptr double, ptr {pointer}, i64 {index}")
        self.lines.append(f"  store {self.type} {value}, ptr {address}, align 8")

    def _store_columns(self) -> None:
        for j, node in enumerate(self.outputs):
            start = self._new(f"mul i64 %stride, {j}")
            self._store(self._value(node), "%out", self._new(f"add i64 {start}, %s"))

    def _store_rows(self) -> None:
        width, lanes = len(self.outputs), self.lanes
        values = [self._value(node) for node in self.outputs]
        rows = [self._row("%out", width, lane) for lane in range(lanes)]
        if lanes == 1 or width < lanes:
            for j, value in enumerate(values):
                for lane in range(lanes):
                    scalar = value
                    if lanes > 1:
                        scalar = self._new(f"extractelement {self.type} {value}, i32 {lane}")
                    address = self._new(f"getelementptr double, ptr {rows[lane]}, i64 {j}")
                    self.lines.append(f"  store double {scalar}, ptr {address}, align 8")
            return
        starts = list(range(0, width - lanes + 1, lanes))
        if starts[-1] + lanes < width:
            starts.append(width - lanes)  # overlaps its neighbour and writes the same values again
        for start in starts:
            block = values[start : start + lanes]
            constant = [self.outputs[j].operation == "constant" for j in range(start, start + lanes)]
            if all(constant):
                numbers = [float(self.outputs[j].value) for j in range(start, start + lanes)]
                bits = [struct.unpack(">Q", struct.pack(">d", v))[0] for v in numbers]
                same = "<" + ", ".join(f"double 0x{b:016X}" for b in bits) + ">"
                parts = [same] * lanes
            else:
                parts = self._transposed(block)
            for row, part in zip(rows, parts, strict=True):
                self._store(part, row, str(start))

    def _transposed(self, block: list[str]) -> list[str]:
        """Transpose a square block of vectors in registers, by halves."""
        distance = 1
        while distance < self.lanes:
            low, high = [], []
            for lane in range(self.lanes):
                pair = lane // distance % 2
                low.append(lane if pair == 0 else lane - distance + self.lanes)
                high.append(lane + distance if pair == 0 else lane + self.lanes)
            block = list(block)
            for lane in range(self.lanes):
                if lane // distance % 2 == 0:
                    a, b = block[lane], block[lane + distance]
                    block[lane] = self._shuffle(a, b, low)
                    block[lane + distance] = self._shuffle(a, b, high)
            distance *= 2
        return block

    def _shuffle(self, a: str, b: str, order: list[int]) -> str:
        mask = ", ".join(f"i32 {k}" for k in order)
        return self._new(f"shufflevector {self.type} {a}, {self.type} {b}, <{self.lanes} x i32> <{mask}>")
