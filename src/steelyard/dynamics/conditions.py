"""The matrices that must be positive semidefinite for the parameters of links and terms to be physically possible."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.lmi import AffineBlock
from steelyard.robot import Robot
from steelyard.robot.inertia import PSEUDO_INERTIA

__all__ = ["CONSISTENCIES", "body_conditions", "model_conditions"]

CONSISTENCIES = ("full", "inertia")


def _symmetric(size: int, entries: list[tuple[int, int, float]]) -> NDArray[np.float64]:
    matrix = np.zeros((size, size))
    for i, j, value in entries:
        matrix[i, j] = matrix[j, i] = value
    return matrix


def _inertia_coefficients() -> NDArray[np.float64]:
    """Coefficients of the 6x6 matrix of thesis eq. 3.20, for ``Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m``."""
    tensor = [[(0, 0, 1.0)], [(0, 1, 1.0)], [(0, 2, 1.0)], [(1, 1, 1.0)], [(1, 2, 1.0)], [(2, 2, 1.0)]]
    first = [
        [(1, 5, 1.0), (2, 4, -1.0)],
        [(0, 5, -1.0), (2, 3, 1.0)],
        [(0, 4, 1.0), (1, 3, -1.0)],
    ]
    mass = [[(3, 3, 1.0), (4, 4, 1.0), (5, 5, 1.0)]]
    return np.array([_symmetric(6, entries) for entries in tensor + first + mass])


@cache
def _body_coefficients(consistency: str) -> NDArray[np.float64]:
    if consistency not in CONSISTENCIES:
        raise InputError(f"consistency must be 'full' or 'inertia', got {consistency!r}.")
    return _inertia_coefficients() if consistency == "inertia" else PSEUDO_INERTIA.copy()


def body_conditions(link_names: Sequence[str], columns: Sequence[int], consistency: str) -> tuple[AffineBlock, ...]:
    """Return the conditions of the bodies of links.

    Parameters
    ----------
    columns : sequence of int
        Where the ten parameters ``Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m`` of each link begin.
    consistency : {"full", "inertia"}
        As in `model_conditions`.

    Raises
    ------
    InputError
        If `consistency` is something else.

    Examples
    --------
    >>> [(c.name, c.size, c.indices[0].item()) for c in body_conditions(["arm", "hand"], [0, 10], "full")]
    [('body of arm', 4, 0), ('body of hand', 4, 10)]
    """
    coefficients = _body_coefficients(consistency)
    zero = np.zeros(coefficients.shape[1:])
    return tuple(
        AffineBlock(f"body of {name}", zero, np.arange(column, column + 10), coefficients, "link", link=name)
        for name, column in zip(link_names, columns, strict=True)
    )


def model_conditions(robot: Robot, consistency: str) -> tuple[AffineBlock, ...]:
    """Return the conditions of all the links and terms of a robot.

    Parameters
    ----------
    consistency : {"full", "inertia"}
        ``"inertia"``: positive mass and positive definite inertia about the centre of mass (thesis eq. 3.20).
        ``"full"``: a positive mass density exists, so that the triangle inequality holds too (Traversaro et al. 2016;
        Wensing et al. 2018).

    Raises
    ------
    InputError
        If `consistency` is something else.
    """
    driving = {joint: k for k, joint in enumerate(robot.driving_joints)}
    result: list[AffineBlock] = []
    column = 0
    for index, link in enumerate(robot.links):
        result.extend(body_conditions([link.name], [column], consistency))
        column += 10
        if index not in driving:
            continue
        joint = robot.joints[index]
        for term in robot.terms:
            symbols = [p.symbol for p in term.parameters]
            units = {p.symbol: p.unit_prismatic if joint.kind == "prismatic" else p.unit for p in term.parameters}
            for condition in term.conditions_at(driving[index]):
                used = [s for s in symbols if s in condition.coefficients]
                result.append(
                    AffineBlock(
                        name=f"{condition.name} at {joint.name}",
                        constant=np.asarray(condition.constant, dtype=np.float64),
                        indices=np.array([column + symbols.index(s) for s in used], dtype=np.intp),
                        coefficients=np.array([condition.coefficients[s] for s in used], dtype=np.float64),
                        kind="term",
                        unit=units[used[0]] if len(used) == 1 else "",
                        joint=joint.name,
                    )
                )
            column += len(symbols)
    return tuple(result)
