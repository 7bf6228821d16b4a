"""Maximum likelihood: noise that lasts, and that joints share, is found from the residuals, and rows are whitened."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from steelyard.dynamics import Model
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError
from steelyard.feasibility.feasible_set import FeasibleSet
from steelyard.files import read_number, shown
from steelyard.recording import Samples
from steelyard.regression import Estimate, Information, least_squares
from steelyard.regression.batch_means import BatchSums
from steelyard.regression.coloured_noise import (
    LARGEST_ORDER,
    ColouredNoise,
    ColouredReduction,
    NoiseFromResiduals,
    residual_channels,
)
from steelyard.regression.factor import column_lengths, solve
from steelyard.regression.parameter_covariance import inverse_root
from steelyard.regression.reduction import JointReduction, empty_whole, require_joints

from .fit import fit

__all__ = ["LikelihoodInformation", "likelihood_information", "likelihood_parts", "maximum_likelihood"]

Matrix = npt.NDArray[np.float64]
Given = Samples | Sequence[Samples] | Callable[[], Iterable[Samples]]

ACCURACY = 0.01
"""Root mean square change of the base parameters, in standard errors, at which the noise counts as settled."""

MOST_ITERATIONS = 10
"""Two or three are usual: the residuals of a consistent estimate hardly change."""

LEAST_SCALE = 1e-9
"""The least scale of an innovation, relative to the root mean square torque: simulated data without noise has residuals
of rounding."""

STRETCHES = 5

APART = 5.0
"""Standard errors of least squares by which an estimate of less variance may differ: with noise alone one in 1e6 does.
Where positions were filtered and torques not, whitening weights what the filter took away, and differs by dozens."""

NOISE_ROWS, PIECE = 200_000, 8192
"""Samples from which the noise is found, in pieces of so many that are spread over all logs: its coefficients are then
known to a few thousandths, and their residuals need not stand in memory for hours of a log."""

ERROR_NUMBERS, FEWEST_ERRORS = 2**19, 4
"""Numbers of each joint that the errors of the parameters may add to the residuals, and columns of them at least. Of
long logs, where they hardly matter, random combinations stand for all of them."""


@dataclass(frozen=True, eq=False)
class LikelihoodInformation(Information):
    """An Information of rows that were whitened in time and across the joints, and the noise that they had.

    Attributes
    ----------
    noise : ColouredNoise
    iterations : int
        How often the noise was found from residuals.
    converged : bool
    """

    noise: ColouredNoise | None = field(default=None, repr=False)
    iterations: int = 0
    converged: bool = True

    @property
    def method(self) -> str:
        """The name of the method that least squares of these rows are."""
        return "maximum likelihood"


@in_one_thread
def likelihood_information(
    model: Model,
    samples: Given,
    *,
    order: int | Literal["aic", "bic"] = "aic",
    largest_order: int = LARGEST_ORDER,
    iterations: int = MOST_ITERATIONS,
) -> LikelihoodInformation:
    """Reduce samples to rows of which least squares are the maximum of the likelihood, also where noise lasts.

    The noise of each joint is autoregressive, with innovations that are normal and correlated across the joints. Its
    coefficients are found from the residuals by Burg's method, so that the model is stable, its order by Akaike's or
    Schwarz's criterion, and what the parameters took out of the noise is given back. The rows are predicted from the
    ones before them, and what is left is whitened across the joints of a sample. Residuals of least squares of these
    rows give the noise anew, until the parameters stay where they are. A
    fit of the result is the estimate: :func:`maximum_likelihood`.

    The first rows of a stretch, and those behind a gap, have the likelihood that they have under that model: a row that
    a mask leaves out tells nothing, and what the rows before it say of the noise behind it is kept. A stretch ends
    where a log does, where stamps jump, and where a gap is longer than the noise lasts.

    Parameters
    ----------
    model : Model
    samples : Samples, sequence of Samples, or callable
        Each begins a stretch. A callable returns an iterable of them, each time it is called, so that they need not
        stand in memory together. They are read twice in each iteration.
    order : int, "aic" or "bic"
        Of the noise in time; 0 for noise that is white, so that rows are whitened across the joints alone.
    largest_order : int
        That a criterion may choose.
    iterations : int
        Largest number of times that the noise is found.

    Returns
    -------
    LikelihoodInformation
        Its errors (`relative_error`) are those of the rows as they were measured. With `batch_means`, so that standard
        errors hold, too, where the noise has more memory than the model found. The sum of two, of which each was
        whitened by its own noise, is an Information whose least squares are the maximum of both likelihoods together.

    Raises
    ------
    InputError
        For an order or a number of iterations that is none, or samples of another robot.

    References
    ----------
    L. Ljung, System identification: theory for the user, Prentice Hall, 1999, section 7.4. P. J. Brockwell and R. A.
    Davis, Time series: theory and methods, Springer, 1991, chapters 5 and 8.

    Examples
    --------
    Noise that lasts, on the simplest robot: the standard error of gravity's moment is that of white noise there, and
    the others are smaller than those of least squares.

    >>> import steelyard as sy
    >>> from scipy.signal import lfilter
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> t = np.arange(4000)[:, None] / 100
    >>> q, dq, ddq = np.sin(3 * t), 3 * np.cos(3 * t), -9 * np.sin(3 * t)
    >>> noise = lfilter([1.0], [1.0, -0.9], np.random.default_rng(1).normal(size=t.shape), axis=0)
    >>> torque = model.inverse_dynamics(q, dq, ddq, np.ones(10)) + noise
    >>> samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque, t=t[:, 0])
    >>> plain = sy.least_squares(sy.Information.from_samples(model, samples))
    >>> information = likelihood_information(model, samples)
    >>> information.noise.orders, information.converged
    ((1,), True)
    >>> better = sy.least_squares(information)
    >>> better.method, bool(np.all(better.standard_error < plain.standard_error))
    ('maximum likelihood', True)
    """
    return likelihood_parts(model, samples, order=order, largest_order=largest_order, iterations=iterations, count=0)[0]


def likelihood_parts(
    model: Model,
    samples: Given,
    *,
    order: int | Literal["aic", "bic"] = "aic",
    largest_order: int = LARGEST_ORDER,
    iterations: int = MOST_ITERATIONS,
    count: int = STRETCHES,
) -> tuple[LikelihoodInformation, tuple[Information, ...]]:
    """Return the Information of `likelihood_information`, and those of so many contiguous parts of the data.

    Parameters
    ----------
    model, samples, order, largest_order, iterations
        See `likelihood_information`.
    count : int
        Of the parts, which are for cross-validation; a part begins as if nothing were known of the noise before it, so
        that all together tell a little less than the whole.
    """
    if isinstance(order, str):
        if order not in ("aic", "bic"):
            raise InputError(f'order must be "aic", "bic" or a number of at least 0, got {shown(order)}.')
    else:
        read_number(order, "order", 'a whole number of at least 0, such as 3, or "aic"', least=0)
    read_number(iterations, "iterations", "a positive number, such as 10", above=0)
    read_number(largest_order, "largest_order", "a positive number, such as 40", above=0)
    read = _reading(samples)
    counts: list[int] = []
    first = Information.from_chunks(model, _checked(model, read(), counts))
    rows = sum(counts)
    if not rows or first.count <= first.base_count:
        raise InputError(
            f"The samples leave {first.count} rows for {first.base_count} base parameters; record a longer motion, or "
            "mask fewer rows."
        )
    plain = least_squares(first)
    base = plain.base
    torque = np.sqrt(sum(f.norm2 for f in first.factors) / first.count)
    floor = max(LEAST_SCALE * torque, float(np.finfo(float).tiny) ** 0.5)
    converged, lengths, root = False, np.zeros(first.base_count), np.zeros((first.base_count, 0))
    iteration = 0
    while not converged and iteration < int(iterations):
        iteration += 1
        collected = NoiseFromResiduals(model.dof)
        for one in _spread(read(), rows):
            collected.add(one, residual_channels(model, one, base, root))
        noise = collected.noise(tuple(model.robot.joint_names), floor, order, largest_order)
        reduction = ColouredReduction(model, noise, BatchSums((empty_whole(model),)))
        for one in read():
            reduction.add(one)
        whitened = replace(first, factors=(reduction.factor(),), torque_factors=first.factors, batch_means=())
        before, problem = base, whitened.reduced(None)
        base = solve(problem)
        step, size = problem.R @ (base - before), column_lengths(problem.R)
        settled = np.all(np.abs(size - lengths) <= ACCURACY * size)
        converged = bool(settled and float(step @ step) <= ACCURACY**2 * len(base))
        lengths, root = size, _drawn(inverse_root(problem.R)[0], min(rows, NOISE_ROWS))
    remark = str(noise) if converged else f"{noise} It had not settled after {iteration} iterations."
    remarks = (*first.remarks, remark, *_apart(plain, base))
    own = replace(whitened, covariance=noise.covariance, remarks=remarks, batch_means=reduction.batch_means())
    whole = LikelihoodInformation.of(own, noise=noise, iterations=iteration, converged=converged)
    return whole, _parts(model, read(), noise, whole, [round(rows * (k + 1) / count) for k in range(count)])


@in_one_thread
def maximum_likelihood(
    info: Information, feasible_set: FeasibleSet, weights: Any = "joint", **options: Any
) -> Estimate:
    """Return the feasible parameters of greatest likelihood, from rows that `likelihood_information` whitened.

    Parameters
    ----------
    info : Information
        From `likelihood_information`, or the sum of such; logs with noise of different kinds are best whitened each by
        itself, and added.
    feasible_set : FeasibleSet
    weights : "joint", None or (N,)
        Not read: the noise that was found takes their place.
    **options
        Those of :func:`steelyard.fit`.

    Returns
    -------
    Estimate
        With standard errors that hold for the noise that was found, and where it lasts longer than that.

    Raises
    ------
    InputError
        For rows that were not whitened.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> random = np.random.default_rng(1)
    >>> q, dq, ddq = random.normal(size=(3, 500, 1))
    >>> body = np.array([2.0, 0.0, 0.0, 2.0, 0.0, 2.0, 0.1, 0.2, 0.0, 3.0])
    >>> torque = model.inverse_dynamics(q, dq, ddq, body) + 0.1 * random.normal(size=(500, 1))
    >>> samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque)
    >>> estimate = maximum_likelihood(likelihood_information(model, samples), sy.FeasibleSet(model))
    >>> estimate.method, estimate.consistency
    ('feasible maximum likelihood', 'full')
    """
    if info.covariance is None:
        raise InputError(
            "maximum_likelihood needs rows whitened by the noise that they have; make the Information with "
            "steelyard.estimators.likelihood_information(model, samples)."
        )
    found = fit(info, feasible_set, weights=None, **options)
    return replace(found, method="feasible maximum likelihood")


maximum_likelihood.rows = likelihood_parts  # type: ignore[attr-defined]
maximum_likelihood.counts_slow_rows = True  # type: ignore[attr-defined]


def _drawn(root: Matrix, rows: int) -> Matrix:
    """The root of a covariance, or fewer random combinations of its columns, whose products are the same on average."""
    count = max(ERROR_NUMBERS // rows, FEWEST_ERRORS)
    if root.shape[1] <= count:
        return root
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (root.shape[1], count))
    return np.asarray(root @ signs / np.sqrt(count))


def _apart(plain: Estimate, base: Matrix) -> tuple[str, ...]:
    """Say where whitened rows tell of another robot than the rows themselves (Hausman, Econometrica 46, 1978)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = np.nan_to_num(np.abs(base - plain.base) / plain.standard_error, posinf=0.0)
    worst = int(np.argmax(errors))
    if errors[worst] <= APART:
        return ()
    return (
        f"The answers by whitened rows and by the rows themselves differ by {errors[worst]:.0f} standard errors of "
        f"least squares in {plain.base_expressions[worst]}, which noise does not explain: whitening gives weight to "
        'frequencies at which the model or the motion errs. Rely on estimator="fit", filter less, or leave out rows '
        "near standstill.",
    )


def _spread(samples: Iterable[Samples], rows: int) -> Iterator[Samples]:
    """All the samples, or pieces evenly spread over them where they are many."""
    every = -(-rows // NOISE_ROWS)
    place = 0
    for one in samples:
        if every == 1:
            yield one
            continue
        for start in range(0, one.count, PIECE):
            if place % every == 0:
                yield one.rows(start, min(start + PIECE, one.count))
            place += 1


def _reading(samples: Given) -> Callable[[], Iterable[Samples]]:
    if callable(samples):
        return samples
    given = [samples] if isinstance(samples, Samples) else list(samples)
    if not given:
        raise InputError("there are no samples to reduce; give at least one Samples.")
    return lambda: given


def _checked(model: Model, samples: Iterable[Samples], counts: list[int]) -> Iterator[Samples]:
    """The samples, each of which has the joints of the model; how many rows each has is appended to `counts`."""
    for one in samples:
        require_joints(model, one)
        counts.append(one.count)
        yield one.with_presliding(model)


def _parts(
    model: Model, samples: Iterable[Samples], noise: ColouredNoise, whole: LikelihoodInformation, ends: Sequence[int]
) -> tuple[Information, ...]:
    """The Informations of the parts of all samples that end before these rows."""
    if not ends:
        return ()
    plain = Information.of(whole)
    parts: list[Information] = []
    reduction, measured, done = ColouredReduction(model, noise), JointReduction(model), 0
    for one in samples:
        start = 0
        while start < one.count:
            stop = min(one.count, start + ends[len(parts)] - done)
            piece = one.rows(start, stop)
            reduction.add(piece)
            measured.add(piece)
            done, start = done + stop - start, stop
            if done == ends[len(parts)]:
                own, torques = (reduction.factor(),), measured.factors()
                parts.append(replace(plain, factors=own, torque_factors=torques, batch_means=()))
                reduction, measured = ColouredReduction(model, noise), JointReduction(model)
    return tuple(parts)
