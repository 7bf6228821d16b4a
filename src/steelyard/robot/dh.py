"""Denavit-Hartenberg tables, standard and modified."""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from steelyard.errors import InputError
from steelyard.files import TomlTable, shown, suggestion
from steelyard.files.arguments import LARGEST

from .described_tree import DescribedJoint, DescribedLink, DescribedTree
from .inertia import Inertia, inertia_tensor
from .joint import Joint, JointKind
from .placement import rotation_x, rotation_z, translation

__all__ = ["dh_inertias", "dh_tree"]

_Shifts = dict[str, tuple[float, float, float]]
# No cell of a table is longer; Python's parser would recurse through the parentheses of an endless one.
LONGEST_CELL = 200

COLUMNS = ("alpha", "a", "d", "theta")
INERTIAL_KEYS = ("link", "mass", "center_of_mass", "inertia")


class _Affine(NamedTuple):
    """An expression `slope * q + constant + sum of coefficient * length`."""

    slope: float
    constant: float
    lengths: Mapping[str, float] = {}

    def times(self, factor: float) -> _Affine:
        lengths = {name: value * factor for name, value in self.lengths.items()}
        return _Affine(self.slope * factor, self.constant * factor, lengths)

    def plus(self, other: _Affine) -> _Affine:
        lengths = {n: self.lengths.get(n, 0.0) + other.lengths.get(n, 0.0) for n in {**self.lengths, **other.lengths}}
        used = {name: value for name, value in lengths.items() if value != 0.0}
        return _Affine(self.slope + other.slope, self.constant + other.constant, used)


def dh_tree(
    rows: Sequence[Sequence[float | str]],
    convention: str,
    name: str,
    where: str = "DH table",
    inertias: Mapping[str, Inertia] | None = None,
    lengths: Mapping[str, float] | None = None,
) -> DescribedTree:
    """Return the joints and links of a robot, see `Robot.from_dh`.

    Parameters
    ----------
    rows, convention, name, inertias
        As in `Robot.from_dh`.
    where : str
        Begins the messages.
    lengths : mapping, optional
        Numbers (m) for names of lengths; names without a value stay symbols.
    """
    if convention not in ("standard", "modified"):
        raise InputError(f'{where}: the convention must be "standard" or "modified", got {convention!r}')
    if isinstance(rows, str | bytes) or not hasattr(rows, "__len__"):
        raise InputError(f"{where}: rows of four cells (alpha, a, d, theta) were expected, got {rows!r}")
    if len(rows) == 0:
        raise InputError(f"{where} has no rows; give one row (alpha, a, d, theta) for each joint")
    joints = [_joint(row, number, convention, where) for number, row in enumerate(rows, start=1)]
    names = [f"link{number}" for number in range(1, len(joints) + 1)]
    known = inertias or {}
    for link in known:
        if link not in names:
            raise InputError(
                f"{where}: an inertia is given for {shown(link)}, which is no link; {suggestion(link, names)}"
            )
    symbols = list(dict.fromkeys(symbol for j in joints for symbol in (*j.before_lengths, *j.after_lengths)))
    for symbol, value in (lengths or {}).items():
        if symbol not in symbols:
            raise InputError(f'{where}: there is no symbolic length "{symbol}"; it has {", ".join(symbols) or "none"}')
        if not math.isfinite(value):
            raise InputError(f'{where}: the length "{symbol}" must be finite, got {value!r}')
    parents = ["base", *names]
    described = {}
    for joint, parent, child in zip(joints, parents, names, strict=False):
        one = joint.with_lengths(lengths or {})
        described[one.name] = DescribedJoint(
            one.name, one.parent + 2, one.kind, parent, child, one.before, child_placement=one.after,
            before_lengths=one.before_lengths, after_lengths=one.after_lengths,
        )  # fmt: skip
    links = {link: DescribedLink(link, number, known.get(link)) for number, link in enumerate(parents)}
    return DescribedTree(where, name, links, described, unwritten_is_massless=False)


def dh_inertias(table: TomlTable) -> dict[str, Inertia]:
    """Return the inertias of the links that the tables ``inertials`` of a description give, by their names.

    Each has ``link``, ``mass`` (kg), ``center_of_mass`` (3, m) and ``inertia`` (kg m²: xx xy xz yy yz zz about the
    centre of mass), in the frame of the link.
    """
    found: dict[str, Inertia] = {}
    for where, content in table.tables("inertials", "description.inertials"):
        one = TomlTable(content, where, INERTIAL_KEYS, "is not known of an inertia")
        one.require(*INERTIAL_KEYS)
        name = one.text("link", "the name of a link, such as link1") or ""
        if name in found:
            raise InputError(f"{where}: {name} has an inertia already; keep one table for each link")
        mass = one.number("mass")
        if mass < 0.0:
            raise one.refuse("mass", "a mass in kg, not negative")
        center = one.numbers("center_of_mass", 3, expected="three numbers in m")
        elements = one.numbers(
            "inertia", 6, expected="six numbers in kg m², xx xy xz yy yz zz about the centre of mass"
        )
        found[name] = Inertia.from_com(mass, center, inertia_tensor(elements))
    return found


def _joint(row: Sequence[float | str], number: int, convention: str, where: str) -> Joint:
    place = f"{where}, row {number}"
    if isinstance(row, str | bytes) or not hasattr(row, "__len__") or len(row) != 4:
        raise InputError(f"{place}: four cells (alpha, a, d, theta) were expected, got {row!r}")
    cells = {
        column: _parse(cell, number, f"{place}, {column}", column in ("a", "d"))
        for column, cell in zip(COLUMNS, row, strict=True)
    }
    moving = [column for column in COLUMNS if cells[column].slope != 0.0]
    for column in ("alpha", "a"):
        if column in moving:
            raise InputError(f"{place}: only d or theta may hold q, but {column} is {row[COLUMNS.index(column)]!r}")
    if len(moving) != 1:
        found = "both do" if moving else "neither does"
        raise InputError(f'{place}: exactly one of d and theta must hold q, but {found}; write "q" in the moving one')
    slope = cells[moving[0]].slope
    if abs(slope) != 1.0:
        raise InputError(
            f"{place}, {moving[0]}: q must have the coefficient 1 or -1, got {slope:g}; let q be the joint value"
        )

    alpha, a, d, theta = (cells[column].constant for column in COLUMNS)
    kind: JointKind = "revolute" if moving == ["theta"] else "prismatic"
    # The constant parts of d and theta commute with the motion, so they can all stand before it.
    along_z = rotation_z(theta) @ translation(0.0, 0.0, d)
    along_x = rotation_x(alpha) @ translation(a, 0.0, 0.0)
    before, after = (along_z, along_x) if convention == "standard" else (along_x @ along_z, np.eye(4))
    if slope < 0:
        # Turning by -q about z is turning by q about the z axis of a frame flipped by pi about x.
        flip = rotation_x(math.pi)
        before, after = before @ flip, flip @ after
    shifts_a = {name: (value, 0.0, 0.0) for name, value in cells["a"].lengths.items()}
    direction = (0.0, 0.0, 1.0) if convention == "standard" else tuple(rotation_x(alpha)[:3, 2].tolist())
    shifts_d = {name: tuple(value * x for x in direction) for name, value in cells["d"].lengths.items()}
    if convention == "modified":
        shifts_a, shifts_d = {}, _added(shifts_a, shifts_d)
    return Joint(
        f"joint{number}",
        kind,
        number - 2,
        before,
        after,
        coordinate=number - 1,
        before_lengths=shifts_d,
        after_lengths=shifts_a,
    )


def _added(first: _Shifts, second: _Shifts) -> _Shifts:
    zero = (0.0, 0.0, 0.0)
    names = dict.fromkeys([*first, *second])
    return {
        n: tuple(x + y for x, y in zip(first.get(n, zero), second.get(n, zero), strict=True))  # type: ignore[misc]
        for n in names
    }


def _parse(cell: object, number: int, place: str, is_length: bool) -> _Affine:
    if isinstance(cell, str):
        if len(cell) > LONGEST_CELL:
            raise InputError(
                f"{place}: cannot read {shown(cell)} (it is too long); give a number or a short expression"
            )
        try:
            value = _evaluate(ast.parse(cell.strip(), mode="eval").body, number)
            if value.lengths and not is_length:
                raise ValueError(f"{next(iter(value.lengths))!r} is unknown; only pi and q are known in an angle")
        except (SyntaxError, ValueError, RecursionError, MemoryError, OverflowError, ZeroDivisionError) as error:
            reason = str(error) if type(error) is ValueError else "it is not a valid expression"
            raise InputError(
                f'{place}: cannot read {cell!r} ({reason}); give a number or an expression such as "q+pi/2"'
            ) from None
    elif isinstance(cell, int | float | np.integer | np.floating) and not isinstance(cell, bool):
        value = _Affine(0.0, float(cell))
    else:
        raise InputError(f'{place}: a number or an expression such as "q+pi/2" was expected, got {shown(cell)}')
    if not all(abs(number) <= LARGEST for number in (value.slope, value.constant, *value.lengths.values())):
        raise InputError(f"{place}: a value below {LARGEST:g} was expected, got {shown(cell)}")
    return value


def _evaluate(node: ast.expr, number: int) -> _Affine:
    """The value of an expression of numbers, pi, q, names of lengths, + - * / and parentheses."""
    match node:
        case ast.Constant(value=bool()):
            raise ValueError("True and False are no numbers")
        case ast.Constant(value=int() | float() as literal):
            return _Affine(0.0, float(literal))
        case ast.Name(id="pi"):
            return _Affine(0.0, math.pi)
        case ast.Name(id=name):
            numbered = re.fullmatch(r"q_?(\d*)", name)
            if numbered is None:
                return _Affine(0.0, 0.0, {name: 1.0})
            if numbered[1] and int(numbered[1]) != number:
                raise ValueError(f"{name!r} stands in the row of joint {number}, which may only hold q or q{number}")
            return _Affine(1.0, 0.0)
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            value = _evaluate(operand, number)
            return value.times(-1.0)
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return _evaluate(operand, number)
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub() | ast.Mult() | ast.Div() as operator, right=right):
            return _combine(_evaluate(left, number), operator, _evaluate(right, number))
    raise ValueError("only numbers, pi, q, names of lengths, + - * / and parentheses may be used")


def _combine(left: _Affine, operator: ast.operator, right: _Affine) -> _Affine:
    match operator:
        case ast.Add():
            return left.plus(right)
        case ast.Sub():
            return left.plus(right.times(-1.0))
        case ast.Mult() if not (left.slope or left.lengths):
            return right.times(left.constant)
        case ast.Mult() if not (right.slope or right.lengths):
            return left.times(right.constant)
        case ast.Div() if not (right.slope or right.lengths):
            if right.constant == 0.0:
                raise ValueError("it divides by zero")
            c = right.constant
            return _Affine(left.slope / c, left.constant / c, {n: v / c for n, v in left.lengths.items()})
    raise ValueError("it must be a sum of numbers, q and lengths with constant factors")
