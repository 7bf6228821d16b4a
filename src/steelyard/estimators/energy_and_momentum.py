"""Rows without accelerations: the balances of momentum and of energy over short windows, integrated by parts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from steelyard.dynamics import Model
from steelyard.dynamics.algorithms.regressor import momentum_balance_with_numpy
from steelyard.dynamics.layout import ParameterLayout
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError
from steelyard.feasibility.feasible_set import FeasibleSet
from steelyard.files import read_number
from steelyard.recording import Samples
from steelyard.regression import Estimate, Information
from steelyard.regression.batch_means import BatchSums
from steelyard.regression.information import FILTERED
from steelyard.regression.reduction import empty_factors, empty_whole, joint_rows, require_joints
from steelyard.regression.time_blocks import SHORTEST, TimeBlocks

from .fit import fit

__all__ = [
    "BalanceInformation",
    "balance_parts",
    "energy",
    "energy_information",
    "momentum",
    "momentum_information",
]

Array = npt.NDArray[np.float64]
Given = Samples | Sequence[Samples] | Callable[[], Iterable[Samples]]

WINDOW = 0.2
"""Seconds. A window passes what is slower than about 1 / WINDOW, which are the motions of arms."""

POWER = 6
"""The exponent of the test function (1 - s²)^POWER. The more of its derivatives vanish at the ends, the nearer sums
over the samples are to integrals: 38 samples in a window, motions to 0.8 Hz, and parameters are off by 1e-5 with 4,
1e-7 with 6."""

OVERLAP = 4
"""Windows that begin within half a window: rows every eighth of a window lose nothing that it passes."""

FEWEST = 8
"""Samples in half a window."""

STILL = 0.5
"""This share of a window may be near standstill, where a mask leaves out what friction does: `_without_passages` takes
that out. Without the windows over such passages 40 % of a log of the TX40 were lost, and the error of what follows it
was 10.5 instead of 8.4 %."""

PASSAGE_ORDER = 2
"""The order of the polynomials that stand for what friction does over such a passage: sticking, and a sign that noise
hides, are torques of which windows tell little more than their sum, their slope and their bend. Estimates on 30 logs of
benchmarks/estimators.py, without anything taken out and with orders 0, 1 and 2: errors of 1, 0.18, 0.12 and 0.1, bias
of 1.9, 1.3, 0.9 and 0.3 standard errors."""

MOST_TOGETHER = 500
"""Windows over passages so near to each other that they are projected together. A joint that hardly moves has more,
and a passage over the end of such a group is then taken out twice, which loses little."""

JITTER = 0.01
"""The share of the time between samples by which a step may differ: a step that differs by more ends a stretch."""

PIECE = 2048
"""Samples of which the regressors stand in memory together."""


@dataclass(frozen=True, eq=False)
class BalanceInformation(Information):
    """An Information of balances over short windows.

    Attributes
    ----------
    kept : {"momentum", "energy"}
        What is balanced.
    window : float
        Seconds, the longest.
    """

    kept: str = "momentum"
    window: float = WINDOW

    @property
    def method(self) -> str:
        """The name of the method that least squares of these rows are."""
        return f"balance of {self.kept}"

    def __add__(self, other: Information) -> Information:
        both = super().__add__(other)
        if not isinstance(other, BalanceInformation) or other.kept != self.kept:
            return both
        return BalanceInformation.of(both, kept=self.kept, window=max(self.window, other.window))

    def told(self) -> BalanceInformation:
        """The same with a remark that its errors are those of windows."""
        averages = (
            f"Errors are those of torques averaged over windows of {self.window:.3g} s, which are smaller than those "
            "of samples: do not compare them with errors of other estimators."
        )
        return replace(self, remarks=(*self.remarks, averages))


@in_one_thread
def momentum_information(model: Model, samples: Given, *, window: float | None = None) -> Information:
    """Reduce samples to balances of the momentum of each joint over short windows, which need no accelerations.

    The regressor is ``dP/dt + R`` with the regressor P of the generalised momentum ``M dq``, and R of gravity, friction
    and ``-C' dq``; neither depends on accelerations. With a smooth test function φ that is zero at both ends of a
    window, integration by parts moves the derivative to φ, which is exact:
    ``∫ φ τ dt = (-∫ φ' P dt + ∫ φ R dt) β``. These are the rows (the weak form), with φ of integral 1, so that they are
    averages of torques, N·m. A fit of the result is the estimate: :func:`momentum`.

    Parameters
    ----------
    model : Model
        Whose terms have inertias that do not depend on positions, as all of Steelyard's do.
    samples : Samples, sequence of Samples, or callable
        With times `t`, evenly spaced; where they jump a new stretch begins. Their `ddq` is not read. A callable returns
        an iterable of them.
    window : float, optional
        Seconds that a row averages over; by default 0.2, or 16 samples where that is longer. It takes the place of the
        filter for accelerations: longer windows pass less noise, and less of fast motions.

    Returns
    -------
    BalanceInformation
        Rows of each joint, with `batch_means`; the errors that it tells are those of these averages. A row is left out
        where the mask leaves out a sample of its window at which the joint moves faster than the slowest that are used,
        or where half of it is near standstill. Over shorter passages near standstill, whatever friction does there is
        taken out of the rows: give samples a mask by a velocity threshold where joints have Coulomb friction.

    Raises
    ------
    InputError
        For samples without times, of another robot, or with no stretch as long as a window.

    References
    ----------
    M. Gautier, W. Khalil, On the identification of the inertial parameters of robots, Proc. IEEE Conference on Decision
    and Control, 1988. D. A. Messenger, D. M. Bortz, Weak SINDy: Galerkin-based data-driven model selection, Multiscale
    Modeling & Simulation 19(3), 2021.

    Examples
    --------
    Samples whose accelerations nobody knows:

    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> t = np.arange(0.0, 4.0, 0.005)[:, None]
    >>> q, dq, ddq = np.sin(3 * t), 3 * np.cos(3 * t), -9 * np.sin(3 * t)
    >>> body = np.array([2.0, 0.0, 0.0, 2.0, 0.0, 2.0, 0.1, 0.2, 0.0, 3.0])
    >>> torque = model.inverse_dynamics(q, dq, ddq, body)
    >>> samples = sy.Samples(q=q, dq=dq, ddq=np.zeros_like(q), torque=torque, t=t[:, 0])
    >>> estimate = sy.least_squares(momentum_information(model, samples))
    >>> bool(np.allclose(estimate.base, model.base_parameters().values(body)))
    True
    """
    return balance_parts("momentum", model, samples, window=window, count=0)[0].told()


@in_one_thread
def energy_information(model: Model, samples: Given, *, window: float | None = None) -> Information:
    """Reduce samples to balances of the energy over short windows, which need no accelerations.

    The power of the drives is the rate of kinetic and potential energy, plus what friction and springs take. Along
    velocities v, with the test function φ, the momentum P and the rest R of :func:`momentum_information`, it is
    ``∫ φ v·τ dt = (-∫ d(φ v)/dt · P dt + ∫ φ v·R dt) β``. For the true velocity this is the balance of energy; it holds
    for any, and v are averages over a window: the noise of measured velocities, and that of the torques which a
    controller makes of it, would add power. There is one such row for all joints together, in W, which tells less than
    theirs: prefer momentum where each joint's torque is known.

    Parameters
    ----------
    model, samples, window
        See :func:`momentum_information`.

    Returns
    -------
    BalanceInformation
        Of one factor over all joints, so that joints have no weights; the errors that it tells are those of the
        balances of momentum, joint by joint. A window counts where no joint has a sample that a mask leaves out
        although it moves faster than the slowest that are used: near standstill, where masks leave out what friction
        does, there is hardly any power.

    Raises
    ------
    InputError
        As :func:`momentum_information`.

    References
    ----------
    M. Gautier, W. Khalil, On the identification of the inertial parameters of robots, Proc. IEEE Conference on Decision
    and Control, 1988.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> t = np.arange(0.0, 4.0, 0.005)[:, None]
    >>> q, dq, ddq = np.sin(3 * t), 3 * np.cos(3 * t), -9 * np.sin(3 * t)
    >>> body = np.array([2.0, 0.0, 0.0, 2.0, 0.0, 2.0, 0.1, 0.2, 0.0, 3.0])
    >>> torque = model.inverse_dynamics(q, dq, ddq, body)
    >>> samples = sy.Samples(q=q, dq=dq, ddq=np.zeros_like(q), torque=torque, t=t[:, 0])
    >>> estimate = sy.least_squares(energy_information(model, samples))
    >>> bool(np.allclose(estimate.base, model.base_parameters().values(body)))
    True
    """
    return balance_parts("energy", model, samples, window=window, count=0)[0].told()


@in_one_thread
def momentum(info: Information, feasible_set: FeasibleSet, weights: Any = "joint", **options: Any) -> Estimate:
    """Return the feasible parameters that balance the momentum best.

    Parameters
    ----------
    info : Information
        From `momentum_information`.
    feasible_set : FeasibleSet
    weights : "joint", None or (N,)
    **options
        Both as in :func:`steelyard.fit`.

    Raises
    ------
    InputError
        For other rows.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([("pi/2", 0, 0, "q")], gravity=(0, 0, 0)))
    >>> t = np.arange(0.0, 4.0, 0.005)[:, None]
    >>> unknown = np.zeros_like(t)
    >>> samples = sy.Samples(q=np.sin(t), dq=np.cos(t), ddq=unknown, torque=-2.0 * np.sin(t), t=t[:, 0])
    >>> estimate = momentum(momentum_information(model, samples), sy.FeasibleSet(model))
    >>> estimate.method, estimate.base.round(3).tolist()
    ('feasible balance of momentum', [2.0])
    """
    _require_balances(info, "momentum")
    return fit(info, feasible_set, weights, **options)


@in_one_thread
def energy(info: Information, feasible_set: FeasibleSet, weights: Any = "joint", **options: Any) -> Estimate:
    """Return the feasible parameters that balance the energy best.

    Parameters
    ----------
    info : Information
        From `energy_information`.
    feasible_set : FeasibleSet
    weights : "joint", None or (N,)
        Not read: a balance of energy is one of all joints.
    **options
        Those of :func:`steelyard.fit`.

    Raises
    ------
    InputError
        For other rows.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([("pi/2", 0, 0, "q")], gravity=(0, 0, 0)))
    >>> t = np.arange(0.0, 4.0, 0.005)[:, None]
    >>> unknown = np.zeros_like(t)
    >>> samples = sy.Samples(q=np.sin(t), dq=np.cos(t), ddq=unknown, torque=-2.0 * np.sin(t), t=t[:, 0])
    >>> estimate = energy(energy_information(model, samples), sy.FeasibleSet(model))
    >>> estimate.method, estimate.base.round(3).tolist()
    ('feasible balance of energy', [2.0])
    """
    _require_balances(info, "energy")
    return fit(info, feasible_set, None, **options)


def _require_balances(info: Information, kept: str) -> None:
    if not isinstance(info, BalanceInformation) or info.kept != kept:
        raise InputError(
            f"{kept} needs rows of balances; make the Information with steelyard.estimators.{kept}_information(model, "
            "samples)."
        )


def _balances(model: Model, samples: Samples, smooth: Array, kinds: Sequence[str]) -> list[tuple[Array, Array, Array]]:
    """The balances of samples, each as the regressors of what is kept and of what flows, and the flow of the drives.

    Those of momentum are one for each joint. That of energy is along the velocity of `_smooth_velocity`:
    ``v'(dP/dt + R)`` is ``d(v'P)/dt + v'R - (dv/dt)'P``, whatever the velocities v are.
    """

    def product(velocity: Array, values: Array) -> Array:
        return np.asarray(np.einsum("sk,sk...->s...", velocity, values))

    given = samples.channels_for(model)
    channels = None if given is None else list(given.T)
    both = momentum_balance_with_numpy(ParameterLayout(model.robot), samples.q, samples.dq, channels)
    kept, flow = (one @ model.base_parameters().Pb for one in both)  # P and R (S, N, n_b)
    torque, found = samples.torque, []
    if "energy" in kinds:
        velocity, slope = smooth
        flowing = product(velocity, flow) - product(slope, kept)
        found.append((product(velocity, kept), flowing, product(velocity, torque)))
    if "momentum" in kinds:
        joints = enumerate(model.base_columns.joints)
        found += [(kept[:, k, own], flow[:, k, own], torque[:, k]) for k, own in joints]
    return found


def _smooth_velocity(dq: Array, half: int, step: float) -> Array:
    """Velocities (S, N) averaged over a window, and the derivative of this average; (2, S, N).

    A balance along them holds as it does along the velocities themselves, but their noise is so small that its product
    with that of the torques, which the controller makes of the same positions, adds no power.
    """
    test, slope = _test_function(half, step)
    padded = np.pad(dq, ((half, half), (0, 0)), mode="edge")
    return np.array([np.transpose([np.correlate(own, w, "valid") for own in padded.T]) for w in (test, -slope)])


def _test_function(half: int, step: float) -> tuple[Array, Array]:
    """The test function over a window, of sum one, and its derivative; (2 half + 1,) each."""
    s = np.linspace(-1.0, 1.0, 2 * half + 1)
    test = (1.0 - s**2) ** POWER
    slope = -2.0 * POWER * s * (1.0 - s**2) ** (POWER - 1) / (half * step)
    return test / test.sum(), slope / test.sum()


def _used(samples: Samples, of_energy: bool) -> tuple[npt.NDArray[np.bool_], Array]:
    """Which samples windows may hold, and which of these joints pass near standstill: (S, N), energy before them."""
    mask = samples.used_rows
    slowest = np.min(np.abs(samples.dq), axis=0, where=mask, initial=np.inf)
    slow = ~mask & (np.abs(samples.dq) < slowest)
    held, still = mask | slow, slow.astype(float)
    if of_energy:
        held = np.column_stack([held.all(axis=1), held])
        still = np.column_stack([np.zeros(samples.count), still])
    return held, still


def balance_parts(
    kept: str, model: Model, samples: Given, *, window: float | None = None, count: int = 5
) -> tuple[BalanceInformation, tuple[Information, ...]]:
    """Return the Information of balances of momentum or energy, and those of so many contiguous parts of the data.

    With parts, all errors are those of the rows as measured, with their accelerations: so predictions are judged alike,
    whatever made the estimate. Without, they are those of the averages over windows.
    """
    if window is not None:
        read_number(window, "window", "a positive number of seconds, such as 0.2", above=0)
    _require_constant_inertias(model)
    of_energy, of_joints = kept == "energy", empty_factors(model)
    empty = (empty_whole(model),) if of_energy else of_joints
    fitted = len(empty)
    # Without parts, errors joint by joint are those of the balances of momentum also where that of energy is fitted.
    kinds = [kept] if count or not of_energy else ["energy", "momentum"]
    blocks = TimeBlocks((*empty, *of_joints) if count or of_energy else empty)
    sums = BatchSums(empty)
    filtered, longest, span = False, 0.0, 0.0
    given = samples() if callable(samples) else [samples] if isinstance(samples, Samples) else samples
    for one in given:
        require_joints(model, one)
        filtered = filtered or one.filtered_torque
        used, still = _used(one, of_energy)
        for first, last, step in _stretches(one):
            half = max(round(0.5 * WINDOW / step), FEWEST) if window is None else max(round(0.5 * window / step), 1)
            span = max(span, 2 * half * step)
            longest = max(longest, (last - first) * step)
            if half < FEWEST:
                raise InputError(
                    f"A window of {window:g} s holds {2 * half} of the samples, which are {step:.3g} s apart; balances "
                    f"need {2 * FEWEST} at least: give a window of {2 * FEWEST * step:.3g} s or more."
                )
            stretch = one.rows(first, last)
            rows, mask = _rows(model, stretch, used[first:last], still[first:last], half, step, kinds)
            if count:
                own = rows[:fitted] or [np.zeros((0, len(factor.columns) + 1)) for factor in empty]
                _add_beside_measured(blocks, model, stretch, own, mask, _spacing(half))
            elif rows:
                blocks.add(rows, mask)
            if rows:
                sums.add(rows[:fitted], mask)
                sums.end()
    factors = blocks.factors()
    if not any(factor.count for factor in factors[:fitted]):
        raise InputError(
            f"No balance can be made over {span:.3g} s: the longest stretch of samples lasts {longest:.3g} s, and rows "
            "that a mask leaves out end a window. Record longer stretches, leave out fewer rows, or call "
            f"steelyard.estimators.{kept}_information with a shorter window."
        )
    base = model.base_parameters()
    whole = BalanceInformation(
        base.names,
        base.expressions,
        tuple(model.robot.joint_names),
        factors[:fitted],
        factors[fitted:],
        remarks=(FILTERED,) if filtered else (),
        batch_means=sums.factors(),
        filtered_torque=filtered,
        kept=kept,
        window=span,
    )
    parts = blocks.folds(count) if count else ()
    return whole, tuple(
        replace(whole, factors=own[:fitted], torque_factors=own[fitted:], batch_means=())
        for own in parts
        if any(factor.count for factor in own[:fitted])
    )


momentum.rows = partial(balance_parts, "momentum")  # type: ignore[attr-defined]
momentum.counts_slow_rows = True  # type: ignore[attr-defined]
energy.rows = partial(balance_parts, "energy")  # type: ignore[attr-defined]


def _add_beside_measured(
    blocks: TimeBlocks, model: Model, samples: Samples, rows: list[Array], mask: npt.NDArray[np.bool_], spacing: int
) -> None:
    """Add the rows of windows, by where these begin, beside the rows as measured."""
    used = samples.used_rows
    for part, measured in joint_rows(model, samples):
        for first in range(part.start, part.stop, SHORTEST):
            last = min(first + SHORTEST, part.stop)
            begun = slice(-(-first // spacing), -(-last // spacing))
            place = slice(first - part.start, last - part.start)
            both = [own[begun][mask[begun, k]] for k, own in enumerate(rows)]
            both += [own[place][used[first:last, k]] for k, own in enumerate(measured)]
            blocks.add_combined(both, [len(own) for own in both], last - first)


def _rows(
    model: Model,
    samples: Samples,
    used: npt.NDArray[np.bool_],
    still: Array,
    half: int,
    step: float,
    kinds: Sequence[str],
) -> tuple[list[Array], npt.NDArray[np.bool_]]:
    """The rows ``[W omega]`` of all windows within a stretch, and which of them count; none where it is too short."""
    test, slope = _test_function(half, step)
    starts = np.arange(0, samples.count - 2 * half, _spacing(half))
    smooth = _smooth_velocity(samples.dq, half, step)
    held: list[list[Array]] = []
    masks = []
    every = max(PIECE // _spacing(half), 1)
    for index in range(0, len(starts), every):
        some = starts[index : index + every]
        part = slice(int(some[0]), int(some[-1]) + 2 * half + 1)
        balances = _balances(model, samples.rows(part.start, part.stop), smooth[:, part], kinds)
        places = some - part.start

        held.append(
            [
                np.column_stack(
                    [
                        _integrated(flow, test, places) - _integrated(kept, slope, places),
                        _integrated(supplied, test, places),
                    ]
                )
                for kept, flow, supplied in balances
            ]
        )
        # The test function is zero at the ends of a window.
        whole = np.lib.stride_tricks.sliding_window_view(used[part], 2 * half + 1, axis=0)[places, :, 1:-1]
        masks.append(np.all(whole, axis=2) & (_integrated(still[part], test, places) <= STILL))
    if not held:
        return [], np.zeros((0, used.shape[1]), dtype=bool)
    mask = np.concatenate(masks)
    rows = [np.concatenate(own) for own in zip(*held, strict=True)]
    return [_without_passages(own, mask[:, k], still[:, k], starts, test) for k, own in enumerate(rows)], mask


def _without_passages(
    rows: Array, used: npt.NDArray[np.bool_], still: Array, starts: npt.NDArray[np.intp], test: Array
) -> Array:
    """Take out of the rows of windows (J, c) whatever friction does while a joint passes near standstill.

    The torque that a model misses over a passage is taken as any polynomial in time of order `PASSAGE_ORDER`, and the
    rows are projected on what no such torque reaches. Windows over a passage keep the rest, which is most.
    """
    flags = np.concatenate([[0.0], still, [0.0]])
    edges = np.flatnonzero(np.diff(flags))
    if not len(edges):
        return rows
    counted = np.flatnonzero(used)
    rows = rows.copy()
    basis: list[Array] = []
    reached: list[npt.NDArray[np.intp]] = []
    for first, last in edges.reshape(-1, 2):
        own = counted[(starts[counted] + len(test) > first) & (starts[counted] < last)]
        if not len(own):
            continue
        s = np.linspace(-1.0, 1.0, last - first + 2)[1:-1]
        places = first - starts[own, None] + np.arange(last - first)
        inside = (places >= 0) & (places < len(test))
        weights = np.where(inside, test[np.clip(places, 0, len(test) - 1)], 0.0)
        powers = np.polynomial.legendre.legvander(s, min(PASSAGE_ORDER, last - first - 1))
        columns = np.asarray(weights @ powers, dtype=np.float64)
        if reached and (own[0] > reached[-1][-1] or len(np.unique(np.concatenate(reached))) > MOST_TOGETHER):
            _project(rows, reached, basis)
            reached, basis = [], []
        reached.append(own)
        basis.append(columns)
    _project(rows, reached, basis)
    return rows


def _project(rows: Array, reached: Sequence[npt.NDArray[np.intp]], basis: Sequence[Array]) -> None:
    """Project rows, in place, on what is orthogonal to columns that reach some of them."""
    if not reached:
        return
    places = np.unique(np.concatenate(reached))
    whole = np.zeros((len(places), sum(one.shape[1] for one in basis)))
    column = 0
    for own, one in zip(reached, basis, strict=True):
        whole[np.searchsorted(places, own), column : column + one.shape[1]] = one
        column += one.shape[1]
    left, values, _ = np.linalg.svd(whole, full_matrices=False)
    left = left[:, values > 1e-6 * values.max(initial=0.0)]
    rows[places] -= left @ (left.T @ rows[places])


def _spacing(half: int) -> int:
    """Samples from the beginning of a window to that of the next."""
    return max(half // OVERLAP, 1)


def _integrated(values: Array, weights: Array, starts: npt.NDArray[np.intp]) -> Array:
    windows = np.lib.stride_tricks.sliding_window_view(values, len(weights), axis=0)
    return np.asarray(windows[starts] @ weights)


def _stretches(samples: Samples) -> Iterator[tuple[int, int, float]]:
    """First and last row of each stretch of evenly spaced samples, and the time between these."""
    if samples.t is None:
        raise InputError(
            "Balances of momentum and energy are integrals over time, and the samples have no times; "
            "give `t` of Samples, as Recording.process does."
        )
    steps = np.diff(samples.t)
    if not len(steps):
        return
    step = float(np.median(steps))
    ends = np.flatnonzero(np.abs(steps - step) > JITTER * step) + 1
    for first, last in zip([0, *ends], [*ends, samples.count], strict=True):
        yield int(first), int(last), step


def _require_constant_inertias(model: Model) -> None:
    """Refuse terms whose inertia depends on positions: how it changes would be part of the balance."""
    random = np.random.default_rng(0)
    positions = random.uniform(-1.0, 1.0, (2, model.dof))
    for k in range(model.dof):
        one, other = (ParameterLayout(model.robot).term_inertias(list(q), k, np) for q in positions)
        if one != other:
            raise InputError(
                "Balances of momentum and energy take the inertias of terms as constant, and a term of "
                f'{model.robot.name} has one that depends on positions; use estimator="fit".'
            )
