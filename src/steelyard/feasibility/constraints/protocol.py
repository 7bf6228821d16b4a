"""What a constraint is: anything that gives blocks and equations for a model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from steelyard.lmi import AffineBlock

from ..protocols import ModelLike

__all__ = ["Constraint", "Equality"]


@dataclass(frozen=True, eq=False)
class Equality:
    """A linear equation coefficients · δ[indices] = value.

    Attributes
    ----------
    name : str
        What it says, e.g. ``"total mass = 27 kg"``.
    indices : (c,)
        Which parameters it is about.
    coefficients : (c,)
    value : float
    """

    name: str
    indices: npt.NDArray[np.intp]
    coefficients: npt.NDArray[np.float64]
    value: float

    def __repr__(self) -> str:
        plural = "" if len(self.indices) == 1 else "s"
        return f"Equality({self.name!r}, of {len(self.indices)} parameter{plural})"


class Constraint(Protocol):
    """Anything that gives blocks (and equations) for a model; users may add their own classes.

    Examples
    --------
    >>> class Heavy:
    ...     def blocks(self, model):
    ...         mass = list(model.parameter_names).index("m1")
    ...         return (AffineBlock("link 1 >= 2 kg", -2 * np.eye(1), np.array([mass]), np.ones((1, 1, 1))),)
    ...
    ...     def equalities(self, model):
    ...         return ()
    >>> from steelyard.dynamics import Model
    >>> from steelyard.feasibility import FeasibleSet
    >>> from steelyard.robot import Robot
    >>> FeasibleSet(Model(Robot.from_dh([("0", 0.0, 0.0, "q")])), constraints=[Heavy()]).blocks[-1].name
    'link 1 >= 2 kg'
    """

    def blocks(self, model: ModelLike) -> tuple[AffineBlock, ...]:
        """Matrices that must be positive semidefinite."""

    def equalities(self, model: ModelLike) -> tuple[Equality, ...]:
        """Equations that must hold."""
