"""The feasible fit that stays as near to what is known of the robot as costs nothing on data that it has not seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.display import html_table, text_table
from steelyard.dynamics import Model
from steelyard.dynamics.threads import in_one_thread
from steelyard.feasibility import FeasibleSet
from steelyard.feasibility.certificates import FeasibilityCertificate
from steelyard.feasibility.constraints import Constraint
from steelyard.files import plain
from steelyard.regression import Estimate, Information, ParameterCovariance

from .cross_validation import FEWEST_FOLDS, TYPICAL_COUNT, CrossValidation, cross_validation, term_deviations
from .fit import fit
from .physical_prior import PhysicalPrior, physical_prior
from .prior import ConstantPullbackPrior, EntropicPrior, distance_from
from .reduced_fit import fit_reduced

__all__ = [
    "PlausibleFit",
    "PriceOfPlausibility",
    "TriedPrior",
    "allowed_share",
    "plausible_fit",
    "set_with_habits",
    "tried_prior",
    "untested_weight",
]

Array = NDArray[np.float64]

SHARES = (1.0, 0.1, 0.01, 0.001)
"""Parts of the prior's weight that are tried where nothing can be held out."""

INDEPENDENT_ROWS = 4.0
"""Independent rows for each base parameter below which all of the weight counts: how uncertain least squares are is not
known then. A Gen3 that moved for 4.7 s, with 2.7 of them, predicts another motion to 8 % so, and to 16 % with as little
of the weight as its covariance asks for; a KR300 with 9 of them, to 27 and 17 %."""

UNTESTED_WEIGHT = 100.0
"""The weight of the prior, for `TYPICAL_COUNT` rows, where nothing can be held out to choose it: what cross-validation
chose for half of 36 simulated logs of twelve arms, within a factor of ten."""

PRICE_GAP = 1e-4
"""Part of the squared residual by which the fit without a prior, of which the error alone is told, may miss the optimum
as far as is proved: of an error of 5 % that is 0.00025 %. To prove 1e-6, as of an answer, takes a second attempt and
five times as long for bounds, and found the same error to seven digits (the WAM)."""


@dataclass(frozen=True, eq=False)
class PriceOfPlausibility:
    """The price of plausibility: the errors of fits that stay near the prior, for every weight that was tried.

    Attributes
    ----------
    prior_weights : (k,)
        Ascending.
    training_error, held_out_error : (k,)
        Relative errors over all the joints, on the data of the fit, and on the stretches left out in turn.
    chosen : int
        Where the answer stands.
    best : int
        Where the held-out error is least.
    unrestricted_error : float
        On the data of the fit, of the feasible optimum without a prior.
    least_squares_error, least_squares_held_out_error : float
        Of plain least squares.
    """

    prior_weights: Array
    training_error: Array
    held_out_error: Array
    chosen: int
    best: int
    unrestricted_error: float
    least_squares_error: float
    least_squares_held_out_error: float

    @property
    def sentence(self) -> str:
        """The price in words."""
        chosen, without = f"{self.training_error[self.chosen]:.2%}", f"{self.unrestricted_error:.2%}"
        beside = "as much as" if chosen == without else without
        return (
            f"Staying near the prior leaves {chosen} of the torques unexplained on the data of the fit, {beside} "
            "without a prior; on stretches left out, "
            f"{self.held_out_error[self.chosen]:.2%} where plain least squares has "
            f"{self.least_squares_held_out_error:.2%}."
        )

    def _rows(self) -> list[tuple[str, ...]]:
        marks = {self.best: "best", self.chosen: "chosen"}
        numbers = zip(self.prior_weights, self.training_error, self.held_out_error, strict=True)
        return [
            (f"{weight:.3g}", f"{training:.2%}", f"{held_out:.2%}", marks.get(index, ""))
            for index, (weight, training, held_out) in enumerate(numbers)
        ]

    def __str__(self) -> str:
        table = text_table(("weight", "training", "held out", ""), self._rows(), numbers=(0, 1, 2))
        return f"{self.sentence}\n{table}"

    def _repr_html_(self) -> str:
        return html_table(self.sentence, ("weight", "training", "held out", ""), self._rows())

    def to_dict(self) -> dict[str, Any]:
        """As plain data for JSON."""
        return {**plain(self)}


@dataclass(frozen=True, eq=False)
class PlausibleFit:
    """The answer, and how it was found.

    Attributes
    ----------
    estimate : Estimate
        Proved to satisfy the conditions of the user's feasible set; those of the prior are not part of the proof.
    plausible_set : FeasibleSet
        The conditions of the user, and those of the prior.
    term_deviations : (n,)
        See `steelyard.estimators.cross_validation.term_deviations`.
    validation : CrossValidation or None
        None where the logs are too short for it. Where the weight was given, it is the only one.
    price : PriceOfPlausibility or None
        None where `validation` is.
    """

    estimate: Estimate
    plausible_set: FeasibleSet
    prior: PhysicalPrior
    prior_weight: float
    term_deviations: Array = field(repr=False)
    validation: CrossValidation | None = field(default=None, repr=False)
    price: PriceOfPlausibility | None = field(default=None, repr=False)

    @property
    def held_out_error(self) -> Array | None:
        """(N,): root mean square of the residuals of each joint on stretches that are left out in turn."""
        return None if self.validation is None else self.validation.joint_errors[self.validation.chosen_index]


@dataclass(frozen=True, eq=False)
class TriedPrior:
    """A prior with its cross-validation: how well fits near it predict data that was not used in them.

    Attributes
    ----------
    scaled : PhysicalPrior
        The same with masses that the data scaled, where they were not known.
    plausible_set : FeasibleSet
        The conditions of the user, and those of the prior.
    distance : Prior
    term_deviations : (n,)
    weight : float
        Of the prior, the largest that predicts stretches of the data as well as the best does, to one standard error.
    validation : CrossValidation or None
        None where the logs are too short for it. Where the weight was given, it is the only one.
    """

    known: PhysicalPrior
    scaled: PhysicalPrior
    plausible_set: FeasibleSet
    distance: EntropicPrior | ConstantPullbackPrior
    term_deviations: Array
    weight: float
    validation: CrossValidation | None


@in_one_thread
def tried_prior(
    info: Information,
    stretches: Sequence[Information],
    feasible_set: FeasibleSet,
    unconstrained: Estimate,
    *,
    prior: PhysicalPrior | None = None,
    prior_weight: float | Literal["auto"] = "auto",
) -> TriedPrior:
    """Try weights of what is known of a robot; see `steelyard.estimators.cross_validation`.

    Parameters
    ----------
    stretches : sequence of Information
        Contiguous parts of the data. With fewer than three, the weight is 100 for each ten thousand rows, or as large a
        part of that as `allowed_share` allows.
    feasible_set : FeasibleSet
        With the constraints of the user.
    unconstrained : Estimate
        Plain least squares of the same data, whose joint weights are used.
    prior : PhysicalPrior, optional
        What is known; gathered from the robot by default.
    prior_weight : float or "auto"

    Raises
    ------
    SolverError
        If no parameters satisfy the constraints of the user.
    """
    model = feasible_set.model
    assert isinstance(model, Model)
    known = physical_prior(model, feasible_set.constraints) if prior is None else prior
    scaled = known.scaled_to(info, feasible_set)
    plausible_set = set_with_habits(feasible_set, scaled)
    scales = term_deviations(info, feasible_set)
    distance = distance_from(scaled.parameters, feasible_set, scales)
    given = None if prior_weight == "auto" else [float(prior_weight)]
    validation, used = None, unconstrained.weights
    if len(stretches) >= FEWEST_FOLDS:
        validation = cross_validation(info, stretches, plausible_set, distance, weights=used, prior_weights=given)
        weight = validation.weight
    elif given is not None:
        weight = given[0]
    else:
        problem, whole = info.reduced(used), untested_weight(info.count)
        covariance = ParameterCovariance.of(info, unconstrained.base, used)
        deviations = covariance.in_deviations()

        def away(share: float) -> float:
            fitted = fit_reduced(problem, plausible_set, prior=distance, prior_weight=share * whole, gap=PRICE_GAP)
            return float(np.sum((deviations @ (fitted.base - unconstrained.base)) ** 2))

        weight = whole * allowed_share(away, covariance)
    return TriedPrior(known, scaled, plausible_set, distance, scales, weight, validation)


def set_with_habits(feasible_set: FeasibleSet, prior: PhysicalPrior) -> FeasibleSet:
    """The set with the conditions of the prior beside its own."""
    constraints: list[Constraint] = [*feasible_set.constraints, *prior.constraints]
    return FeasibleSet(
        feasible_set.model, feasible_set.consistency, constraints, feasible_set.margin, feasible_set.terms
    )


def untested_weight(count: int) -> float:
    """The weight of the prior beside so many rows where nothing can be held out to choose it."""
    return UNTESTED_WEIGHT * max(count / TYPICAL_COUNT, 1.0)


def allowed_share(away: Callable[[float], float], covariance: ParameterCovariance) -> float:
    """Return the largest part of the prior's weight with which it moves a fit no further than noise does.

    So a fit lies where the data's own confidence region is, as far as the set allows (the discrepancy principle of
    Morozov, 1966). *Measured* with all of the weight, on simulated arms that moved for 60 s: torques off by 0.24 %
    (WAM), 3 and 7 % (two joints), where least squares are off by 0.09, 0.05 and 0.3 %, and fits some hundred standard
    deviations from these.

    Parameters
    ----------
    away : callable
        Returns for a part of the weight how far the fit is from least squares: squared, in standard deviations.
    covariance : ParameterCovariance
        Of least squares.
    """
    correlation, count = covariance.correlation, len(covariance.root)
    # Sums that do not tell how long residuals last, of rows that each count for an independent one, tell too much.
    if correlation is None or float(np.sum(correlation.effective_count)) < INDEPENDENT_ROWS * count:
        return 1.0
    # How far noise moves the base parameters on average is their number.
    found: list[float] = []
    for share in SHARES:
        found.append(away(share))
        if found[-1] <= count:
            break
    # Where the set itself keeps fits away from the data, a smaller weight mends nothing.
    return SHARES[int(np.argmax(np.array(found) - found[-1] <= count))]


@in_one_thread
def plausible_fit(
    info: Information, feasible_set: FeasibleSet, unconstrained: Estimate, tried: TriedPrior
) -> PlausibleFit:
    """Fit within the feasible set, near what is known of the robot.

    Parameters
    ----------
    info : Information
    feasible_set : FeasibleSet
        With the constraints of the user.
    unconstrained : Estimate
        Plain least squares of the same data, whose joint weights are used.
    tried : TriedPrior
        What `tried_prior` made of them.

    Raises
    ------
    SolverError
        If no parameters satisfy the constraints of the user.
    """
    plausible_set, weight, validation = tried.plausible_set, tried.weight, tried.validation
    estimate = fit(info, plausible_set, weights=unconstrained.weights, prior=tried.distance, prior_weight=weight)
    assert estimate.parameters is not None
    # What is proved is what the user asked for: the conditions of the prior are habits of robots, not laws.
    certificate = FeasibilityCertificate.of_parameters(feasible_set, estimate.parameters)
    estimate = replace(estimate, certificate=certificate.document(), base=certificate.base)
    price = None if validation is None else _price(info, feasible_set, unconstrained, validation, plausible_set)
    return PlausibleFit(estimate, plausible_set, tried.scaled, weight, tried.term_deviations, validation, price)


def _price(
    info: Information,
    feasible_set: FeasibleSet,
    unconstrained: Estimate,
    validation: CrossValidation,
    plausible_set: FeasibleSet,
) -> PriceOfPlausibility:
    torque = _size(np.sqrt([f.norm2 / max(f.count, 1) for f in info.measured]))
    reduced = info.reduced(unconstrained.weights)
    free = fit_reduced(reduced, feasible_set, prefer=None, gap=PRICE_GAP)
    return PriceOfPlausibility(
        prior_weights=validation.prior_weights,
        training_error=np.array([info.relative_error(plausible_set.K @ p) for p in validation.parameters]),
        held_out_error=np.array([_size(errors) / torque for errors in validation.joint_errors]),
        chosen=validation.chosen_index,
        best=validation.best_index,
        unrestricted_error=info.relative_error(free.base),
        least_squares_error=unconstrained.relative_error,
        least_squares_held_out_error=_size(validation.plain_joint_errors) / torque,
    )


def _size(values: ArrayLike) -> float:
    return float(np.linalg.norm(values))
