"""The smallest total mass with which an estimate is possible at all."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import scipy.special

from steelyard.conic import Outcome, Rows
from steelyard.errors import InputError
from steelyard.feasibility.cone_program import Conditions, Part, Program
from steelyard.feasibility.feasible_set import FeasibleSet
from steelyard.feasibility.tie_break import TieBreak
from steelyard.feasibility.units import Units
from steelyard.regression import Information

from .reduced import ReducedRegression

__all__ = ["SmallestMass", "smallest_total_mass"]

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SmallestMass:
    """Answer of `smallest_total_mass`.

    Attributes
    ----------
    mass : float
        In kg.
    base : (n_b,)
        Base parameters of the lightest robot.
    parameters : (n,)
        Its standard parameters; at the boundary of what is possible.
    confidence : float or None
        Of the region within which the base parameters were free.
    """

    mass: float
    base: Vector = field(repr=False)
    parameters: Vector = field(repr=False)
    confidence: float | None = None

    def __str__(self) -> str:
        if self.confidence is None:
            return f"No robot lighter than {self.mass:.3g} kg has these base parameters."
        return (
            f"No robot lighter than {self.mass:.3g} kg has base parameters within the {self.confidence:.4g} confidence "
            "region."
        )


def smallest_total_mass(
    feasible: FeasibleSet,
    base: npt.ArrayLike | None = None,
    information: Information | None = None,
    confidence: float | None = None,
    weights: npt.ArrayLike | str | None = "joint",
) -> SmallestMass:
    """The smallest total mass of a physically possible robot with given base parameters, or within their confidence.

    The mass of many links does not show in the motion, yet it is not free: a first moment and a moment of inertia need
    mass.

    Parameters
    ----------
    feasible : FeasibleSet
    base : (n_b,), optional
        Base parameters; those of least squares where absent, which need `information`.
    information : Information, optional
    confidence : float, optional
        Let the base parameters move within the region that holds the true ones with this probability, such as 0.95, if
        the noise of all rows is independent: ‖R (β - base)‖² ≤ σ² χ². Needs `information`.
    weights : "joint", None or (N,)
        Of the joints, as in `fit`.

    Returns
    -------
    SmallestMass

    Raises
    ------
    InputError
        If arguments are missing or wrong, or no possible robot has the base parameters at all.
    SolverError
        If the solver finds no answer.

    Examples
    --------
    A pendulum whose centre of mass lies 0.5 kg m from the axis, with 0.1 kg m² about it:

    >>> from steelyard.dynamics import Model
    >>> from steelyard.robot import Robot
    >>> model = Model(Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    >>> print(smallest_total_mass(FeasibleSet(model), base=[0.1, 0.5, 0.0]))  # 0.5² / 0.1
    No robot lighter than 2.5 kg has these base parameters.
    """
    if base is None and information is None:
        raise InputError("smallest_total_mass needs base=... or information=...; give at least one.")
    if confidence is not None and information is None:
        raise InputError("a confidence region needs information=..., which knows the spread of the base parameters.")
    if confidence is not None and not (
        isinstance(confidence, (int, float)) and not isinstance(confidence, bool) and 0 < confidence < 1
    ):
        raise InputError(f"confidence must be a probability such as 0.95, got {confidence!r}.")
    regression = None
    if information is not None:
        regression = ReducedRegression.of(information.reduced(weights), feasible)
    given = regression.base if regression is not None else np.zeros(0)
    if base is not None:
        given = feasible.as_base(base)
    if regression is None:
        units = Units.from_sizes(feasible, np.full(feasible.parameter_count, np.inf)).with_cad()
    else:
        units = regression.units(feasible).with_cad()
    radius = _radius(regression, confidence)
    if radius == 0.0 or regression is None:
        program, objective = _of_base(feasible, given, units)
        ball: tuple[Rows, ...] = ()
    else:
        parameters = feasible.model.base_parameters()
        order = np.concatenate([np.asarray(parameters.independent), np.asarray(parameters.dependent)]).astype(np.intp)
        conditions = Conditions(feasible, feasible.base_dependent)
        columns = units.parameters[order]
        program = Program(feasible, conditions, units.parameters, columns, feasible.lift @ given, 0.0)
        objective = _mass(feasible).part(program)
        ball = (regression.ball(columns, radius),)
    solution = program.solve(objective, ball)
    if solution.outcome is Outcome.INFEASIBLE:
        within = "within this confidence region" if confidence is not None else "with these base parameters"
        raise InputError(
            f"there is no physically possible robot {within}, however heavy ({solution.solver}: {solution.status}); "
            "use the base parameters of steelyard.fit or steelyard.correct."
        )
    solution.require("find the smallest total mass")
    found = program.parameters(solution.primal)
    mass = float(found[feasible.mass_indices].sum())
    return SmallestMass(mass, feasible.K @ found, found, None if confidence is None else float(confidence))


def _radius(regression: ReducedRegression | None, confidence: float | None) -> float:
    """Radius of the confidence region, as ‖R (β - base)‖; 0 for a point."""
    if regression is None or confidence is None:
        return 0.0
    count = len(regression.base)
    variance = regression.residual2 / max(regression.count - count, 1)
    return float(np.sqrt(variance * scipy.special.chdtri(count, 1.0 - confidence)))


def _mass(feasible: FeasibleSet) -> TieBreak:
    gradient = np.zeros(feasible.parameter_count)
    gradient[feasible.mass_indices] = 1.0
    return TieBreak("the lightest", np.zeros(feasible.parameter_count), gradient)


def _of_base(feasible: FeasibleSet, base: Vector, units: Units) -> tuple[Program, Part]:
    """Over the parameters that the motion does not show."""
    matrix = feasible.unidentifiable
    sizes = np.abs(matrix / units.parameters[:, None]).max(axis=0, initial=0.0)
    columns = 1.0 / np.where(sizes > 0, sizes, 1.0)
    conditions = Conditions(feasible, matrix)
    program = Program(feasible, conditions, units.parameters, columns, feasible.lift @ base, 0.0)
    return program, _mass(feasible).part(program)
