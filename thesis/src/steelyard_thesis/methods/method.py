"""The interface of the earlier methods, and the problem that each of them is given."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from steelyard.dynamics import Model
from steelyard.dynamics.threads import one_thread
from steelyard.errors import InputError
from steelyard.estimators.reduced_regression import ReducedRegression
from steelyard.feasibility import FeasibilityCertificate, FeasibleSet
from steelyard.feasibility.units import Units
from steelyard.regression import Estimate, Information, ParameterCovariance

__all__ = ["Method", "Problem", "Progress", "Weights", "require_choice", "require_positive"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]
Progress = Callable[[str], None]
"""A function that is called with a few words on each step."""

Weights = Literal["joint"] | npt.ArrayLike | None
"""None, ``"joint"`` or one weight for each joint, as in `steelyard.least_squares`."""

HEAVY = 1e3
"""Ratio of a link's mass to the robot's typical mass of a link above which a remark says that masses grew."""


class Method(ABC):
    """An identification method: a frozen dataclass whose fields are the method's own settings, as published."""

    name: ClassVar[str]
    """Authors and year."""

    source: ClassVar[str]
    """Full citation."""

    def fit(
        self,
        information: Information,
        feasible_set: FeasibleSet,
        *,
        weights: Weights = "joint",
        prior: npt.ArrayLike | None = None,
        progress: Progress | None = None,
    ) -> Estimate:
        """Identify.

        Parameters
        ----------
        information : Information
            Of the same model as `feasible_set`.
        feasible_set : FeasibleSet
        weights : "joint", None or (N,)
            As in `steelyard.least_squares`.
        prior : (n,), optional
            Standard parameters known before, such as those of CAD; NaN where unknown.
        progress : callable, optional
            Is told what happens.

        Returns
        -------
        Estimate
            `parameters` where the method gives standard parameters; `consistency` only where they are proved feasible.
            A method that does not converge returns the best that it has and says so in `remarks`.

        Raises
        ------
        InputError
            For data of another model, a prior of the wrong length, and constraints that the method cannot express.
        """
        problem = Problem.of(information, feasible_set, weights)
        known = problem.as_prior(prior)
        with one_thread():
            return self._fit(problem, known, progress)

    @abstractmethod
    def _fit(self, problem: Problem, prior: Vector | None, progress: Progress | None) -> Estimate:
        """Identify from reduced data; the prior is checked, (n,) with NaN where unknown."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Least squares in standard parameters over the reduced regression: ‖R K δ - ρ‖² + residual2 (thesis 3.48, 2.41).

    Attributes
    ----------
    information : Information
    feasible_set : FeasibleSet
    weights : (N,) or None
        Joint weights that are in R and ρ already.
    R : (n_b, n_b)
    rho : (n_b,)
    residual2 : float
        Squared residual of plain least squares.
    norm2 : float
        Squared norm of the (weighted) regressand.
    """

    information: Information = field(repr=False)
    feasible_set: FeasibleSet
    weights: Vector | None
    R: Matrix = field(repr=False)
    rho: Vector = field(repr=False)
    residual2: float
    norm2: float

    @classmethod
    def of(cls, information: Information, feasible_set: FeasibleSet, weights: Weights = "joint") -> Problem:
        """Reduce and weight.

        Parameters
        ----------
        information : Information
        feasible_set : FeasibleSet
        weights : "joint", None or (N,)
            ``"joint"`` is None where the rows of the joints are not known apart, as in `steelyard.fit`.

        Raises
        ------
        InputError
            If the data belongs to another model, or holds no usable samples.
        """
        values = information.joint_weights(weights) if information.is_weighted(weights) else None
        reduced = information.reduced(values)
        checked = ReducedRegression.of(reduced, feasible_set)
        problem = cls(information, feasible_set, values, reduced.R, reduced.rho, reduced.residual2, reduced.norm2)
        problem.__dict__["regression"] = checked
        return problem

    @cached_property
    def regression(self) -> ReducedRegression:
        """The problem around its least squares solution, in the form that `steelyard.fit` uses."""
        return ReducedRegression.of(self.information.reduced(self.weights), self.feasible_set)

    @cached_property
    def matrix(self) -> Matrix:
        """R K, (n_b, n): what the standard parameters do."""
        return np.asarray(self.R @ self.feasible_set.K)

    @property
    def least_squares(self) -> Vector:
        """Base parameters of plain least squares, (n_b,)."""
        return self.regression.base

    @cached_property
    def units(self) -> Units:
        """Masses and lengths that are typical of this robot, from CAD or from the torques."""
        return self.regression.units(self.feasible_set).with_cad()

    @cached_property
    def links(self) -> Indices:
        """Columns of ``Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m`` of every link in δ, (links, 10)."""
        return self.feasible_set.link_columns

    @cached_property
    def others(self) -> Indices:
        """Columns of all other parameters (of drive terms) in δ."""
        mask = np.ones(self.feasible_set.parameter_count, dtype=bool)
        mask[self.links] = False
        return np.flatnonzero(mask)

    @cached_property
    def lower_bounds(self) -> Vector:
        """Least value of each parameter that the set states by itself, (n,): 0 for friction, -inf where none."""
        bounds = np.full(self.feasible_set.parameter_count, -np.inf)
        for block in self.feasible_set.blocks:
            if block.kind != "link" and block.size == 1 and len(block.indices) == 1 and block.coefficients[0, 0, 0] > 0:
                index = block.indices[0]
                bounds[index] = max(bounds[index], -block.constant[0, 0] / block.coefficients[0, 0, 0])
        return bounds

    def margin_shift(self, full: bool) -> Vector:
        """Parameters of links whose matrices D are the set's margin times 1, (n,); zero for terms.

        D(δ) - ε 1 = D(δ - shift), so that conditions on δ - shift keep the distance that `steelyard.fit` keeps.

        Parameters
        ----------
        full : bool
            Whether D are the 4 x 4 pseudo-inertias of "full" consistency, else the 6 x 6 matrices of "inertia".
        """
        found = np.zeros(self.feasible_set.parameter_count)
        found[self.links[:, [0, 3, 5]]] = self.feasible_set.margin * (2.0 if full else 1.0)
        found[self.links[:, 9]] = self.feasible_set.margin
        return found

    def squared_residual(self, parameters: Vector) -> float:
        """‖W K δ - ω‖², weighted."""
        error = self.matrix @ parameters - self.rho
        return float(error @ error) + self.residual2

    def relative_error(self, parameters: Vector) -> float:
        """``‖W K δ - ω‖ / ‖ω‖``, weighted."""
        return float(np.sqrt(self.squared_residual(parameters) / self.norm2))

    def as_prior(self, prior: npt.ArrayLike | None) -> Vector | None:
        """Check standard parameters known before, (n,); NaN where unknown.

        Raises
        ------
        InputError
            If the length is wrong.
        """
        if prior is None:
            return None
        values = np.asarray(prior, dtype=np.float64)
        count = self.feasible_set.parameter_count
        if values.shape != (count,) or np.any(np.isinf(values)):
            raise InputError(
                f"prior must hold the model's {count} standard parameters, NaN where unknown, got an array of shape "
                f"{values.shape}{' with infinite values' if values.shape == (count,) else ''}."
            )
        return values

    def base_of(self, parameters: Vector) -> Vector:
        """K δ, (n_b,), NaN for what depends on an unknown (NaN) parameter."""
        unknown = np.isnan(parameters)
        base = self.feasible_set.K @ np.where(unknown, 0.0, parameters)
        return np.where(np.any(self.feasible_set.K[:, unknown] != 0.0, axis=1), np.nan, base)

    def refuse_constraints(self, method: str) -> None:
        """Refuse constraints beyond those of links and terms, which the method cannot express.

        Raises
        ------
        InputError
            If the set has any.
        """
        if self.feasible_set.constraints:
            kinds = ", ".join(sorted({type(c).__name__ for c in self.feasible_set.constraints}))
            raise InputError(
                f"{method} knows the conditions of links and terms alone, but the feasible set also has {kinds}; "
                "leave the constraints out, or use steelyard.fit."
            )
        for block in self.feasible_set.blocks:
            if block.kind == "term" and not (block.size == 1 and len(block.indices) == 1):
                raise InputError(
                    f"{method} knows terms whose parameters have lower bounds of their own, but {block.name!r} is a "
                    "condition on several parameters or a matrix; use steelyard.fit."
                )

    def estimate(
        self,
        method: str,
        parameters: Vector | None = None,
        base: Vector | None = None,
        remarks: Sequence[str] = (),
    ) -> Estimate:
        """Return the estimate; whether it is feasible is proved here, exactly.

        Parameters
        ----------
        method : str
            In words.
        parameters : (n,), optional
            Standard parameters, where the method gives them.
        base : (n_b,), optional
            Base parameters; K δ where absent.
        remarks : sequence of str
            Sentences.

        Returns
        -------
        Estimate
        """
        information, feasible_set, model = self.information, self.feasible_set, self.feasible_set.model
        if base is None:
            if parameters is None:
                raise InputError("an estimate needs parameters or base parameters; give one of them.")
            base = feasible_set.K @ parameters
        proved = parameters is not None and feasible_set.contains(parameters)
        notes = [*information.remarks, *remarks]
        if parameters is not None and not proved:
            notes.append(f'The parameters are not feasible in the sense of "{feasible_set.consistency}".')
        if parameters is not None and len(self.links):
            heaviest = float(parameters[self.links[:, 9]].max())
            if heaviest > HEAVY * float(self.units.masses.max()):
                notes.append(
                    f"Masses grew to {heaviest:.3g} kg: the residual keeps falling as masses that the motion does not "
                    "show grow."
                )
        unidentifiable = np.asarray(information.unidentifiable_mask)
        if unidentifiable.any():
            notes.append(
                f"The data does not determine {len(information.unidentifiable)} of {information.base_count} base "
                f"parameters: {'; '.join(information.unidentifiable)}."
            )
        drives: dict[str, Any] = {}
        expressions, joint_names = information.base_expressions, information.joint_names
        if isinstance(model, Model):
            # Reduced data has names of its own, or none.
            expressions = model.base_parameters().expressions
            joint_names = joint_names or tuple(model.robot.joint_names)
            if parameters is not None:
                drives = model.drives(parameters).always_told()
        certificate = None
        if proved and parameters is not None:
            # Methods that set base parameters to zero mean zero, so that these are given and the parameters follow.
            certificate = FeasibilityCertificate(feasible_set, base, parameters)
            parameters = np.array([float(value) for value in certificate.exact_parameters])
        return Estimate(
            method=method,
            base_names=information.base_names,
            base_expressions=expressions if certificate is None else certificate.base_expressions,
            base=base,
            standard_error=ParameterCovariance.of(information, base, self.weights).standard_error,
            filtered_torque=information.filtered_torque,
            joint_names=joint_names,
            relative_error=information.relative_error(base),
            row_count=information.count,
            condition_number=information.condition_number,
            joint_relative_error=information.joint_relative_error(base) if information.has_joint_errors else None,
            weights=self.weights,
            parameter_names=() if parameters is None else tuple(map(str, model.parameter_names)),
            parameters=parameters,
            consistency=feasible_set.consistency if proved else None,
            **drives,
            certificate=None if certificate is None else certificate.document(),
            remarks=tuple(notes),
        )


def require_positive(method: object, *names: str, zero: Sequence[str] = ()) -> None:
    """Refuse settings of a method that are not positive numbers.

    Parameters
    ----------
    method : object
    names : str
        Its fields.
    zero : sequence of str
        Fields that may also be zero.

    Raises
    ------
    InputError
        That names the field and its value.
    """
    for name in (*names, *zero):
        value = getattr(method, name)
        number = isinstance(value, (int, float)) and not isinstance(value, bool) and np.isfinite(value)
        if not number or value < 0 or (value == 0 and name not in zero):
            least = "zero or a positive number" if name in zero else "a positive number"
            raise InputError(f"{name} of {type(method).__name__} must be {least}, got {value!r}.")


def require_choice(method: object, name: str, choices: Sequence[str]) -> None:
    """Refuse a setting of a method that is not one of its choices.

    Raises
    ------
    InputError
        That names the field, its value and the choices.
    """
    value = getattr(method, name)
    if value not in choices:
        known = ", ".join(map(repr, choices))
        raise InputError(f"{name} of {type(method).__name__} must be one of {known}, got {value!r}.")
