"""Point masses: feasible identification as a quadratic program (Ayusawa and Nakamura 2010; thesis 2.74 to 2.78)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from steelyard.errors import InputError
from steelyard.regression import Estimate

from .method import Method, Problem, Progress
from .point_mass_program import PointMassProgram
from .point_masses import Corners, boxes_of_links, inertia_of_points, masses_near, points_in_box
from .quadratic_solver import find_quadratic_solver, solve_quadratic

__all__ = ["Ayusawa2010"]

Vector = npt.NDArray[np.float64]

TIE = 1e-9
"""Weight of the squared masses where no prior is given: it only chooses among masses that fit alike."""

LIFTS = 6
"""How often the least mass is raised tenfold where rounding hides that the answer is feasible."""


@dataclass(frozen=True)
class Ayusawa2010(Method):
    """Least squares over links made of point masses at fixed places, none of them negative.

    Every link is a set of points p at fixed places of its bounding box, and δ = R p (thesis 2.74). Then p > 0 suffices
    for feasibility, and the fit is a quadratic program (thesis 2.76):

        minimise ‖G_f (ω - W K R p)‖² + ‖G_p (p̂ - p)‖²  subject to  p > 0.

    The inertial parameters that so many points can make are a polyhedral cone within the feasible cone (thesis 2.78):
    the answer is always feasible (also under ``"full"`` consistency), and never better than that of `steelyard.fit`.
    The prior of `fit`, standard parameters of CAD, gives p̂: the masses that come
    nearest to them, spread as evenly as that allows; links with an unknown parameter have none. The points keep the
    centre of mass, and the whole body, within the box.

    Parameters
    ----------
    kinds : sequence of str
        Which points of the box: of ``"vertices"``, ``"edges"``, ``"faces"``, ``"centre"``. All of them are the 3³ = 27
        points of the paper.
    subdivisions : int
        Into how many parts the sides of the box are divided; 2 puts one point on the middle of each edge. All kinds
        together are (subdivisions + 1)³ points.
    points : sequence of (3,), optional
        Places of one's own instead, where the box is from -1 to 1 along each axis.
    boxes : mapping from link to (lower, upper), optional
        Corners of the box of a link, in metres, in the link frame. A link that is not named takes the box of the set's
        `DensityInBox`, else that of `CenterOfMassBox`, else a cube of the default size, and a remark says so.
    default_size : float, optional
        Half the side of that cube, in metres; 2 typical lengths of the robot's links where absent.
    prior_weight : float
        1 / τ² where a prior is believed to be right to a deviation of τ times the typical mass of a point: G_p in units
        of the noise. Without a prior, the smallest masses win among those that fit alike.
    least_mass : float
        Least mass of a point, in units of the typical mass of a point: what "> 0" means.
    solver : str
        ``"nnls"`` (active set of Lawson and Hanson, from SciPy; where every condition is a bound), ``"clarabel"``
        (interior point), ``"osqp"`` and ``"piqp"`` where they are installed, or another one of
        `steelyard.solver_table`. ``"auto"`` takes the first where it can and there is no prior, else the second, as
        they were the fastest that come with Steelyard.

    See Also
    --------
    steelyard.fit : The same without the restriction to points.

    Notes
    -----
    Drive terms keep their bounds; 1 x 1 constraints (`TotalMass`, `MeasuredMass`, `LinearBound`, ...) and equations
    belong to the quadratic program. Constraints that are matrices, such as `CenterOfMassSphere`, are refused.

    The unknowns of the program are the masses and the base parameters they make, so that its matrices are as sparse as
    R and K; the objective is over the base parameters alone.

    References
    ----------
    K. Ayusawa, Y. Nakamura, Identification of standard inertial parameters for large-DOF robots considering physical
    consistency, IEEE/RSJ International Conference on Intelligent Robots and Systems, 2010.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 0, 0, "q")], name="pendulum", gravity=(0, -9.81, 0)))
    >>> information = sy.Information.from_factor(
    ...     10 * np.eye(3), [-0.1, 5.0, 0.0], 0.02, 100, model.base_parameters().names
    ... )
    >>> estimate = Ayusawa2010().fit(information, sy.FeasibleSet(model))
    >>> estimate.consistency, bool(estimate.relative_error > sy.least_squares(information).relative_error)
    ('full', True)
    """

    kinds: Sequence[str] = ("vertices", "edges", "faces", "centre")
    subdivisions: int = 2
    points: Sequence[Sequence[float]] | None = None
    boxes: Mapping[str, Corners] = field(default_factory=dict)
    default_size: float | None = None
    prior_weight: float = 1.0
    least_mass: float = 1e-6
    solver: str = "auto"

    name: ClassVar[str] = "Ayusawa and Nakamura 2010"
    source: ClassVar[str] = (
        "K. Ayusawa, Y. Nakamura, Identification of standard inertial parameters for large-DOF robots considering "
        "physical consistency, IEEE/RSJ International Conference on Intelligent Robots and Systems, 2010."
    )

    def __post_init__(self) -> None:
        for name, least in (("prior_weight", 0.0), ("least_mass", 0.0), ("default_size", 0.0)):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > least):
                raise InputError(f"{name} must be a positive number, got {value!r}.")
        find_quadratic_solver(self.solver)
        points_in_box(self.kinds, self.subdivisions, self.points)

    def _fit(self, problem: Problem, prior: Vector | None, progress: Progress | None) -> Estimate:
        """Identify; a solver without an answer raises `SolverError`, one that is not installed `MissingExtraError`."""
        boxes, remarks = boxes_of_links(problem, self.boxes, self.default_size, prior)
        places = points_in_box(self.kinds, self.subdivisions, self.points)
        R = inertia_of_points(boxes, places)
        typical = problem.units.masses / len(places)
        goal, strength = np.zeros((len(R), len(places))), np.full(len(R), TIE)
        if prior is not None:
            whole = np.flatnonzero(np.all(np.isfinite(prior[problem.links]), axis=1))
            scale = problem.units.inertial[whole]
            goal[whole] = masses_near(R[whole], prior[problem.links[whole]], scale, typical[whole])
            strength[whole] = self.prior_weight * problem.regression.variance / problem.regression.scale
        program = PointMassProgram.of(problem, R, typical, goal, strength, self.least_mass)
        if progress is not None:
            progress(f"{program.point_count} point masses")
        solution = solve_quadratic(program, self.solver)
        parameters = program.parameters(solution.x)
        for lift in range(LIFTS):
            if problem.feasible_set.contains(parameters):
                break
            parameters = program.parameters(solution.x, self.least_mass * 10.0 ** (lift + 1))
        if not solution.converged:
            remarks.append(f"The solver of the quadratic program stopped early ({solution.status}).")
        note = f"{len(places)} point masses a link"
        return problem.estimate(f"{self.name}: {note}", parameters, remarks=remarks)
