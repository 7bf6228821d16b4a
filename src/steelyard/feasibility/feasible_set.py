"""The set of parameters that a real robot can have."""

from collections.abc import Callable, Collection, Sequence
from typing import Any, Literal, TypeVar

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard import lmi  # its objects are made when they are asked for
from steelyard.conic import Cone, Rows
from steelyard.display import html_table
from steelyard.errors import InputError
from steelyard.files import read_number, suggestion
from steelyard.files.arguments import real_array
from steelyard.lmi import AffineBlock, AffineStack
from steelyard.once import cached_property
from steelyard.regression import Reduced
from steelyard.robot.inertia import INERTIA_SYMBOLS

from .constraints import Constraint, Equality
from .constraints.constraint import (
    ModelLike,
    blocks_of,
    distinct_blocks,
    equalities_of,
    independent_equalities,
    solved_for_some,
)

__all__ = ["MARGIN_FACTORS", "FeasibleSet", "reduced_regression"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

MARGIN_FACTORS = (1.0, 1.5, 3.0, 10.0, 1e2, 1e3, 1e4, 1e5, 1e6)
"""Factors of the margin that are tried in turn while the solver ends outside the set; the last makes a margin of 1e-6
one of 1 SI unit, for robots of tonnes."""

_BISECTIONS = 30
"""After which the distance to the best point is 1e-9 of the line."""

Kept = TypeVar("Kept")


class FeasibleSet:
    """The set of parameters δ with D(δ) ≻ 0: the conditions of all links, drive terms and constraints (thesis 3.27).

    Parameters
    ----------
    model : Model
    consistency : {"full", "inertia"}
        ``"inertia"``: mass and inertia about the centre of mass are positive (thesis 3.20, 6 x 6 blocks). ``"full"``:
        also the principal moments obey the triangle inequality, so that a positive density exists (pseudo-inertia,
        4 x 4 blocks: Traversaro et al. 2016, Wensing et al. 2018, Sousa and Cortesão 2019).
    constraints : sequence of Constraint
        Further knowledge: `TotalMass`, `MeasuredMass`, `LinearBound`, `ConfidenceInterval`, `CenterOfMassBox`,
        `CenterOfMassSphere`, `CenterOfMassHull`, `DensityInBox`, `DensityInEllipsoid`, `SymmetricLink`, `EqualLinks`,
        or a class of your own, see `Constraint`. Conditions that two of them share count once.
    margin : float
        Distance ε by which `correct` and `fit` keep from the boundary: D(δ) - ε 1 ⪰ 0 (thesis 3.29).
    terms : bool
        Whether the conditions of drive terms (friction and rotor inertia not negative) belong to the set.

    Raises
    ------
    InputError
        For an unknown consistency, a margin that is not positive, a constraint on a link that does not exist, or
        equations of constraints that contradict each other.

    Examples
    --------
    >>> from steelyard.dynamics import Model, Viscous
    >>> from steelyard.robot import Robot
    >>> robot = Robot.from_dh([("-pi/2", 0.0, 0.3, "q"), ("0", 0.5, 0.0, "q")]).with_terms(Viscous())
    >>> FeasibleSet(Model(robot), consistency="full")
    FeasibleSet('full': 4 blocks (2 of links, 2 of terms), 22 parameters, margin 1e-06)
    """

    def __init__(
        self,
        model: ModelLike,
        consistency: Literal["full", "inertia"] = "full",
        constraints: Sequence[Constraint] = (),
        margin: float = 1e-6,
        terms: bool = True,
    ) -> None:
        if consistency not in ("full", "inertia"):
            close = suggestion(str(consistency), ("full", "inertia"))
            raise InputError(f'consistency must be "full" or "inertia", got {consistency!r}; {close}')
        if not isinstance(constraints, (list, tuple)):
            raise InputError(f"constraints must be a list, got {constraints!r}; write constraints=[...].")
        self.model = model
        self.consistency: Literal["full", "inertia"] = consistency
        self.constraints = tuple(constraints)
        self.margin = read_number(margin, "margin", "a positive number such as 1e-6", above=0)
        self.terms = bool(terms)
        self._kept: dict[Callable[[FeasibleSet], Any], Any] = {}
        for constraint in self.constraints:
            if not (hasattr(constraint, "blocks") and hasattr(constraint, "equalities")):
                raise InputError(f"constraints must hold objects such as TotalMass(maximum=27.0), got {constraint!r}.")
        self.blocks: tuple[AffineBlock, ...] = self._blocks()
        self.equalities: tuple[Equality, ...] = independent_equalities(
            (equality for constraint in self.constraints for equality in equalities_of(constraint, model)),
            self.parameter_count,
        )

    def _blocks(self) -> tuple[AffineBlock, ...]:
        found = [block for block in self.model.conditions(self.consistency) if self.terms or block.kind != "term"]
        for constraint in self.constraints:
            found.extend(blocks_of(constraint, self.model))
        return distinct_blocks(found)

    def __repr__(self) -> str:
        kinds = {kind: sum(block.kind == kind for block in self.blocks) for kind in ("link", "term", "constraint")}
        counts = ", ".join(f"{count} of {kind}s" for kind, count in kinds.items() if count)
        equations = len(self.equalities)
        equal = f"{equations} equation{'' if equations == 1 else 's'}, " if equations else ""
        return (
            f"FeasibleSet({self.consistency!r}: {len(self.blocks)} blocks ({counts}), {equal}"
            f"{self.parameter_count} parameters, margin {self.margin:g})"
        )

    def _repr_html_(self) -> str:
        rows = [(block.name, f"{block.size} × {block.size}") for block in self.blocks]
        rows += [(equality.name, "equation") for equality in self.equalities]
        return html_table(repr(self), ("block", "size"), rows)

    @property
    def parameter_count(self) -> int:
        """Number n of standard parameters."""
        return len(self.model.parameter_names)

    @cached_property
    def stack(self) -> AffineStack:
        """All blocks, stacked, in the standard parameters."""
        return AffineStack(self.blocks, self.parameter_count)

    @cached_property
    def inequality(self) -> "lmi.LinearMatrixInequality":
        """The inequality D(δ) ≻ 0 of all blocks in named parameters (thesis 3.26), without equations of constraints.

        Examples
        --------
        >>> from steelyard.dynamics import Model
        >>> from steelyard.robot import Robot
        >>> feasible_set = FeasibleSet(Model(Robot.from_dh([("0", 0.0, 0.0, "q")])), consistency="inertia")
        >>> print(feasible_set.inequality.with_margin(feasible_set.margin).pretty(most=3))
        body of link1:
        ⎡ Lxx1 - 1e-06  ⋯  -ly1       ⎤
        ⎢ ⋮             ⋱  ⋮          ⎥
        ⎣ -ly1          ⋯  m1 - 1e-06 ⎦ ⪰ 0
        """
        return lmi.LinearMatrixInequality(tuple(map(str, self.model.parameter_names)), self.blocks, strict=True)

    @cached_property
    def K(self) -> Matrix:
        """β = K δ, (n_b, n)."""
        return np.asarray(self.model.base_parameters().K, dtype=float)

    @cached_property
    def lift(self) -> Matrix:
        """P_b, (n, n_b): the parameters that carry β when all others are zero."""
        independent = np.asarray(self.model.base_parameters().independent, dtype=np.intp)
        matrix = np.zeros((self.parameter_count, len(independent)))
        matrix[independent, np.arange(len(independent))] = 1.0
        return matrix

    @cached_property
    def unidentifiable(self) -> Matrix:
        """P_d - P_b K_d, (n, n_d): the directions that the motion does not show, K times it is zero (thesis 3.13)."""
        base = self.model.base_parameters()
        dependent = np.asarray(base.dependent, dtype=np.intp)
        matrix = np.zeros((self.parameter_count, len(dependent)))
        matrix[dependent, np.arange(len(dependent))] = 1.0
        return matrix - self.lift @ self.K[:, dependent]

    @cached_property
    def base_dependent(self) -> Matrix:
        """[P_b, P_d - P_b K_d], (n, n): δ from (β, δ_d) (thesis 3.13)."""
        return np.hstack([self.lift, self.unidentifiable])

    @cached_property
    def stacked_base_dependent(self) -> sparse.csc_array:
        """Coefficients of the stacked blocks in (β, δ_d)."""
        return sparse.csc_array(self.stack.coefficients @ sparse.csc_array(self.base_dependent))

    @cached_property
    def equation_matrix(self) -> Matrix:
        """Left sides E of the equations E δ = f, (r, n)."""
        matrix = np.zeros((len(self.equalities), self.parameter_count))
        for row, equality in zip(matrix, self.equalities, strict=True):
            np.add.at(row, equality.indices, equality.coefficients)
        return matrix

    @cached_property
    def equation_values(self) -> Vector:
        """Right sides f, (r,)."""
        return np.array([equality.value for equality in self.equalities])

    @cached_property
    def equation_directions(self) -> Matrix | None:
        """Orthonormal directions along which the equations keep holding, (n, m); None where there are none."""
        if not self.equalities:
            return None
        from scipy.linalg import null_space

        return np.asarray(null_space(self.equation_matrix))

    def rows(self, directions: Matrix, origin: Vector, margin: float = 0.0) -> tuple[Rows, Rows]:
        """Equations and blocks as rows of a cone program over x, where δ = origin + directions x.

        Parameters
        ----------
        directions : (n, m)
        origin : (n,)
        margin : float
            The blocks keep this distance from the boundary: D(δ) - margin 1 ⪰ 0.
        """
        stack = self.stack
        values = stack.constant + stack.coefficients @ origin - margin * stack.identity
        missing = self.equation_values - self.equation_matrix @ origin
        if directions is self.base_dependent:
            coefficients = self.stacked_base_dependent
        else:
            coefficients = sparse.csc_array(stack.coefficients @ sparse.csc_array(directions))
        return (
            Rows(self.equation_matrix @ directions, missing, Cone("zero", len(missing))),
            Rows(-coefficients, values, *stack.cones),
        )

    @cached_property
    def base_equations(self) -> tuple[Matrix, Vector]:
        """Equations Z β = z, (k, n_b) and (k,), that constraints impose on β alone; other β are infeasible."""
        if not self.equalities:
            return np.zeros((0, self.K.shape[0])), np.zeros(0)
        effect = self.equation_matrix @ self.unidentifiable
        left, sizes, _ = np.linalg.svd(effect)
        scale = np.linalg.norm(self.equation_matrix, axis=1).max()
        combinations = left[:, int(np.sum(sizes > 1e-9 * scale)) :].T
        return combinations @ self.equation_matrix @ self.lift, combinations @ self.equation_values

    def kept(self, build: Callable[["FeasibleSet"], Kept]) -> Kept:
        """The result of a function of this set, computed at the first call and kept for as long as the set lives.

        Parameters
        ----------
        build : callable
            A function of a module, which serves as the key; it is called with the set.
        """
        if build not in self._kept:
            self._kept[build] = build(self)
        return self._kept[build]  # type: ignore[no-any-return]

    @cached_property
    def link_columns(self) -> npt.NDArray[np.intp]:
        """Indices of the ten inertial parameters of every link, (links, 10)."""
        names = {name: index for index, name in enumerate(self.model.parameter_names)}
        links = range(1, len(self.model.robot.link_names) + 1)
        rows = [[names[f"{symbol}{link}"] for symbol in INERTIA_SYMBOLS] for link in links]
        return np.array(rows, dtype=np.intp).reshape(-1, 10)

    @property
    def mass_indices(self) -> npt.NDArray[np.intp]:
        """Indices of the masses of the links, in the order of the links."""
        return np.asarray(self.link_columns[:, 9])

    @cached_property
    def conditioned_masses(self) -> npt.NDArray[np.intp]:
        """Indices of the masses of links that have a condition: all links, unless `without` removed some."""
        links = [block.indices for block in self.blocks if block.kind == "link"]
        return np.intersect1d(self.mass_indices, np.concatenate([np.zeros(0, dtype=np.intp), *links]))

    def without(self, blocks: Collection[int]) -> "FeasibleSet":
        """The set without some of its blocks, so that it is larger.

        Parameters
        ----------
        blocks : collection of int
            Indices in `blocks`.
        """
        found = FeasibleSet(self.model, self.consistency, self.constraints, self.margin, self.terms)
        found.blocks = tuple(block for index, block in enumerate(self.blocks) if index not in blocks)
        return found

    @cached_property
    def trace_row(self) -> Vector:
        """The sum of the traces of all blocks of links and terms as a row over δ, (n,); it bounds their elements."""
        row = np.zeros(self.parameter_count)
        for block in self.blocks:
            if block.kind != "constraint":
                np.add.at(row, block.indices, np.trace(block.coefficients, axis1=1, axis2=2))
        return row

    def as_base(self, base: npt.ArrayLike) -> Vector:
        """Check and convert a base parameter vector.

        Raises
        ------
        InputError
            If the length is wrong or a value is not finite.
        """
        return self._vector(base, self.K.shape[0], "base", "base parameters")

    def as_parameters(self, parameters: npt.ArrayLike) -> Vector:
        """Check and convert a standard parameter vector.

        Raises
        ------
        InputError
            If the length is wrong or a value is not finite.
        """
        return self._vector(parameters, self.parameter_count, "parameters", "standard parameters")

    def _vector(self, values: npt.ArrayLike, count: int, name: str, kind: str) -> Vector:
        if hasattr(values, "parameter_names"):  # an estimate
            from steelyard.dynamics.functions import given_parameters  # which most questions do not need

            values = given_parameters(self.model, values, base=name == "base")
        vector = real_array(values, name, f"the model's {count} {kind}")
        if vector.shape != (count,):
            raise InputError(f"{name} must hold the model's {count} {kind}, got an array of shape {vector.shape}.")
        bad = np.flatnonzero(~np.isfinite(vector))
        if len(bad):
            label = f"number {bad[0] + 1}" if name == "base" else str(self.model.parameter_names[bad[0]])
            raise InputError(
                f"{name} must be finite, got {vector[bad[0]]} for {label}; give a value for every parameter."
            )
        return vector

    @cached_property
    def _solved_equations(self) -> tuple[npt.NDArray[np.intp], Matrix, Vector]:
        return solved_for_some(self.equation_matrix, self.equation_values)

    def satisfies_equations(self, parameters: Vector) -> bool:
        """Return whether the equations hold to rounding."""
        if not self.equalities:
            return True
        return self._equations_hold(parameters, 1e-9)

    def _equations_hold(self, parameters: Vector, relative: float) -> bool:
        """Whether errors are small relative to the terms of each equation, or to rounding of the largest parameter."""
        sizes = np.abs(self.equation_matrix)
        error = np.abs(self.equation_matrix @ parameters - self.equation_values)
        scale = sizes @ np.abs(parameters) + np.abs(self.equation_values)
        rounding = np.finfo(float).eps * sizes.sum(axis=1) * np.abs(parameters).max(initial=0.0)
        return bool(np.all(error <= relative * scale + rounding))

    def project_on_equations(self, parameters: Vector) -> Vector:
        """Remove the error that a solver left in the equations.

        Unidentifiable parameters are changed first, so that β stays the same. An error that is left after that, in
        equations of β itself, is removed by the smallest change of δ. Finally some parameters are computed from the
        others, so that parameters that must be zero or equal are so exactly.
        """
        if not self.equalities:
            return parameters
        error = self.equation_values - self.equation_matrix @ parameters
        step = np.linalg.lstsq(self.equation_matrix @ self.unidentifiable, error)[0]
        moved = parameters + self.unidentifiable @ step
        if not self._equations_hold(moved, 1e-13):
            error = self.equation_values - self.equation_matrix @ moved
            moved = moved + np.linalg.lstsq(self.equation_matrix, error)[0]
        which, rest, constant = self._solved_equations
        moved[which] = constant - rest @ moved
        return np.asarray(moved)

    def contains(self, parameters: npt.ArrayLike) -> bool:
        """Whether all blocks are proved positive definite at δ (1 x 1 blocks may be zero) and the equations hold.

        Parameters
        ----------
        parameters : (n,)
        """
        vector = self.as_parameters(parameters)
        return self.stack.all_positive(vector) and self.satisfies_equations(vector)

    def pull_inside(self, outside: Vector, inside: Vector) -> Vector:
        """Return the point nearest to `outside`, on the line to `inside`, that is well inside.

        A solver may end just outside the set. Well inside means half the margin, or a tenth of that of the point
        `inside` if it is smaller. The set is convex, so that bisection finds the point; equations that hold at both
        ends hold between them.

        Parameters
        ----------
        outside : (n,)
        inside : (n,)
            A point that the set contains.

        Returns
        -------
        (n,)
            A point that the set contains.
        """
        least = min(0.5 * self.margin, 0.1 * self.stack.smallest_eigenvalues(inside).min(initial=np.inf))
        low, high, best = 0.0, 1.0, inside
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            point = outside + middle * (inside - outside)
            if self.stack.smallest_eigenvalues(point).min(initial=np.inf) >= least and self.contains(point):
                high, best = middle, point
            else:
                low = middle
        return best


def reduced_regression(data: Any, weights: Any, feasible_set: FeasibleSet) -> Reduced:
    """The reduced regression of an Information, or of an object that already is one, checked.

    Raises
    ------
    InputError
        If it belongs to another model or holds no usable numbers.
    """
    reduced = data.reduced(weights) if hasattr(data, "reduced") else data
    missing = [name for name in ("R", "rho", "residual2", "count", "norm2") if not hasattr(reduced, name)]
    if missing:
        raise InputError(f"info must be an Information (or its reduced form), got {data!r}.")
    R, rho = np.asarray(reduced.R, dtype=float), np.asarray(reduced.rho, dtype=float)
    count = feasible_set.K.shape[0]
    if R.ndim != 2 or R.shape[1] != count or rho.shape != (R.shape[0],):
        raise InputError(
            f"the data belongs to another model: its reduced regression has R of shape {R.shape}, but the feasible "
            f"set is of a model with {count} base parameters; use the Information of the same model."
        )
    if not (np.all(np.isfinite(R)) and np.all(np.isfinite(rho)) and reduced.norm2 > 0):
        raise InputError("the data holds no usable samples: its torques are all zero or not finite numbers.")
    return Reduced(R, rho, float(reduced.residual2), int(reduced.count), float(reduced.norm2))
