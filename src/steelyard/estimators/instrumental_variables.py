"""Instrumental variables: regression on what of the regressor follows from a motion without noise."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from operator import add
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from steelyard.dynamics import Model
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError, SolverError
from steelyard.feasibility.feasible_set import FeasibleSet
from steelyard.files import read_number, shown
from steelyard.once import cached_property
from steelyard.recording import Samples
from steelyard.regression import Estimate, Factor, Information, least_squares, triangular
from steelyard.regression.batch_means import BatchMeans, BatchSums
from steelyard.regression.factor import RANK, column_lengths, combined
from steelyard.regression.reduction import joint_rows, require_joints
from steelyard.regression.time_blocks import TimeBlocks

from .fit import fit

__all__ = [
    "InstrumentStrength",
    "InstrumentalInformation",
    "InstrumentedRegression",
    "Motion",
    "first_made",
    "first_parameters",
    "instrumental_variables",
    "instrumented_parts",
    "made_by",
    "model_of",
    "of_instruments",
    "step_in_errors",
    "used_in_both",
    "with_motions",
]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

Motion = Callable[[Vector], Samples]
"""From base parameters (n_b,) to the motion that a robot with these makes, free of measurement noise: samples at the
times of the measured ones, with the torques of its drives. Raises SolverError where there is no such motion."""

WEAK = 10.0
"""F statistic below which instruments count as weak, for one instrument a parameter (Staiger and Stock 1997)."""

ALIKE = 0.9999
"""Share from which instruments take nothing away, as smooth positions that were filtered no further than the rows."""

CONVERGED = 0.01
"""The iterations end when no base parameter moves by more than this part of its standard error."""


@dataclass(frozen=True, eq=False)
class InstrumentStrength:
    """The strength of instruments: how well they determine the regressor.

    Attributes
    ----------
    f_statistic : float
        Rows times motion over noise, in squares, for the combination of base parameters of which that is least; below
        10 instruments are weak. Infinite where the regressor is that of the instruments exactly.
    share : float
        Part of the squared regressor of that combination that is the motion of the instruments, from 0 to 1. The rest
        is noise, which draws least squares of that combination towards zero by about as much, or motion in which the
        robot did not follow that of the instruments.
    weakest : str
        The base parameter that is greatest in that combination, in units in which all columns are equally long.
    """

    f_statistic: float
    share: float
    weakest: str

    def __str__(self) -> str:
        if self.share > ALIKE:
            return (
                f"The instruments are the measured regressor itself to {self.share:.2%} of its square, in any "
                "combination of base parameters: this is hardly more than least squares."
            )
        return (
            f"Of the squared regressor of any combination of base parameters at least {self.share:.2%} is that of the "
            f"instruments (least near {self.weakest}); the rest is noise, which least squares takes for motion, or "
            "motion that the instruments do not have."
        )


@dataclass(frozen=True, eq=False)
class InstrumentalInformation(Information):
    """An Information with the regressor of the instruments, and torques that make its least squares those of them."""

    strength: InstrumentStrength | None = field(default=None, repr=False)

    @property
    def method(self) -> str:
        """The name of the method that least squares of these rows are."""
        return "instrumental variables"


class InstrumentedRegression:
    """The rows ``[Z X ω]`` of each joint, reduced: instruments, measured regressor and torque side by side.

    The triangle of a joint answers for the data: two of them add, and the regression at any parameters follows without
    the rows. Plain instrumental variables are ``β = (Z' X)⁻¹ Z' ω``. The regression of ``ω - (X - Z) β`` on Z, the
    regressor of the motion without noise, has them as its least squares. Its metric Z'Z is free of noise, and its
    residuals are the structural ones ``ω - X β``, so that feasible fits, variances, weights of the joints and
    correlation in time follow from it as from any other regression. (The projection of two-stage least squares,
    ``Z (Z'Z)⁻¹ Z'X``, keeps some of the noise of X, and takes it for motion.)

    Parameters
    ----------
    factors : tuple of Factor
        For each joint, of 2 c + 1 columns.
    batch_means : tuple of tuples of Factor
        The same of sums of neighbouring rows.
    filtered : bool
        Whether torques were filtered and the regressor was not.

    Examples
    --------
    A joint that turns with a position noise that least squares take for acceleration:

    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([("pi/2", 0, 0, "q")], gravity=(0, 0, 0)))
    >>> random = np.random.default_rng(1)
    >>> q, dq, ddq = random.normal(size=(3, 4000, 1))
    >>> torque = 2.0 * ddq
    >>> noisy = sy.Samples(q=q, dq=dq, ddq=ddq + 0.5 * random.normal(size=ddq.shape), torque=torque)
    >>> exact = sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque)
    >>> float(sy.least_squares(sy.Information.from_samples(model, noisy)).base[0].round(1))
    1.6
    >>> regression = InstrumentedRegression.of_samples(model, noisy, exact)
    >>> float(regression.solution()[0].round(1))
    2.0
    """

    def __init__(self, model: Model, factors: tuple[Factor, ...], batch_means: BatchMeans, filtered: bool) -> None:
        self.model, self.factors, self.batch_means, self.filtered = model, factors, batch_means, filtered

    @classmethod
    def of_samples(cls, model: Model, samples: Samples, instruments: Samples) -> InstrumentedRegression:
        """Reduce measured samples beside those of the instruments.

        Parameters
        ----------
        samples : Samples
            As they were measured.
        instruments : Samples
            The motion at the same times without the noise of the measurement; their torques are not used. Rows that
            the mask of either leaves out are left out.

        Raises
        ------
        InputError
            If the two differ in their numbers of rows or joints.
        """
        require_joints(model, samples)
        require_joints(model, instruments)
        if instruments.count != samples.count:
            raise InputError(
                f"The instruments have {instruments.count} rows and the samples {samples.count}; each row of the "
                "samples needs the motion at its time."
            )
        empty = tuple(
            Factor(k, np.arange(2 * len(own)), np.zeros((2 * len(own) + 1, 2 * len(own) + 1)), 0)
            for k, own in enumerate(model.base_columns.joints)
        )
        blocks, sums = TimeBlocks(empty, 1), BatchSums(empty)
        mask = used_in_both(samples, instruments)
        for (part, rows), (_, motion) in zip(joint_rows(model, samples), joint_rows(model, instruments), strict=True):
            wide = [np.hstack([z[:, :-1], x]) for z, x in zip(motion, rows, strict=True)]
            used = None if mask is None else mask[part]
            sums.add(wide, used)
            blocks.add(wide, used)
        return cls(model, blocks.factors(), sums.factors(), samples.is_biased_for(model))

    def __add__(self, other: InstrumentedRegression) -> InstrumentedRegression:
        means = tuple(
            tuple(a + b for a, b in zip(one, two, strict=True))
            for one, two in zip(self.batch_means, other.batch_means, strict=True)
        )
        factors = tuple(a + b for a, b in zip(self.factors, other.factors, strict=True))
        return InstrumentedRegression(self.model, factors, means, self.filtered or other.filtered)

    def measured(self) -> Information:
        """The Information of the rows as measured, whose least squares are the ordinary ones."""
        plain = Information.empty(self.model)

        def narrow(factors: Sequence[Factor]) -> tuple[Factor, ...]:
            return tuple(
                Factor(f.joint, e.columns, triangular(f.triangle[:, len(e.columns) :]), f.count)
                for f, e in zip(factors, plain.factors, strict=True)
            )

        return replace(
            plain,
            factors=narrow(self.factors),
            batch_means=tuple(map(narrow, self.batch_means)),
            filtered_torque=self.filtered,
        )

    def solution(self, weights: npt.ArrayLike | None = None) -> Vector:
        """Return the base parameters (n_b,) of plain instrumental variables, of least norm where there are several."""
        plain = Information.empty(self.model)
        width = plain.base_count
        used = np.ones(len(self.factors)) if weights is None else np.asarray(weights, dtype=np.float64)
        places = [np.concatenate([e.columns, width + e.columns]) for e in plain.factors]
        rows = [replace(f, columns=own) for f, own in zip(self.factors, places, strict=True)]
        triangle = combined(rows, used, 2 * width)
        instruments, regressor, torque = np.split(triangle, [width, 2 * width], axis=1)
        return _solved(instruments, regressor, torque[:, 0])

    def information(self, base: npt.ArrayLike) -> InstrumentalInformation:
        """Return the regression whose residuals at some base parameters are the structural ones.

        For the estimate of instrumental variables these are those of `solution`.
        """
        beta, measured = np.asarray(base, dtype=np.float64), self.measured()

        def at(factors: Sequence[Factor]) -> tuple[Factor, ...]:
            return tuple(
                Factor(f.joint, m.columns, triangular(_rows_at(f.triangle, beta[m.columns])), f.count)
                for f, m in zip(factors, measured.factors, strict=True)
            )

        rows = replace(
            measured,
            factors=at(self.factors),
            torque_factors=measured.factors,
            batch_means=tuple(map(at, self.batch_means)),
        )
        return InstrumentalInformation.of(rows, strength=self.strength)

    @cached_property
    def strength(self) -> InstrumentStrength:
        """How well the instruments tell the regressor."""
        plain = Information.empty(self.model)

        def triangle(part: Callable[[Matrix, int], Matrix]) -> Matrix:
            factors = tuple(
                Factor(f.joint, e.columns, triangular(part(f.triangle, len(e.columns))), f.count)
                for f, e in zip(self.factors, plain.factors, strict=True)
            )
            return replace(plain, factors=factors).reduced(None).R

        def with_zeros(columns: Matrix) -> Matrix:
            return np.column_stack([columns, np.zeros(len(columns))])

        motion = triangle(lambda rows, c: with_zeros(rows[:, :c]))
        noise = triangle(lambda rows, c: with_zeros(rows[:, c : 2 * c] - rows[:, :c]))
        lengths = column_lengths(motion)
        scale = np.where(lengths > 0.0, lengths, 1.0)
        _, values, rows = np.linalg.svd(motion / scale)
        kept = values > RANK * values.max(initial=0.0)
        if not kept.any():
            return InstrumentStrength(0.0, 0.0, "none")
        # Combinations of which the instruments show nothing, the motion does not show either: fits tell of them.
        inverse = rows[kept].T / values[kept]
        _, ratios, directions = np.linalg.svd(noise / scale @ inverse)
        largest, worst = float(ratios[0] ** 2), np.abs(inverse @ directions[0])
        rows_each = max((f.count for f in self.factors), default=0)
        statistic = np.inf if largest * rows_each <= RANK else rows_each / largest
        return InstrumentStrength(statistic, 1.0 / (1.0 + largest), plain.base_expressions[int(np.argmax(worst))])


def _solved(instruments: Matrix, regressor: Matrix, torque: Vector) -> Vector:
    """Solve ``Z' (ω - X β) = 0`` in the combinations that the instruments show."""
    lengths = column_lengths(instruments)
    scale = np.where(lengths > 0.0, lengths, 1.0)
    left, values, rows = np.linalg.svd(instruments / scale, full_matrices=False)
    kept = values > RANK * values.max(initial=0.0)
    seen = rows[kept].T / values[kept] / scale[:, None]  # instruments times these are orthonormal
    inner = np.linalg.lstsq(left[:, kept].T @ regressor @ seen, left[:, kept].T @ torque, rcond=None)[0]
    return np.asarray(seen @ inner)


def _rows_at(triangle: Matrix, base: Vector) -> Matrix:
    """The rows ``[Z, ω - (X - Z) β]`` by the rows ``[Z X ω]``."""
    count = len(base)
    instruments, regressor = triangle[:, :count], triangle[:, count : 2 * count]
    return np.column_stack([instruments, triangle[:, -1] - (regressor - instruments) @ base])


@in_one_thread
def instrumental_variables(
    samples: Samples | Sequence[Samples],
    feasible_set: FeasibleSet,
    motion: Samples | Motion | Sequence[Samples | Motion],
    weights: Literal["joint"] | npt.ArrayLike | None = "joint",
    start: Samples | Sequence[Samples] | npt.ArrayLike | None = None,
    iterations: int = 10,
    **options: Any,
) -> Estimate:
    """Estimate feasible parameters by instrumental variables: IDIM-IV of Janot, Vandanjon and Gautier.

    Positions are measured with noise, and velocities and accelerations are derived from them: noise is then in the
    regressor, and least squares draw inertias towards zero however long the log is. In closed loop it is in the
    torques, too. Instruments are correlated with the regressor and not with the noise: the regressor of the motion that
    the robot would have made without noise. Simulating the identified model under the controller of the robot gives it,
    and so does the reference that the controller follows.

    Parameters
    ----------
    samples : Samples or sequence of Samples
        As they were measured, one for each log; they need no careful filter.
    feasible_set : FeasibleSet
        Of a Model.
    motion : Samples or callable, or a sequence of these
        One for each log. Samples: the motion without noise at the times of the measured ones, such as the reference. A
        function from base parameters (n_b,) to such samples, for instance a `ClosedLoop`: it is called with the
        estimate, which gives the next estimate, until the estimate stays. It may leave out rows by its mask: unlike a
        mask that depends on what was measured, one that depends on this motion brings no bias.
    weights : "joint", None or (N,)
        As in `least_squares`; ``"joint"`` from the structural residuals.
    start : Samples, sequence of Samples or (n_b,), optional
        The first instruments, or base parameters with which the first motion is made. Where absent, the reference of a
        `ClosedLoop`, and for other functions the parameters of feasible least squares: with these, noise can have drawn
        inertias so near to zero that the simulation diverges.
    iterations : int
        Largest number of motions.
    **options
        Those of `fit`: `prefer`, `residual_slack`, `prior`, `prior_weight`, `solver`.

    Returns
    -------
    Estimate
        Least squares within the feasible set of the regressor projected on the instruments (two stages). Its standard
        errors are those of instrumental variables, with the correlation of the residuals in time. The remarks tell how
        strong the instruments are, how far least squares are off, and whether the iterations did not converge.

    Raises
    ------
    InputError
        If the motion does not fit the samples.
    SolverError
        If no parameters satisfy all conditions, or not even the first motion can be simulated.

    See Also
    --------
    steelyard.estimators.output_error : Where the controller is known exactly, compares torques or positions.
    steelyard.control.ClosedLoop : The motion of a robot under its controller.

    References
    ----------
    A. Janot, P.-O. Vandanjon, M. Gautier, A generic instrumental variable approach for industrial robot
    identification, IEEE Transactions on Control Systems Technology 22(1), 2014.
    D. Staiger, J. H. Stock, Instrumental variables regression with weak instruments, Econometrica 65(3), 1997.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([("pi/2", 0, 0, "q")], gravity=(0, 0, 0)))
    >>> random = np.random.default_rng(1)
    >>> q, dq, ddq = random.normal(size=(3, 4000, 1))
    >>> noisy = sy.Samples(q=q, dq=dq, ddq=ddq + 0.5 * random.normal(size=ddq.shape), torque=2.0 * ddq)
    >>> exact = sy.Samples(q=q, dq=dq, ddq=ddq, torque=0.0 * ddq)
    >>> estimate = instrumental_variables(noisy, sy.FeasibleSet(model), exact)
    >>> estimate.base.round(1).tolist(), estimate.consistency
    ([2.0], 'full')
    """
    return _iterated(samples, feasible_set, motion, weights, start, iterations, options).told()


def instrumented_parts(
    samples: Samples | Sequence[Samples],
    feasible_set: FeasibleSet,
    motion: Samples | Motion | Sequence[Samples | Motion],
    weights: Literal["joint"] | npt.ArrayLike | None = "joint",
    iterations: int = 10,
    count: int = 5,
) -> tuple[InstrumentalInformation, tuple[Information, ...]]:
    """Return the regression of `instrumental_variables`, and those of so many contiguous parts of each log together.

    Parameters
    ----------
    samples, feasible_set, motion, weights, iterations
        See `instrumental_variables`.
    count : int
        Of the parts, which are for cross-validation.

    Returns
    -------
    information : InstrumentalInformation
        Its remarks are those of the estimate.
    parts : tuple of Information
    """
    found = _iterated(samples, feasible_set, motion, weights, None, iterations, {})
    base = found.regression.solution(found.estimate.weights)
    whole = found.regression.information(base)
    parts = []
    for k in range(count):
        pieces = [
            InstrumentedRegression.of_samples(
                found.regression.model,
                *(x.rows(one.count * k // count, one.count * (k + 1) // count) for x in (one, made)),
            )
            for one, made in zip(found.samples, found.motions, strict=True)
            if one.count >= count
        ]
        if pieces:
            parts.append(replace(reduce(add, pieces).information(base), batch_means=(), strength=None))
    return replace(whole, remarks=(*whole.remarks, *found.remarks)), tuple(parts)


@in_one_thread
def of_instruments(info: Information, feasible_set: FeasibleSet, weights: Any = "joint", **options: Any) -> Estimate:
    """Fit a regression of `instrumented_parts`: `instrumental_variables` under the name by which it is found.

    Raises
    ------
    InputError
        For rows without instruments.
    """
    if not info.torque_factors:
        raise InputError(
            "Instrumental variables need the motion without noise beside the samples; call "
            "steelyard.instrumental_variables(samples, feasible_set, motion)."
        )
    return replace(fit(info, feasible_set, weights, **options), method="feasible instrumental variables")


of_instruments.rows_of_motion = instrumented_parts  # type: ignore[attr-defined]
of_instruments.counts_slow_rows = True  # type: ignore[attr-defined]


@dataclass(frozen=True, eq=False)
class _Iterated:
    """The last estimate, and from what it comes."""

    estimate: Estimate
    regression: InstrumentedRegression
    samples: Sequence[Samples]
    motions: Sequence[Samples]
    ended: str

    @property
    def remarks(self) -> tuple[str, ...]:
        """How strong the instruments are, how far least squares are off, and whether the iterations converged."""
        estimate, strength = self.estimate, self.regression.strength
        base = self.regression.solution(estimate.weights)
        plain = least_squares(self.regression.measured(), estimate.weights).base
        errors = estimate.standard_error
        known = np.isfinite(errors) & (errors > 0.0)
        off = np.where(known, np.abs(plain - base) / np.where(known, errors, 1.0), 0.0)
        worst = int(np.argmax(off))
        told = [
            str(strength),
            f"Least squares of the rows as measured differ from plain instrumental variables by up to {off[worst]:.2g} "
            f"standard errors of the latter, at {estimate.base_expressions[worst]}.",
        ]
        if strength.f_statistic < WEAK:
            told.append(
                f"The instruments are weak near {strength.weakest} (F statistic {strength.f_statistic:.3g}, below "
                f"{WEAK:g}): its estimate may be far off, and its interval does not hold."
            )
        return (*told, *([self.ended] if self.ended else []))

    def told(self) -> Estimate:
        """The estimate with its remarks."""
        return replace(
            self.estimate,
            remarks=(*self.estimate.remarks, *self.remarks),
            unconstrained_base=self.regression.solution(self.estimate.weights),
        )


def _iterated(
    samples: Samples | Sequence[Samples],
    feasible_set: FeasibleSet,
    motion: Samples | Motion | Sequence[Samples | Motion],
    weights: Any,
    start: Samples | Sequence[Samples] | npt.ArrayLike | None,
    iterations: int,
    options: Mapping[str, Any],
) -> _Iterated:
    """Make motions and estimates from each other until the estimate stays."""
    read_number(iterations, "iterations", "a positive number, such as 10", above=0)
    logs, motions = with_motions(samples, motion)
    model = model_of(feasible_set)
    simulated = [one for one in motions if not isinstance(one, Samples)]
    base, found = None, None
    if simulated:
        base, found = first_parameters(logs, feasible_set, motions, start, weights, options)
    count, moved, ended = 0, np.inf, ""
    while moved > CONVERGED and count < int(iterations):
        try:
            made = made_by(motions, base)
        except SolverError as error:
            if found is None:
                raise impossible(error) from None
            ended = f"after {count} simulated motions the next one was impossible ({error})"
            if not count:
                ended = f"the motion of the first estimate, with the reference as instruments, was impossible ({error})"
            break
        count += 1
        regression = regressed(model, logs, made)
        estimate = _fitted(regression, feasible_set, weights, options)
        moved = 0.0 if base is None else step_in_errors(estimate.base - base, estimate.standard_error)
        found, base = _Iterated(estimate, regression, logs, made, ""), None if base is None else estimate.base
    assert found is not None
    if not simulated:
        return found
    if moved <= CONVERGED:
        return replace(found, ended=f"Instrumental variables converged with {count} simulated motions.")
    ended = ended or f"the last of {count} simulated motions moved a base parameter by {moved:.2g} standard errors"
    return replace(
        found, ended=f"Instrumental variables did not converge: {ended}; this is the estimate of the last one."
    )


def with_motions(
    samples: Samples | Sequence[Samples], motion: Samples | Motion | Sequence[Samples | Motion]
) -> tuple[list[Samples], list[Samples | Motion]]:
    """Return the samples of each log, and what makes its motion.

    Raises
    ------
    InputError
        If they are not samples, or not as many motions as logs.
    """
    logs: list[Any] = list(samples) if isinstance(samples, list | tuple) else [samples]
    motions: list[Any] = list(motion) if isinstance(motion, list | tuple) else [motion]
    wrong = next((one for one in logs if not isinstance(one, Samples)), None)
    if wrong is not None:
        raise InputError(f"samples must be sy.Samples, one for each log, got {shown(wrong)}.")
    for one in motions:
        if not isinstance(one, Samples) and not callable(one):
            raise InputError(
                f"motion must be sy.Samples or a function of base parameters, such as a ClosedLoop, got {shown(one)}."
            )
    if not logs or len(logs) != len(motions):
        raise InputError(f"Each log needs a motion: there are {len(logs)} logs and {len(motions)} motions.")
    return logs, motions


def made_by(motions: Sequence[Samples | Motion], base: Vector | None) -> list[Samples]:
    """Return the motions that base parameters make; samples stay what they are."""
    made = []
    for one in motions:
        if isinstance(one, Samples):
            made.append(one)
        else:
            assert base is not None
            made.append(one(base))
    return made


def first_made(motions: Sequence[Samples | Motion], base: Vector) -> list[Samples]:
    """Return the motions of the first estimate, without which there is no other."""
    try:
        return made_by(motions, base)
    except SolverError as error:
        raise impossible(error) from None


def impossible(error: SolverError) -> SolverError:
    """Return the message for robots of which not even the first motion can be simulated."""
    return SolverError(
        f"The motion of the first estimate is impossible ({error}); check the gains, the rate and the reference of the "
        "controller, and their units."
    )


def used_in_both(samples: Samples, motion: Samples) -> npt.NDArray[np.bool_] | None:
    """Return which rows of each joint (S, N) neither of the masks leaves out; None where there is no mask."""
    masks = [one.mask for one in (samples, motion) if one.mask is not None]
    return np.logical_and.reduce(masks) if masks else None


def regressed(model: Model, logs: Sequence[Samples], motions: Sequence[Samples]) -> InstrumentedRegression:
    """Return the regression of all logs together."""
    parts = [InstrumentedRegression.of_samples(model, *pair) for pair in zip(logs, motions, strict=True)]
    return reduce(add, parts)


def first_parameters(
    logs: Sequence[Samples],
    feasible_set: FeasibleSet,
    motions: Sequence[Samples | Motion],
    start: Samples | Sequence[Samples] | npt.ArrayLike | None,
    weights: Any,
    options: Mapping[str, Any],
) -> tuple[Vector, _Iterated | None]:
    """Return base parameters with which the first motion is made, and their estimate if it is one of instruments."""
    model = model_of(feasible_set)
    given: Any = start
    if start is None:
        given = [one if isinstance(one, Samples) else getattr(one, "reference_motion", None) for one in motions]
        if any(one is None for one in given):
            plain = Information.from_chunks(model, logs)
            return fit(plain, feasible_set, weights, **options).base, None
    given = [given] if isinstance(given, Samples) else given
    if isinstance(given, list | tuple) and given and isinstance(given[0], Samples):
        logs, first = with_motions(logs, given)
        made = made_by(first, None)
        regression = regressed(model, logs, made)
        estimate = _fitted(regression, feasible_set, weights, options)
        return estimate.base, _Iterated(estimate, regression, logs, made, "")
    base = np.asarray(given, dtype=np.float64)
    if base.shape != (model.base_parameters().count,) or not np.isfinite(base).all():
        raise InputError(
            f"start must be Samples of each log or {model.base_parameters().count} finite base parameters, got "
            f"{shown(start)}."
        )
    return base, None


def model_of(feasible_set: FeasibleSet) -> Model:
    """Return the model of a feasible set whose rows can be computed."""
    if not isinstance(feasible_set.model, Model):
        raise InputError("This estimator computes regressors; give the FeasibleSet of a sy.Model.")
    return feasible_set.model


def step_in_errors(step: Vector, standard_error: Vector) -> float:
    """Return the largest change of a base parameter in its standard errors; those without one do not count."""
    known = np.isfinite(standard_error) & (standard_error > 0.0)
    return float(np.max(np.abs(step[known]) / standard_error[known], initial=0.0))


def _fitted(
    regression: InstrumentedRegression, feasible_set: FeasibleSet, weights: Any, options: Mapping[str, Any]
) -> Estimate:
    """Fit, with weights from the structural residuals."""
    plain = regression.information(regression.solution())
    if not plain.is_weighted(weights):
        return fit(plain, feasible_set, None, **options)
    used = plain.joint_weights(weights)
    return fit(regression.information(regression.solution(used)), feasible_set, used, **options)
