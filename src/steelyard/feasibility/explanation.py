"""Explaining why an estimate is infeasible."""

import math
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from steelyard.conic import ConicProblem, solve
from steelyard.display import combination, few_digits, html_sentences, html_table, percent, text_table
from steelyard.dynamics.threads import one_thread
from steelyard.errors import InputError
from steelyard.files import plain, tell
from steelyard.regression import ParameterCovariance

from .bounds.confidence_region import region_of
from .check import check
from .feasible_set import FeasibleSet
from .irreducible_subsystem import IrreducibleInfeasibleSubsystem, irreducible_infeasible_subsystems
from .nearest_point import nearest_in_region

__all__ = [
    "BaseParameterDegree",
    "InfeasibilityExplanation",
    "change_alone",
    "explain_infeasibility",
    "rank_correlation",
]

Vector = npt.NDArray[np.float64]

ABSENT = 1e-7
"""A base parameter with less weight than this in a contradiction cannot resolve it: the weight is a rounding error of a
direction whose largest element is 1."""


@dataclass(frozen=True, eq=False)
class BaseParameterDegree:
    """The part of one base parameter in the infeasibility of an estimate.

    Attributes
    ----------
    name : str
        Such as ``"Lzz1R"``: the leading parameter of the combination, with an R if it is regrouped with others.
    expression : str
        The combination of standard parameters, such as ``"Lzz1 + m2"``.
    value : float
    change : float
        Difference between the nearest feasible base parameters and the estimate.
    share : float
        Share of this parameter in the squared distance. Shares add up to 1; they may be negative if the metric is not
        diagonal.
    alone : float
        Smallest change of this parameter alone, with its sign, that makes the estimate feasible; infinite if there is
        none.
    deviation : float
        Standard deviation; nan if it is not known, infinite where the data does not determine the parameter.
    """

    name: str
    expression: str
    value: float
    change: float
    share: float
    alone: float
    deviation: float

    @property
    def relative_deviation(self) -> float:
        """Standard deviation over the size of the parameter (thesis 4.29)."""
        return self.deviation / abs(self.value) if self.value else float("inf")

    @property
    def change_in_deviations(self) -> float:
        """The change over the standard deviation."""
        return self.change / self.deviation if self.deviation else float("nan")


def change_alone(
    feasible_set: FeasibleSet,
    base: Vector,
    index: int,
    subsystems: tuple[IrreducibleInfeasibleSubsystem, ...],
    solver: str,
) -> float:
    """The smallest change of one base parameter that makes the estimate feasible; infinite if there is none.

    Parameters
    ----------
    base : (n_b,)
    subsystems : tuple of IrreducibleInfeasibleSubsystem
        The contradictions of these base parameters; all must be resolved.
    """
    if not subsystems:
        return 0.0
    weights = np.array([subsystem.direction[index] for subsystem in subsystems])
    if np.any(np.abs(weights) < ABSENT) or np.any(np.sign(weights) != np.sign(weights[0])):
        return float("inf")
    sign = float(np.sign(weights[0]))
    stack, unit = feasible_set.stack, sign * feasible_set.lift[:, index]
    needed = max(
        (subsystem.threshold - subsystem.value) / abs(w) for subsystem, w in zip(subsystems, weights, strict=True)
    )
    # In units of the change that the contradictions require at least.
    directions = np.hstack([needed * unit[:, None], feasible_set.unidentifiable])
    reference, count = feasible_set.lift @ base, directions.shape[1]
    equations, blocks = feasible_set.rows(directions, reference)
    cost = np.concatenate([[1.0], np.zeros(count - 1)])
    problem = ConicProblem.from_rows(cost, (equations, blocks))
    solution = solve(problem, solver=solver)
    if not solution.usable:
        return float("inf")
    left = blocks.right - blocks.matrix @ solution.primal
    if _smallest_eigenvalue(feasible_set, left) < -1e-4 * needed * float(
        np.abs(stack.coefficients @ unit).max(initial=0.0)
    ):
        return float("inf")
    return float(sign * needed * solution.primal[0])


def _smallest_eigenvalue(feasible_set: FeasibleSet, stacked: Vector) -> float:
    return min((float(np.linalg.eigvalsh(D)[0]) for D in feasible_set.stack.matrices(stacked)), default=0.0)


def rank_correlation(first: Vector, second: Vector) -> tuple[float, float]:
    """Spearman's rank correlation and its p-value; nan if they are not defined.

    Examples
    --------
    >>> round(rank_correlation(np.array([1.0, 2.0, 3.0, 4.0]), np.array([1.0, 10.0, 100.0, 50.0]))[0], 12)
    0.8
    """
    from scipy.special import betainc
    from scipy.stats import rankdata

    kept = ~(np.isnan(first) | np.isnan(second))
    one, other = rankdata(first[kept]), rankdata(second[kept])
    if len(one) < 3 or np.ptp(one) == 0 or np.ptp(other) == 0:
        return float("nan"), float("nan")
    value = float(np.corrcoef(one, other)[0, 1])
    freedom = len(one) - 2
    # Student's t with t² = ρ² f / (1 - ρ²).
    chance = float(betainc(freedom / 2.0, 0.5, max(0.0, 1.0 - value**2)))
    return value, chance


HEADS = ("name", "value", "change", "in deviations", "share", "alone", "base parameter")

SMALLEST_SHARE = 1e-4
"""Smallest share of a condition that is listed."""

SHOWN = 12
"""Number of base parameters in the table, those with the largest shares."""


@dataclass(frozen=True, eq=False)
class InfeasibilityExplanation:
    """The answer of `explain_infeasibility`.

    Attributes
    ----------
    status : str
        ``"feasible"``, ``"infeasible"`` or ``"undecided"``, as `check` says.
    margin : float
        Largest margin (`Verdict.margin`).
    shares : tuple of (str, float)
        Conditions that the nearest feasible parameters only just satisfy, with their shares in the squared distance,
        largest first.
    subsystems : tuple of IrreducibleInfeasibleSubsystem
        Small sets of conditions that contradict each other. No condition is in two of them, and the conditions outside
        them can hold together.
    degrees : tuple of BaseParameterDegree
        Of every base parameter.
    distance : float
        Distance to the nearest feasible base parameters, in standard deviations if the covariance is known, else
        Euclidean.
    probability : float or None
        Probability of the confidence region with that radius.
    region : float or None
        Radius of the 95 % region, in standard deviations.
    correlation : float or None
        Spearman's rank correlation between relative standard deviation and degree of infeasibility (the size of the
        change over that of the parameter), over all identifiable base parameters.
    chance : float or None
        Probability of a correlation at least as strong by chance (p-value).
    base : (n_b,)
    nearest : (n_b,)
        The nearest feasible base parameters.
    consistency : str
    """

    status: str
    margin: float
    shares: tuple[tuple[str, float], ...]
    subsystems: tuple[IrreducibleInfeasibleSubsystem, ...]
    degrees: tuple[BaseParameterDegree, ...]
    distance: float
    probability: float | None
    region: float | None
    correlation: float | None
    chance: float | None
    base: Vector = field(repr=False)
    nearest: Vector = field(repr=False)
    consistency: str

    @property
    def reasons(self) -> tuple[str, ...]:
        """Each of the subsystems in a sentence."""
        names = [degree.name for degree in self.degrees]
        return tuple(f"{one}: {_in_words(one, self.base, names)}." for one in self.subsystems)

    def sentences(self) -> tuple[str, ...]:
        """The explanation in sentences."""
        kind = f'under "{self.consistency}" consistency'
        if self.status == "feasible":
            return (f"Nothing to explain: the estimate is feasible {kind}, with a margin of {self.margin:.3g}.",)
        if self.status == "undecided":
            return (
                f"It cannot be told whether the estimate is feasible {kind}: it is too close to the boundary (margin "
                f"{self.margin:.3g}).",
            )
        count = len(self.subsystems)
        if count == 1:
            found = [f"The estimate is infeasible {kind}: {self.reasons[0]}"]
        else:
            several = f", for {count} reasons that have no condition in common" if count else ", by very little"
            found = [f"The estimate is infeasible {kind}{several}."]
            found += [f"{number}. {reason}" for number, reason in enumerate(self.reasons, start=1)]
        if self.region is None:
            found.append(f"The nearest feasible base parameters lie {few_digits(self.distance)} away.")
        else:
            found.append(
                f"The nearest feasible base parameters lie {few_digits(self.distance)} standard deviations away; the "
                f"95 % region ends at {few_digits(self.region)}."
            )
        largest = [f"{name} ({percent(share, 2)})" for name, share in self.shares[:5] if share >= 0.005]
        if largest:
            found.append(f"What keeps the estimate out, by shares in the squared distance: {', '.join(largest)}.")
        cured = [degree for degree in self.degrees if math.isfinite(degree.alone)]
        if cured:
            best = min(cured, key=lambda degree: abs(degree.alone))
            found.append(f"{best.name} alone could make it feasible, by a change of {few_digits(best.alone)}.")
        else:
            found.append("No base parameter alone can make it feasible.")
        if self.correlation is not None and not math.isnan(self.correlation):
            found.append(
                f"Poorly identified parameters are the infeasible ones with a rank correlation of "
                f"{self.correlation:.2f} (by chance as strong with a probability of {self.chance:.2g})."
            )
        return tuple(found)

    def _rows(self) -> list[tuple[str, ...]]:
        order = sorted(self.degrees, key=lambda degree: -abs(degree.share))[:SHOWN]
        found: list[tuple[str, ...]] = []
        for degree in order:
            deviations = few_digits(degree.change_in_deviations, 3) if not math.isnan(degree.deviation) else "-"
            alone = few_digits(degree.alone, 3) if math.isfinite(degree.alone) else "-"
            share = percent(degree.share)
            found.append(
                (
                    degree.name,
                    few_digits(degree.value, 5),
                    few_digits(degree.change, 3),
                    deviations,
                    share,
                    alone,
                    degree.expression,
                )
            )
        return found

    def __str__(self) -> str:
        if self.status != "infeasible":
            return self.sentences()[0]
        return "\n".join((*self.sentences(), text_table(HEADS, self._rows(), numbers=(1, 2, 3, 4, 5))))

    def _repr_html_(self) -> str:
        first, *others = self.sentences()
        text = html_sentences(first, others, strong=True)
        if self.status != "infeasible":
            return text
        return text + html_table("Base parameters with the largest shares", HEADS, self._rows())

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data for JSON; what is infinite or unknown is None."""
        found: dict[str, Any] = plain(self)
        found["shares"] = [{"name": name, "share": share} for name, share in self.shares]
        for subsystem in found["subsystems"]:
            del subsystem["blocks"]
        return found


def _in_words(subsystem: IrreducibleInfeasibleSubsystem, base: Vector, names: list[str]) -> str:
    """The impossible combination, with its largest terms."""
    parts = np.abs(subsystem.direction * base)
    order = np.argsort(-parts, kind="stable")
    kept = [i for i in order if parts[i] > 1e-3 * parts.max(initial=0.0)]
    text = combination(subsystem.direction[kept], [names[i] for i in kept], most=4)
    least = "negative" if abs(subsystem.threshold) < 1e-12 else f"below {few_digits(subsystem.threshold)}"
    return f"{text} is {few_digits(subsystem.value)}, and in no robot {least}"


def explain_infeasibility(
    feasible_set: FeasibleSet,
    base: npt.ArrayLike | None = None,
    *,
    info: Any = None,
    covariance: npt.ArrayLike | ParameterCovariance | None = None,
    weights: Any = "joint",
    solver: str = "clarabel",
) -> InfeasibilityExplanation:
    """Find the links, terms, constraints and base parameters that make an estimate infeasible (thesis 8.1).

    Parameters
    ----------
    feasible_set : FeasibleSet
    base : (n_b,), optional
        The estimate; by default the least-squares solution if `info` is given.
    info : Information, optional
        The data, with which distances are in standard deviations of the estimate.
    covariance : (n_b, n_b) or ParameterCovariance, optional
        Covariance of the estimate, instead of `info`.
    weights : "joint", None or (N,)
        Weights of the joints in `info`, as in `least_squares`.
    solver : str
        As in `solve`.

    Raises
    ------
    InputError
        If nothing is given, or something does not fit the model.
    SolverError
        If no parameters at all satisfy the conditions.

    See Also
    --------
    check : The verdict, with its proof.
    shadow_prices : By how much the conditions raise the residual of a fit.

    Examples
    --------
    A pendulum whose moment of inertia came out negative:

    >>> from steelyard.dynamics import Model
    >>> from steelyard.feasibility import FeasibleSet
    >>> from steelyard.robot import Robot
    >>> model = Model(Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    >>> explanation = explain_infeasibility(FeasibleSet(model), base=[-0.6, 1.0, 0.0])
    >>> print(explanation.reasons[0])
    body of link1 cannot hold by itself: Lzz1 is -0.6, and in no robot negative.
    """
    with one_thread():
        region = region_of(feasible_set, base, info, covariance, weights)
        if region is None and base is None:
            raise InputError("neither base= nor info= was given; give the estimate or the data that it follows from.")
        beta = region.base if region is not None else feasible_set.as_base(base if base is not None else ())
        verdict = check(feasible_set, base=beta)
        names = tuple(zip(_base_names(feasible_set), _base_expressions(feasible_set), strict=True))
        count = len(beta)
        deviation = region.covariance.standard_error if region is not None else np.full(count, np.nan)
        told = partial(
            InfeasibilityExplanation,
            status=verdict.status,
            margin=verdict.margin,
            region=None if region is None else region.radius,
            base=beta,
            consistency=feasible_set.consistency,
        )
        if verdict.feasible is not False:
            degrees = tuple(
                BaseParameterDegree(*name, float(value), 0.0, 0.0, 0.0, float(sigma))
                for name, value, sigma in zip(names, beta, deviation, strict=True)
            )
            return told(
                shares=(),
                subsystems=(),
                degrees=degrees,
                distance=0.0,
                probability=None if region is None else 0.0,
                correlation=None,
                chance=None,
                nearest=beta,
            )
        axes, unknown = (region.axes, region.unknown) if region is not None else (np.eye(count), np.zeros((count, 0)))
        nearest = nearest_in_region(feasible_set, beta, axes, unknown, solver)
        corrected = feasible_set.K @ nearest.parameters
        change = corrected - beta
        measure = np.eye(count) if region is None else region.covariance.in_deviations()
        pulled = measure.T @ (measure @ change)
        squared = float(change @ pulled)
        shares = change * pulled / squared if squared > 0 else np.zeros(count)
        subsystems = irreducible_infeasible_subsystems(feasible_set, beta)
        alone = []
        for i in range(count):
            tell("changing one base parameter after the other", i, count, "parameters")
            alone.append(change_alone(feasible_set, beta, i, subsystems, solver) if subsystems else math.inf)
    kept = [i for i in np.argsort(-nearest.shares) if nearest.shares[i] > SMALLEST_SHARE]
    degrees = tuple(
        BaseParameterDegree(*name, *(float(value) for value in values))
        for name, *values in zip(names, beta, change, shares, alone, deviation, strict=True)
    )
    correlation, chance = _correlation(degrees) if region is not None else (None, None)
    return told(
        shares=tuple((feasible_set.blocks[i].name, float(nearest.shares[i])) for i in kept),
        subsystems=subsystems,
        degrees=degrees,
        distance=math.sqrt(max(squared, 0.0)),
        probability=None if region is None else region.probability(math.sqrt(max(squared, 0.0))),
        correlation=correlation,
        chance=chance,
        nearest=corrected,
    )


def _correlation(degrees: tuple[BaseParameterDegree, ...]) -> tuple[float, float]:
    known = [d for d in degrees if d.value and math.isfinite(d.deviation)]
    return rank_correlation(
        np.array([degree.relative_deviation for degree in known]),
        np.array([abs(degree.change / degree.value) for degree in known]),
    )


def _base_expressions(feasible_set: FeasibleSet) -> tuple[str, ...]:
    """Each base parameter as a combination of standard ones, e.g. ``"Lzz1 + m2"``."""
    base = feasible_set.model.base_parameters()
    expressions = getattr(base, "expressions", None)
    if expressions is not None:
        return tuple(expressions)
    names = feasible_set.model.parameter_names
    return tuple(combination(row, names, digits=6) for row in feasible_set.K)


def _base_names(feasible_set: FeasibleSet) -> tuple[str, ...]:
    """Short names: the leading parameter of each combination, with an R (regrouped) if there are others."""
    names = feasible_set.model.parameter_names
    leading = np.asarray(feasible_set.model.base_parameters().independent, dtype=np.intp)
    alone = np.count_nonzero(feasible_set.K, axis=1) == 1
    return tuple(f"{names[i]}{'' if single else 'R'}" for i, single in zip(leading, alone, strict=True))
