"""Least squares over unconstrained numbers θ, of which the parameters of links and terms are functions."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import scipy.linalg.lapack

from .method import Problem, Progress
from .parametrisations import Parametrisation

__all__ = ["FACTORED_SOLVERS", "FactoredFit", "FactoredOutcome", "FactoredSolver"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

FactoredSolver = Literal["newton", "gauss-newton", "levenberg-marquardt"]
FACTORED_SOLVERS: tuple[FactoredSolver, ...] = ("newton", "gauss-newton", "levenberg-marquardt")

FIRST_DAMPING = 1e-3
"""Damping of the first step of the descent, as a part of the largest second derivative (Nielsen 1999)."""

WORTH_A_STEP = 1e-4
"""Part of the expected decrease from which a step is taken."""

ROUNDING = 1e-15
"""Decreases below this part of the value end the descent."""

LEAST = 1e-12
"""Terms start above their bound by at least this part of their unit."""


@dataclass(frozen=True)
class FactoredOutcome:
    """The result of a descent.

    Attributes
    ----------
    parameters : (n,)
    iterations : int
    converged : bool
    message : str
        The message of the solver.
    """

    parameters: Vector = field(repr=False)
    iterations: int
    converged: bool
    message: str

    def sentence(self) -> str:
        """Return a sentence for the remarks on how the descent ended."""
        if self.converged:
            return f"converged after {self.iterations} iterations."
        return f"not converged after {self.iterations} iterations ({self.message.strip().rstrip('.')})."


@dataclass(frozen=True, eq=False)
class FactoredFit:
    """Minimise ‖R K δ(θ) - target‖² over θ (thesis 2.72, 2.73).

    Attributes
    ----------
    problem : Problem
    parametrisation : Parametrisation
        Of the links.
    target : (n_b,)
        R times the base parameters that are approached; ρ for those of least squares.
    exponential : bool
        Whether terms that must not be negative are exponentials; else squares.
    shift : (n,) or None
        What is added to all parameters.
    """

    problem: Problem
    parametrisation: Parametrisation
    target: Vector
    exponential: bool = False
    shift: Vector | None = None

    @cached_property
    def order(self) -> npt.NDArray[np.intp]:
        """Columns of δ: those of the links first, then the others."""
        return np.concatenate([self.problem.links.ravel(), self.problem.others])

    @cached_property
    def offset(self) -> Vector:
        """Parameters at the zero of squares, (n,)."""
        bounds = self.problem.lower_bounds
        found = np.zeros(len(bounds)) if self.shift is None else self.shift.copy()
        others = self.problem.others
        found[others] += np.where(np.isfinite(bounds[others]), bounds[others], 0.0)
        return found

    @cached_property
    def bounded(self) -> npt.NDArray[np.bool_]:
        """Which of the others have a lower bound."""
        return np.isfinite(self.problem.lower_bounds[self.problem.others])

    @cached_property
    def linear(self) -> tuple[Matrix, Vector]:
        """A and b of ‖A y - b‖², with parameters y in units of their link; the unit is that of least squares."""
        problem = self.problem
        root = np.sqrt(problem.regression.scale)
        rows = problem.matrix * problem.units.parameters / root
        right = (self.target - problem.matrix @ self.offset) / root
        return np.ascontiguousarray(rows[:, self.order]), right

    @cached_property
    def gram(self) -> tuple[Matrix, Vector]:
        """AᵀA and Aᵀb."""
        A, b = self.linear
        return A.T @ A, A.T @ b

    def _split(self, theta: Vector) -> tuple[Matrix, Vector]:
        count = self.problem.links.size
        return theta[:count].reshape(-1, 10), theta[count:]

    def values(self, theta: Vector) -> Vector:
        """Parameters in units of their link, in `order`."""
        links, others = self._split(theta)
        positive = np.exp(others) if self.exponential else others**2
        return np.concatenate([self.parametrisation.inertial(links).ravel(), np.where(self.bounded, positive, others)])

    def slopes(self, theta: Vector) -> tuple[Matrix, Vector]:
        """Return the derivatives of `values`: of the links (links, 10, 10), of the others (k,)."""
        links, others = self._split(theta)
        positive = np.exp(others) if self.exponential else 2.0 * others
        return self.parametrisation.jacobian(links), np.where(self.bounded, positive, 1.0)

    def _right_product(self, matrix: Matrix, slopes: tuple[Matrix, Vector]) -> Matrix:
        """Matrix (m, n) times the derivatives."""
        blocks, diagonal = slopes
        count = 10 * len(blocks)
        found = np.empty_like(matrix)
        parts = matrix[:, :count].reshape(len(matrix), len(blocks), 10).swapaxes(0, 1)
        found[:, :count] = (parts @ blocks).swapaxes(0, 1).reshape(len(matrix), count)
        found[:, count:] = matrix[:, count:] * diagonal
        return found

    def residual(self, theta: Vector) -> Vector:
        """A y - b."""
        A, b = self.linear
        return np.asarray(A @ self.values(theta) - b)

    def jacobian(self, theta: Vector) -> Matrix:
        """Return the derivatives of `residual`."""
        return self._right_product(self.linear[0], self.slopes(theta))

    def objective(self, theta: Vector) -> float:
        """½ ‖A y - b‖²."""
        error = self.residual(theta)
        return 0.5 * float(error @ error)

    def gradient(self, theta: Vector) -> Vector:
        """Return the first derivatives of `objective`."""
        return self._pulled(theta, self._by_values(theta))

    def _by_values(self, theta: Vector) -> Vector:
        H, c = self.gram
        return np.asarray(H @ self.values(theta) - c)

    def _pulled(self, theta: Vector, gradient: Vector) -> Vector:
        blocks, diagonal = self.slopes(theta)
        links, others = self._split(gradient)
        return np.concatenate([np.einsum("ksa,ks->ka", blocks, links).ravel(), others * diagonal])

    def hessian(self, theta: Vector) -> Matrix:
        """Return the second derivatives of `objective`: those of Gauss and Newton, and a 10 x 10 block a link."""
        slopes = self.slopes(theta)
        half = self._right_product(self.gram[0], slopes)
        found = self._right_product(np.ascontiguousarray(half.T), slopes)
        links, others = self._split(theta)
        by_links, by_others = self._split(self._by_values(theta))
        blocks = self.parametrisation.curvature(links, by_links)
        count = 10 * len(links)
        places = np.arange(count).reshape(-1, 10)
        found[places[:, :, None], places[:, None, :]] += blocks
        more = by_others * np.where(self.bounded, np.exp(others) if self.exponential else 2.0, 0.0)
        diagonal = np.arange(count, len(theta))
        found[diagonal, diagonal] += more
        return found

    def to_parameters(self, theta: Vector) -> Vector:
        """δ of θ."""
        found = np.empty(len(theta))
        found[self.order] = self.values(theta)
        return np.asarray(found * self.problem.units.parameters + self.offset)

    def to_theta(self, parameters: Vector) -> Vector:
        """θ of parameters strictly inside the conditions; links move by the shift."""
        inside = np.array(parameters)
        inside[self.problem.others] -= self.offset[self.problem.others]
        scaled = (inside / self.problem.units.parameters)[self.order]
        links, others = self._split(scaled)
        positive = np.where(self.bounded, np.maximum(others, LEAST), 1.0)
        positive = np.log(positive) if self.exponential else np.sqrt(positive)
        return np.concatenate([self.parametrisation.theta(links).ravel(), np.where(self.bounded, positive, others)])

    def solve(
        self, start: Vector, solver: FactoredSolver, iterations: int, tolerance: float, progress: Progress | None = None
    ) -> FactoredOutcome:
        """Descend from parameters (n,) strictly inside the conditions."""
        import scipy.optimize

        theta = self.to_theta(start)
        if solver == "newton":
            return self._descend(theta, iterations, tolerance, progress)
        if progress is not None:
            progress(f"{solver} of SciPy, at most {iterations} evaluations")
        least_squares: Any = scipy.optimize.least_squares
        lm = solver == "levenberg-marquardt"
        found = least_squares(
            self._tall(self.residual) if lm else self.residual,
            theta,
            jac=self._tall(self.jacobian) if lm else self.jacobian,
            method="lm" if lm else "trf",
            xtol=1e-15,
            ftol=max(tolerance * tolerance, 1e-15),
            gtol=tolerance,
            max_nfev=iterations,
        )
        parameters = self.to_parameters(found.x)
        return FactoredOutcome(parameters, int(found.nfev), bool(found.success), str(found.message))

    def _descend(self, theta: Vector, iterations: int, tolerance: float, progress: Progress | None) -> FactoredOutcome:
        """Levenberg-Marquardt's damping with exact second derivatives, after Nielsen (1999)."""
        value, gradient, hessian = self.objective(theta), self.gradient(theta), self.hessian(theta)
        damping, growth = FIRST_DAMPING * float(np.abs(np.diagonal(hessian)).max(initial=1.0)), 2.0
        message, count = "limit of iterations", 0
        for _ in range(iterations):
            if float(np.abs(gradient).max(initial=0.0)) <= tolerance:
                message = ""
                break
            count += 1
            factor, failed = scipy.linalg.lapack.dpotrf(hessian + damping * np.eye(len(theta)), lower=1)
            if failed == 0:
                step = -scipy.linalg.lapack.dpotrs(factor, gradient, lower=1)[0]
                expected = -float(gradient @ step + 0.5 * step @ (hessian @ step))
                if expected <= ROUNDING * value:
                    message = ""
                    break
                ratio = (value - self.objective(theta + step)) / expected
            if failed != 0 or not ratio > WORTH_A_STEP:
                damping, growth = damping * growth, min(2.0 * growth, 64.0)
                if not np.isfinite(damping):
                    message = "no step lowers the residual"
                    break
                continue
            theta = theta + step
            value, gradient, hessian = self.objective(theta), self.gradient(theta), self.hessian(theta)
            damping, growth = damping * max(0.1, 1.0 - (2.0 * ratio - 1.0) ** 3), 2.0
            if progress is not None:
                error = self.problem.relative_error(self.to_parameters(theta))
                progress(f"iteration {count}: relative error {error:.4%}")
        return FactoredOutcome(self.to_parameters(theta), count, not message, message)

    def _tall(self, function: Any) -> Any:
        """Return the function with rows of zeros appended, because MINPACK needs as many rows as unknowns."""
        missing = len(self.order) - len(self.target)

        def padded(theta: Vector) -> Matrix:
            value: Matrix = function(theta)
            return np.concatenate([value, np.zeros((max(missing, 0), *value.shape[1:]))])

        return padded
