"""Output error in closed loop: parameters whose simulated torques, or positions, are nearest to the measured ones."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from steelyard.dynamics import Model
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError, SolverError
from steelyard.feasibility.feasible_set import FeasibleSet
from steelyard.files import read_number, shown
from steelyard.recording import Samples
from steelyard.regression import Estimate, Factor, Information
from steelyard.regression.batch_means import BatchSums
from steelyard.regression.factor import solve
from steelyard.regression.reduction import BLOCK, empty_factors, joint_rows
from steelyard.regression.time_blocks import TimeBlocks

from .fit import fit
from .instrumental_variables import (
    CONVERGED,
    Motion,
    first_made,
    first_parameters,
    made_by,
    model_of,
    step_in_errors,
    used_in_both,
    with_motions,
)

__all__ = ["OutputInformation", "of_outputs", "output_error", "output_parts"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

RISE = 1e-3
"""Relative rise of the mean square of the errors up to which a step is taken whole. The regressor of the motion is not
quite the derivative of the simulated torques, so that its fixed point is not quite their least square."""

HALVINGS = 6
"""How often a step that raises the errors, or whose motion diverges, is halved; then the iterations end."""

DIFFERENCE = 0.1
"""Step of the differences by which positions are derived, in standard errors."""


@in_one_thread
def output_error(
    samples: Samples | Sequence[Samples],
    feasible_set: FeasibleSet,
    motion: Motion | Sequence[Motion],
    output: Literal["torque", "position"] = "torque",
    weights: Literal["joint"] | npt.ArrayLike | None = "joint",
    start: Samples | Sequence[Samples] | npt.ArrayLike | None = None,
    iterations: int = 15,
    **options: Any,
) -> Estimate:
    """Estimate feasible parameters by output error in closed loop: of torques (DIDIM), or of positions (CLOE).

    The robot is simulated under its controller, and the simulated torques (or positions) are compared with the measured
    ones. Measured positions are not derived, so that neither a filter nor its noise matters; but the controller has to
    be known exactly, with its gains, its rate and its reference.

    With ``output="torque"`` a step is the least squares of the measured torques on the regressor of the simulated
    motion (DIDIM: a controller that tracks well makes nearly the same motion with any parameters, so that the regressor
    is the derivative of the simulated torques). With ``output="position"`` the derivatives of the positions are
    differences of simulations. Each step is a fit within the feasible set, and a step that raises the errors is
    halved: since the set is convex, every motion is that of a possible robot.

    Parameters
    ----------
    samples : Samples or sequence of Samples
        As they were measured, one for each log. Of their motion only the positions are used.
    feasible_set : FeasibleSet
        Of a Model.
    motion : callable, or a sequence of these
        One for each log: from base parameters (n_b,) to the simulated samples at the times of the measured ones, with
        the torques of the drives; a `ClosedLoop`. One that has a method ``several(bases)``, for (R, n_b), is asked for
        all differences at once; one that has ``expected(base)``, for the mean of what sensors read in many noisy
        motions, for what is compared with the log.
    output : {"torque", "position"}
    weights : "joint", None or (N,)
        ``"joint"``: of each joint the inverse standard deviation of the errors, N·m, N, rad or m.
    start : Samples, sequence of Samples or (n_b,), optional
        As in `instrumental_variables`.
    iterations : int
        Largest number of steps.
    **options
        Those of `fit`: `prefer`, `residual_slack`, `prior`, `prior_weight`, `solver`.

    Returns
    -------
    Estimate
        Its standard errors take the correlation of the errors in time into account; `relative_error` is that of its
        torques for the measured motion, as of any other estimate. The remarks tell the error of the simulation, and
        whether the iterations did not converge.

    Raises
    ------
    InputError
        If the motion does not fit the samples.
    SolverError
        If no parameters satisfy all conditions, or not even the first motion can be simulated.

    See Also
    --------
    steelyard.estimators.instrumental_variables : Where the controller is known only roughly, or not at all.

    References
    ----------
    M. Gautier, A. Janot, P.-O. Vandanjon, A new closed-loop output error method for parameter identification of robot
    dynamics, IEEE Transactions on Control Systems Technology 21(2), 2013.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([("pi/2", 0, 0, "q")], gravity=(0, 0, 0)))
    >>> random = np.random.default_rng(1)
    >>> q, dq, ddq = random.normal(size=(3, 1000, 1))
    >>> noisy = sy.Samples(q=q, dq=0 * q, ddq=0 * q, torque=2.0 * ddq + 0.1 * random.normal(size=ddq.shape))
    >>> def motion(base):
    ...     return sy.Samples(q=q, dq=dq, ddq=ddq, torque=base[0] * ddq)
    >>> estimate = output_error(noisy, sy.FeasibleSet(model), motion, start=[1.0])
    >>> estimate.base.round(1).tolist(), estimate.consistency
    ([2.0], 'full')
    """
    found = _iterated(samples, feasible_set, motion, output, weights, start, iterations, options)
    return replace(
        found.estimate,
        remarks=(*found.estimate.remarks, *found.remarks),
        unconstrained_base=solve(found.information.reduced(found.estimate.weights)),
    )


@dataclass(frozen=True, eq=False)
class OutputInformation(Information):
    """The regression of the last step of `output_error`, around the motion that was simulated last.

    Attributes
    ----------
    output : {"torque", "position"}
    """

    output: str = "torque"

    @property
    def method(self) -> str:
        """The name of the method that least squares of these rows are."""
        return f"output error of the {self.output}s"


def output_parts(
    samples: Samples | Sequence[Samples],
    feasible_set: FeasibleSet,
    motion: Motion | Sequence[Motion],
    weights: Literal["joint"] | npt.ArrayLike | None = "joint",
    iterations: int = 15,
    count: int = 5,
    output: Literal["torque", "position"] = "torque",
) -> tuple[OutputInformation, tuple[Information, ...]]:
    """Return the regression of the last step of `output_error`, and those of so many parts of each log together.

    Parameters
    ----------
    samples, feasible_set, motion, weights, iterations, output
        See `output_error`.
    count : int
        Of the parts, which are for cross-validation.

    Returns
    -------
    information : OutputInformation
        Its remarks are those of the estimate.
    parts : tuple of Information
    """
    found = _iterated(samples, feasible_set, motion, output, weights, None, iterations, {})
    parts = []
    for k in range(count):
        pieces = [problem.information(*found.step[place], (k, count)) for place, problem in enumerate(found.problems)]
        parts.append(replace(Information.total(pieces), batch_means=()))
    return replace(found.information, remarks=(*found.information.remarks, *found.remarks)), tuple(parts)


@in_one_thread
def of_outputs(info: Information, feasible_set: FeasibleSet, weights: Any = "joint", **options: Any) -> Estimate:
    """Fit a regression of `output_parts`: `output_error` under the name by which it is found.

    Raises
    ------
    InputError
        For other rows.
    """
    if not info.torque_factors:
        raise InputError(
            "Output error needs simulated motions beside the samples; call "
            "steelyard.output_error(samples, feasible_set, motion)."
        )
    return replace(fit(info, feasible_set, weights, **options), method=f"feasible {info.method or 'output error'}")


of_outputs.rows_of_motion = output_parts  # type: ignore[attr-defined]
of_outputs.needs_controller = True  # type: ignore[attr-defined]


@dataclass(frozen=True, eq=False)
class _Iterated:
    """The last estimate, and from what it comes."""

    estimate: Estimate
    information: OutputInformation
    problems: Sequence[_Problem]
    step: Sequence[tuple[Samples, Vector, Matrix | None]]
    remarks: tuple[str, ...]


def _iterated(
    samples: Samples | Sequence[Samples],
    feasible_set: FeasibleSet,
    motion: Motion | Sequence[Motion],
    output: str,
    weights: Any,
    start: Samples | Sequence[Samples] | npt.ArrayLike | None,
    iterations: int,
    options: Mapping[str, Any],
) -> _Iterated:
    """Make steps until the estimate stays."""
    model = model_of(feasible_set)
    read_number(iterations, "iterations", "a positive number, such as 15", above=0)
    if output not in ("torque", "position"):
        raise InputError(f'output must be "torque" or "position", got {shown(output)}.')
    logs, given = with_motions(samples, motion)
    motions = [one for one in given if not isinstance(one, Samples)]
    if len(motions) < len(given):
        raise InputError("Output error needs functions of base parameters that simulate, such as a ClosedLoop.")
    problems = [_Problem(model, one, output) for one in logs]
    base, _ = first_parameters(logs, feasible_set, given, start, weights, options)
    expected = [getattr(one, "expected", one) for one in motions]
    at, count = first_made(expected, base), 1
    estimate: Estimate | None = None
    moved, ended = np.inf, ""
    for _ in range(int(iterations)):
        errors = None if estimate is None else estimate.standard_error
        step = [
            (own, base, problem.derivatives(one, base, errors))
            for problem, one, own in zip(problems, motions, at, strict=True)
        ]
        parts = [problem.information(*own) for problem, own in zip(problems, step, strict=True)]
        info = OutputInformation.of(Information.total(parts), output=output)
        used = info.joint_weights(weights)
        estimate = fit(info, feasible_set, used, **options)
        moved = step_in_errors(estimate.base - base, estimate.standard_error)
        if moved <= CONVERGED:
            break
        found = _shortened(expected, problems, at, base, estimate.base, used)
        count += 1
        if found is None:
            ended = "no part of the last step made the simulation come nearer"
            break
        at, base = found
    assert estimate is not None
    unit = "N·m or N" if output == "torque" else "rad or m"
    listed = ", ".join(f"{value:.3g}" for value in _error(problems, at))
    remarks = [f"The simulated {output}s differ from the measured ones by {listed} {unit} (root mean squares)."]
    noise = [np.max(getattr(one, "position_noise", 0.0)) for one in motions]
    if max(noise) > 0.0:
        remarks.append(
            f"Noise of the positions that the controller reads, up to {max(noise):.2g} rad or m, was simulated, too: "
            "it shakes friction where a joint turns around."
        )
    if moved > CONVERGED:
        ended = ended or f"the last of {count} steps moved a base parameter by {moved:.2g} standard errors"
        remarks.append(f"The output error did not converge: {ended}; this is the estimate of the last step.")
    else:
        remarks.append(f"The output error converged with {count} simulated motions.")
    return _Iterated(estimate, info, problems, step, tuple(remarks))


class _Problem:
    """The measured outputs, and the linear regressions around simulated motions."""

    def __init__(self, model: Model, samples: Samples, output: str) -> None:
        self.model, self.samples, self.output = model, samples, output
        self.plain = Information.from_samples(model, samples, batch_means=False)
        self.measured = samples.torque if output == "torque" else samples.q

    def _simulated(self, at: Samples) -> Matrix:
        if at.q.shape != self.samples.q.shape:
            raise InputError(
                f"The simulated motion is of shape {at.q.shape} and the samples {self.samples.q.shape}; each row of "
                "the samples needs the motion at its time."
            )
        return at.torque if self.output == "torque" else at.q

    def squares(self, at: Samples) -> tuple[Vector, Vector]:
        """Sums of the squared errors of each joint, (N,), and of how many rows."""
        mask, left = used_in_both(self.samples, at), self.measured - self._simulated(at)
        used = np.ones(left.shape, dtype=bool) if mask is None else mask
        return np.sum(np.where(used, left, 0.0) ** 2, axis=0), used.sum(axis=0)

    def derivatives(self, motion: Motion, base: Vector, errors: Vector | None) -> Matrix | None:
        """Return those of the positions by the base parameters, (n_b, S, N); None for torques."""
        if self.output == "torque":
            return None
        known = None if errors is None else np.where(np.isfinite(errors) & (errors > 0.0), errors, 0.0)
        sizes = 1e-3 * (0.1 + np.abs(base)) if known is None else DIFFERENCE * known
        sizes = np.where(sizes > 0.0, sizes, 1e-3 * (0.1 + np.abs(base)))
        bases = np.vstack([base, base + np.diag(sizes)])
        several = getattr(motion, "several", None)
        at, *runs = [motion(one) for one in bases] if several is None else several(bases)
        return np.array([(one.q - at.q) / size for one, size in zip(runs, sizes, strict=True)])

    def information(
        self, at: Samples, base: Vector, derivatives: Matrix | None, part: tuple[int, int] = (0, 1)
    ) -> Information:
        """The regression of one step: errors plus what the parameters already explain, on the derivatives.

        Of the k-th of so many parts of the rows, (k, count).
        """
        left, mask = self.measured - self._simulated(at), used_in_both(self.samples, at)
        if derivatives is None:
            own = [e.columns for e in self.plain.factors]
            empty = empty_factors(self.model)
        else:
            own = [np.arange(len(base))] * self.model.dof
            size = len(base) + 1
            empty = tuple(Factor(k, columns, np.zeros((size, size)), 0) for k, columns in enumerate(own))
        first, last = (self.samples.count * k // part[1] for k in (part[0], part[0] + 1))
        plain = self.plain
        if part != (0, 1):
            plain = Information.from_samples(self.model, self.samples.rows(first, last), batch_means=False)
        blocks, sums = TimeBlocks(empty, 1), BatchSums(empty)
        for place, regressors in self._regressors(at, derivatives, first, last):
            rows = [
                np.column_stack([x, left[place, k] + x @ base[columns]])
                for k, (x, columns) in enumerate(zip(regressors, own, strict=True))
            ]
            used = None if mask is None else mask[place]
            sums.add(rows, used)
            blocks.add(rows, used)
        return replace(
            plain,
            factors=blocks.factors(),
            torque_factors=plain.factors,
            batch_means=sums.factors(),
            remarks=(),
        )

    def _regressors(
        self, at: Samples, derivatives: Matrix | None, first: int, last: int
    ) -> Iterator[tuple[slice, list[Matrix]]]:
        for start in range(first, last, BLOCK):
            part = slice(start, min(start + BLOCK, last))
            if derivatives is None:
                for _, rows in joint_rows(self.model, at.rows(part.start, part.stop, False)):
                    yield part, [own[:, :-1] for own in rows]
            else:
                yield part, [derivatives[:, part, k].T for k in range(self.model.dof)]


def _error(problems: Sequence[_Problem], at: Sequence[Samples]) -> Vector:
    """Root mean squares of the errors of each joint over all logs, (N,)."""
    both = [problem.squares(own) for problem, own in zip(problems, at, strict=True)]
    squares, counts = (np.sum([one[k] for one in both], axis=0) for k in range(2))
    return np.asarray(np.sqrt(squares / np.maximum(counts, 1)))


def _shortened(
    motions: Sequence[Motion],
    problems: Sequence[_Problem],
    at: Sequence[Samples],
    base: Vector,
    target: Vector,
    weights: Vector,
) -> tuple[list[Samples], Vector] | None:
    """Simulate the end of a step, or half of it and so on, until the errors fall; None where they do not."""
    before = float(np.sum((weights * _error(problems, at)) ** 2))
    share = 1.0
    for _ in range(HALVINGS):
        trial = base + share * (target - base)
        share *= 0.5
        try:
            moved = made_by(motions, trial)
        except SolverError:
            continue
        if float(np.sum((weights * _error(problems, moved)) ** 2)) <= before * (1.0 + RISE):
            return moved, trial
    return None
