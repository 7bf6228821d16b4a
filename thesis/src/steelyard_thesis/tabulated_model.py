"""A robot of which only the table of its base parameters is known, as publications print it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics.base_parameters import BaseParameters
from steelyard.dynamics.conditions import body_conditions
from steelyard.errors import InputError
from steelyard.lmi import AffineBlock
from steelyard.robot import INERTIA_SYMBOLS

__all__ = ["TabulatedModel", "TabulatedRobot"]


@dataclass(frozen=True, eq=False)
class TabulatedRobot:
    """The names of a robot of which only base parameters are known.

    Attributes
    ----------
    name : str
    link_names : tuple of str
    parameters : ndarray
        (n,) values from CAD: NaN, since there are none.
    """

    name: str
    link_names: tuple[str, ...]
    parameters: NDArray[np.float64]


class TabulatedModel:
    """Rigid links of which only the combinations of base parameters are known.

    It has what `FeasibleSet`, `check`, `correct`, `fit` and the earlier methods ask of a model, but neither kinematics
    nor torques: a published table of base parameters does not tell them.

    Parameters
    ----------
    link_names : sequence of str
        N links, each with the ten parameters ``Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m`` and its number, from 1 on.
    combinations : sequence of mapping from str to float
        For each base parameter the coefficients of the standard parameters in it. The first one leads it: it has the
        coefficient 1 and is in no other combination.
    name : str
        Of the robot.

    Raises
    ------
    InputError
        If a combination names a parameter that no link has, or does not begin with a parameter of its own.

    Examples
    --------
    Two bodies of which a motion shows only how much they weigh together:

    >>> model = TabulatedModel(["arm", "hand"], [{"m1": 1.0, "m2": 1.0}], name="pair")
    >>> model.base_parameters().expressions
    ('m1 + m2',)
    >>> from steelyard.feasibility import FeasibleSet, check
    >>> check(FeasibleSet(model), base=[-1.0]).status
    'infeasible'
    """

    def __init__(
        self, link_names: Sequence[str], combinations: Sequence[Mapping[str, float]], name: str = "robot"
    ) -> None:
        count = len(link_names)
        self.parameter_names = tuple(f"{s}{link}" for link in range(1, count + 1) for s in INERTIA_SYMBOLS)
        self.robot = TabulatedRobot(name, tuple(link_names), np.full(len(self.parameter_names), np.nan))
        K = np.zeros((len(combinations), len(self.parameter_names)))
        places = {text: k for k, text in enumerate(self.parameter_names)}
        for row, combination in zip(K, combinations, strict=True):
            for text, coefficient in combination.items():
                if text not in places:
                    raise InputError(
                        f"base parameters of {name} name {text!r}, which none of its {count} links has; parameters are "
                        f"called {', '.join(INERTIA_SYMBOLS)} with the number of the link, 1 to {count}."
                    )
                row[places[text]] = coefficient
        independent = [places[next(iter(combination), "")] for combination in combinations if combination]
        if len(independent) < len(K) or not np.array_equal(K[:, independent], np.eye(len(K))):
            raise InputError(
                f"each base parameter of {name} must begin with a standard parameter of its own, with coefficient 1."
            )
        dependent = [k for k in range(len(places)) if k not in set(independent)]
        self._base = BaseParameters(
            self.parameter_names,
            np.array(independent, dtype=np.intp),
            np.array(dependent, dtype=np.intp),
            K[:, dependent],
        )

    def __repr__(self) -> str:
        return (
            f"TabulatedModel({self.robot.name}: {len(self.robot.link_names)} links, {self._base.count} base parameters)"
        )

    def base_parameters(self) -> BaseParameters:
        """Return the combinations."""
        return self._base

    def conditions(self, consistency: str) -> tuple[AffineBlock, ...]:
        """Return the matrices of the links that must be positive semidefinite.

        Parameters
        ----------
        consistency : {"full", "inertia"}
            As in `steelyard.FeasibleSet`.
        """
        names = self.robot.link_names
        return body_conditions(names, range(0, 10 * len(names), 10), consistency)
