"""Information: what a data set says about the base parameters, in a fixed and mergeable size."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import reduce
from operator import add
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.display import html_table, shortened
from steelyard.errors import InputError
from steelyard.files import listed, plain, read_json, require_format, shown, write_json
from steelyard.once import cached_property
from steelyard.recording import Samples
from steelyard.recording.samples import regrouped

from .batch_means import BATCH_LENGTHS, BatchMeans, BatchSums, added
from .factor import LARGEST, Factor, Reduced, combined, solve, triangular, unidentifiable_columns
from .reduction import CHUNK, JointReduction, WhitenedReduction, as_covariance, empty_factors, narrowing, require_joints
from .repeated_motion import MotionSums, ReturningErrors, added_returning, returning_errors
from .time_blocks import FOLDS, TimeBlocks

if TYPE_CHECKING:
    from steelyard.dynamics import Model

__all__ = ["FIRST_DEVIATION", "Information", "inverse_deviations"]

Array = NDArray[np.float64]
Kept = TypeVar("Kept")
FORMAT = "steelyard-information-2"


FIRST_DEVIATION = 0.03
"""The deviation of the torques, relative to them, by noise and errors of the model that is assumed at least while rows
are few. Without it, the first dozens of rows, which any parameters explain, would count as exact."""

FILTERED = (
    "Torques were filtered or decimated, and the regressor of this model was not, which keeps the jumps of friction "
    "that the filter rounds: estimates are biased by more than noise explains, and no interval of a base parameter is "
    "given. Give the model to Recording.process, which filters both, or leave out `torque_cutoff` and `decimate`."
)


@dataclass(frozen=True, eq=False)
class Information:
    """The reduced regression of a data set: for each joint the triangular factor of its rows, and how many there were.

    It answers exactly, without the data, for every weighting of the joints: least squares, residual norms, constrained
    fits. Two of them add: ``a + b`` is the Information of both data sets together. Of a data set of more than 131 072
    samples, 64 neighbouring rows at a time are replaced by four combinations of them wherever the motion is so smooth
    that less than a thousandth of any column is lost; standard errors and residual norms change by a millionth.

    Attributes
    ----------
    base_names, base_expressions : tuple of str
        The n_b base parameters.
    joint_names : tuple of str
    factors : tuple of Factor
        One for each joint, or a single one for all the joints where the data came reduced or its noise is correlated.
    torque_factors : tuple of Factor
        The same rows for each joint as they were measured, where `factors` holds weighted or whitened rows; errors are
        computed from them. Empty where `factors` holds the rows as measured.
    covariance : ndarray or None
        (N, N), of the noise across the joints with which the rows were whitened; of a sum of data sets that were each
        whitened by their own noise, the mean over the rows. None where rows were not whitened.
    remarks : tuple of str
        What the user should know of these rows, in sentences; estimates repeat it.
    batch_means : tuple of tuples of Factor
        The same of the sums over 8, 16, ... 1024 neighbouring samples, of long data 64 at least, from which
        `ParameterCovariance` tells how far residuals are correlated in time. Empty where they were not asked for.
    filtered_torque : bool
        Whether torques were filtered and the dynamics were not, see `Samples`; no interval of a base parameter holds
        then.
    returning : tuple of ReturningErrors
        What returns with each period of the motions of these rows, one for each motion.
    contents : tuple of str
        Hashes of the logs whose rows it holds, where these are known: it is not added to another one of any of them.

    Examples
    --------
    >>> import numpy as np
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> random = np.random.default_rng(1)
    >>> q, dq, ddq = random.normal(size=(3, 100, 1))
    >>> torque = model.inverse_dynamics(q, dq, ddq, np.arange(10.0))
    >>> samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque)
    >>> information = Information.from_samples(model, samples)
    >>> estimate = sy.least_squares(information)
    >>> bool(np.allclose(estimate.base, model.base_parameters().values(np.arange(10.0))))
    True
    """

    base_names: tuple[str, ...]
    base_expressions: tuple[str, ...]
    joint_names: tuple[str, ...]
    factors: tuple[Factor, ...]
    torque_factors: tuple[Factor, ...] = ()
    covariance: Array | None = None
    remarks: tuple[str, ...] = ()
    batch_means: BatchMeans = field(default=(), kw_only=True, repr=False)
    filtered_torque: bool = field(default=False, kw_only=True)
    returning: tuple[ReturningErrors, ...] = field(default=(), kw_only=True, repr=False)
    contents: tuple[str, ...] = field(default=(), kw_only=True, repr=False)

    def __repr__(self) -> str:
        return (
            f"Information({len(self.base_names)} base parameters, {self.count} rows of {len(self.joint_names)} joints, "
            f"condition number {self.condition_number:.4g})"
        )

    def _repr_html_(self) -> str:
        heads: tuple[str, ...] = ()
        rows: list[tuple[object, ...]] = []
        if self.has_joint_errors:
            heads = ("joint", "rows", "RMS of the torque")
            sizes = self.joint_rms_error(np.zeros(self.base_count))
            counts = [factor.count for factor in self.measured]
            rows = [(j, n, f"{size:.4g}") for j, n, size in zip(self.joint_names, counts, sizes, strict=True)]
        hidden = self.unidentifiable
        remarks = (f"The data does not show {listed(hidden, 3)}.",) if hidden else ()
        return html_table(repr(self), heads, rows, remarks)

    @property
    def method(self) -> str:
        """The name of the method that least squares of these rows are; empty where the weights decide it."""
        return "" if self.covariance is None else "generalised least squares"

    @property
    def base_count(self) -> int:
        """Number n_b of base parameters."""
        return len(self.base_names)

    @property
    def count(self) -> int:
        """Number of rows: samples times joints, less what was masked."""
        return sum(f.count for f in self.factors)

    @classmethod
    def of(cls, rows: Information, **own: Any) -> Self:
        """Return an Information of this class with the rows of another, and what it has of its own."""
        return cls(**{one.name: getattr(rows, one.name) for one in fields(Information)}, **own)

    @classmethod
    def empty(cls, model: Model) -> Information:
        """Return the Information of no data."""
        base = model.base_parameters()
        return cls(base.names, base.expressions, tuple(model.robot.joint_names), empty_factors(model))

    @classmethod
    def from_samples(
        cls, model: Model, samples: Samples, covariance: ArrayLike | None = None, *, batch_means: bool = True
    ) -> Information:
        """Reduce samples.

        Parameters
        ----------
        model : Model
        samples : Samples
            (S, N) arrays.
        covariance : array_like, optional
            (N, N), of the noise across the joints, such as `residual_covariance` gives. The rows of each sample are
            then multiplied by the inverse of its Cholesky factor, so that least squares are generalised least squares
            (the estimator of least variance, Gauss and Aitken). Where a mask leaves out joints of a sample, the others
            have their marginal covariance.
        batch_means : bool
            Whether to keep `batch_means`, for intervals that hold where residuals are correlated in time. They make
            the Information nine times as large.

        Raises
        ------
        InputError
            If the samples have another number of joints than the model, or the covariance is not positive definite.
        """
        return cls.from_chunks(model, [samples], covariance, batch_means=batch_means)

    @classmethod
    def from_chunks(
        cls,
        model: Model,
        chunks: Iterable[Samples],
        covariance: ArrayLike | None = None,
        *,
        batch_means: bool = True,
        blocks: TimeBlocks | None = None,
        exact: int | None = None,
        motion: MotionSums | None = None,
    ) -> Information:
        """Reduce samples that come one chunk after the other, so that they never stand in memory together.

        Parameters
        ----------
        model : Model
        chunks : iterable of Samples
        covariance : array_like, optional
        batch_means : bool
            Both as in `from_samples`.
        blocks : TimeBlocks, optional
            Keeps stretches of the data apart, for cross-validation; see `stretches`.
        exact : int, optional
            Samples, a multiple of 1024, of which each row is reduced by itself; 131 072 by default. Neighbouring rows
            of those that follow are combined where they say the same.
        motion : MotionSums, optional
            With it the Information tells what returns with each period of the motion, where this repeats.

        Returns
        -------
        Information
            The same numbers, to the last bit, wherever the samples were cut.
        """
        base, names = model.base_parameters(), tuple(model.robot.joint_names)
        matrix = None if covariance is None else as_covariance(covariance, model.dof)
        sums = BatchSums(empty_factors(model)) if batch_means and matrix is None else None
        by_joint = JointReduction(model, sums, blocks, exact, motion)
        whole = None if matrix is None else WhitenedReduction(model, matrix, batch_means)
        filtered, any_rows = False, False
        # Blocks of rows are the same, and are added in the same order, wherever the chunks end.
        for samples in regrouped((one.with_presliding(model) for one in chunks), CHUNK):
            require_joints(model, samples)
            filtered, any_rows = filtered or samples.is_biased_for(model), True
            by_joint.add(samples)
            if whole is not None:
                whole.add(samples)
        if not any_rows:
            return cls.empty(model)
        factors, held = by_joint.factors(), () if sums is None else sums.factors()
        found = cls(
            base.names,
            base.expressions,
            names,
            factors if whole is None else (whole.factor(),),
            () if whole is None else factors,
            matrix,
            (FILTERED,) if filtered else (),
            batch_means=held if whole is None else whole.batch_means(),
            filtered_torque=filtered,
        )
        if motion is None or whole is not None or not motion.repeats():
            return found
        returning = motion.returning(factors, solve(found.reduced("joint")))
        return found if returning is None else replace(found, returning=(returning,))

    @classmethod
    def from_factor(
        cls,
        R: ArrayLike,
        rho: ArrayLike,
        residual2: float,
        count: int,
        base_names: Sequence[str],
        joint_names: Sequence[str] = (),
    ) -> Information:
        """Build an Information from a regression over the rows of all the joints that was reduced elsewhere.

        Parameters
        ----------
        R : array_like
            (n_b, n_b): ``R'R = W'W`` (thesis eq. 3.46); need not be triangular.
        rho : array_like
            (n_b,): ``Q1' omega`` (thesis eq. 3.49).
        residual2 : float
            Smallest squared residual, ``|rho_2|²``.
        count : int
            Number of rows of W.
        base_names : sequence of str
            The base parameters in the order of the columns.
        joint_names : sequence of str, optional

        Returns
        -------
        Information
            Joint weights and errors per joint cannot be had from it.

        Raises
        ------
        InputError
            If the sizes do not fit.
        """
        factor, target = np.asarray(R, dtype=np.float64), np.asarray(rho, dtype=np.float64)
        n = len(base_names)
        if factor.shape != (n, n) or target.shape != (n,) or residual2 < 0.0 or count < 1:
            raise InputError(
                f"A reduced regression of {n} base parameters needs R of shape ({n}, {n}), rho of shape ({n},), "
                f"a squared residual and a positive number of rows, got {factor.shape}, {target.shape}, {residual2} "
                f"and {count}."
            )
        rows = np.zeros((n + 1, n + 1))
        rows[:n, :n], rows[:n, n], rows[n, n] = factor, target, np.sqrt(residual2)
        one = Factor(None, np.arange(n), triangular(rows), int(count))
        return cls(tuple(base_names), tuple(base_names), tuple(joint_names), (one,))

    def __add__(self, other: Information) -> Information:
        if self.base_expressions != other.base_expressions or len(self.factors) != len(other.factors):
            raise InputError(
                "Only Informations of the same model can be added, with or without covariance alike; these have "
                "different base parameters, or only one of them was whitened."
            )
        factors = tuple(a + b for a, b in zip(self.factors, other.factors, strict=True))
        measured: tuple[Factor, ...] = ()
        if self.torque_factors or other.torque_factors:
            pairs = zip(self.torque_factors or self.factors, other.torque_factors or other.factors, strict=True)
            measured = tuple(a + b for a, b in pairs)
        if (self.covariance is None) != (other.covariance is None) and self.count and other.count:
            raise InputError(
                "Only one of two Informations was whitened by the noise of its rows, so that they cannot be added; "
                "whiten both, each by its own noise, or neither."
            )
        if set(self.contents) & set(other.contents):
            raise InputError("Two Informations that are added hold the rows of one log, which would count twice.")
        remarks = tuple(dict.fromkeys((*self.remarks, *other.remarks)))
        if self.count and other.count:
            means = added(self.batch_means, other.batch_means)
        else:
            means = (self if self.count else other).batch_means
        return Information(
            self.base_names,
            self.base_expressions,
            self.joint_names,
            factors,
            measured,
            _mean_covariance(self, other),
            remarks,
            batch_means=means,
            filtered_torque=self.filtered_torque or other.filtered_torque,
            returning=added_returning(self.returning, other.returning),
            contents=(*self.contents, *other.contents),
        )

    def model_among(self, models: Sequence[Model], path: str) -> Model:
        """Return of which of some models an Information from a file is.

        Raises
        ------
        InputError
            If it is of none; the message tells how it differs from the first.
        """
        found = next((one for one in models if one.base_parameters().expressions == self.base_expressions), None)
        if found is not None:
            return found
        base, own = models[0].base_parameters(), set(models[0].base_parameters().expressions)
        alone = next((one for one in self.base_expressions if one not in own), None)
        told = f"; it alone has {shortened(alone, 60)}" if alone is not None else ""
        raise InputError(
            f"{path}: is of another robot or of other terms than {models[0].robot.name}: {self.base_count} base "
            f"parameters where this has {base.count}{told}; reduce the logs with this robot."
        )

    def stretches(self, blocks: TimeBlocks, count: int = FOLDS) -> tuple[Information, ...]:
        """The Informations of contiguous parts of this data, which together are the whole.

        Parameters
        ----------
        blocks : TimeBlocks
            What `from_chunks` filled.
        count : int
            How many, at most; fewer where the data is short.
        """
        return tuple(
            replace(
                self, factors=factors, torque_factors=(), covariance=None, batch_means=(), returning=(), contents=()
            )
            for factors in blocks.folds(count)
        )

    def narrowed(self, wider: Model, model: Model) -> Information:
        """Return the Information of the same data for a model that lacks some terms of that of this one.

        It is exact: the parameters of the terms are zero.

        Parameters
        ----------
        wider : Model
            Of this Information.
        model : Model
            The same robot with fewer terms.
        """
        base, change = model.base_parameters(), narrowing(wider, model)

        def without(factors: Sequence[Factor]) -> tuple[Factor, ...]:
            return tuple(f.changed(change, _columns_of(model, f.joint)) for f in factors)

        return replace(
            self,
            base_names=base.names,
            base_expressions=base.expressions,
            factors=without(self.factors),
            torque_factors=without(self.torque_factors),
            batch_means=tuple(map(without, self.batch_means)),
        )

    @classmethod
    def total(cls, parts: Sequence[Information]) -> Information:
        """Return the Information of all parts together, of which there is at least one."""
        return reduce(add, parts)

    @classmethod
    def without_each(cls, parts: Sequence[Information]) -> Iterator[Information]:
        """Yield for each of the parts the Information of all the others together."""
        # Sums from either end: twelve additions for six parts, where all the others of each would take 24.
        before = list(itertools.accumulate(parts[:-1], add))
        behind = list(itertools.accumulate(parts[:0:-1], lambda later, earlier: earlier + later))[::-1]
        for place in range(len(parts)):
            yield cls.total([*before[max(place - 1, 0) : place], *behind[place : place + 1]])

    @classmethod
    def held_out_squares(cls, parts: Sequence[Information], base_of: Callable[[Information], Array]) -> Array:
        """Return the squared residuals of each joint on parts of which each is predicted from all the others.

        Parameters
        ----------
        parts : sequence of Information
            At least two, such as `stretches` returns.
        base_of : callable
            Base parameters by an Information.

        Returns
        -------
        ndarray
            (N,) sums over the rows of all parts.
        """
        squares = np.zeros(len(parts[0].measured))
        for left_out, others in zip(parts, cls.without_each(parts), strict=True):
            base = base_of(others)
            squares += [factor.residual2(base) for factor in left_out.measured]
        return squares

    @property
    def returns(self) -> Array:
        """(N,) or (1,): how many times the variance of a mean is that of noise, for what returns with the motion."""
        found = np.ones(len(self.factors))
        for one in self.returning:
            if self.by_joint and len(one.counts) == len(self.factors):
                found += one.raised * one.counts / np.maximum([f.count for f in self.factors], 1)
        return found

    def with_returning(
        self,
        stretches: Sequence[tuple[Samples, Array]],
        earlier: Sequence[Information] = (),
        measured: Information | None = None,
    ) -> Information:
        """Return the Information that also tells what returns from one log to the next, where several hold one motion.

        That a motion repeats within a log was found when this was reduced.

        Parameters
        ----------
        stretches : sequence of (Samples, ndarray)
            Rows of the logs, and what is left of their torques (S, N), NaN where a row is not used.
        earlier : sequence of Information
            The part of it that was reduced before, of which no rows are known.
        measured : Information, optional
            Of the same logs with the rows as they were measured, where an estimator made others of them.
        """
        measured = self if measured is None else measured
        if not self.batch_means or not self.by_joint or not measured.by_joint:
            return self
        rows = np.array([f.count for f in measured.factors])
        told = [(samples.t, samples.q, left) for samples, left in stretches if samples.t is not None]
        together = measured
        if 1 < len(told) == len(stretches):
            own = rows - sum(np.array([f.count for f in one.factors]) for one in earlier)
            found = returning_errors(told, own)
            if found is not None:  # of which what each log tells by itself is a part
                before = [each for one in earlier for each in one.returning]
                together = replace(measured, returning=added_returning(before, [found]))
        returning = max(measured, together, key=lambda one: float(np.sum(one.returns))).returning
        if returning and self is not measured and len(self.factors) == len(rows):
            share = np.array([f.count for f in self.factors]) / np.maximum(rows, 1)
            returning = tuple(replace(one, counts=np.rint(share * one.counts).astype(int)) for one in returning)
        return replace(self, returning=returning) if returning else self

    @property
    def by_joint(self) -> bool:
        """Whether the rows of each joint are known apart."""
        return all(f.joint is not None for f in self.factors)

    @property
    def has_joint_errors(self) -> bool:
        """Whether errors can be computed joint by joint."""
        return all(f.joint is not None for f in self.measured)

    @property
    def measured(self) -> tuple[Factor, ...]:
        """The factors of the rows in N·m or N, as they were measured."""
        return self.torque_factors or self.factors

    def reduced(self, weights: str | ArrayLike | None = "joint") -> Reduced:
        """Return the least-squares problem over all the base parameters.

        Parameters
        ----------
        weights : "joint", None or array_like
            ``"joint"`` takes the inverse standard deviations of the unweighted residuals of each joint (thesis eq.
            4.33), and weights all rows alike where the rows of the joints are not known apart; None weights all rows
            alike; an array (N,) gives the weights themselves.
        """
        used = self.joint_weights(weights)
        return self.remembered(("reduced", used.tobytes()), lambda: self._reduced(used))

    def _reduced(self, weights: Array) -> Reduced:
        n = self.base_count
        triangle = combined(self.factors, weights, n)
        triangle.flags.writeable = False  # whoever asks again gets the same
        return Reduced(
            triangle[:n, :n],
            triangle[:n, n],
            float(triangle[n, n] ** 2),
            self.count,
            float(np.sum(triangle[:, n] ** 2)),
        )

    @cached_property
    def _remembered(self) -> dict[Hashable, Any]:
        return {}

    def remembered(self, key: Hashable, build: Callable[[], Kept]) -> Kept:
        """Return what a function of this Information alone gives, computed at the first call with a key.

        Several steps of an identification ask for the same reduction, and for the same covariance.
        """
        if key not in self._remembered:
            self._remembered[key] = build()
        return self._remembered[key]  # type: ignore[no-any-return]

    def is_weighted(self, weights: str | ArrayLike | None) -> bool:
        """Tell whether such weights make a difference between the joints; ``"joint"`` needs their rows apart."""
        return weights is not None and not (isinstance(weights, str) and weights == "joint" and not self.by_joint)

    def joint_weights(self, weights: str | ArrayLike | None = "joint") -> Array:
        """Return one weight for each factor, (N,); what ``"joint"`` is stands at `inverse_deviations`.

        Parameters
        ----------
        weights : "joint", None or array_like
            See `reduced`.

        Raises
        ------
        InputError
            If the weights are unknown, of a wrong size or not positive.
        """
        n = len(self.factors)
        if not self.is_weighted(weights):
            return np.ones(n)
        if isinstance(weights, str) and weights == "joint":
            return inverse_deviations(self.factors, solve(self.reduced(None)))
        assert weights is not None
        return _given_weights(weights, n)

    @cached_property
    def condition_number(self) -> float:
        """Condition number of the base regressor W (thesis section 4.3.2), infinite where it has no full rank."""
        if self.unidentifiable_mask.any():
            return float("inf")
        values = np.linalg.svd(self.reduced(None).R, compute_uv=False)
        return float(values[0] / values[-1]) if len(values) and values[-1] > 0.0 else float("inf")

    @cached_property
    def unidentifiable_mask(self) -> NDArray[np.bool_]:
        """Which base parameters the data does not determine, whatever its noise; (n_b,)."""
        return unidentifiable_columns(self.reduced(None).R)

    @property
    def unidentifiable(self) -> tuple[str, ...]:
        """Base parameters that the data does not determine, whatever its noise."""
        return tuple(itertools.compress(self.base_expressions, self.unidentifiable_mask))

    def relative_error(self, base: ArrayLike) -> float:
        """Return ``|omega - W beta| / |omega|`` over all the joints (thesis eq. 4.37); 0.05 means 5 %.

        Parameters
        ----------
        base : array_like
            (n_b,).
        """
        beta = self._base(base)
        residual = sum(f.residual2(beta) for f in self.measured)
        norm = sum(f.norm2 for f in self.measured)
        return float(np.sqrt(residual / norm)) if norm > 0.0 else float("nan")

    def joint_relative_error(self, base: ArrayLike) -> Array:
        """Return the relative error of each joint, (N,)  (thesis table 4.7); NaN where a joint has no torque."""
        beta = self._base(base)
        self._require_joint_errors()
        pairs = [(f.residual2(beta), f.norm2) for f in self.measured]
        return np.array([np.sqrt(r / n) if n > 0.0 else np.nan for r, n in pairs])

    def joint_rms_error(self, base: ArrayLike) -> Array:
        """Return the root mean square residual of each joint, (N,), N·m or N; NaN where a joint has no rows."""
        beta = self._base(base)
        self._require_joint_errors()
        return np.array([np.sqrt(f.residual2(beta) / f.count) if f.count else np.nan for f in self.measured])

    def _base(self, base: ArrayLike) -> Array:
        beta = np.asarray(base, dtype=np.float64)
        if beta.shape != (self.base_count,):
            raise InputError(
                f"base must have shape ({self.base_count},), one number a base parameter, got shape {beta.shape}."
            )
        return beta

    def _require_joint_errors(self) -> None:
        if not self.has_joint_errors:
            why = "reduced over all joints" if self.covariance is None else "whitened across the joints"
            raise InputError(f"Errors per joint need the rows of each joint apart, but this Information was {why}.")

    def save(self, path: str | Path) -> None:
        """Write the Information as JSON; the file appears whole or not at all."""
        write_json({"format": FORMAT, **plain(self)}, path, indent=None)

    @classmethod
    def load(cls, path: str | Path) -> Information:
        """Read what `save` wrote.

        Raises
        ------
        InputError
            If the file is missing or is something else.
        """
        document = read_json(path, remedy="give an Information that steelyard saved")
        try:
            require_format(document["format"], FORMAT, path, "reduce the samples anew")
            values: dict[str, Any] = {
                name: tuple(document[name]) for name in ("base_names", "base_expressions", "joint_names")
            }
            for name in ("remarks", "contents"):
                values[name] = tuple(document.get(name, ()))
            for name, texts in values.items():
                if not all(isinstance(text, str) for text in texts):
                    raise ValueError(f"{name!r} must be texts")
            count, joints = len(values["base_names"]), len(values["joint_names"])
            if len(values["base_expressions"]) != count:
                raise ValueError(f"there are {count} names but {len(values['base_expressions'])} expressions")
            factors = values["factors"] = tuple(_factor(entry, count) for entry in document["factors"])
            if [f.joint for f in factors] not in ([None], list(range(joints))):
                raise ValueError("there must be one factor for each joint, or one for all")
            measured = tuple(_factor(entry, count) for entry in document.get("torque_factors", ()))
            if measured and [f.joint for f in measured] != list(range(joints)):
                raise ValueError("there must be one torque factor for each joint")
            values["torque_factors"] = measured
            levels = tuple(tuple(_factor(e, count) for e in level) for level in document.get("batch_means", ()))
            if levels and len(levels) != len(BATCH_LENGTHS):
                raise ValueError(f"there must be batch means for {len(BATCH_LENGTHS)} lengths")
            for level in levels:
                pairs = list(zip(level, factors, strict=True))
                if any(b.joint != f.joint or not np.array_equal(b.columns, f.columns) for b, f in pairs):
                    raise ValueError("batch means must be of the same columns as the factors")
            values["batch_means"] = levels
            values["filtered_torque"] = document.get("filtered_torque", False)
            if not isinstance(values["filtered_torque"], bool):
                raise ValueError("'filtered_torque' must be true or false")
            values["returning"] = tuple(_returning(one, joints) for one in document.get("returning", ()))
            covariance = document.get("covariance")
            values["covariance"] = None if covariance is None else as_covariance(_finite(covariance), joints)
        except (ValueError, KeyError, TypeError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(
                f"{path}: is not an Information that was saved by steelyard ({shown(str(error))})."
            ) from None
        return cls(**values)


def _mean_covariance(one: Information, other: Information) -> Array | None:
    """The mean over the rows of two data sets; whitened rows are of variance one, whatever they were whitened by."""
    held = [part for part in (one, other) if part.covariance is not None]
    if len(held) < 2 or np.array_equal(np.asarray(one.covariance), np.asarray(other.covariance)):
        return held[0].covariance if held else None
    total = max(one.count + other.count, 1)
    return np.asarray(sum(np.asarray(part.covariance) * (part.count / total) for part in held))


def _columns_of(model: Model, joint: int | None) -> NDArray[np.intp]:
    """The base parameters on which the torque of a joint depends; all of them where the joints stand together."""
    return np.arange(model.base_parameters().count) if joint is None else model.base_columns.joints[joint]


def _factor(entry: dict[str, Any], width: int) -> Factor:
    joint, columns, count = entry["joint"], entry["columns"], entry["count"]
    for number, least in [
        (count, 0),
        *((column, 0) for column in columns),
        *([(joint, 0)] if joint is not None else []),
    ]:
        if isinstance(number, bool) or not isinstance(number, int) or number < least:
            raise ValueError(f"{shown(number)} is no count or index")
    if sorted(set(columns)) != columns or (columns and columns[-1] >= width):
        raise ValueError(f"columns must be different indices below {width}, in ascending order")
    triangle = _finite(entry["triangle"])
    if triangle.shape != (len(columns) + 1, len(columns) + 1) or np.any(np.tril(triangle, -1) != 0.0):
        raise ValueError(f"a factor of {len(columns)} columns must be an upper triangle of one row more")
    return Factor(joint, np.array(columns, dtype=np.intp), triangle, count)


def _returning(entry: dict[str, Any], joints: int) -> ReturningErrors:
    positions, (correlation, counts) = _finite(entry["positions"]), _finite([entry["correlation"], entry["counts"]])
    [[period, periods, alike]] = _finite([[entry[name] for name in ("period", "periods", "alike")]])
    if positions.shape != (2, joints) or correlation.shape != (joints,):
        raise ValueError("what returns with a motion must be told of each joint")
    if period <= 0.0 or periods < 1.0 or min(*correlation, *counts, alike, 1.0 - alike) < 0.0:
        raise ValueError("a period, and what returns with it, must be positive")
    return ReturningErrors(period, periods, positions, correlation, alike, counts.astype(np.intp))


def _finite(rows: Any) -> NDArray[np.float64]:
    flat = [value for row in rows for value in row]
    if not all(isinstance(value, int | float) and not isinstance(value, bool) for value in flat):
        raise ValueError("a matrix must hold numbers")
    matrix = np.array(rows, dtype=np.float64)
    if np.max(np.abs(matrix), initial=0.0) > LARGEST:
        raise ValueError(f"a matrix holds numbers beyond {LARGEST:g}")
    return matrix


def inverse_deviations(factors: Sequence[Factor], base: Array, fewest: float = 1.0) -> Array:
    """Return the inverse standard deviations of the residuals of each joint (thesis eq. 4.32, 4.33).

    Parameters
    ----------
    factors : sequence of Factor
        The rows of each of N joints, unweighted.
    base : (n_b,)
        Base parameters of ordinary least squares, whose residuals they are.
    fewest : float
        Rows for each column of a joint up to which its residual tells little of its noise, since any parameters explain
        so few. Of such a joint a deviation of `FIRST_DEVIATION` is assumed at least.

    Returns
    -------
    (N,)
        In 1/(N·m) or 1/N; 1 for a joint without rows.

    Examples
    --------
    >>> rows = np.array([[1.0, 1.0], [1.0, 3.0]])  # the regressor's only column, and the torque: residuals of ±1
    >>> joints = [Factor(j, np.array([0]), scale * rows, 2) for j, scale in enumerate((1.0, 2.0))]
    >>> inverse_deviations(joints, np.array([2.0])).round(4).tolist()
    [0.7071, 0.3536]
    """
    freedom = [max(f.count - len(base), 1) for f in factors]
    values = np.sqrt([f.residual2(base) / n for f, n in zip(factors, freedom, strict=True)])
    # A joint that hardly moves may have two rows that count, which would be met exactly, whatever all others say.
    few = [0 < f.count <= fewest * len(f.columns) for f in factors]
    torques = np.sqrt([f.norm2 / max(f.count, 1) for f in factors])
    values = np.where(few, np.maximum(values, FIRST_DEVIATION * torques), values)
    # A joint without noise or without rows would get an infinite weight: bound it by the others.
    largest = float(values.max(initial=0.0))
    if largest == 0.0:
        return np.ones(len(values))
    floor = 1e-9 * largest
    return np.where([f.count > 0 for f in factors], 1.0 / np.maximum(values, floor), 1.0)


def _given_weights(weights: str | ArrayLike, joints: int) -> Array:
    """Return the weights that a user gave, (joints,); they must be one positive number for each joint."""
    if isinstance(weights, str):
        raise InputError(f"weights must be None, 'joint' or one number for each joint, got {weights!r}.")
    values = np.asarray(weights, dtype=np.float64)
    if values.shape != (joints,) or not np.all(np.isfinite(values)) or np.any(values <= 0.0):
        raise InputError(f"weights must be {joints} positive numbers, one for each joint, got {weights!r}.")
    return values
