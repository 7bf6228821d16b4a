"""Denavit-Hartenberg tables, standard and modified."""

import ast
import math
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from steelyard.errors import InputError
from steelyard.robot.joint import Joint, JointKind, Link
from steelyard.robot.placement import rotation_x, rotation_z, translation
from steelyard.robot.robot import Robot

__all__ = ["robot_from_dh"]

COLUMNS = ("alpha", "a", "d", "theta")


class _Affine(NamedTuple):
    """An expression `slope * q + constant`."""

    slope: float
    constant: float


def robot_from_dh(
    rows: Sequence[Sequence[float | str]], convention: str, name: str, gravity: ArrayLike, where: str = "DH table"
) -> Robot:
    """See `Robot.from_dh`; `where` begins the messages."""
    if convention not in ("standard", "modified"):
        raise InputError(f'{where}: the convention must be "standard" or "modified", got {convention!r}')
    if isinstance(rows, str | bytes) or not hasattr(rows, "__len__"):
        raise InputError(f"{where}: rows of four cells (alpha, a, d, theta) were expected, got {rows!r}")
    if len(rows) == 0:
        raise InputError(f"{where} has no rows; give one row (alpha, a, d, theta) for each joint")
    joints = tuple(_joint(row, number, convention, where) for number, row in enumerate(rows, start=1))
    links = tuple(Link(f"link{number}") for number in range(1, len(joints) + 1))
    return Robot(name, joints, links, np.asarray(gravity, dtype=object))


def _joint(row: Sequence[float | str], number: int, convention: str, where: str) -> Joint:
    place = f"{where}, row {number}"
    if isinstance(row, str | bytes) or not hasattr(row, "__len__") or len(row) != 4:
        raise InputError(f"{place}: four cells (alpha, a, d, theta) were expected, got {row!r}")
    cells = {column: _parse(cell, number, f"{place}, {column}") for column, cell in zip(COLUMNS, row, strict=True)}
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
    return Joint(f"joint{number}", kind, number - 2, before, after, coordinate=number - 1)


def _parse(cell: object, number: int, place: str) -> _Affine:
    if isinstance(cell, str):
        try:
            value = _evaluate(ast.parse(cell.strip(), mode="eval").body, number)
        except (SyntaxError, ValueError, RecursionError, MemoryError, OverflowError, ZeroDivisionError) as error:
            reason = str(error) if type(error) is ValueError else "it is not a valid expression"
            raise InputError(
                f'{place}: cannot read {cell!r} ({reason}); give a number or an expression such as "q+pi/2"'
            ) from None
    elif isinstance(cell, int | float | np.integer | np.floating) and not isinstance(cell, bool):
        value = _Affine(0.0, float(cell))
    else:
        raise InputError(f'{place}: a number or an expression such as "q+pi/2" was expected, got {cell!r}')
    if not (math.isfinite(value.slope) and math.isfinite(value.constant)):
        raise InputError(f"{place}: a finite value was expected, got {cell!r}")
    return value


def _evaluate(node: ast.expr, number: int) -> _Affine:
    """The value of an expression of numbers, pi, q, + - * / and parentheses."""
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
                raise ValueError(f"{name!r} is unknown; only pi and q are known")
            if numbered[1] and int(numbered[1]) != number:
                raise ValueError(f"{name!r} stands in the row of joint {number}, which may only hold q or q{number}")
            return _Affine(1.0, 0.0)
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            value = _evaluate(operand, number)
            return _Affine(-value.slope, -value.constant)
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return _evaluate(operand, number)
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub() | ast.Mult() | ast.Div() as operator, right=right):
            return _combine(_evaluate(left, number), operator, _evaluate(right, number))
    raise ValueError("only numbers, pi, q, + - * / and parentheses may be used")


def _combine(left: _Affine, operator: ast.operator, right: _Affine) -> _Affine:
    match operator:
        case ast.Add():
            return _Affine(left.slope + right.slope, left.constant + right.constant)
        case ast.Sub():
            return _Affine(left.slope - right.slope, left.constant - right.constant)
        case ast.Mult() if left.slope == 0.0 or right.slope == 0.0:
            slope = left.slope * right.constant + left.constant * right.slope
            return _Affine(slope, left.constant * right.constant)
        case ast.Div() if right.slope == 0.0:
            if right.constant == 0.0:
                raise ValueError("it divides by zero")
            return _Affine(left.slope / right.constant, left.constant / right.constant)
    raise ValueError("it must be q times a constant plus a constant")
