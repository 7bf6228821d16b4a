"""Reduction of the model until least squares are feasible (Díaz-Rodríguez et al. 2010; thesis 2.6.6, 6.4)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt

from steelyard.dynamics.threads import one_thread
from steelyard.errors import InputError
from steelyard.feasibility import FeasibleSet, check, correct
from steelyard.feasibility.certificates import FeasibilityCertificate, InfeasibilityCertificate
from steelyard.feasibility.check import decide
from steelyard.lmi.affine import is_positive_definite
from steelyard.regression import Estimate, Information

from .brute_force import GridSearch, search_grid
from .elimination import Elimination
from .method import Method, Problem, Progress, Weights

__all__ = ["DiazRodriguez2010", "ReductionStep"]

Vector = npt.NDArray[np.float64]

CLEARLY = 1e-9
"""A direction refutes base parameters where their product is negative by more than this, relative to both."""


@dataclass(frozen=True, eq=False)
class ReductionStep:
    """One reduced model.

    Attributes
    ----------
    excluded : tuple of str
        Base parameters that are taken out, in this order.
    base : (n_b,)
        Least squares of the others.
    relative_error : float
        Over all joints, unweighted (thesis 4.37).
    feasible : bool or None
        None where it is undecided.
    distance : float
        Euclidean distance of the base parameters from the feasible set; NaN where it was not asked for.
    """

    excluded: tuple[str, ...] = field(repr=False)
    base: Vector = field(repr=False)
    relative_error: float
    feasible: bool | None
    distance: float = float("nan")

    @property
    def excluded_count(self) -> int:
        """Number of parameters that are taken out."""
        return len(self.excluded)


class _Refutations:
    """The proofs of infeasibility found so far; each refutes all base parameters on one side of its hyperplane."""

    def __init__(self, feasible_set: FeasibleSet) -> None:
        self.feasible_set = feasible_set
        # Only where the set is a cone, a direction says yᵀβ ≥ 0 of all feasible β, without a constant.
        self.is_cone = not np.any(feasible_set.equation_values) and not any(
            np.any(b.constant) for b in feasible_set.blocks
        )
        self.directions: list[Vector] = []
        unidentifiable = feasible_set.unidentifiable
        self.known_blocks = [b for b in feasible_set.blocks if b.size > 1 and not np.any(unidentifiable[b.indices])]

    def decide(self, base: Vector) -> bool | None:
        """Tell whether base parameters are feasible; None where neither can be proved."""
        size = float(np.linalg.norm(base))
        if self.directions and float((np.array(self.directions) @ base).min()) < -CLEARLY * size:
            return False
        if self._block_refutes(base):
            return False
        # A block that the base parameters determine wholly, and which is singular, leaves nothing to look for.
        parameters = self.feasible_set.lift @ base
        if not all(is_positive_definite(block.evaluate(parameters)) for block in self.known_blocks):
            return None
        certificate = decide(self.feasible_set, base).certificate
        if isinstance(certificate, FeasibilityCertificate):
            return True
        if isinstance(certificate, InfeasibilityCertificate):
            if self.is_cone:
                direction = certificate.direction
                self.directions.append(direction / np.linalg.norm(direction))
            return False
        return None

    def _block_refutes(self, base: Vector) -> bool:
        """Tell whether a single block refutes: v'D(δ)v < 0 for a v with which it depends on base parameters alone."""
        feasible_set = self.feasible_set
        parameters = feasible_set.lift @ base
        eigenvalues = feasible_set.stack.smallest_eigenvalues(parameters)
        for index in np.argsort(eigenvalues):
            if eigenvalues[index] >= 0.0:
                break
            block = feasible_set.blocks[index]
            vector = np.linalg.eigh(block.evaluate(parameters))[1][:, 0]
            row = np.einsum("kij,i,j->k", block.coefficients, vector, vector)
            unidentifiable = row @ feasible_set.unidentifiable[block.indices]
            scale = np.abs(row) @ np.abs(parameters[block.indices]) + float(np.abs(block.constant).max())
            if np.all(np.abs(unidentifiable) <= 1e-14 * np.abs(row).max()) and eigenvalues[index] < -CLEARLY * scale:
                return True
        return False


@dataclass(frozen=True)
class DiazRodriguez2010(Method):
    """Least squares of fewer and fewer base parameters, until they are feasible.

    As long as the estimate is infeasible, the base parameter with the largest relative standard deviation is taken out
    of the model (held at zero), and the rest is estimated anew. What is left at the end are the "relevant" parameters.
    The answer is the first reduction that is feasible, with standard parameters that prove it; where there is none, the
    unreduced least squares without standard parameters, and a remark. A prior is not used.

    Known flaws: no reduction need be feasible, and the error of a feasible one may be large; to hold a parameter at
    zero is a statement about the robot without any evidence. Where all ten parameters of a link are identifiable, no
    model without one of its moments of inertia is feasible.

    Parameters
    ----------
    feasibility : {"exact", "search"}
        ``"exact"``: decided with a proof, as `steelyard.check` does (the thesis did likewise). ``"search"``: the
        paper's own bounded search for δ_d on a grid, which finds feasible parameters only where there are few
        dependent ones; not finding any proves nothing.
    most_removed : int, optional
        Reductions after which it gives up; all where absent.
    levels : int
        Of the search: values of each dependent parameter.
    budget : int
        Of the search: most points to try at each reduction.
    seed : int
        Of the search, where the grid has more points than that.

    References
    ----------
    M. Díaz-Rodríguez, V. Mata, Á. Valera, Á. Page, A methodology for dynamic parameters identification of 3-DOF
    parallel robots in terms of relevant parameters, Mechanism and Machine Theory 45 (2010).

    Examples
    --------
    >>> import steelyard as sy
    >>> robot = sy.Robot.from_dh([(0, 0, 0, "q")], gravity=(0, -9.81, 0)).with_terms(sy.Viscous())
    >>> model = sy.Model(robot)
    >>> model.base_parameters().names
    ('Lzz1', 'lx1', 'ly1', 'Fvj1')
    >>> information = sy.Information.from_factor(
    ...     10 * np.eye(4), [3.0, 5.0, 1.0, -0.1], 1.0, 100, model.base_parameters().names
    ... )
    >>> estimate = DiazRodriguez2010().fit(information, sy.FeasibleSet(model))
    >>> estimate.remarks
    ('Taken out: 1 of 4 base parameters: Fvj1.',)
    """

    feasibility: Literal["exact", "search"] = "exact"
    most_removed: int | None = None
    levels: int = 3
    budget: int = 100_000
    seed: int = 0

    name: ClassVar[str] = "Díaz-Rodríguez et al. 2010"
    source: ClassVar[str] = (
        "M. Díaz-Rodríguez, V. Mata, Á. Valera, Á. Page, A methodology for dynamic parameters identification of 3-DOF "
        "parallel robots in terms of relevant parameters, Mechanism and Machine Theory 45 (2010)."
    )

    def __post_init__(self) -> None:
        if self.feasibility not in ("exact", "search"):
            raise InputError(f'feasibility must be "exact" or "search", got {self.feasibility!r}.')
        for name, least in (("levels", 2), ("budget", 1), ("most_removed", 0)):
            value = getattr(self, name)
            if value is not None and not (isinstance(value, int) and value >= least):
                raise InputError(f"{name} must be an integer of at least {least}, got {value!r}.")

    def path(
        self,
        information: Information,
        feasible_set: FeasibleSet,
        *,
        weights: Weights = "joint",
        distances: bool = True,
        progress: Progress | None = None,
    ) -> tuple[ReductionStep, ...]:
        """Return all reductions, beyond the first feasible one (thesis figure 6.4); feasibility is decided exactly.

        Parameters
        ----------
        information : Information
        feasible_set : FeasibleSet
        weights : "joint", None or (N,)
        distances : bool
            Whether to compute the distance to the feasible set, as `steelyard.correct` finds it, at every step.
        progress : callable, optional

        Returns
        -------
        tuple of ReductionStep
            The first one has nothing taken out; the last one `most_removed` parameters.
        """
        problem = Problem.of(information, feasible_set, weights)
        refutations = _Refutations(feasible_set)
        found: list[ReductionStep] = []
        with one_thread():
            for elimination in self._models(problem):
                base = elimination.base
                possible = refutations.decide(base)
                distance = float("nan")
                if distances:
                    distance = 0.0 if possible else float(np.sqrt(correct(feasible_set, base=base).squared_distance))
                found.append(self._step(problem, elimination, base, possible, distance))
                if progress is not None:
                    progress(f"{found[-1].excluded_count} parameters taken out")
        return tuple(found)

    def _models(self, problem: Problem) -> Iterator[Elimination]:
        """The elimination after each step."""
        elimination = Elimination(problem)
        last = len(problem.rho) if self.most_removed is None else self.most_removed
        yield elimination
        while len(elimination.removed) < last and len(elimination.kept) > 1:
            elimination.remove_weakest()
            yield elimination

    @staticmethod
    def _step(
        problem: Problem, elimination: Elimination, base: Vector, possible: bool | None, distance: float
    ) -> ReductionStep:
        names = problem.information.base_expressions
        excluded = tuple(names[index] for index in elimination.removed)
        return ReductionStep(excluded, base, problem.information.relative_error(base), possible, distance)

    def _fit(self, problem: Problem, prior: Vector | None, progress: Progress | None) -> Estimate:
        refutations = _Refutations(problem.feasible_set)
        first: Vector | None = None
        search: GridSearch | None = None
        for elimination in self._models(problem):
            base = elimination.base
            first = base if first is None else first
            parameters = None
            if self.feasibility == "search":
                search = search_grid(problem, base, self.levels, self.budget, self.seed, progress)
                parameters = search.parameters
            elif refutations.decide(base):
                parameters = check(problem.feasible_set, base=base).parameters
            if parameters is not None:
                return self._estimate(problem, elimination, parameters, search)
            if progress is not None:
                progress(f"{len(elimination.removed)} parameters taken out")
        count = len(elimination.removed)
        remarks = [f"No reduced model, with up to {count} base parameters taken out, has a feasible estimate."]
        if search is not None:
            remarks = [
                f"For none of the models with up to {count} base parameters taken out feasible parameters were found.",
                search.sentence,
            ]
        return problem.estimate(f"{self.name}: not reduced", base=first, remarks=remarks)

    def _estimate(
        self, problem: Problem, elimination: Elimination, parameters: Vector, search: GridSearch | None
    ) -> Estimate:
        names = problem.information.base_expressions
        excluded = [names[index] for index in elimination.removed]
        remarks = []
        if excluded:
            remarks.append(f"Taken out: {len(excluded)} of {len(names)} base parameters: {'; '.join(excluded)}.")
        if search is not None:
            remarks.append(search.sentence)
        method = f"{self.name}: {len(elimination.kept)} of {len(names)} base parameters"
        return problem.estimate(method, parameters, elimination.base, remarks)
