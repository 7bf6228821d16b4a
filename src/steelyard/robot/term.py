"""What a term of the model is: the base class of friction, rotor inertia and whatever users add."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .joint import Joint
    from .robot import Robot

__all__ = ["Condition", "Term", "TermParameter"]

Matrix = NDArray[np.float64]


@dataclass(frozen=True)
class TermParameter:
    """One parameter that a term has for each coordinate.

    Parameters
    ----------
    symbol : str
        Symbol without the joint's number, such as "Fv".
    unit, unit_prismatic : str
        Unit at a revolute and at a prismatic joint.
    description : str
        What it is, in a few words.
    nonnegative : bool
        Whether a negative value is physically impossible.

    Examples
    --------
    >>> TermParameter("Fv", "N·m·s/rad", "N·s/m", "viscous friction", nonnegative=True).symbol
    'Fv'
    """

    symbol: str
    unit: str
    unit_prismatic: str
    description: str
    nonnegative: bool


@dataclass(frozen=True, eq=False)
class Condition:
    """An affine matrix of a term's parameters that is positive semidefinite where the term is physically possible.

    The matrix is `constant + sum(value[symbol] * coefficients[symbol])`.

    Parameters
    ----------
    name : str
        What must hold, in a few words.
    size : int
        Order d of the matrix.
    constant : (d, d) array
        Constant part.
    coefficients : mapping from symbol to (d, d) array
        Symmetric coefficient of each parameter.

    Examples
    --------
    >>> Condition("Fv <= 5", 1, np.array([[5.0]]), {"Fv": np.array([[-1.0]])}).name
    'Fv <= 5'
    """

    name: str
    size: int
    constant: Matrix
    coefficients: Mapping[str, Matrix]


class Term(ABC):
    """A part of the joint torques that is linear in parameters of its own.

    A subclass sets `kind` (its name in robot.toml) and `parameters` (those that it has for *each* coordinate), and
    gives its regressor columns over generic scalars.

    Examples
    --------
    >>> class Spring(Term):
    ...     kind = "spring"
    ...     parameters = (TermParameter("Ks", "N·m/rad", "N/m", "stiffness of a spring at q = 0", nonnegative=True),)
    ...
    ...     def columns(self, k, q, dq, ddq, algebra):
    ...         return ({k: q[k]},)
    >>> Spring().columns(0, [0.5], [0.0], [0.0], None)
    ({0: 0.5},)
    >>> [condition.name for condition in Spring().conditions()]
    ['Ks >= 0']
    """

    kind: ClassVar[str]
    parameters: tuple[TermParameter, ...]

    @abstractmethod
    def columns(
        self, k: int, q: Sequence[Any], dq: Sequence[Any], ddq: Sequence[Any], algebra: Any
    ) -> tuple[dict[int, Any], ...]:
        """Regressor columns of coordinate `k`: for each parameter, torque row -> scalar (absent rows are 0).

        Parameters
        ----------
        k : int
            Index of the coordinate.
        q, dq, ddq : sequence of N scalars
            Coordinates (rad or m), speeds and accelerations; any type with + - *.
        algebra : object
            Functions that operators do not give, over the same scalars (`sin`, `cos`, `sign`, ...).
        """

    def nominal(self, joint: Joint) -> tuple[float, ...]:
        """Values that the description gives at the driving joint, one a parameter; NaN where unknown."""
        return (np.nan,) * len(self.parameters)

    def potential(self, k: int, q: Sequence[Any], algebra: Any) -> tuple[Any, ...]:
        """Potential energy (J) of coordinate `k` by each parameter; none, unless a subclass (a spring) says so."""
        return (0.0,) * len(self.parameters)

    def conditions(self) -> tuple[Condition, ...]:
        """Conditions on the parameters of one coordinate; by default each nonnegative parameter is at least 0."""
        return tuple(
            Condition(f"{parameter.symbol} >= 0", 1, np.zeros((1, 1)), {parameter.symbol: np.ones((1, 1))})
            for parameter in self.parameters
            if parameter.nonnegative
        )

    def check(self, robot: Robot) -> None:
        """Raise InputError where the term does not fit the robot (a matrix of another size, for example)."""
        return

    def to_dict(self) -> dict[str, Any]:
        """The term as it stands in robot.toml."""
        return {"kind": self.kind}
