"""The least masses that a robot can have, given an estimate of its base parameters."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from steelyard.display import few_digits, html_table, text_table
from steelyard.dynamics.threads import one_thread
from steelyard.regression import ParameterCovariance

from ..cone_program import Program, unidentifiable_conditions
from ..dual_bound import ConvexProblem, Multipliers
from ..feasible_set import FeasibleSet
from ..tie_break import TieBreak
from ..units import Units
from .bound_finder import BoundFinder, NoInteriorError, given_by
from .quantities import Quantity, quantities

__all__ = ["LeastMass", "LightestRobot", "lightest_robot"]

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LeastMass:
    """The smallest mass of a link, or of all of them.

    Attributes
    ----------
    name : str
    meaning : str
    proved : float
        Lower bound, in kg: no robot has a smaller mass.
    attained : float
        Mass, in kg, that a certain robot has.
    parameters : (n,)
        Parameters of that robot.
    """

    name: str
    meaning: str
    proved: float
    attained: float
    parameters: Vector = field(repr=False)

    def __str__(self) -> str:
        return f"The {self.meaning} is at least {few_digits(self.attained)} kg."


@dataclass(frozen=True, eq=False)
class LightestRobot:
    """The answer of `lightest_robot`.

    Attributes
    ----------
    total : LeastMass
        Least mass of all links together.
    links : tuple of LeastMass
        Least mass of each link by itself; the robots differ, so that these need not add up to the total.
    base : (n_b,)
    consistency : str
    confidence : float or None
        Probability of the region of base parameters; None for a point.
    """

    total: LeastMass
    links: tuple[LeastMass, ...]
    base: Vector = field(repr=False)
    consistency: str
    confidence: float | None

    @property
    def parameters(self) -> Vector:
        """Standard parameters of the lightest robot, (n,)."""
        return self.total.parameters

    def sentences(self) -> tuple[str, ...]:
        """The answer in sentences."""
        given = (
            "these base parameters"
            if self.confidence is None
            else f"base parameters in the {100 * self.confidence:g} % region"
        )
        return (
            f"The lightest robot with {given} weighs {few_digits(self.total.attained)} kg, under "
            f'"{self.consistency}" consistency.',
        )

    def _rows(self) -> list[tuple[str, ...]]:
        return [(least.name, few_digits(least.attained), least.meaning) for least in self.links]

    def __str__(self) -> str:
        return "\n".join(
            (*self.sentences(), text_table(("link", "at least, kg", "meaning"), self._rows(), numbers=(1,)))
        )

    def _repr_html_(self) -> str:
        return html_table(" ".join(self.sentences()), ("link", "at least, kg", "meaning"), self._rows())

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data for JSON."""

        def entry(least: LeastMass) -> dict[str, Any]:
            return {"name": least.name, "meaning": least.meaning, "proved": least.proved, "attained": least.attained}

        return {
            "consistency": self.consistency,
            "confidence": self.confidence,
            "total": entry(self.total),
            "links": [entry(least) for least in self.links],
            "base": self.base.tolist(),
            "parameters": self.parameters.tolist(),
        }


def lightest_robot(
    feasible_set: FeasibleSet,
    base: npt.ArrayLike | None = None,
    *,
    info: Any = None,
    covariance: npt.ArrayLike | ParameterCovariance | None = None,
    confidence: float = 0.95,
    weights: Any = "joint",
    solver: str = "clarabel",
) -> LightestRobot:
    """Find the least total mass with which an estimate is physically possible, and the least mass of each link.

    Parameters
    ----------
    feasible_set, base, info, covariance, confidence, weights, solver
        As in `parameter_intervals`.

    Returns
    -------
    LightestRobot
        Where the base parameters leave no room, as those of point masses, its robots lie on the boundary of the set.

    Raises
    ------
    InputError
        If no physically possible robot has these base parameters, or none within the region; or for a bad argument.
    SolverError
        If no parameters satisfy all conditions.

    Examples
    --------
    A pendulum with a moment of inertia of 0.5 kg m² and a first moment of 1 kg m is at least 2 kg at 0.5 m:

    >>> from steelyard.dynamics import Model
    >>> from steelyard.feasibility import FeasibleSet
    >>> from steelyard.robot import Robot
    >>> model = Model(Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    >>> print(lightest_robot(FeasibleSet(model), base=[0.5, 1.0, 0.0]).sentences()[0])
    The lightest robot with these base parameters weighs 2 kg, under "full" consistency.
    """
    names = [str(feasible_set.model.parameter_names[i]) for i in feasible_set.mass_indices]
    total, *links = quantities(feasible_set, ["total mass", *names])
    with one_thread():
        try:
            given = given_by(feasible_set, base, info, covariance, weights, confidence, solver)
        except NoInteriorError as error:
            if base is None or info is not None or covariance is not None:
                raise
            beta, probability = feasible_set.as_base(base), None
            found = [_on_the_boundary(feasible_set, beta, mass, solver, error) for mass in (total, *links)]
        else:
            beta, probability = given.base, given.confidence
            found = [_inside(given.finder, mass) for mass in (total, *links)]
    return LightestRobot(found[0], tuple(found[1:]), beta, feasible_set.consistency, probability)


def _inside(finder: BoundFinder, mass: Quantity) -> LeastMass:
    """The least mass over a slice with an interior."""
    found = finder.least(mass.row)
    parameters = found.parameters if found.parameters is not None else finder.center.parameters
    attained = found.attained if math.isfinite(found.attained) else 0.0
    return LeastMass(mass.name, mass.meaning, max(found.proved, 0.0), attained, parameters)


def _on_the_boundary(
    feasible_set: FeasibleSet, base: Vector, mass: Quantity, solver: str, error: NoInteriorError
) -> LeastMass:
    """The least mass over a set without an interior, from one cone program and the bound that its dual point proves."""
    conditions, nothing = feasible_set.kept(unidentifiable_conditions), np.zeros((0, feasible_set.parameter_count))
    units = Units.of(feasible_set).parameters
    program = Program.along(feasible_set, conditions, units, feasible_set.lift @ base, 0.0)
    objective = TieBreak(mass.name, np.zeros(feasible_set.parameter_count), mass.row).part(program)
    solution = program.solve(objective, solver=solver)
    if not solution.usable:
        raise error
    parameters = program.parameters(solution.primal)
    attained = float(mass.row @ parameters)
    problem = ConvexProblem(
        feasible_set=feasible_set,
        point=parameters,
        directions=conditions.matrix,
        units=program.columns,
        value=attained,
        gradient=mass.row,
        root=nothing,
        rows=nothing,
        slack=np.zeros(0),
        size=units[feasible_set.mass_indices].sum(),
    )
    proved = problem.lower_bound(Multipliers(program.stacked_dual(solution.dual), np.zeros(0)))
    return LeastMass(mass.name, mass.meaning, max(proved, 0.0), max(attained, 0.0), parameters)
