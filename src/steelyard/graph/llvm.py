"""Writes a function as LLVM assembly: one loop over samples, several of them side by side.

A block of samples is read into a workspace on the stack, where each value has a slot as wide as the lanes. The parts
of the program, each a function, read and write slots, so that the work of the compiler grows in proportion to the
program. The block's outputs are then moved from their slots to memory. What reads, writes and turns angles into sines
and cosines is the same for all programs: the support, compiled once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

from .expression import Node, reachable
from .function import Argument
from .instructions import SUPPORT, Instructions

__all__ = ["Fused", "Program", "kernel_source"]

# LLVM takes more than linear time over a long stretch of code without branches. `_UNDIVIDED` operations in one stretch
# are still cheap; a longer program is cut into parts of about `_PART` operations.
_UNDIVIDED = 1200
_PART = 600

# With so many outputs, values that are computed output after output are in fewer registers at a time: single samples of
# a regressor take 228 instead of 288 ns (WAM) or 1 to 2 % less (three other arms), batches 4 to 11 % less. With seven
# outputs, inverse dynamics, batches take a quarter more.
_MANY_OUTPUTS = 100

# Neighbouring outputs of a single sample that are written at once, by one part: the processor writes once or twice in a
# cycle, and the regressor of seven joints has 490 numbers. Longer runs of zeros than `_LONG` are written by a loop.
_TOGETHER = 4
_LONG = 64

_PAGE = 4096  # bytes

# Numbers in the widest register there is, a multiple of those in all others.
_WIDEST = 8


@dataclass(frozen=True)
class Fused:
    """A product and a sum as one operation with one rounding: ``(-)a b + (-)c``."""

    a: Node
    b: Node
    c: Node
    negative_product: bool
    negative_addend: bool


class Program:
    """The order in which the nodes of a function are computed.

    Sines and cosines of what the arguments give directly are computed together, after the first part.

    Attributes
    ----------
    uniform : set of int
        Indices of the nodes that are the same for all the samples.
    once : list of Node
        Operations that are the same for all the samples.
    angles : list of Node
        Nodes whose sine and cosine are computed after the first part.
    circular : dict
        For a sine or cosine of an angle, by index: the number of the angle and ``"sin"`` or ``"cos"``.
    fused : dict of int to Fused
    parts : list of list of Node
        Operations of a sample. Where there are angles the first part computes those that are not inputs.
    """

    def __init__(self, arguments: Sequence[Argument], outputs: Sequence[Node]) -> None:
        self.outputs = outputs
        self.inputs = {f"{a.name}[{k}]": (number, k) for number, a in enumerate(arguments) for k in range(a.width)}
        nodes = reachable(outputs)
        self.used_arguments = {self.inputs[str(n.value)][0] for n in nodes if n.operation == "input"}
        self.uniform: set[int] = set()
        for node in nodes:
            if node.operation == "input":
                same = arguments[self.inputs[str(node.value)][0]].uniform
            else:
                same = all(a.index in self.uniform for a in node.arguments)
            if same:
                self.uniform.add(node.index)
        operations = [n for n in nodes if n.operation not in ("input", "constant")]
        self.once = [n for n in operations if n.index in self.uniform]
        work = [n for n in operations if n.index not in self.uniform]
        self.angles, self.circular = self._find_angles(work)
        self.fused: dict[int, Fused] = {}
        work = self._fuse(work)
        self.parts = self._divide(work)

    def operands(self, node: Node) -> tuple[Node, ...]:
        """Return the nodes that an operation reads."""
        fused = self.fused.get(node.index)
        return node.arguments if fused is None else (fused.a, fused.b, fused.c)

    def _find_angles(self, work: list[Node]) -> tuple[list[Node], dict[int, tuple[int, str]]]:
        numbers: dict[int, int] = {}
        angles: list[Node] = []
        circular: dict[int, tuple[int, str]] = {}
        behind: set[int] = set()  # nodes that need a sine or cosine themselves
        for node in work:
            late = any(a.index in behind for a in node.arguments)
            if node.operation in ("sin", "cos"):
                behind.add(node.index)
                if not late:
                    angle = node.arguments[0]
                    if angle.index not in numbers:
                        numbers[angle.index] = len(angles)
                        angles.append(angle)
                    circular[node.index] = (numbers[angle.index], node.operation)
            elif late:
                behind.add(node.index)
        return angles, circular

    def _fuse(self, work: list[Node]) -> list[Node]:
        """Join sums with products that nothing else reads, so that every lane count rounds alike."""
        uses: dict[int, int] = {}
        for node in [argument for n in work for argument in n.arguments] + [*self.outputs, *self.angles]:
            uses[node.index] = uses.get(node.index, 0) + 1
        inside = {node.index for node in work}

        def alone(node: Node) -> bool:
            return node.operation == "mul" and node.index in inside and uses[node.index] == 1

        absorbed: set[int] = set()
        for node in work:
            if node.operation not in ("add", "sub"):
                continue
            x, y = node.arguments
            minus = node.operation == "sub"
            if alone(x):
                self.fused[node.index] = Fused(x.arguments[0], x.arguments[1], y, False, minus)
                absorbed.add(x.index)
            elif alone(y):
                self.fused[node.index] = Fused(y.arguments[0], y.arguments[1], x, minus, False)
                absorbed.add(y.index)
        return [node for node in work if node.index not in absorbed]

    def _divide(self, work: list[Node]) -> list[list[Node]]:
        first: set[int] = set()
        inside = {node.index for node in work}
        stack = list(self.angles)
        while stack:
            node = stack.pop()
            if node.index in inside and node.index not in first:
                first.add(node.index)
                stack.extend(self.operands(node))
        rest = [n for n in work if n.index not in first and n.index not in self.circular]
        if len(rest) > _UNDIVIDED or len(self.outputs) >= _MANY_OUTPUTS:
            rest = self._depth_first(rest)
        count = 1 if len(rest) <= _UNDIVIDED else -(-len(rest) // _PART)
        bounds = [len(rest) * k // count for k in range(count + 1)]
        parts = [rest[start:end] for start, end in pairwise(bounds)]
        if self.angles:
            parts.insert(0, [n for n in work if n.index in first])
        return parts

    def _depth_first(self, work: list[Node]) -> list[Node]:
        """Order by need, output after output, so that few values are kept from one part to another."""
        inside = {node.index for node in work}
        order: list[Node] = []
        done: set[int] = set()
        for output in self.outputs:
            stack: list[tuple[Node, int]] = [(output, 0)]
            while stack:
                node, position = stack.pop()
                if node.index in done or node.index not in inside:
                    continue
                operands = self.operands(node)
                if position < len(operands):
                    stack.append((node, position + 1))
                    stack.append((operands[position], 0))
                else:
                    done.add(node.index)
                    order.append(node)
        return order


def kernel_source(arguments: Sequence[Argument], outputs: Sequence[Node], *, lanes: int, triple: str = "") -> str:
    """Return the LLVM assembly of a function ``kernel(count, argument pointers…, out, cached)``.

    Output j of sample s goes to ``out[s * len(outputs) + j]``, past the cache where `cached` is negative.

    Parameters
    ----------
    arguments : sequence of Argument
        The arrays that the function reads; an array of samples is row-major, (count, width).
    lanes : int
        Samples computed side by side.
    triple : str
        Target triple.
    """
    return _Writer(arguments, outputs, lanes, triple).text()


class _Slots:
    """Places of all values in the workspace, in slots of one value each."""

    def __init__(self, program: Program, arguments: Sequence[Argument], lanes: int) -> None:
        self.of: dict[int, int] = {}
        self.total = 0
        self.arguments: dict[int, int] = {}
        if lanes > 1:
            for number, argument in enumerate(arguments):
                if number in program.used_arguments and not argument.uniform:
                    self.arguments[number] = self._take(_padded(argument.width, lanes))
        # Of single samples, a register holds several angles; their slots are the first, so they begin where one does.
        self.angle_count = len(program.angles) if lanes > 1 else _padded(len(program.angles), _WIDEST)
        self.angles = self._take(3 * self.angle_count)
        for index, (number, name) in program.circular.items():
            self.of[index] = self.angles + self.angle_count * (1 if name == "sin" else 2) + number
        self._place_what_crosses(program)
        # What moves the outputs may begin at any of them, and then reads past the last.
        self.outputs = self._take(_padded(len(program.outputs), lanes) + lanes) if lanes > 1 else self.total

    def _take(self, count: int) -> int:
        first = self.total
        self.total += count
        return first

    def _place_what_crosses(self, program: Program) -> None:
        """Give a slot to each value that a later part reads; parts after its last reader may have it again."""
        written = {node.index: k for k, part in enumerate(program.parts) for node in part}
        last: dict[int, int] = {}
        for k, part in enumerate(program.parts):
            for node in part:
                for operand in program.operands(node):
                    if written.get(operand.index, k) < k:
                        last[operand.index] = k
        free: list[int] = []
        ending: dict[int, list[int]] = {}
        for k, part in enumerate(program.parts):
            free += ending.pop(k - 1, [])
            for node in part:
                if node.index in last:
                    slot = free.pop() if free else self._take(1)
                    self.of[node.index] = slot
                    ending.setdefault(last[node.index], []).append(slot)


def _runs(flags: Sequence[bool], shortest: int) -> list[tuple[int, int]]:
    """Return where each run of so many flags that are set, or more, begins and ends."""
    runs, begin = [], 0
    for flag, neighbours in groupby(flags):
        end = begin + len(list(neighbours))
        if flag and end - begin >= shortest:
            runs.append((begin, end))
        begin = end
    return runs


def _padded(width: int, lanes: int) -> int:
    return -(-width // lanes) * lanes


class _Writer:
    def __init__(self, arguments: Sequence[Argument], outputs: Sequence[Node], lanes: int, triple: str) -> None:
        self.arguments = arguments
        self.outputs = outputs
        self.lanes = lanes
        self.triple = triple
        self.program = Program(arguments, outputs)
        self.slots = _Slots(self.program, arguments, lanes)
        self.once = {node.index: k for k, node in enumerate(self.program.once)}
        # Zeros are written before the rest.
        zero = [node.operation == "constant" and node.value == 0.0 for node in outputs]
        self.clears = any(zero) and lanes > 1
        self.runs = _runs(zero, 2 * lanes) if lanes > 1 else []
        self.columns: dict[int, list[int]] = {}
        for column, node in enumerate(outputs):
            if not zero[column]:
                self.columns.setdefault(node.index, []).append(column)
        self.zeros: list[tuple[int, int]] = []
        self.together: dict[int, list[str]] = {}
        if lanes == 1:
            self._join_outputs(zero)
        self.pointers = [f"%g{k}" for k in range(len(arguments))]
        # Whether there is a way past the cache: where rows have several whole lines of it. With 42 outputs it takes
        # two thirds of the time in large batches, with 16 a third more, because parts of lines take two turns. Rows
        # that all begin at the same place of a page get in each other's way unless much of them is zero: the inertia
        # matrix of eight joints takes half as long again at 5 and 20 MiB, and the regressors of a hand and of a
        # humanoid (20 and 80 KiB a sample) a third of the time of the way through the cache.
        whole_pages = 8 * lanes * len(outputs) % _PAGE == 0
        self.passes = lanes > 1 and len(outputs) >= 32 and bool(self.runs or not whole_pages)

    def _join_outputs(self, zero: list[bool]) -> None:
        """Find the neighbouring outputs that one part computes, zeros among them, and the runs of zeros beside them."""
        last = len(self.program.parts) - 1
        part = {node.index: number for number, nodes in enumerate(self.program.parts) for node in nodes}
        for start in range(0, len(zero), _TOGETHER):
            columns = range(start, min(start + _TOGETHER, len(zero)))
            writers = {part.get(self.outputs[column].index, last) for column in columns if not zero[column]}
            if len(writers) == 1:
                self.together[start] = ["0.0" if zero[column] else "" for column in columns]
                continue
            for column in columns:
                if zero[column] and self.zeros and sum(self.zeros[-1]) == column:
                    self.zeros[-1] = (self.zeros[-1][0], self.zeros[-1][1] + 1)
                elif zero[column]:
                    self.zeros.append((column, 1))

    def text(self) -> str:
        lines = [f'target triple = "{self.triple}"'] if self.triple else []
        for lanes in sorted({1, self.lanes}):
            lines += Instructions.declarations(lanes)
        lines += [f"declare void @{name}({types})" for name, types in SUPPORT.items()]
        # One pair more, which is read and not looked at.
        numbers = ", ".join(f"i64 {number}" for run in [*self.runs, (0, 0)] for number in run)
        lines.append(f"@runs = private constant [{2 * len(self.runs) + 2} x i64] [{numbers}]")
        last = len(self.program.parts) - 1
        for number, part in enumerate(self.program.parts):
            lines += self._part(number, part, is_last=number == last)
        lines += self._kernel()
        lines += ["attributes #0 = { nounwind }", "!0 = !{}"]
        return "\n".join(lines) + "\n"

    def _part(self, number: int, part: list[Node], *, is_last: bool) -> list[str]:
        """Return the function that computes some of the nodes of a block."""
        it = Instructions(self.lanes)
        names: dict[int, str] = {}
        pairs: dict[int, tuple[str, str]] = {}
        for node in part:
            names[node.index] = self._operation(it, node, names, pairs)
            if node.index in self.slots.of:
                it.store(names[node.index], "%w", self.slots.of[node.index])
            self._store_output(it, node, names[node.index])
        if number == 0:
            for k, angle in enumerate(self.program.angles):
                it.store(self._value(it, angle, names), "%w", self.slots.angles + k)
            for k in range(len(self.program.angles), self.slots.angle_count):
                it.store(it.constant(0.0), "%w", self.slots.angles + k)
        if is_last:
            computed = {node.index for p in self.program.parts for node in p}
            for node in {n.index: n for n in self.outputs}.values():
                same = self.lanes > 1 and node.index in self.program.uniform  # written once, before the loop
                if node.index not in computed and not same:
                    self._store_output(it, node, self._value(it, node, names))
        pointers = "".join(f"ptr noalias readonly {p}, " for p in self.pointers)
        # No slot that a part reads is one that it writes, so the two pointers may be told apart.
        head = f"ptr noalias readonly %r, ptr noalias %w, ptr noalias readonly %u, {pointers}ptr noalias %o"
        return [f"define internal void @part{number}({head}) #0 {{", *it.lines, "  ret void", "}"]

    def _value(self, it: Instructions, node: Node, names: dict[int, str]) -> str:
        """Return a value that a part reads; what is the same for all samples is read anew at each use."""
        name = names.get(node.index)
        if name is not None:
            return name
        if node.operation == "constant":
            return it.constant(float(node.value))
        if node.index in self.once:
            return it.load_same("%u", self.once[node.index])
        if node.operation == "input":
            number, column = self.program.inputs[str(node.value)]
            if self.lanes == 1 or self.arguments[number].uniform:
                return it.load_same(self.pointers[number], column)
            slot = self.slots.arguments[number] + column
        else:
            slot = self.slots.of[node.index]
        names[node.index] = it.load("%r", slot, unchanging=True)
        return names[node.index]

    def _operation(self, it: Instructions, node: Node, names: dict[int, str], pairs: dict[int, tuple[str, str]]) -> str:
        values = [self._value(it, operand, names) for operand in self.program.operands(node)]
        fused = self.program.fused.get(node.index)
        if fused is not None:
            a, b, c = values
            a = it.negative(a) if fused.negative_product else a
            return it.multiply_add(a, b, it.negative(c) if fused.negative_addend else c)
        return plain_operation(it, node, values, pairs)

    def _store_output(self, it: Instructions, node: Node, value: str) -> None:
        for column in self.columns.get(node.index, ()):
            if self.lanes > 1:
                it.store(value, "%w", self.slots.outputs + column)
                continue
            start = column - column % _TOGETHER
            values = self.together.get(start)
            if values is None:
                it.store(value, "%o", column)
                continue
            values[column - start] = value
            if all(values):
                it.store_row(values, "%o", start)

    def _kernel(self) -> list[str]:
        """Return the function that is called: what is done once, then the loop over blocks."""
        scalar, vector = Instructions(1, "c"), Instructions(self.lanes, "v")
        self._compute_once(scalar, vector)
        block = Instructions(self.lanes, "b")
        self._block(block)
        parameters = "".join(f"ptr noalias readonly {p}, " for p in self.pointers)
        return [
            f"define void @kernel(i64 %count, {parameters}ptr noalias %out, i64 %cached) #0 {{",
            "entry:",
            f"  %w = alloca [{max(1, self.slots.total)} x {vector.type}], align 64",
            f"  %u = alloca [{max(1, len(self.once))} x double], align 64",
            *scalar.lines,
            *self._clearing(),
            *vector.lines,
            "  %last = sub i64 %count, 1",
            "  %past = icmp slt i64 %cached, 0",
            "  %some = icmp sgt i64 %count, 0",
            "  br i1 %some, label %body, label %done",
            "body:",
            "  %s = phi i64 [ 0, %entry ], [ %following, %body ]",
            *block.lines,
            f"  %following = add i64 %s, {self.lanes}",
            "  %more = icmp slt i64 %following, %count",
            "  br i1 %more, label %body, label %done",
            "done:",
            *(["  br i1 %past, label %settle, label %end", "settle:", "  fence seq_cst"] if self.passes else []),
            *(["  br label %end", "end:"] if self.passes else []),
            "  ret void",
            "}",
        ]

    def _samples(self, it: Instructions) -> tuple[str, str]:
        """Write which samples a turn of the loop computes: the first, and the distance from one to the next.

        Neighbours, as a rule. Where outputs are written past the cache, a square block of samples is computed in
        turns of samples that lie a register apart: their rows begin at the same place of a line of the cache.
        """
        if not self.passes:
            return "%s", "1"
        square = self.lanes * self.lanes
        base = it.new(f"and i64 %s, {-square}")
        whole = it.new(f"icmp sle i64 {it.new(f'add i64 {base}, {square}')}, %count")
        apart = it.new(f"and i1 %past, {whole}")
        turn = it.new(f"udiv i64 {it.new(f'sub i64 %s, {base}')}, {self.lanes}")
        first = it.new(f"select i1 {apart}, i64 {it.new(f'add i64 {base}, {turn}')}, i64 %s")
        return first, it.new(f"select i1 {apart}, i64 {self.lanes}, i64 1")

    def _clearing(self) -> list[str]:
        """Return what writes zeros into the slots of outputs, where those that are zero stay so.

        What lies deep in a run of zeros is never read.
        """
        if not self.clears:
            return []
        it = Instructions(self.lanes, "z")
        begins = [0, *(end - self.lanes for _, end in self.runs)]
        ends = [*(begin + self.lanes for begin, _ in self.runs), len(self.outputs)]
        for begin, end in zip(begins, ends, strict=True):
            start = it.new(f"getelementptr {it.type}, ptr %w, i64 {self.slots.outputs + begin}")
            it.lines.append(f"  call void @clear(ptr {start}, i64 {self.lanes * (end - begin)})")
        return it.lines

    def _compute_once(self, scalar: Instructions, vector: Instructions) -> None:
        """Write what is the same for all the samples: operations as numbers, outputs into their slots."""
        names: dict[int, str] = {}
        pairs: dict[int, tuple[str, str]] = {}

        def value(node: Node) -> str:
            if node.index not in names:
                if node.operation == "constant":
                    return scalar.constant(float(node.value))
                number, column = self.program.inputs[str(node.value)]
                names[node.index] = scalar.load(self.pointers[number], column)
            return names[node.index]

        for node in self.program.once:
            names[node.index] = plain_operation(scalar, node, [value(a) for a in node.arguments], pairs)
            scalar.store(names[node.index], "%u", self.once[node.index])
        if self.lanes == 1:
            return
        for node in {n.index: n for n in self.outputs if n.index in self.program.uniform}.values():
            constant = node.operation == "constant"
            self._store_output(
                vector, node, vector.constant(float(node.value)) if constant else vector.same(value(node))
            )

    def _block(self, it: Instructions) -> None:
        """Write one turn of the loop: read, compute, write."""
        pointers, out = list(self.pointers), "%out"
        if self.lanes == 1:
            for number, argument in enumerate(self.arguments):
                if not argument.uniform:
                    start = it.new(f"mul i64 %s, {argument.width}")
                    pointers[number] = it.new(f"getelementptr double, ptr %g{number}, i64 {start}")
            start = it.new(f"mul i64 %s, {len(self.outputs)}")
            out = it.new(f"getelementptr double, ptr %out, i64 {start}")
        for column, count in self.zeros:
            if count > _LONG:
                it.lines.append(
                    f"  call void @clear(ptr {it.new(f'getelementptr double, ptr {out}, i64 {column}')}, i64 {count})"
                )
            else:
                it.store_row(["0.0"] * count, out, column)
        first, step = self._samples(it)
        for number, slot in self.slots.arguments.items():
            target = it.new(f"getelementptr {it.type}, ptr %w, i64 {slot}")
            width = self.arguments[number].width
            given = f"ptr %g{number}, i64 {width}, i64 {first}, i64 {step}, i64 %last, ptr {target}"
            it.lines.append(f"  call void @gather({given})")
        given = "".join(f"ptr {p}, " for p in pointers)
        for number in range(len(self.program.parts)):
            it.lines.append(f"  call void @part{number}(ptr %w, ptr %w, ptr %u, {given}ptr {out})")
            if number == 0 and self.program.angles:
                angles = it.new(f"getelementptr {it.type}, ptr %w, i64 {self.slots.angles}")
                it.lines.append(
                    f"  call void @sines_and_cosines(ptr {angles}, i64 {self.lanes * self.slots.angle_count})"
                )
        if self.lanes > 1:
            source = it.new(f"getelementptr {it.type}, ptr %w, i64 {self.slots.outputs}")
            given = f"ptr {source}, i64 {len(self.outputs)}, i64 {first}, i64 {step}, i64 %last, ptr %out"
            it.lines.append(f"  call void @scatter({given}, ptr @runs, i64 {len(self.runs)})")


def plain_operation(it: Instructions, node: Node, values: list[str], pairs: dict[int, tuple[str, str]]) -> str:
    """Write one operation; `pairs` keeps sine and cosine of an angle, which are computed together."""
    kind = node.operation
    if kind in ("add", "sub", "mul", "div"):
        return it.binary(kind, values[0], values[1])
    if kind == "neg":
        return it.negative(values[0])
    if kind == "sign":
        return it.sign(values[0])
    if kind == "sqrt":
        return it.square_root(values[0])
    if kind == "exp":
        return it.exponential(values[0])
    if kind == "log":
        return it.logarithm(values[0])
    angle = node.arguments[0].index
    if angle not in pairs:
        pairs[angle] = it.sine_and_cosine(values[0])
    return pairs[angle][0 if kind == "sin" else 1]
