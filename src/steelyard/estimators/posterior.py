"""The posterior distribution on the feasible set, from data and prior: samples of it, and Laplace's approximation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from steelyard.display import html_table, text_table
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError, SolverError
from steelyard.feasibility.barrier import Barrier, minimise
from steelyard.feasibility.bounds.quantities import Combination, Quantity, quantities
from steelyard.feasibility.feasible_set import FeasibleSet
from steelyard.feasibility.growth import growing_links
from steelyard.files import read_number, read_whole, suggestion
from steelyard.regression import Estimate, Information, ParameterCovariance, column_lengths
from steelyard.regression.factor import eigenvectors, solve
from steelyard.regression.parameter_covariance import NORMAL

from .cross_validation import term_deviations
from .estimator import proved_estimate
from .prior import PreparedPrior, Prior, distance_from
from .reduced_fit import fit_reduced

__all__ = ["Posterior", "PosteriorRow", "bayesian", "effective_count", "posterior", "split_r_hat"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
Tensor = npt.NDArray[np.float64]

PRIOR_WEIGHT = 11.0
"""The weight of the prior where the estimator is called by its name: links are expected to be right to three tenths, as
descriptions are."""

MODE_BARRIER = 1e-4
"""Factor of the barrier with which the mode is found: it stands off the boundary by this, over the slope there."""

START_BARRIER = 1.0
"""Factor of the barrier at the point around which chains begin: well inside."""

START_SPREAD = 2.0
"""The spread of the starts of the chains, in standard deviations: wider than the posterior, as R-hat asks for."""

ACCEPTED = 0.7
"""Share of accepted proposals: they move farthest with 0.65 (Beskos et al., Bernoulli 19, 2013)."""

PROPOSALS = 2
"""In a step, so that 500 steps of four chains hold 400 independent samples as a rule."""

TURN, LONGEST_STRIDE, MOST_STRIDES = 1.5, 1.2, 20
"""A proposal goes about a quarter of a turn of the normal distribution, in at most so many strides."""

LAZY_SPREAD = 0.3
"""Standard deviation of the logarithm of the length of strides, so that no orbit repeats."""

RIDGE = 1e-12
"""Added to scaled metrics: directions in which neither data, prior nor conditions have curvature would be singular."""

FEWEST_EFFECTIVE, LARGEST_R_HAT = 400.0, 1.01
"""What the chains must reach to be trusted (Vehtari et al. 2021)."""


@dataclass(frozen=True, eq=False)
class PosteriorRow:
    """One quantity of a posterior.

    Attributes
    ----------
    name, meaning, unit : str
    mean, deviation : float
        Of the samples.
    lower, upper : float
        Of the interval that holds 95 % of the samples: the middle ones, or, of a quantity that physics keeps from being
        negative, the shortest, which begins at zero where the samples press against it.
    mode : float
        At the greatest density.
    laplace_lower, laplace_upper : float
        Of the normal distribution with the curvature at the mode, which knows no boundary.
    effective_count : float
        Number of independent samples that would tell the mean, or the ends of the interval, as well; the lesser.
    r_hat : float
        Spread between the chains and within them; 1 where they agree.
    """

    name: str
    meaning: str
    unit: str
    mean: float
    deviation: float
    lower: float
    upper: float
    mode: float
    laplace_lower: float
    laplace_upper: float
    effective_count: float
    r_hat: float

    @property
    def laplace_ratio(self) -> float:
        """Width of Laplace's interval over that of the samples."""
        return (self.laplace_upper - self.laplace_lower) / (self.upper - self.lower)


@dataclass(frozen=True, eq=False)
class Posterior:
    """Samples of the parameters that data, prior and physics leave open; every one of them is possible, and proved so.

    Attributes
    ----------
    rows : tuple of PosteriorRow
    samples : (m, n)
        Standard parameters.
    chain : (m,)
        Of which chain each is.
    mode : (n,)
        Of greatest density.
    estimate : Estimate
        The mean of the samples, which is possible because the set is convex, with its proof.
    inside : float
        Share of Laplace's normal distribution that lies within the set.
    acceptance : float
        Share of the proposals that were accepted.
    steps : int
        Of each chain, after the warm-up.
    """

    rows: tuple[PosteriorRow, ...]
    samples: Matrix = field(repr=False)
    chain: npt.NDArray[np.intp] = field(repr=False)
    mode: Vector = field(repr=False)
    estimate: Estimate = field(repr=False)
    inside: float
    acceptance: float
    steps: int

    def __getitem__(self, name: str) -> PosteriorRow:
        for row in self.rows:
            if row.name == name:
                return row
        raise InputError(f"there is no quantity {name!r}; {suggestion(name, [row.name for row in self.rows])}")

    def __iter__(self) -> Iterator[PosteriorRow]:
        return iter(self.rows)

    @property
    def least_effective_count(self) -> float:
        """The smallest effective sample size of all quantities."""
        return min(row.effective_count for row in self.rows)

    @property
    def largest_r_hat(self) -> float:
        """The largest R-hat of all quantities."""
        return max(row.r_hat for row in self.rows)

    @property
    def converged(self) -> bool:
        """Whether the chains agree and hold enough independent samples for intervals: R-hat to 1.01, 400 samples."""
        return self.least_effective_count >= FEWEST_EFFECTIVE and self.largest_r_hat <= LARGEST_R_HAT

    @property
    def sentence(self) -> str:
        """How the samples were drawn, and how far they can be relied on."""
        state = "" if self.converged else ", which is not enough to rely on: draw more steps"
        return (
            f"{len(self.samples)} samples of {len(np.unique(self.chain))} chains, all proved possible; at least "
            f"{self.least_effective_count:.0f} of them independent, R-hat at most {self.largest_r_hat:.3f}{state}."
        )

    def __repr__(self) -> str:
        return f"Posterior({self.sentence})"

    def _table(self) -> list[tuple[str, ...]]:
        return [
            (
                row.name,
                *(f"{value:.4g}" for value in (row.mean, row.lower, row.upper, row.laplace_lower, row.laplace_upper)),
                row.unit,
                f"{row.effective_count:.0f}",
                f"{row.r_hat:.3f}",
            )
            for row in self.rows
        ]

    def __str__(self) -> str:
        return f"{self.sentence}\n{text_table(_HEADS, self._table(), numbers=(1, 2, 3, 4, 5, 7, 8))}"

    def _repr_html_(self) -> str:
        return html_table(self.sentence, _HEADS, self._table())


_HEADS = ("name", "mean", "from", "to", "Laplace from", "to", "unit", "independent", "R-hat")


@in_one_thread
def posterior(
    info: Information,
    feasible_set: FeasibleSet,
    prior: Prior | None = None,
    prior_weight: float = 1.0,
    *,
    weights: Any = "joint",
    names: Sequence[str] | None = None,
    combinations: Mapping[str, Combination] | None = None,
    chains: int = 4,
    steps: int = 2000,
    kept: int = 2000,
    seed: int = 0,
) -> Posterior:
    """Draw samples of the parameters from what data, prior and physics leave open.

    Minus the logarithm of the density is ``½ (K δ - β̂)' C⁻¹ (K δ - β̂) + prior_weight · (distance from the prior)``
    within the set, where β̂ is least squares and C its covariance, with the correlation of residuals in time as
    `ParameterCovariance` tells it; without a prior the density before the data is the same everywhere in the set.
    Chains follow Hamiltonian motions, which cross the posterior, in the metric of that function's curvature and of the
    logarithmic barrier at a point well inside; they are accepted by the rule of Metropolis. Every sample that is kept
    is proved possible.

    Parameters
    ----------
    info : Information
    feasible_set : FeasibleSet
    prior : Prior, optional
        With term_deviations where terms are not seen. Needed where neither data nor conditions bound the parameters.
    prior_weight : float
        1 / τ² if the prior is expected to be right to a relative deviation τ.
    weights : "joint", None or (N,)
        Of the joints, as in :func:`steelyard.least_squares`.
    names : sequence of str, optional
        Standard parameters, ``"total mass"``, ``"cx1"`` and so on; all by default.
    combinations : mapping, optional
        Further quantities: rows (n,) or mappings from names to coefficients.
    chains : int
        They begin apart.
    steps : int
        Of each chain; a warm-up of half as many comes before.
    kept : int
        Samples that are kept of all chains together, evenly.
    seed : int

    Raises
    ------
    InputError
        Where the posterior has no finite mass, or an option cannot be used.
    SolverError
        If no parameters satisfy all conditions.

    References
    ----------
    S. Duane et al., Hybrid Monte Carlo, Physics Letters B 195, 1987. A. Vehtari et al., Rank-normalization, folding,
    and localization: an improved R-hat, Bayesian Analysis 16, 2021.

    Examples
    --------
    A pendulum of which 200 samples tell mass times lever and inertia about the axis; the rest is what the prior leaves:

    >>> import steelyard as sy
    >>> from steelyard.estimators import EntropicPrior
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> body = np.array([2.0, 0.0, 0.0, 2.0, 0.0, 2.0, 0.1, 0.2, 0.0, 3.0])
    >>> random = np.random.default_rng(1)
    >>> q, dq, ddq = random.normal(size=(3, 200, 1))
    >>> torque = model.inverse_dynamics(q, dq, ddq, body) + 0.3 * random.normal(size=(200, 1))
    >>> info = sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    >>> feasible_set = sy.FeasibleSet(model)
    >>> found = posterior(info, feasible_set, EntropicPrior(body), 10.0, names=["m1"], steps=150)
    >>> found["m1"].lower < 3.0 < found["m1"].upper, found.largest_r_hat < 1.1
    (True, True)
    >>> bool(all(feasible_set.contains(sample) for sample in found.samples))
    True
    """
    for name, value, least in (("chains", chains, 2), ("steps", steps, 20), ("kept", kept, 10), ("seed", seed, 0)):
        read_whole(value, name, least)
    read_number(prior_weight, "prior_weight", "a positive number such as 10.0", above=0)
    if info.filtered_torque:
        raise InputError(
            "Torques were filtered and the dynamics were not, so that errors are larger than noise explains, and no "
            "posterior holds; give the model to Recording.process, which filters both, or leave out `torque_cutoff` "
            "and `decimate`."
        )
    if info.count <= info.base_count:
        raise InputError(
            f"{info.count} rows for {info.base_count} base parameters leave nothing to estimate the noise from; give a "
            "longer log."
        )
    asked = quantities(feasible_set, names, combinations)
    used = info.joint_weights(weights) if info.is_weighted(weights) else None
    covariance = ParameterCovariance.of(info, weights=used)
    if prior is None:
        _require_bounded(info, feasible_set, covariance)
    prepared = None if prior is None else prior.prepare(feasible_set, prior_weight)
    density = _Density(info, covariance, feasible_set, prepared, prior_weight, used)
    start = density.inside(prior)
    mode = density.mode(start, MODE_BARRIER)
    random = np.random.default_rng(seed)
    walk = _Walk(density, random, density.mode(start, START_BARRIER))
    every = max(1, int(chains) * int(steps) // int(kept))
    drawn, acceptance = walk.run(walk.starts(int(chains)), int(steps), every)
    return _told(info, density, mode, asked, drawn, acceptance, int(steps), used, random)


@in_one_thread
def bayesian(
    info: Information,
    feasible_set: FeasibleSet,
    weights: Any = "joint",
    prior: Prior | None = None,
    prior_weight: float = PRIOR_WEIGHT,
    steps: int = 500,
    **options: Any,
) -> Estimate:
    """Return the mean of the posterior, which is possible because the set is convex; see `posterior`.

    Parameters
    ----------
    info : Information
    feasible_set : FeasibleSet
    weights : "joint", None or (N,)
    prior : Prior, optional
        The description of the robot by default, with terms that make three tenths of their joint's torque.
    prior_weight : float
        By default links are expected to be right to three tenths.
    steps : int
    **options
        Those of the fit are not read: the prior takes the place of `prefer`.

    Returns
    -------
    Estimate
        Its remarks tell how far the samples can be relied on.

    Examples
    --------
    >>> import steelyard as sy
    >>> from steelyard.estimators import EntropicPrior
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> body = np.array([2.0, 0.0, 0.0, 2.0, 0.0, 2.0, 0.1, 0.2, 0.0, 3.0])
    >>> random = np.random.default_rng(1)
    >>> q, dq, ddq = random.normal(size=(3, 200, 1))
    >>> torque = model.inverse_dynamics(q, dq, ddq, body) + 0.3 * random.normal(size=(200, 1))
    >>> info = sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    >>> estimate = bayesian(info, sy.FeasibleSet(model), prior=EntropicPrior(body), steps=100)
    >>> estimate.method, bool(np.allclose(estimate.base, model.base_parameters().values(body), atol=0.3))
    ('mean of the posterior', True)
    """
    described = prior is None
    if prior is None:
        unknown = links_without_mass(feasible_set)
        if unknown:
            raise InputError(
                f"The mean of the posterior needs a prior, and the description tells no mass of {', '.join(unknown)}; "
                "add the inertials to the description, give prior=EntropicPrior(parameters), or take another estimator."
            )
        prior = distance_from(None, feasible_set, term_deviations(info, feasible_set))
    found = posterior(info, feasible_set, prior, prior_weight, weights=weights, steps=steps).estimate
    if not described:
        return found
    right = f"{prior_weight**-0.5:.0%}"
    told = f"The prior is the description of the robot, whose links are expected to be right to {right}."
    return replace(found, remarks=(*found.remarks, told))


bayesian.has_prior = True  # type: ignore[attr-defined]


def links_without_mass(feasible_set: FeasibleSet) -> list[str]:
    """Names of the links of which the description tells no inertial parameters."""
    robot = feasible_set.model.robot
    bodies = np.asarray(robot.parameters)[feasible_set.link_columns]
    told = np.isfinite(bodies).all(axis=1) & (bodies[:, 9] > 0.0)
    return [str(name) for name, known in zip(robot.link_names, told, strict=True) if not known]


def _require_bounded(info: Information, feasible_set: FeasibleSet, covariance: ParameterCovariance) -> None:
    growing = growing_links(feasible_set, covariance.unidentifiable)
    remedy = "give a prior, such as EntropicPrior() of the description, or constraints that bound them"
    if growing:
        names = feasible_set.model.robot.link_names
        raise InputError(
            f"Neither the data nor the conditions bound the masses of {', '.join(names[link] for link in growing)}, so "
            f"that no posterior exists without a prior; {remedy}."
        )
    if info.unidentifiable:
        raise InputError(
            f"The data does not determine {', '.join(info.unidentifiable[:3])}, so that no posterior may exist without "
            f"a prior; {remedy}."
        )


class _Density:
    """Minus the logarithm of the density: its values, gradients and curvature at many points of the set at once.

    Points are (p, n). With a factor of the barrier it is a `Function` that `minimise` takes.
    """

    def __init__(
        self,
        info: Information,
        covariance: ParameterCovariance,
        feasible_set: FeasibleSet,
        prior: PreparedPrior | None,
        weight: float,
        weights: Vector | None,
    ) -> None:
        problem = info.reduced(weights)
        # The rows that the root of the covariance leaves: zero for what the data does not tell.
        lengths = column_lengths(problem.R)
        scale = np.where(lengths > 0.0, lengths, 1.0)
        rows = np.linalg.pinv(covariance.root * scale[:, None]) * scale
        self.rows, self.target = rows @ feasible_set.K, rows @ solve(problem)
        self.curvature = self.rows.T @ self.rows
        self.feasible_set, self.prior, self.weight = feasible_set, prior, weight
        self.barrier, self.factor = Barrier(feasible_set), 0.0
        self.basis = feasible_set.equation_directions
        self.problem = problem

    def value(self, points: Matrix, problems: npt.NDArray[np.intp] | None = None) -> Vector:
        errors = points @ self.rows.T - self.target
        found = 0.5 * np.einsum("pi,pi->p", errors, errors)
        inside = self.barrier.value(points)
        if self.prior is not None:
            found = found + self.weight * self.prior.distances(points)
        return np.where(np.isfinite(inside), found + (self.factor * inside if self.factor else 0.0), np.inf)

    def derivatives(self, points: Matrix, problems: npt.NDArray[np.intp] | None = None) -> tuple[Matrix, Tensor]:
        gradients = (points @ self.rows.T - self.target) @ self.rows
        hessians = np.tile(self.curvature, (len(points), 1, 1))
        if self.prior is not None:
            self.prior.add_derivatives(points, np.full(len(points), self.weight), gradients, hessians)
        if self.factor:
            self.barrier.add_derivatives(points, np.full(len(points), self.factor), gradients, hessians)
        return gradients, hessians

    def gradients(self, points: Matrix) -> Matrix:
        """Return the gradients of the density alone, without its curvature."""
        found = (points @ self.rows.T - self.target) @ self.rows
        return found if self.prior is None else found + self.weight * self.prior.gradients(points)

    def root(self, point: Vector, factor: float) -> Matrix:
        """A root of the inverse of the curvature at a point, with a barrier of this factor, (n, m)."""
        gradients, hessians = self.derivatives(point[None])
        if factor:
            self.barrier.add_derivatives(point[None], np.full(1, factor), gradients, hessians)
        basis = np.eye(len(point)) if self.basis is None else self.basis
        matrix = basis.T @ hessians[0] @ basis
        scales = 1.0 / np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))
        values, vectors = eigenvectors(matrix * np.outer(scales, scales))
        return np.asarray(basis @ (scales[:, None] * vectors / np.sqrt(np.maximum(values, RIDGE))))

    def inside(self, prior: Prior | None) -> Vector:
        """A point of the set."""
        found = fit_reduced(self.problem, self.feasible_set, prior=prior, prior_weight=self.weight)
        return self.feasible_set.project_on_equations(found.parameters)

    def mode(self, start: Vector, factor: float) -> Vector:
        """The point of greatest density, held off the boundary by a barrier of this factor."""
        self.factor = factor
        try:
            return np.asarray(minimise(self, start[None], self.basis, accuracy=1e-6)[0])
        finally:
            self.factor = 0.0


class _Walk:
    """Hamiltonian motions of several chains side by side, in one metric for all points.

    *Measured* on a UR5, a Panda and a Z1 with the entropic prior, 500 steps: 560 to 1200 independent samples in 1.3 s.
    With Langevin steps in the metric of each point in turn with these there were 480 to 790, in 2 s.
    """

    def __init__(self, density: _Density, random: np.random.Generator, center: Vector) -> None:
        self.density, self.random, self.center = density, random, center
        self.root = density.root(center, START_BARRIER)
        self.size = self.root.shape[1]

    def starts(self, chains: int) -> Matrix:
        """Points around the center."""
        points = np.empty((chains, len(self.center)))
        for k in range(chains):
            step = START_SPREAD * self.root @ self.random.standard_normal(self.size)
            while not np.isfinite(self.density.value((self.center + step)[None])[0]):
                step *= 0.7
            points[k] = self.center + step
        return points

    def run(self, points: Matrix, steps: int, every: int) -> tuple[Tensor, float]:
        """Samples (chains, kept, n) of so many steps, and the share of accepted proposals."""
        warm = max(steps // 2, 50)
        logarithms = np.full(len(points), np.log(1.2 / self.size**0.25))
        drawn: list[Matrix] = []
        accepted = 0.0
        values = self.density.value(points)
        for step in range(-warm, steps):
            shares = np.zeros(len(points))
            for _ in range(PROPOSALS):
                points, values, chances = self._moved(points, values, np.exp(logarithms))
                shares += chances / PROPOSALS
            if step < 0:
                # Robbins and Monro; ever smaller, so that it has settled when samples are kept. Each chain for itself:
                # one that begins at the boundary stays there with strides that suit the others.
                logarithms += (shares - ACCEPTED) * 2.0 / (step + warm + 10) ** 0.6
                if step == -1:
                    logarithms[:] = np.median(logarithms)
            else:
                accepted += float(shares.mean()) / steps
                if step % every == every - 1:
                    drawn.append(points.copy())
        return np.array(drawn).transpose(1, 0, 2), accepted

    def _moved(self, points: Matrix, values: Vector, strides: Vector) -> tuple[Matrix, Vector, Vector]:
        """One proposal of each chain, a quarter of a turn, more or less, and how likely each was to be accepted."""
        strides = np.minimum(strides, LONGEST_STRIDE) * float(np.exp(LAZY_SPREAD * self.random.standard_normal()))
        turn = self.random.uniform(0.5, 1.5) * TURN
        count = int(np.clip(round(turn / float(np.median(strides))), 1, MOST_STRIDES))
        stride = strides[:, None]
        momentum = self.random.standard_normal((len(points), self.size))
        start = 0.5 * np.einsum("pi,pi->p", momentum, momentum)
        position, inside = points.copy(), np.ones(len(points), dtype=bool)
        momentum -= 0.5 * stride * self._force(position)
        for number in range(count):
            moved = position + stride * momentum @ self.root.T
            inside &= np.isfinite(self.density.barrier.value(moved))
            position = np.where(inside[:, None], moved, position)
            momentum -= (0.5 if number == count - 1 else 1.0) * stride * self._force(position)
        reached = np.where(inside, self.density.value(position), np.inf)
        with np.errstate(over="ignore"):
            chance = np.exp(np.minimum(values + start - reached - 0.5 * np.einsum("pi,pi->p", momentum, momentum), 0.0))
        taken = self.random.random(len(points)) < chance
        return np.where(taken[:, None], position, points), np.where(taken, reached, values), chance

    def _force(self, points: Matrix) -> Matrix:
        return np.asarray(self.density.gradients(points) @ self.root)


def _told(
    info: Information,
    density: _Density,
    mode: Vector,
    asked: Sequence[Quantity],
    drawn: Tensor,
    acceptance: float,
    steps: int,
    weights: Vector | None,
    random: np.random.Generator,
) -> Posterior:
    """The posterior of samples (chains, kept, n)."""
    feasible_set = density.feasible_set
    if density.basis is not None:
        # Rounding of thousands of steps along the equations is taken out.
        drawn = np.array([[feasible_set.project_on_equations(one) for one in chain] for chain in drawn])
    flat = drawn.reshape(-1, drawn.shape[2])
    proved = np.array([feasible_set.contains(one) for one in flat])
    if not proved.all():
        raise SolverError(
            f"{np.sum(~proved)} of {len(flat)} samples lie so close to the boundary that they are not proved possible; "
            "give FeasibleSet constraints that keep away from it, or another seed."
        )
    root = density.root(mode, 0.0)
    deviates = root @ random.standard_normal((root.shape[1], 4000))
    inside = float(np.mean(np.isfinite(density.barrier.value(mode + deviates.T))))
    rows = []
    for quantity in asked:
        values = _values(quantity, drawn)
        slope = quantity.slope(mode)
        half = NORMAL * float(np.linalg.norm(slope @ root))
        at_mode = quantity.value(mode)
        lower, upper = _interval(values.ravel(), quantity.never_negative)
        below, above = (values <= level for level in np.quantile(values, (0.025, 0.975)))
        count = min(effective_count(values), effective_count(below), effective_count(above))
        rows.append(
            PosteriorRow(
                quantity.name,
                quantity.meaning,
                quantity.unit,
                float(values.mean()),
                float(values.std()),
                lower,
                upper,
                at_mode,
                at_mode - half,
                at_mode + half,
                count,
                split_r_hat(values),
            )
        )
    mean = feasible_set.project_on_equations(flat.mean(axis=0))
    chain = np.repeat(np.arange(len(drawn)), drawn.shape[1])
    estimate = proved_estimate(info, feasible_set, mean, "mean of the posterior", weights=weights)
    found = Posterior(tuple(rows), flat, chain, mode, estimate, inside, acceptance, steps)
    return replace(found, estimate=replace(estimate, remarks=(*estimate.remarks, found.sentence)))


def _values(quantity: Quantity, drawn: Tensor) -> Matrix:
    """Return the values of a quantity, (chains, kept), for samples (chains, kept, n)."""
    found = drawn @ quantity.row
    return np.asarray(found if quantity.mass is None else found / (drawn @ quantity.mass))


def _interval(values: Vector, never_negative: bool) -> tuple[float, float]:
    """The middle 95 % of samples; of what is never negative the shortest 95 %, from zero where these are the least."""
    if not never_negative:
        low, high = np.quantile(values, (0.025, 0.975))
        return float(low), float(high)
    ordered = np.sort(values)
    count = int(np.ceil(0.95 * len(ordered)))
    first = int(np.argmin(ordered[count - 1 :] - ordered[: len(ordered) - count + 1]))
    # Of a density that falls from zero on, the shortest interval begins within the first of the samples.
    lower = 0.0 if first <= 0.005 * len(ordered) and ordered[0] < 0.02 * ordered[count - 1] else float(ordered[first])
    return lower, float(ordered[first + count - 1])


def effective_count(values: npt.ArrayLike) -> float:
    """Number of independent samples that would tell the mean of those of several chains as well.

    The autocorrelation of all chains together is summed up to where sums of pairs are no longer positive and falling
    (Geyer, Statistical Science 7, 1992), each chain split in halves (Vehtari et al. 2021).

    Parameters
    ----------
    values : (chains, count)

    Returns
    -------
    float
        NaN where all values are alike.
    """
    halves = _halves(np.asarray(values, dtype=float))
    chains, count = halves.shape
    deviations = halves - halves.mean(axis=1, keepdims=True)
    size = 2 ** int(np.ceil(np.log2(2 * count)))
    spectrum = np.fft.rfft(deviations, size, axis=1)
    covariances = np.fft.irfft(np.abs(spectrum) ** 2, size, axis=1)[:, :count] / count
    within = float(covariances[:, 0].mean()) * count / (count - 1)
    total = within * (count - 1) / count + float(np.var(halves.mean(axis=1), ddof=1))
    if not total > 0.0:
        return float("nan")
    correlations = 1.0 - (within - covariances.mean(axis=0) * count / (count - 1)) / total
    correlations[0] = 1.0
    pairs = correlations[: count // 2 * 2].reshape(-1, 2).sum(axis=1)
    ends = np.flatnonzero(pairs <= 0.0)
    pairs = np.minimum.accumulate(pairs[: ends[0] if len(ends) else len(pairs)])
    time = max(2.0 * float(pairs.sum()) - 1.0, 1.0 / np.log10(chains * count))
    return float(chains * count / time)


def split_r_hat(values: npt.ArrayLike) -> float:
    """Potential scale reduction of chains (chains, count), each split in halves, of ranks (Vehtari et al. 2021)."""
    from scipy.special import ndtri
    from scipy.stats import rankdata

    halves = _halves(np.asarray(values, dtype=float))

    def of(numbers: Matrix) -> float:
        normal = ndtri((rankdata(numbers).reshape(numbers.shape) - 0.375) / (numbers.size + 0.25))
        count = normal.shape[1]
        within = float(normal.var(axis=1, ddof=1).mean())
        between = count * float(normal.mean(axis=1).var(ddof=1))
        return float(np.sqrt(((count - 1) / count * within + between / count) / within)) if within > 0.0 else 1.0

    return max(of(halves), of(np.abs(halves - np.median(halves))))


def _halves(values: Matrix) -> Matrix:
    half = values.shape[1] // 2
    return np.concatenate([values[:, :half], values[:, half : 2 * half]])
