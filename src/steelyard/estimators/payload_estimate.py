"""Estimation of a payload from a log without and a log with it, or from the latter alone where the robot is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.display import few_digits, html_table, outward, text_table
from steelyard.dynamics import BaseParameters
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError
from steelyard.feasibility import FeasibleSet
from steelyard.feasibility.bounds.bound_finder import NoInteriorError, given_region
from steelyard.feasibility.bounds.confidence_region import ConfidenceRegion
from steelyard.feasibility.bounds.intervals import interval_of
from steelyard.feasibility.bounds.profile_intervals import profile_intervals
from steelyard.feasibility.bounds.quantities import Quantity, standard_errors
from steelyard.feasibility.certificates import FeasibilityCertificate
from steelyard.feasibility.constraints import Constraint
from steelyard.feasibility.nearest_point import nearest_in_region
from steelyard.lmi import AffineBlock
from steelyard.regression import Information, ParameterCovariance, Reduced
from steelyard.regression.factor import eigenvectors
from steelyard.regression.least_squares import least_squares
from steelyard.regression.parameter_covariance import NORMAL
from steelyard.robot import INERTIA_SYMBOLS, Inertia
from steelyard.robot.inertia import transformation
from steelyard.robot.placement import translation

from .carried_body import PAYLOAD, CarriedBody, CarryingModel, OfTheRobot
from .pooling import Share, pooled

__all__ = ["KnownRobot", "PayloadEstimate", "PayloadQuantities", "PayloadQuantity", "estimate_payload"]

Array = NDArray[np.float64]

CONFIDENCE = 0.95

NOISE_FREE = 3e-4
"""Relative error of the torques below which a log counts as free of noise, and intervals are those of this error: no
drive tells its torque better. Regions without extent cannot be searched; with 1e-4 rounding makes the search for the
intervals of seven joints take ten times as long."""

PRECISE = 0.5
"""Half of a 95 % interval over the size of the quantity, up to which it counts as measured: the value is then known to
be neither nothing nor twice as large."""

LENGTH = 0.1
"""m; a centre of mass counts as measured where it is known to half of this, however near it lies to the frame's origin.
It is the size of what hands hold."""


@dataclass(frozen=True, eq=False)
class PayloadQuantity:
    """One number of a payload.

    Attributes
    ----------
    name : str
        ``"mass"``, ``"cx"``, ``"cy"``, ``"cz"``, or ``"Ixx"`` ... ``"Izz"`` about the centre of mass.
    meaning, unit : str
    value : float
        NaN where the motion does not show it.
    lower, upper : float
        95 % interval among possible payloads; infinite where neither data nor physics bound it.
    standing : {"measured", "bounded", "open"}
        Measured: data alone tell it, to half of its size. Bounded: data and physics together confine it. Open: nothing
        does, on one side at least.
    """

    name: str
    meaning: str
    unit: str
    value: float
    lower: float
    upper: float
    standing: Literal["measured", "bounded", "open"]

    def __contains__(self, value: float) -> bool:
        return self.lower <= value <= self.upper

    def __str__(self) -> str:
        low, high = outward(self.lower, self.upper)
        value = "not shown" if np.isnan(self.value) else f"{few_digits(self.value)} {self.unit}"
        return f"{self.meaning}: {value} ({low} to {high} {self.unit}), {self.standing}"


class PayloadQuantities:
    """The quantities that are estimated of a payload, by their names."""

    quantities: tuple[PayloadQuantity, ...]

    def __getitem__(self, name: str) -> PayloadQuantity:
        for quantity in self.quantities:
            if quantity.name == name:
                return quantity
        raise InputError(f"a payload has no {name!r}; it has {', '.join(q.name for q in self.quantities)}.")

    @property
    def mass(self) -> float:
        """kg; NaN where the motion does not show it."""
        return self["mass"].value

    @property
    def center_of_mass(self) -> Array:
        """(3,) m in the mounting frame; NaN where the motion does not show it."""
        return np.array([self[f"c{axis}"].value for axis in "xyz"])

    @property
    def inertia(self) -> Array:
        """(3, 3) kg m² about the centre of mass, in the axes of the mounting frame; NaN where it is not shown."""
        return np.array([[self["I" + "".join(sorted(a + b))].value for b in "xyz"] for a in "xyz"])


@dataclass(frozen=True, eq=False)
class PayloadEstimate(PayloadQuantities):
    """A payload, with 95 % intervals.

    Attributes
    ----------
    quantities : tuple of PayloadQuantity
        Mass, centre of mass and inertia about it, in the mounting frame.
    parameters : ndarray
        (10,) ``Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m`` in the mounting frame: of a body that can exist, and that no other
        possible one fits better. What the motion does not show of it was chosen by the solver.
    parameter_names : tuple of str
        Of `robot_and_payload`.
    robot_and_payload : ndarray
        The parameters of robot and payload together that are proved feasible, or those of the payload alone where the
        robot was given; then the friction while the payload is carried.
    friction_names : tuple of str
        Of the parameters of the joints that may have changed.
    friction, loaded_friction, friction_error : ndarray
        (f,) those without and with the payload, and the standard error of their difference. Where the robot was given,
        `friction` is zero and `loaded_friction` the change.
    condition_number : float
        Of the pooled regression.
    unloaded_error, loaded_error : float
        Relative errors of the torque of both logs; 0.05 means 5 %. NaN where there was no unloaded log.
    robot_alone_error : float
        The same of the loaded log where nothing was carried.
    distance : float
        How far from what the data say the nearest possible payload is, in standard deviations; 0 where the data
        themselves speak of a possible one.
    inflation : ndarray
        (N,) one row in so many is independent of its neighbours; empty where that is not known.
    certificate : mapping
        The proof of feasibility, as plain data.
    remarks : tuple of str
    """

    quantities: tuple[PayloadQuantity, ...]
    parameters: Array = field(repr=False)
    parameter_names: tuple[str, ...] = field(repr=False)
    robot_and_payload: Array = field(repr=False)
    friction_names: tuple[str, ...] = field(repr=False)
    friction: Array = field(repr=False)
    loaded_friction: Array = field(repr=False)
    friction_error: Array = field(repr=False)
    condition_number: float
    unloaded_error: float
    loaded_error: float
    robot_alone_error: float
    distance: float
    inflation: Array = field(repr=False)
    certificate: dict[str, Any] = field(repr=False)
    remarks: tuple[str, ...] = ()

    def _rows(self) -> list[tuple[str, ...]]:
        rows: list[tuple[str, ...]] = []
        for one in self.quantities:
            low, high = outward(one.lower, one.upper)
            value = "not shown" if np.isnan(one.value) else few_digits(one.value)
            rows.append((one.meaning, value, low, high, one.unit, one.standing))
        return rows

    def __str__(self) -> str:
        heads = ("payload", "value", "from", "to", "unit", "standing")
        return text_table(heads, self._rows(), numbers=(1, 2, 3))

    def _repr_html_(self) -> str:
        return html_table("Payload, 95 % intervals", ("payload", "value", "from", "to", "", ""), self._rows())


@dataclass(frozen=True, eq=False)
class KnownRobot:
    """The base parameters of a robot that was identified before.

    Parameters
    ----------
    base : (n_b,) array
    covariance : (n_b, n_b) array, optional
        Of their errors; zero where absent.
    """

    base: Array
    covariance: Array | None = field(default=None, repr=False)


@in_one_thread
def estimate_payload(
    body: CarriedBody,
    loaded: Information,
    unloaded: Information | None = None,
    *,
    robot: KnownRobot | None = None,
    consistency: Literal["full", "inertia"] = "full",
    constraints: Sequence[Constraint] = (),
    weights: Literal["joint"] | ArrayLike | None = "joint",
    solver: str = "clarabel",
) -> PayloadEstimate:
    """Estimate a payload and how sure it is.

    The rows of both logs are one regression: the robot's base parameters β are shared, and in the loaded log the
    payload adds to them what its ten parameters p do, β + K_link T p, with T the mounting frame. So nothing need be
    known of the robot, what is not shown of the robot does not matter, and the covariance of β counts in that of p.

    Parameters
    ----------
    body : CarriedBody
        Where it is mounted, and whether friction may have changed.
    loaded : Information
        With the payload.
    unloaded : Information, optional
        Of the same robot without it.
    robot : KnownRobot, optional
        Instead of `unloaded`.
    consistency : {"full", "inertia"}
        See :class:`steelyard.FeasibleSet`.
    constraints : sequence of Constraint
        On the robot alone. Not with `robot`.
    weights : "joint", None or array_like
        As in :func:`steelyard.least_squares`.
    solver : str

    Raises
    ------
    InputError
        If the data do not fit the model, or neither or both of `unloaded` and `robot` are given.
    SolverError
        If no robot satisfies the constraints.

    Notes
    -----
    The estimate is that of least squares if it is possible for robot and payload together, otherwise the possible one
    that is nearest in the metric of the covariance, corrected for residuals that are correlated in time. An interval
    holds the values of all possible robots and payloads whose squared distance from least squares is at most t² more
    than that of the nearest one (profile likelihood), t of Student's distribution. That of the mass begins at zero
    where neither the mass nor all ten parameters together exclude that nothing is carried. The inertia is that about
    the estimated centre of mass, which is the one about the true centre of mass to first order.

    References
    ----------
    W. Khalil, M. Gautier and P. Lemoine, Identification of the payload inertial parameters of industrial manipulators,
    IEEE International Conference on Robotics and Automation, 2007.

    Examples
    --------
    >>> import steelyard as sy
    >>> arm = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q"), ("pi/2", 0.3, 0, "q")])
    >>> model = sy.Model(arm)
    >>> random = np.random.default_rng(1)
    >>> q, dq, ddq = random.normal(size=(3, 400, 3))
    >>> links = np.tile(sy.Inertia.from_com(2.0, [-0.1, 0, 0], 0.02 * np.eye(3)).parameters, 3)
    >>> held = sy.Inertia.from_com(0.5, [0.02, 0.03, 0.1], 0.001 * np.eye(3)).parameters
    >>> with_it = links + np.concatenate([np.zeros(20), held])
    >>> alone, loaded = (
    ...     sy.Information.from_samples(
    ...         model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=model.inverse_dynamics(q, dq, ddq, parameters))
    ...     )
    ...     for parameters in (links, with_it)
    ... )
    >>> found = estimate_payload(CarriedBody(model, 2), loaded, alone)
    >>> round(found.mass, 4), found.center_of_mass.round(4).tolist(), found["mass"].standing
    (0.5, [0.02, 0.03, 0.1], 'measured')
    """
    return _estimated(_problem(body, loaded, unloaded, robot, consistency, constraints, weights), solver)


@in_one_thread
def unexplained_with(
    body: CarriedBody,
    loaded: Information,
    unloaded: Information | None = None,
    *,
    robot: KnownRobot | None = None,
    weights: Literal["joint"] | ArrayLike | None = "joint",
) -> tuple[float, float]:
    """Relative errors that least squares leave of the torques of a loaded log and of an unloaded one.

    The latter is NaN where there is none. Such a payload may be impossible. All arguments are as in `estimate_payload`.
    """
    problem = _problem(body, loaded, unloaded, robot, "full", (), weights)
    of_loaded = loaded.relative_error(problem.carrying @ problem.base + problem.offset)
    return of_loaded, np.nan if unloaded is None else unloaded.relative_error(problem.alone @ problem.base)


@dataclass(frozen=True, eq=False)
class _Problem:
    """A pooled regression within its feasible set, and where the payload is in its parameters."""

    body: CarriedBody
    feasible_set: FeasibleSet
    information: Information
    base: Array
    covariance: ParameterCovariance
    start: int
    unloaded: Information | None
    loaded: Information
    alone: Array  # base parameters of the robot as they are in the base parameters here: alone @ base + offset
    carrying: Array
    offset: Array


def _problem(
    body: CarriedBody,
    loaded: Information,
    unloaded: Information | None,
    robot: KnownRobot | None,
    consistency: Literal["full", "inertia"],
    constraints: Sequence[Constraint],
    weights: Any,
) -> _Problem:
    if unloaded is not None and robot is None:
        return _with_both(body, loaded, unloaded, consistency, constraints, weights)
    if robot is not None and unloaded is None:
        return _with_known(body, loaded, robot, consistency, weights)
    raise InputError(
        "A payload is found from a log without and a log with it, or from the latter and the parameters of the robot: "
        "give one of unloaded= and robot=, not both."
    )


def _with_both(
    body: CarriedBody,
    loaded: Information,
    unloaded: Information,
    consistency: Literal["full", "inertia"],
    constraints: Sequence[Constraint],
    weights: Any,
) -> _Problem:
    model = CarryingModel(body)
    base = model.base_parameters()
    for one, what in ((unloaded, "unloaded"), (loaded, "loaded")):
        _require_rows(one, body, what)
    alone, carrying = model.maps
    information = pooled([Share(unloaded, [alone]), Share(loaded, [carrying])], base.names, base.expressions)
    kept = [OfTheRobot(constraint, body.model) for constraint in constraints]
    estimate = least_squares(information, weights)
    covariance = ParameterCovariance.of(information, estimate.base, weights)
    return _Problem(
        body,
        FeasibleSet(model, consistency, kept),
        information,
        estimate.base,
        _with_floor(covariance, information, estimate.base, information),
        body.model.parameter_count,
        unloaded,
        loaded,
        alone,
        carrying,
        np.zeros(len(alone)),
    )


def _with_known(
    body: CarriedBody,
    loaded: Information,
    robot: KnownRobot,
    consistency: Literal["full", "inertia"],
    weights: Any,
) -> _Problem:
    _require_rows(loaded, body, "loaded")
    known, effects = np.asarray(robot.base, dtype=float), body.shown_effects
    names = tuple(body.base.parameter_names)
    information = pooled([Share(loaded, [effects], [known])], [names[k] for k in body.base.independent])
    estimate = least_squares(information, weights)
    covariance = ParameterCovariance.of(information, estimate.base, weights)
    covariance = _with_floor(covariance, information, estimate.base, loaded)
    if robot.covariance is not None:
        R = loaded.reduced(information.joint_weights(weights)).R
        slope = np.linalg.pinv(R @ effects) @ R
        covariance = _with_more(covariance, slope @ robot.covariance @ slope.T)
    return _Problem(
        body,
        FeasibleSet(_BodyAlone(body), consistency),
        information,
        estimate.base,
        covariance,
        0,
        None,
        loaded,
        np.zeros_like(effects),
        effects,
        known,
    )


class _BodyAlone:
    """A payload, and changes of friction beside it, as a model of one link."""

    def __init__(self, body: CarriedBody) -> None:
        self.body = body
        self.parameter_names: Sequence[str] = (*(f"{s}1" for s in INERTIA_SYMBOLS), *body.names[10:])
        unknown = np.full(len(self.parameter_names), np.nan)
        self.robot = SimpleNamespace(name=PAYLOAD, link_names=(PAYLOAD,), parameters=unknown)

    def base_parameters(self) -> BaseParameters:
        """Return what the log can show of it."""
        base = self.body.base
        return BaseParameters(tuple(self.parameter_names), base.independent, base.dependent, base.Kd)

    def conditions(self, consistency: str) -> tuple[AffineBlock, ...]:
        """The condition that the body has a mass density."""
        return self.body.body_conditions(consistency, 0)


def _require_rows(information: Information, body: CarriedBody, what: str) -> None:
    base = body.model.base_parameters()
    if information.base_count != base.count:
        raise InputError(
            f"The {what} log was reduced for another model: it has {information.base_count} base parameters, and "
            f"{body.model.robot.name} has {base.count}; reduce both logs with the same robot file."
        )
    if information.count <= information.base_count:
        raise InputError(
            f"The {what} log leaves {information.count} rows for {information.base_count} base parameters; record a "
            "longer motion, trim less or lower velocity_threshold."
        )


def _with_floor(
    covariance: ParameterCovariance, information: Information, base: Array, torques: Information
) -> ParameterCovariance:
    """The same, or where that would be less, the covariance of torques that are known to a part of their size.

    The information is about the unknowns, of which `base` is least squares; `torques` is that of the log.
    """
    residual2 = np.array([factor.residual2(base) for factor in information.factors])
    norm2 = np.array([factor.norm2 for factor in torques.factors])
    if not norm2.sum() > 0.0 or residual2.sum() >= NOISE_FREE**2 * norm2.sum():
        return covariance
    counts = np.maximum([factor.count for factor in information.factors], 1)
    largest = float((norm2 / counts).max())
    noise = np.sqrt(np.maximum(residual2, NOISE_FREE**2 * np.maximum(norm2, 1e-6 * largest * counts)) / counts)
    weighted = information.reduced(1.0 / noise)
    exact = Reduced(weighted.R, weighted.R @ base, float(max(weighted.count - len(base), 1)), weighted.count, 0.0)
    found = ParameterCovariance.of_reduced(exact, base)  # of rows with a variance of 1
    return ParameterCovariance(found.root, found.unidentifiable, covariance.unknown, None, covariance.filtered_torque)


def _with_more(covariance: ParameterCovariance, further: Array) -> ParameterCovariance:
    """The covariance of an independent error beside it, in what the data determine."""
    values, vectors = eigenvectors(covariance.root @ covariance.root.T + further)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    unidentifiable = covariance.unidentifiable
    if unidentifiable.shape[1]:
        shown = np.linalg.svd(unidentifiable.T)[2][unidentifiable.shape[1] :]
        root = shown.T @ (shown @ root)
    left, sizes, _ = np.linalg.svd(root, full_matrices=False)
    kept = sizes > 1e-12 * sizes.max(initial=0.0)
    return ParameterCovariance(
        left[:, kept] * sizes[kept],
        unidentifiable,
        covariance.unknown,
        covariance.correlation,
        covariance.filtered_torque,
    )


def _estimated(problem: _Problem, solver: str) -> PayloadEstimate:
    """The nearest possible point, the intervals around it, and what is to be said."""
    feasible_set, covariance, body = problem.feasible_set, problem.covariance, problem.body
    _require_weight(problem)
    nearest = nearest_in_region(feasible_set, problem.base, covariance.root, covariance.unidentifiable, solver)
    found, remarks = nearest.parameters, list(problem.information.remarks)
    asked = [*_mass_and_center(problem, found), *_inertia(problem, found)]
    ends = np.full((len(asked), 2), np.nan)
    if covariance.filtered_torque:
        remarks.append("No interval is told, since the torques were filtered.")
    else:
        ends = _ends(problem, [one for one, _ in asked], found, nearest.distance, solver)
        if not _is_shown(problem):
            ends[0, 0] = 0.0
    mass, *rest = (_quantity(problem, found, *one, *both) for one, both in zip(asked, ends, strict=True))
    center, tensor = rest[:3], rest[3:]
    if mass.lower <= 0.0:
        # What weighs nothing has no centre, and any number may come out of a division by nearly nothing.
        center = [replace(one, value=np.nan, lower=-np.inf, upper=np.inf, standing="open") for one in center]
    if any(one.standing != "measured" for one in center):
        tensor = _about_any_point(tensor)
    quantities = (mass, *center, *tensor)
    if nearest.distance > TOO_FAR:
        remarks.append(
            "No possible robot and payload explain the data within their noise: the nearest lie "
            f"{nearest.distance:.3g} standard deviations away. The model misses something, and the intervals, which "
            "know of noise alone, are too narrow. Check the mounting frame, that nothing else changed between the "
            "logs, and the constraints."
        )
    base = feasible_set.K @ found
    certificate = FeasibilityCertificate.of_parameters(feasible_set, found)
    count = problem.start + 10
    friction, error = _friction(problem, found)
    alone, carrying = (one @ base + problem.offset for one in (problem.alone, problem.carrying))
    correlation = covariance.correlation
    return PayloadEstimate(
        quantities=quantities,
        parameters=found[problem.start : count],
        parameter_names=tuple(feasible_set.model.parameter_names),
        robot_and_payload=found,
        friction_names=tuple(body.model.parameter_names[k] for k in body.friction),
        friction=friction,
        loaded_friction=found[count:],
        friction_error=error,
        condition_number=problem.information.condition_number,
        unloaded_error=np.nan if problem.unloaded is None else problem.unloaded.relative_error(alone),
        loaded_error=problem.loaded.relative_error(carrying),
        robot_alone_error=problem.loaded.relative_error(alone),
        distance=nearest.distance,
        inflation=np.zeros(0) if correlation is None else correlation.inflation,
        certificate=certificate.to_dict(),
        remarks=tuple(remarks),
    )


@dataclass(frozen=True, eq=False)
class _ProfileRegion(ConfidenceRegion):
    """A region of a given size, for intervals of single quantities."""

    reach: float = 0.0

    @property
    def radius(self) -> float:
        """In standard deviations."""
        return self.reach


def _ends(problem: _Problem, asked: list[Quantity], found: Array, distance: float, solver: str) -> Array:
    """Both ends of every interval, (k, 2)."""
    feasible_set, covariance = problem.feasible_set, problem.covariance
    errors = standard_errors(feasible_set, covariance, [one.slope(found) for one in asked])
    # Where nothing else can be told: what the data say, without physics.
    middle = np.array([one.value(found) for one in asked])
    ends = np.column_stack([middle - NORMAL * errors, middle + NORMAL * errors])
    positive = [one.never_negative for one in asked]
    ends[positive, 0] = np.maximum(ends[positive, 0], 0.0)
    told = np.isfinite(errors)
    chosen = np.flatnonzero(told)
    if len(chosen):
        try:
            # In regions that are thin beside what is unidentifiable, rounding leaves no Newton step.
            with np.errstate(all="ignore"):
                quick = profile_intervals(
                    feasible_set, problem.base, covariance, [asked[k] for k in chosen], found, CONFIDENCE
                )
            both = np.column_stack([quick.lower, quick.upper])
            ends[chosen] = np.where(np.isfinite(both), both, ends[chosen])
        except np.linalg.LinAlgError:
            pass
    if told.all():
        return ends
    # Its ends beside an infinite one have no proof, and what is a payload at all hangs on the least mass.
    region = _ProfileRegion(problem.base, covariance, CONFIDENCE, reach=float(np.hypot(distance, NORMAL)))
    try:
        finder = given_region(feasible_set, region, solver).finder
        for index in np.flatnonzero(~told):
            interval = interval_of(finder, asked[index])
            ends[index] = interval.lower, interval.upper
            if index == 0 and interval.lower <= 0.0:
                break
    except (NoInteriorError, np.linalg.LinAlgError):
        pass
    return ends


def _is_shown(problem: _Problem) -> bool:
    """Say whether the data exclude that nothing is carried, at the level of the intervals.

    A body of no mass has neither moments nor inertia, so any of the ten parameters may exclude it, and the profile of
    the mass, which reckons with one, does so too often: in 15 of 100 logs without a payload. Here the mass and all
    ten together are tested, each at half of the level.
    """
    from scipy.special import fdtri, stdtrit

    feasible_set, covariance = problem.feasible_set, problem.covariance
    freedom, each = min(covariance.degrees_of_freedom, 1e9), 1.0 - (1.0 - CONFIDENCE) / 2.0
    payload = np.arange(problem.start, problem.start + 10)
    mass = np.eye(feasible_set.parameter_count)[payload[9]]
    error = float(standard_errors(feasible_set, covariance, mass[None])[0])
    if float(mass @ feasible_set.lift @ problem.base) > stdtrit(freedom, each) * error:
        return True
    to_deviations = covariance.in_deviations()
    columns = to_deviations @ np.delete(feasible_set.K, payload, axis=1)
    lengths = np.linalg.norm(columns, axis=0)
    left, sizes, _ = np.linalg.svd(columns / np.where(lengths > 0.0, lengths, 1.0), full_matrices=False)
    of_others = left[:, sizes > 1e-9 * sizes.max(initial=0.0)]
    away = to_deviations @ problem.base
    away = away - of_others @ (of_others.T @ away)
    count = len(away) - of_others.shape[1]
    return count > 0 and bool(away @ away > count * fdtri(count, freedom, each))


TOO_FAR = 6.0
"""Distance of the nearest possible point, in standard deviations, that noise hardly explains: of 80 base parameters a
dozen or so lie on the boundary of what is possible, and their distance is then 3 or 4."""


def _friction(problem: _Problem, found: Array) -> tuple[Array, Array]:
    """Friction without the payload, and the standard error of its change."""
    indices, count = problem.body.friction, problem.start + 10
    own = np.zeros(len(indices)) if problem.unloaded is None else found[indices]
    rows = np.eye(len(found))[count : count + len(indices)]
    if problem.unloaded is not None:
        rows[np.arange(len(indices)), indices] = -1.0
    return own, standard_errors(problem.feasible_set, problem.covariance, rows)


def _require_weight(problem: _Problem) -> None:
    """Refuse data by which the payload has a negative mass, beyond all doubt."""
    row = np.zeros(problem.feasible_set.parameter_count)
    row[problem.start + 9] = 1.0
    error = float(standard_errors(problem.feasible_set, problem.covariance, row[None])[0])
    mass = float(row @ problem.feasible_set.lift @ problem.base)
    if mass + TOO_FAR * error < 0.0:
        other = "the unloaded log" if problem.unloaded is not None else "the estimate of the robot"
        raise InputError(
            f"The payload comes out with a mass of {mass:.4g} kg: more was carried in {other} than in the loaded log; "
            "check which log is which, the frame in which the payload is mounted, the signs and units of the torques, "
            "and that both logs hold a whole motion."
        )


def _mass_and_center(problem: _Problem, found: Array) -> list[tuple[Quantity, float]]:
    """Return mass and centre of mass of the payload, each with a size below which a value means nothing."""
    identity = np.eye(len(found))[problem.start : problem.start + 10]
    mass = identity[9]
    asked = [(Quantity("mass", "mass", "kg", mass, never_negative=True), 0.0)]
    for k, axis in enumerate("xyz"):
        moments = tuple(identity[place] for place in {0: (3, 5), 1: (0, 5), 2: (0, 3)}[k])
        asked.append((Quantity(f"c{axis}", f"centre of mass {axis}", "m", identity[6 + k], mass, moments), LENGTH))
    return asked


def _inertia(problem: _Problem, found: Array) -> list[tuple[Quantity, float]]:
    """The inertia about the estimated centre of mass, each element with a size below which it means nothing."""
    identity = np.eye(len(found))[problem.start : problem.start + 10]
    body = Inertia.from_parameters(found[problem.start : problem.start + 10])
    about = transformation(translation(*-body.com)) @ identity
    size = max(float(np.trace(body.about_com)) / 3.0, 0.0)
    return [
        (
            Quantity(
                f"I{s[1:]}", f"inertia {s[1:]} about the centre of mass", "kg m²", row, never_negative=s[1] == s[2]
            ),
            size,
        )
        for s, row in zip(INERTIA_SYMBOLS[:6], about[:6], strict=True)
    ]


def _about_any_point(tensor: list[PayloadQuantity]) -> list[PayloadQuantity]:
    """Return what the inertia about some point tells of that about the centre of mass, wherever it is.

    About the centre of mass no moment of inertia is larger than about any other point, and a product of inertia is no
    larger than the root of both moments.
    """
    most = {one.name[1]: one.upper for one in tensor if one.name[1] == one.name[2]}
    found = []
    for one in tensor:
        first, second = one.name[1], one.name[2]
        upper = float(np.sqrt(most[first]) * np.sqrt(most[second]))
        lower = 0.0 if first == second else -upper
        standing: Literal["bounded", "open"] = "bounded" if np.isfinite(upper) else "open"
        found.append(replace(one, value=np.nan, lower=lower, upper=upper, standing=standing))
    return found


def _quantity(
    problem: _Problem, found: Array, asked: Quantity, size: float, lower: float, upper: float
) -> PayloadQuantity:
    """Value, interval and standing of one quantity."""
    value = asked.value(found)
    error = float(standard_errors(problem.feasible_set, problem.covariance, asked.slope(found)[None])[0])
    lower, upper = min(lower, value), max(upper, value)
    standing: Literal["measured", "bounded", "open"] = "open"
    if NORMAL * error <= PRECISE * max(abs(value), size):
        standing = "measured"
    elif np.isfinite(lower) and np.isfinite(upper):
        standing = "bounded"
    value = value if np.isfinite(error) else np.nan
    return PayloadQuantity(asked.name, asked.meaning, asked.unit, value, lower, upper, standing)
