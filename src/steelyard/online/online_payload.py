"""Estimation of a payload that a moving robot has just picked up: mass, centre of mass and inertia, with intervals."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics.threads import one_thread
from steelyard.errors import InputError
from steelyard.estimators.carried_body import CarriedBody, Changes, changing_parameters, mounting
from steelyard.estimators.payload_estimate import LENGTH, PRECISE, PayloadQuantities, PayloadQuantity
from steelyard.feasibility.barrier import add_log_determinants, log_determinants, minimise
from steelyard.regression import Factor, Information, ParameterCovariance
from steelyard.regression.factor import triangular
from steelyard.regression.parameter_covariance import NORMAL, inverse_root
from steelyard.robot import Inertia
from steelyard.robot.inertia import PSEUDO_INERTIA, parameters_of_pseudo_inertia, pseudo_inertia

from .online_estimator import OnlineEstimator

__all__ = ["OnlinePayload", "OnlinePayloadEstimate"]

Array = NDArray[np.float64]

LIKELY = 1.0 * np.diag([0.01, 0.01, 0.01, 1.0])
"""Pseudo-inertia of what a payload is taken for where the motion does not tell: 1 kg, 10 cm of standard deviation along
each axis about the mounting frame's origin."""

LIKELINESS = 0.1
"""Weight of the distance from it, in units in which the data move by 1 as noise does: it decides what the data leave
open, and moves a mass that is known to 5 % by a hundredth of its interval."""

LARGER = 2.0
"""How many times the deviation of before the residuals may have beside a payload, until it is told: noise alone makes
no such difference, and a robot that lost a screw, or moves as its model does not describe, makes a larger one."""

ACCURACY = 5e-9
"""The accuracy of the objective, which the noise of the data moves by about 1."""


@dataclass(frozen=True, eq=False)
class OnlinePayloadEstimate(PayloadQuantities):
    """A payload at a moment, with 95 % intervals.

    Attributes
    ----------
    t : float
        Time of the newest sample that counts.
    since : float
        s of samples on which it rests.
    parameters : ndarray
        (10,) ``Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m`` in the mounting frame; of a body that can exist.
    quantities : tuple of PayloadQuantity
        Mass, centre of mass and inertia about it, in the mounting frame. The intervals are those of the data alone,
        with residuals that last; infinite where the data do not tell. Where the mass may be nothing, there is no centre
        of mass to tell, nor an inertia about it: their values are NaN.
    remarks : tuple of str
        What speaks against a payload.
    """

    t: float
    since: float
    parameters: Array = field(repr=False)
    quantities: tuple[PayloadQuantity, ...]
    remarks: tuple[str, ...] = ()


class OnlinePayload:
    """Tells what hangs on a robot since it changed.

    The rows from before and those from after the change are one regression, as in `steelyard payload`: the robot's base
    parameters are shared, and in the latter the payload adds to them. So nothing need be known of the robot beforehand,
    and what is uncertain of it counts in the intervals. How long residuals last is taken from the rows before, which
    are many; where those after are larger, intervals grow with them.

    Parameters
    ----------
    estimator : OnlineEstimator
        With ``detect_changes=True``, or with `before`.
    frame : str, optional
        In which the payload is told: a link that moves; the last one where absent.
    placement : (4, 4) array_like, optional
        Of the mounting frame in that frame.
    before : Information, optional
        Of the robot without payload; that of the first robot that the estimator met where absent.
    changes : {"nothing", "friction", "friction-and-offset"}
        Which parameters of the joints may be other ones since the change, as in `steelyard payload`. Friction grows
        with the load on most gears. *Measured* on simulated arms whose friction grew by a fifth with the payload: with
        ``"nothing"`` 95 % intervals hold the mass in 10 to 65 of 100 cases.

    Raises
    ------
    InputError
        If there is no such frame, the robot does not move it, or `before` is of another robot.

    Examples
    --------
    >>> import steelyard as sy
    >>> arm = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q"), ("pi/2", 0.3, 0, "q")])
    >>> model = sy.Model(arm)
    >>> links = np.tile(sy.Inertia.from_com(2.0, [-0.1, 0, 0], 0.02 * np.eye(3)).parameters, 3)
    >>> held = sy.Inertia.from_com(0.5, [0.02, 0.03, 0.1], 0.001 * np.eye(3)).parameters
    >>> t, pace = np.arange(12000)[:, None] / 1000, np.array([2.0, 3.1, 4.3])
    >>> motion = np.sin(pace * t), pace * np.cos(pace * t), -(pace**2) * np.sin(pace * t)
    >>> torque = model.inverse_dynamics(*motion, links) + 0.05 * np.random.default_rng(1).normal(size=(12000, 3))
    >>> with_it = model.inverse_dynamics(*motion, links + np.concatenate([np.zeros(20), held]))
    >>> torque[8000:] += (with_it - model.inverse_dynamics(*motion, links))[8000:]
    >>> estimator = sy.OnlineEstimator(model, detect_changes=True)
    >>> payload = sy.OnlinePayload(estimator)
    >>> estimator.update(t[:, 0], motion[0], torque)
    >>> found = payload.estimate()
    >>> round(found.mass, 2), 0.5 in found["mass"]
    (0.5, True)
    """

    def __init__(
        self,
        estimator: OnlineEstimator,
        *,
        frame: str | None = None,
        placement: ArrayLike | None = None,
        before: Information | None = None,
        changes: Changes = "friction",
    ) -> None:
        self.estimator = estimator
        link, place, self.frame = mounting(estimator.model, frame, placement)
        changing_parameters(estimator.model, changes)  # refuses other words now, not when something is picked up
        self.body = CarriedBody(estimator.model, link, place, changes)
        if before is not None:
            before.model_among([estimator.model], "before")
            if not before.by_joint:
                raise InputError("before was reduced over all joints together; give one with the rows of each apart.")
        self._before = before
        self._robot: _KnownRows | None = None

    def estimate(self) -> OnlinePayloadEstimate | None:
        """Return what hangs on the robot now; None while it is the first one, and before there are samples of another.

        It takes a few milliseconds; after a change the first time some 50.
        """
        before = self._before if self._before is not None else self.estimator.first_robot
        if before is None:
            return None
        with one_thread():
            if self._robot is None or self._robot.information is not before:
                self._robot = _KnownRows(before, self.body.effects)
            factors = self.estimator.factors()
            if not any(f.count for f in factors):
                return None
            return self._found(self._robot.with_payload(factors), factors)

    def _found(self, told: _Told, factors: tuple[Factor, ...]) -> OnlinePayloadEstimate:
        parameters = _possible(told)
        quantities = _quantities(told, parameters)
        since = max(f.count for f in factors) / self.estimator.rate
        names = self.estimator.model.robot.joint_names
        worse = [name for name, times in zip(names, told.larger, strict=True) if times > LARGER]
        remarks: tuple[str, ...] = ()
        if worse:
            remarks = (
                f"A payload does not explain the torques of {', '.join(worse)}, which are off by up to "
                f"{max(told.larger):.2g} times as much as before the change: something else changed, or the model does "
                "not describe the motion since.",
            )
        return OnlinePayloadEstimate(self.estimator.time, since, parameters, quantities, remarks)


@dataclass(frozen=True, eq=False)
class _Told:
    """The information of rows on the ten parameters: ``|R p - rho|²``, their least squares and its covariance."""

    R: Array
    rho: Array
    center: Array
    covariance: Array
    unknown: NDArray[np.bool_]
    larger: Array
    """(N,) deviations of the residuals of rows with payload over those before."""


class _KnownRows:
    """The rows without payload, in the form in which those with it are added to them."""

    def __init__(self, information: Information, effects: Array) -> None:
        # What may change beside the payload comes first, so that the last triangle is that of the payload alone.
        self.information, self.effects = information, np.roll(effects, -10, axis=1)
        self.weights = information.joint_weights("joint")
        covariance = ParameterCovariance.of(information, weights=self.weights)
        correlation = covariance.correlation
        count = len(information.factors)
        self.deviation2 = np.ones(count) if correlation is None else correlation.variance * self.weights**2
        self.long_run = np.ones(count)
        if correlation is not None:
            self.long_run = correlation.widening * correlation.long_run_variance * self.weights**2
        reduced = information.reduced(self.weights)
        self.triangle = np.column_stack([reduced.R, np.zeros((len(reduced.R), effects.shape[1])), reduced.rho])

    def with_payload(self, factors: tuple[Factor, ...]) -> _Told:
        n, count = len(self.triangle), self.effects.shape[1]
        loaded = []
        for factor, weight in zip(factors, self.weights, strict=True):
            rows = np.zeros((len(factor.triangle), n + count + 1))
            rows[:, factor.columns] = weight * factor.triangle[:, :-1]
            rows[:, n:-1] = weight * factor.triangle[:, :-1] @ self.effects[factor.columns]
            rows[:, -1] = weight * factor.triangle[:, -1]
            loaded.append(rows)
        triangle = triangular(np.vstack([self.triangle, *loaded]))
        whole, target = triangle[:-1, :-1], triangle[:-1, -1]
        R, rho = whole[-10:, -10:], target[-10:]
        inverse, _, unknown = inverse_root(whole)
        solution = inverse @ (inverse.T @ (whole.T @ target))
        of_payload = inverse @ inverse[-10:].T
        covariance, deviations = np.zeros((10, 10)), np.ones(len(loaded))
        for k, (before, rows) in enumerate(zip(self.information.factors, loaded, strict=True)):
            left = rows[:, :-1] @ solution - rows[:, -1]
            larger = float(left @ left) / max(factors[k].count, 1) / max(self.deviation2[k], 1e-300)
            deviations[k] = np.sqrt(larger)
            for own, noise in (
                (self.weights[k] * before.triangle[:, :-1] @ of_payload[before.columns], 1.0),
                (rows[:, :-1] @ of_payload, max(1.0, larger)),
            ):
                covariance += self.long_run[k] * noise * own.T @ own
        return _Told(R, rho, solution[-10:], covariance, unknown[-10:], deviations)


def _possible(told: _Told) -> Array:
    """The body that the data and what payloads are like speak for; a positive definite pseudo-inertia."""
    # The data count with the covariance that holds where residuals last, as far as one number can tell.
    plain = np.sum(told.R**2, axis=0)
    with np.errstate(divide="ignore"):
        shares = np.diagonal(told.covariance) * plain
    inflation = max(1.0, float(np.median(shares[plain > 0.0])) if np.any(plain > 0.0) else 1.0)
    objective = _Likely(told.R.T @ told.R / inflation, told.R.T @ told.rho / inflation)
    start = np.asarray(parameters_of_pseudo_inertia(LIKELY))
    return np.asarray(minimise(objective, start[None], accuracy=ACCURACY)[0])


class _Likely:
    """½ p' C p - s' p, which is what the data say of ten parameters p, and the entropic distance from `LIKELY`."""

    def __init__(self, curvature: Array, slope: Array) -> None:
        traces = np.einsum("ij,kij->k", np.linalg.inv(LIKELY), PSEUDO_INERTIA)
        self.curvature, self.linear = curvature, LIKELINESS * traces - slope

    def value(self, points: Array, problems: NDArray[np.intp]) -> Array:
        """At points (p, 10); infinite where no body is."""
        smooth = np.einsum("pi,pi->p", points, 0.5 * points @ self.curvature + self.linear)
        return np.asarray(smooth - LIKELINESS * log_determinants(pseudo_inertia(points)))

    def derivatives(self, points: Array, problems: NDArray[np.intp]) -> tuple[Array, Array]:
        """Gradients (p, 10) and Hessians (p, 10, 10)."""
        gradients = points @ self.curvature + self.linear
        hessians = np.tile(self.curvature, (len(points), 1, 1))
        matrices, factors = pseudo_inertia(points)[:, None], np.full(len(points), -LIKELINESS)
        add_log_determinants(matrices, PSEUDO_INERTIA[None], np.arange(10)[None], factors, gradients, hessians)
        return gradients, hessians


_MEANINGS = {
    "mass": ("mass", "kg"),
    **{f"c{axis}": (f"centre of mass {axis}", "m") for axis in "xyz"},
    **{f"I{axes}": (f"inertia {axes} about it", "kg m²") for axes in ("xx", "xy", "xz", "yy", "yz", "zz")},
}


def _values(parameters: Array) -> Array:
    """Mass, centre of mass, and inertia about it, (10,)."""
    body = Inertia.from_parameters(parameters)
    return np.concatenate([[body.mass], body.com, body.about_com[np.triu_indices(3)]])


def _quantities(told: _Told, parameters: Array) -> tuple[PayloadQuantity, ...]:
    values = _values(parameters)
    slopes = np.empty((10, 10))
    for k in range(10):  # by central differences: the functions are quotients of low degree
        step = 1e-6 * max(abs(parameters[k]), 1e-3)
        moved = step * np.eye(10)[k]
        slopes[k] = (_values(parameters + moved) - _values(parameters - moved)) / (2.0 * step)
    half = NORMAL * np.sqrt(np.maximum(np.einsum("kq,kl,lq->q", slopes, told.covariance, slopes), 0.0))
    half[np.any((slopes != 0.0) & told.unknown[:, None], axis=0)] = np.inf
    # About what the data alone say, to first order.
    centers = values + (told.center - parameters) @ slopes
    found: list[PayloadQuantity] = []
    for name, value, center, width in zip(_MEANINGS, values, centers, half, strict=True):
        low, high = (center - width, center + width) if np.isfinite(width) else (-np.inf, np.inf)
        if name in ("mass", "Ixx", "Iyy", "Izz"):
            low, high = max(low, 0.0), max(high, 0.0)
        low, high = min(low, value), max(high, value)
        meaning, unit = _MEANINGS[name]
        if found and found[0].lower <= 0.0:  # what weighs nothing has no centre, nor an inertia about it
            low = 0.0 if name in ("Ixx", "Iyy", "Izz") else -np.inf
            found.append(PayloadQuantity(name, meaning, unit, np.nan, low, np.inf, "open"))
            continue
        found.append(PayloadQuantity(name, meaning, unit, float(value), low, high, _standing(name, value, width)))
    return tuple(found)


def _standing(name: str, value: float, half: float) -> Literal["measured", "bounded", "open"]:
    if half <= PRECISE * abs(value) or (name[0] == "c" and half <= PRECISE * LENGTH):
        return "measured"
    return "bounded" if np.isfinite(half) else "open"
