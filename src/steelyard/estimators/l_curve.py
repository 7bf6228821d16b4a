"""The L-curve of a prior: residual against distance from the prior over all weights, and the weight at its corner."""

import html
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import scipy.linalg

from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError, SolverError
from steelyard.feasibility.feasible_set import FeasibleSet
from steelyard.regression import Information, Reduced

from .prior import PreparedPrior, Prior
from .reduced_fit import fit_reduced
from .reduced_regression import ReducedRegression

__all__ = ["LCurve", "l_curve"]

Vector = npt.NDArray[np.float64]

POINTS_PER_DECADE = 3
"""Weights per decade where the user gives none: enough for a corner that is right to a factor of two, at a fit each."""

SPAN = 1e12
"""Largest ratio of the default weights. Directions that the data shows by less than this ratio belong to rounding, and
each further decade costs three fits."""


@dataclass(frozen=True, eq=False)
class LCurve:
    """Squared residual and distance from a prior for many weights of the prior.

    Attributes
    ----------
    label : str
        Name of the prior's distance.
    prior_weights : (k,)
        Ascending.
    squared_residuals : (k,)
        ‖W β - ω‖² of the (weighted) regression.
    distances : (k,)
        From the prior.
    parameters : (k, n)
    corner_index : int
        Index of the weight at the corner; see `corner`.
    """

    label: str
    prior_weights: Vector
    squared_residuals: Vector
    distances: Vector
    parameters: npt.NDArray[np.float64] = field(repr=False)
    corner_index: int

    @property
    def corner(self) -> float:
        """The weight at the corner of the curve.

        The logarithms of residual and distance are each brought to the interval from 0 to 1; the corner is the point
        farthest below the straight line between the two ends. (P. C. Hansen, Analysis of discrete ill-posed problems by
        means of the L-curve, 1992, takes the point of largest curvature, which noise of the solver would move.)
        """
        return float(self.prior_weights[self.corner_index])

    def __str__(self) -> str:
        least = self.squared_residuals.min()
        lines = [f"{'weight':>12} {'residual²':>14} {'above least':>12} {'distance':>12}"]
        for index, (weight, squared, distance) in enumerate(
            zip(self.prior_weights, self.squared_residuals, self.distances, strict=True)
        ):
            mark = "  corner" if index == self.corner_index else ""
            lines.append(f"{weight:12.4g} {squared:14.7g} {squared / least - 1:12.3%} {distance:12.4g}{mark}")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"

    def figure(self) -> Any:
        """Draw the curve with Plotly, with logarithmic axes; the weights are shown at the points.

        Returns
        -------
        plotly.graph_objects.Figure
        """
        import plotly.graph_objects as go

        text = [f"weight {weight:.3g}" for weight in self.prior_weights]
        curve = go.Scatter(x=self.squared_residuals, y=self.distances, text=text, mode="lines+markers", name="fits")
        at = self.corner_index
        corner = go.Scatter(
            x=self.squared_residuals[at : at + 1],
            y=self.distances[at : at + 1],
            text=text[at : at + 1],
            mode="markers",
            marker={"size": 14, "symbol": "circle-open", "line": {"width": 3}},
            name="corner",
        )
        figure = go.Figure([curve, corner])
        figure.update_xaxes(type="log", title="squared residual")
        figure.update_yaxes(type="log", title=f"{self.label} distance from the prior")
        return figure


@in_one_thread
def l_curve(
    info: Information,
    feasible_set: FeasibleSet,
    prior: Prior,
    weights: Literal["joint"] | npt.ArrayLike | None = "joint",
    prior_weights: npt.ArrayLike | None = None,
    solver: str = "clarabel",
) -> LCurve:
    """Fit with many weights of a prior, so that one of them can be chosen.

    Parameters
    ----------
    info : Information
    feasible_set : FeasibleSet
    prior : Prior
    weights : "joint", None or (N,)
        Of the joints, as in `fit`.
    prior_weights : (k,), optional
        At least three. By default three per decade, from a weight at which the prior hardly matters to one at which the
        data hardly matters: the smallest and the largest generalised eigenvalue of the two curvatures.
    solver : str

    Returns
    -------
    LCurve
        Its `corner` can be passed to `fit` as `prior_weight`.

    Raises
    ------
    InputError
        For an impossible prior or weights.
    SolverError
        If no parameters satisfy all conditions.

    Examples
    --------
    >>> from steelyard.dynamics import Model
    >>> from steelyard.estimators import EntropicPrior
    >>> from steelyard.robot import Robot
    >>> model = Model(Robot.from_dh([("0", 0.0, 0.0, "q")], name="pendulum", gravity=(0, -9.81, 0)))
    >>> names = model.base_parameters().names
    >>> info = Information.from_factor(10 * np.eye(3), [2.0, 5.0, 0.0], 0.02, 100, names)
    >>> prior = EntropicPrior([0.2, 0.0, 0.0, 0.2, 0.0, 0.3, 0.4, 0.0, 0.0, 2.0])
    >>> curve = l_curve(info, FeasibleSet(model), prior, prior_weights=[1e2, 1e4, 1e6])
    >>> bool(np.all(np.diff(curve.distances) < 0)), bool(np.all(np.diff(curve.squared_residuals) > 0))
    (True, True)
    """
    reduced = info.reduced(weights)
    if not isinstance(prior, Prior):
        raise InputError(f"l_curve needs a prior such as EntropicPrior(), got {prior!r}.")
    prepared = prior.prepare(feasible_set)
    chosen = _default_weights(reduced, feasible_set, prepared) if prior_weights is None else _given(prior_weights)
    found, failed = [], None
    for weight in chosen:
        try:
            fit = fit_reduced(reduced, feasible_set, prior=prior, prior_weight=float(weight), solver=solver)
        except SolverError as error:
            failed = error
            continue
        found.append((float(weight), fit.squared_residual, float(fit.prior_distance or 0.0), fit.parameters))
    if len(found) < 3:
        raise failed or SolverError("too few of the fits for the curve were solved; give other prior_weights.")
    weight, squared, distance, parameters = (np.array(column) for column in zip(*found, strict=True))
    return LCurve(prepared.label, weight, squared, distance, parameters, _corner(squared, distance))


def _given(prior_weights: npt.ArrayLike) -> Vector:
    values = np.asarray(prior_weights, dtype=float)
    if values.ndim != 1 or len(values) < 3 or not np.all(np.isfinite(values)) or np.any(values <= 0):
        raise InputError(f"prior_weights must be at least three positive numbers, got {prior_weights!r}.")
    return np.unique(values)


def _default_weights(reduced: Reduced, feasible_set: FeasibleSet, prior: PreparedPrior) -> Vector:
    """Weights from the smallest to the largest eigenvalue of the data's curvature in the metric of the prior."""
    regression = ReducedRegression.of(reduced, feasible_set)
    known = np.zeros(feasible_set.parameter_count, dtype=bool)
    known[feasible_set.link_columns] = True
    known |= prior.diagonal > 0
    metric = prior.curvature().toarray()[np.ix_(known, known)]
    factor = np.linalg.cholesky(metric)
    rows = scipy.linalg.solve_triangular(factor, (regression.R @ feasible_set.K[:, known]).T, lower=True).T
    values = np.square(np.linalg.svd(rows, compute_uv=False)) / regression.variance
    largest = float(values.max(initial=0.0)) or 1.0
    shown = values[values > largest / SPAN]
    smallest = float(shown.min(initial=largest))
    count = 1 + max(2, int(np.ceil(POINTS_PER_DECADE * np.log10(largest / smallest))))
    return np.geomspace(smallest, largest, count)


def _corner(squared: Vector, distances: Vector) -> int:
    """Index of the point farthest below the chord between the ends, in logarithms scaled to [0, 1]."""
    x = np.log(np.maximum(squared, 1e-300))
    y = np.log(np.maximum(distances, 1e-300))
    across, along = np.ptp(x), np.ptp(y)
    if across < 1e-9 or along < 1e-9:  # the prior agrees with the data, so that a large weight costs nothing
        return len(x) - 1
    x, y = (x - x.min()) / across, (y - y.min()) / along
    below = (x[-1] - x[0]) * (y[0] - y) - (x[0] - x) * (y[-1] - y[0])
    return int(np.argmax(below))
