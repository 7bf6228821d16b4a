"""Excitation design: the motion that identifies a robot's parameters best within all its limits."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.display import html_table
from steelyard.dynamics import Model
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError, SolverError
from steelyard.files import listed, replaced_folder, write_json, write_text
from steelyard.recording import Samples
from steelyard.regression import Information

from .criterion import TORQUE_NOISE, Criterion, Identifiability, Spectrum, identifiability, make_subset
from .design_problem import DesignProblem, coefficient_scale
from .family import Family, make_family
from .friction_laws import with_friction_laws
from .limit_margins import Margin, Verifier, keeps_all, margins_of
from .motion_constraints import MotionConstraint, joint_limits, predicted_parameters, remedy_of, torque_limits
from .motion_limits import MotionLimits, limits_from_file
from .motion_search import Search, SearchOptions, resting_configurations
from .trajectory import Trajectory, save_trajectory
from .vjp import RegressorInformation

if TYPE_CHECKING:
    from steelyard.collision.surroundings import Surroundings

__all__ = ["FORMAT", "ExcitationDesign", "ExcitationObjective", "design_excitation", "nearest_first"]

Array = NDArray[np.float64]

_WATCHED = "; self-collision is watched by default, and `self = false` in [collision] of the limits file watches none"
_MOST = 1e6  # samples of a period, which take 1 GB for six joints
_NAMED = 5  # parameters that a remark names at most
_SHORT = 40  # characters of an expression in a remark at most
# Part of a limit of torque that friction may take. A Gen3 whose description foretold 20 N·m came to 30.
_ROOM_FOR_FRICTION = 1.0 / 3.0
_USED_UP = 0.01  # a limit whose margin is a smaller part of its scale counts as used up by the motion
# Width of the smooth sign of Coulomb friction during the search, relative to typical velocities. With 0.002 to 0.1 the
# condition numbers of motions for a WAM were 60 to 62; with 0.5, where Coulomb friction looks like viscous friction,
# 102.
_SMOOTHNESS = 0.02
# Harmonics, periods and duration of slow passages (s) where nothing is said. Friction is told by many reversals, at all
# speeds: polynomials by fast phases, LuGre's friction by slow reversals.
_PLAIN, _FOR_FRICTION = (6, 1, 0.0), (10, 6, 5.0)


@dataclass(frozen=True, kw_only=True)
class ExcitationObjective:
    """The parameters that an excitation is to identify, and the criterion.

    Attributes
    ----------
    criterion : {"condition", "d", "a", "friction"}
        Condition number of the base regressor (Gautier and Khalil 1992), determinant of the information matrix
        (D-optimality), or trace of the inverse information matrix, which is the sum of the variances (A-optimality;
        Pukelsheim 2006). ``"friction"`` is for choosing friction by the log: the determinant of the information about
        the numbers of several laws together (viscous by direction, with a square and a cube, Stribeck's, a spring),
        whichever of them the model has, while all others are estimated from the same data.
    subset : str or sequence of str, optional
        The parameters that the motion is to identify: names of joints, links or parameters, or ``"payload"`` for the
        last link. All parameters by default.
    nuisance : {"unknown", "known"}
        Whether the parameters outside the subset are estimated from the same data, or known already.
    noise : array_like, optional
        (N,) standard deviation of the torque of each joint, by whose inverse its rows are weighted.
    prior_information : Information, Trajectory or ExcitationDesign, optional
        Data that exist already, or a motion that is planned. The criterion is that of both together. The noise of an
        Information is taken from `noise` as well.
    """

    criterion: Literal["condition", "d", "a", "friction"] = "condition"
    subset: str | Sequence[str] | None = None
    nuisance: Literal["unknown", "known"] = "unknown"
    noise: ArrayLike | None = None
    prior_information: Information | Trajectory | ExcitationDesign | None = None


@in_one_thread
def design_excitation(
    model: Model,
    limits: MotionLimits | Mapping[str, Any] | str | Path | None = None,
    *,
    family: Literal["fourier", "spline", "quintic"] = "fourier",
    period: float = 12.5,
    harmonics: int | None = None,
    points: int | None = None,
    ramp_time: float | None = None,
    periods: int | None = None,
    slow_time: float | None = None,
    objective: ExcitationObjective | None = None,
    constraints: Sequence[MotionConstraint] = (),
    self_collision: bool = True,
    parameters: ArrayLike | None = None,
    margin: float = 0.0,
    rate: float = 1000.0,
    search: SearchOptions | None = None,
    progress: Callable[[str], None] | None = None,
) -> ExcitationDesign:
    """Design a motion that excites a robot's dynamics for identification (thesis section 4.3.2).

    From each of several random starts the criterion is minimised with its gradient, which is computed by reverse
    differentiation of the expression graph, and the best results are refined. Every limit is then checked over the
    whole motion, ramp-up and ramp-down included, at 1 kHz or finer, and violations are repaired. The same arguments
    give the same motion, unless the search ends early by a time limit or by Ctrl-C; then the best motion so far is
    returned, and its `status` says so.

    Parameters
    ----------
    model : Model
    limits : MotionLimits, mapping, str, Path or None
        Limits of positions, velocities, accelerations, torques and power: a MotionLimits object, a mapping with the
        arguments of :meth:`MotionLimits.of`, or the path of a limits file (TOML). Limits that a mapping or a file does
        not name are taken from the robot's description; with None all of them are.
    family : {"fourier", "spline", "quintic"}
        Fourier series; B-splines of degree five that start and end at rest; or point-to-point moves of degree five
        with a rest at each point. The latter two end where they began.
    period : float
        Period of a Fourier series, or duration of the other motions, s.
    harmonics : int, optional
        Number of harmonics of the Fourier series; 6 by default, 10 with the criterion ``"friction"``.
    points : int, optional
        Number of control points of a spline, or of points of the moves; ``2 harmonics + 1`` by default.
    ramp_time : float, optional
        Duration of the ramp-up from rest and of the ramp-down to rest of a Fourier series, s; 0 for none. By default
        one oscillation of the highest harmonic.
    periods : int, optional
        Number of periods of a Fourier series that the motion contains; 1 by default, 6 with the criterion
        ``"friction"``.
    slow_time : float, optional
        Duration of a slow passage after each period of a Fourier series, s, with a twentieth of its speed, so that
        joints turn around slowly; 0 for none. By default 5 s with the criterion ``"friction"``, otherwise none.
    objective : ExcitationObjective, optional
        The parameters to identify and the criterion; by default all parameters and the condition number.
    constraints : sequence of MotionConstraint
        Further constraints, such as clearances from a table or of bodies from each other.
    self_collision : bool
        Whether the links are kept 0.01 m from each other. This applies where the description has collision geometry and
        neither `constraints` nor the limits file say anything about self-collision. The remarks say what could not be
        checked, of floor and table as well.
    parameters : array_like, optional
        (n,) parameters with which torques are predicted; those of the description by default.
    margin : float
        Fraction of each limit that is left free.
    rate : float
        Rate at which the motion will be recorded, Hz.
    search : SearchOptions, optional
        Number of starts, duration and method of the search.
    progress : callable, optional
        Function that is called with a short text after each step of the search.

    Raises
    ------
    InputError
        If an argument cannot be used.
    SolverError
        If no motion keeps every limit; the message names the limit.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")], gravity=(0, -9.81, 0)))
    >>> limits = {"lower": -1.5, "upper": 1.5, "velocity": 2.0, "acceleration": 6.0}
    >>> design = design_excitation(model, limits, period=5.0, harmonics=3, search=SearchOptions(starts=1, workers=1))
    >>> design.condition_number < 10, design.margins[0].clearance >= 0
    (True, True)
    """
    whole, model = model, model.without_channels  # no motion sets a temperature
    say = progress or (lambda _: None)
    if not (np.isfinite(rate) and rate > 0.0):
        raise InputError(f"rate must be positive, got {rate!r}.")
    asked = ExcitationObjective() if objective is None else objective
    options = SearchOptions() if search is None else search
    about_friction = asked.criterion == "friction"
    _require_friction_asked_alone(asked)
    played = _FOR_FRICTION if about_friction and family == "fourier" else _PLAIN
    chosen = make_family(
        family,
        period=period,
        harmonics=(_FOR_FRICTION if about_friction else _PLAIN)[0] if harmonics is None else harmonics,
        points=points,
        ramp_time=ramp_time,
        periods=played[1] if periods is None else periods,
        slow_time=played[2] if slow_time is None else slow_time,
    )
    _require_samples(chosen, rate)
    verifier = Verifier(chosen, whole=True)
    remarks: list[str] = [] if whole is model else [_not_judged(whole)]
    where = "limits"
    sections: dict[str, Any] = {}
    if isinstance(limits, str | Path):
        where, folder = str(limits), Path(limits).parent
        limits, sections = limits_from_file(limits)
        constraints = (*constraints, *_geometry(model, sections, folder, where))
    around = _surroundings(model, constraints, sections, self_collision)
    remarks += around.remarks
    if around.own is not None:
        constraints = (*constraints, around.own)
    for constraint in constraints:
        remarks += getattr(constraint, "remarks", ())
    bounds = _limits(model, limits, where, remarks, parameters).reduced(margin)
    shown_model, subset = with_friction_laws(model, bounds) if about_friction else (model, asked.subset)
    measure = Criterion(asked.criterion, make_subset(shown_model, subset, asked.nuisance))
    weights = _weights(model, asked.noise)
    regressor = RegressorInformation(shown_model, _sign_width(bounds, chosen), weights)
    prior = _prior(shown_model, asked.prior_information, weights, rate)
    problem = _problem(model, chosen, bounds, measure, regressor, prior, rate, (*constraints,), parameters)
    configurations, obstacle = resting_configurations(problem, bounds, options.seed, options.starts)
    if obstacle is not None:
        what, name, label = obstacle
        if what == "rest":
            why, otherwise = f"no configuration was found that keeps {name}, {label}", "widen this limit or take it out"
        else:
            why = f"wherever it can rest, {name}, {label}, is passed as soon as it moves"
            otherwise = "widen this limit or take it out"
            if name == "torque":
                why, otherwise = f"{why}, by friction and weight together", f"{otherwise}, or state a lower friction"
        watched = _WATCHED if around.own is not None and name == around.own.name else ""
        remedy = remedy_of(constraints, name, label, otherwise)
        raise SolverError(f"The robot cannot even {what} within its limits: {why}; {remedy}{watched}.")
    if len(problem.constraints) == len(joint_limits(bounds)):
        configurations = configurations[:1]  # with limits of the joints alone, all starts are about the middle

    recorded = _period_times(chosen, rate)
    recorded_basis = chosen.basis(recorded)

    def spectrum(x: Array, of: Model = shown_model, prior: Array = prior) -> Spectrum:
        """Return the spectrum of the whole information, with the exact sign of Coulomb friction."""
        motion = problem.motion(x, recorded_basis)
        part = problem.count / len(recorded)
        return Spectrum.of(
            prior.T @ prior + part * RegressorInformation.exact(of, *motion, weights),
            lambda: np.vstack([prior, np.sqrt(part) * RegressorInformation.exact_factor(of, *motion, weights)]),
        )

    def figure(x: Array) -> float:
        return measure.figure(spectrum(x))

    result = Search(problem, Verifier(chosen), figure, bounds, options, say).run(configurations)
    assert result.best.x is not None
    best, found = result.best.x, result.best.figure

    def checked(x: Array) -> tuple[Trajectory, Trajectory, tuple[Array, ...], tuple[Margin, ...]]:
        """Return the series, the motion, its samples and margins, independently of the search."""
        coefficients = problem.coefficients(x)
        series, whole = chosen.excitation(coefficients), chosen.trajectory(coefficients)
        motion = whole.motion(verifier.times)
        return series, whole, motion, nearest_first(margins_of(problem.constraints, verifier.times, motion))

    excitation, trajectory, motion, margins = checked(best)
    if not keeps_all(margins):  # between samples of the first period, where those of the others are
        repaired = verifier.repaired(problem, best)
        if repaired is not None:
            best, found = repaired, figure(repaired)
            excitation, trajectory, motion, margins = checked(best)
    if not keeps_all(margins):
        raise SolverError(f"The motion that was found does not keep its limits after all ({margins[0]}).")
    own = _information(model, excitation, rate)
    if np.abs(motion[1][0]).max() > 1e-6:
        remarks.append(
            "The motion starts and ends in motion, without a ramp-up: bring the robot to the initial velocity first."
        )
    remarks += _not_limited(bounds, motion, _torque(model, motion, parameters))
    if parameters is None:
        remarks += _without_friction(model, margins)
    remarks += _notes(result.status, result.finished, options.starts)
    way = result.best.in_the_way
    if way is not None:
        remedy = remedy_of(constraints, way.name, way.label, "widen this limit, or give the motion more time")
        remarks.append(
            f"The motion was made smaller, since those of full size passed {way.name}, {way.label}; {remedy}, or try "
            "more starts, for one that shows more."
        )
    remarks += model.robot.remarks  # such as springs that the model does not have
    asked_for, known = measure.subset, prior
    if about_friction:  # laws that the robot may not have, in powers of its units: the stated model is judged
        asked_for, known = make_subset(model, None), _prior(model, asked.prior_information, weights, rate)
    shown = identifiability(spectrum(best, model, known), asked_for, problem.count * model.dof)
    unchecked = around.missing(motion[0])
    remarks = [*unchecked, *remarks]
    if shown.unidentifiable:
        remarks.insert(0, _hopeless(shown, len(asked_for.names), margins, period))
    return ExcitationDesign(
        robot_name=model.robot.name,
        joint_names=tuple(model.robot.joint_names),
        trajectory=trajectory,
        excitation=excitation,
        condition_number=own.condition_number,
        combined_condition_number=_combined(model, own, asked.prior_information, rate),
        criterion=asked.criterion,
        figure=found,
        subset=() if subset is None else measure.subset.names,
        terms=tuple(term.kind for term in model.robot.terms),
        parameter_count=whole.parameter_count,
        base_count=whole.base_parameters().count,
        uncertainty=shown.uncertainty,
        unidentifiable=shown.unidentifiable,
        unchecked=unchecked,
        limits=bounds,
        margins=margins,
        family=family,
        method=options.method,
        status=result.status,
        rate=rate,
        ramp_time=chosen.window[0],
        slow_time=getattr(chosen, "slow_time", 0.0),
        seed=options.seed,
        starts=options.starts,
        finished_starts=result.finished,
        remarks=tuple(remarks),
        geometry=(*constraints,),
    )


def _geometry(model: Model, sections: Mapping[str, Any], folder: Path, where: str) -> Sequence[MotionConstraint]:
    """Return the geometric constraints that the tables of a limits file describe."""
    if not sections:
        return ()
    from steelyard.collision import geometry_from_dict

    return geometry_from_dict(sections, model.robot, folder, where=where)


def _surroundings(
    model: Model, constraints: Sequence[MotionConstraint], sections: Mapping[str, Any], self_collision: bool
) -> Surroundings:
    from steelyard.collision.surroundings import Surroundings

    return Surroundings.of(model.robot, constraints, sections, self_collision)


def _limits(
    model: Model,
    limits: MotionLimits | Mapping[str, Any] | None,
    where: str,
    remarks: list[str],
    parameters: ArrayLike | None,
) -> MotionLimits:
    bounds = MotionLimits.for_robot(model.robot, limits, where)
    remarks += bounds.widening(model.robot)
    if not isinstance(limits, MotionLimits):
        torques = {"torque", "effort", "power", "total_power"} & set(limits or {})
        if not torques and parameters is None and np.isnan(model.robot.parameters[_link_columns(model)]).any():
            if np.isfinite(bounds.torque).any():
                remarks.append(
                    "The effort limits of the description were not checked, because it has no inertia for some link."
                )
            bounds = bounds.updated({"torque": float("inf")})
    if endless := bounds.endless:
        raise InputError(
            f"Nothing limits the position, the velocity or the acceleration of {listed(endless)}, so that the motion "
            'would grow without bound; give limits, such as the line "velocity = 1.0" in a limits file.'
        )
    return bounds


def _link_columns(model: Model) -> NDArray[np.intp]:
    return np.concatenate([np.asarray(c, dtype=np.intp) for c in model.link_columns])


def _weights(model: Model, noise: ArrayLike | None) -> Array:
    if noise is None:
        return np.ones(model.dof)
    values = np.asarray(noise, dtype=np.float64)
    if values.shape != (model.dof,) or not np.isfinite(values).all() or (values <= 0.0).any():
        raise InputError(
            f"noise must be {model.dof} positive numbers, one standard deviation for each joint, got {noise!r}."
        )
    return np.asarray(1.0 / values)


def _require_friction_asked_alone(asked: ExcitationObjective) -> None:
    if asked.criterion != "friction":
        return
    if asked.subset is not None:
        raise InputError("The criterion friction is about friction of all joints; leave out subset, or take another.")
    if isinstance(asked.prior_information, Information):
        raise InputError(
            "The criterion friction needs prior information that is a motion: a saved Information tells nothing of "
            "the laws of friction beyond those of its model."
        )


def _require_samples(family: Family, rate: float) -> None:
    """Refuse a rate at which a period leaves no samples, or more than fit into the memory."""
    if not 2.0 <= family.period * rate <= _MOST:
        raise InputError(
            f"rate must give 2 to {_MOST:g} samples of the {family.period:g} s that the criterion is about, got "
            f"{rate:g} Hz; give another rate or period."
        )


def _period_times(family: Family, rate: float) -> Array:
    begin, end = family.window
    return np.asarray(begin + np.arange(round((end - begin) * rate)) / rate)


def _period_instants(family: Family) -> Array:
    """Return the instants of the first period at which the criterion and the limits are evaluated."""
    begin, end = family.window
    count = int(np.ceil((end - begin) / family.step))
    return np.asarray(begin + (end - begin) * np.arange(count) / count)


def _sign_width(limits: MotionLimits, family: Family) -> float:
    """Return the width of the smooth sign of Coulomb friction, from a typical velocity within the limits."""
    basis = family.basis(_period_instants(family))
    fast = np.sqrt(np.mean(coefficient_scale(limits, basis) ** 2)) * float(np.abs(basis[1]).max())
    return float(_SMOOTHNESS * min(fast, float(np.min(limits.velocity))))


def _problem(
    model: Model,
    family: Family,
    limits: MotionLimits,
    criterion: Criterion,
    regressor: RegressorInformation,
    prior: Array,
    rate: float,
    constraints: tuple[MotionConstraint, ...],
    parameters: ArrayLike | None,
) -> DesignProblem:
    begin, end = family.window
    period = _period_instants(family)
    count = len(period)
    step = min(family.step, begin / 20.0) if begin > 0.0 else family.step  # in the ramps, which may be short
    leads = np.concatenate([np.arange(0.0, begin, step), [end]])
    if begin > 0.0:
        leads = np.concatenate([leads, np.arange(family.duration, family.duration - begin, -step)])
    changes = [np.arange(start, stop, step) for start, stop in getattr(family, "leads", ())]
    leads = np.concatenate([leads, *changes])
    lower, upper = limits.ranges
    return DesignProblem(
        family=family,
        regressor=regressor,
        criterion=criterion,
        constraints=(*joint_limits(limits), *torque_limits(model, limits, parameters), *constraints),
        center=0.5 * (lower + upper),
        scale=coefficient_scale(limits, family.basis(period)),
        prior=prior,
        count=(end - begin) * rate * getattr(family, "periods", 1),
        times=np.concatenate([period, leads]),
        period_count=count,
        external_count=len(constraints),
        initial_count=count + len(leads),
    )


def _prior(
    model: Model, prior_information: Information | Trajectory | ExcitationDesign | None, weights: Array, rate: float
) -> Array:
    """Return a factor (n_b, n_b) of the prior information."""
    if prior_information is None:
        return np.zeros((model.base_parameters().count,) * 2)
    information = _known(model, prior_information, rate)
    if information.base_expressions != model.base_parameters().expressions:
        raise InputError(
            f"The prior information belongs to another robot than {model.robot.name}, since its base parameters "
            "differ; give that of the same robot file."
        )
    given = weights if information.by_joint else None
    if given is None and np.ptp(weights) > 0.0:
        raise InputError(
            "noise needs prior information with separate joints; this Information was reduced over all joints."
        )
    return np.asarray(information.reduced(given).R)


def _known(model: Model, prior_information: Information | Trajectory | ExcitationDesign, rate: float) -> Information:
    if isinstance(prior_information, Information):
        return prior_information
    motion = prior_information.excitation if isinstance(prior_information, ExcitationDesign) else prior_information
    if motion.dof != model.dof:
        raise InputError(
            f"The prior information is a motion of {motion.dof} joints, but {model.robot.name} has {model.dof}; "
            "give a motion of this robot."
        )
    return _information(model, motion, rate)


def _information(model: Model, motion: Trajectory, rate: float) -> Information:
    _, q, dq, ddq = motion.sample(rate)
    return Information.from_samples(model, Samples(q=q, dq=dq, ddq=ddq, torque=np.zeros_like(q)))


def _combined(
    model: Model, own: Information, prior_information: Information | Trajectory | ExcitationDesign | None, rate: float
) -> float | None:
    if prior_information is None:
        return None
    both = [information.reduced(None).R for information in (own, _known(model, prior_information, rate))]
    values = np.linalg.svd(np.vstack(both), compute_uv=False)
    return float(values[0] / values[-1]) if values[-1] > 0.0 else float("inf")


def _hopeless(shown: Identifiability, count: int, margins: Sequence[Margin], period: float) -> str:
    """Return the remark that a motion cannot identify some parameters, which ones, and what to try."""
    names = listed(map(_short, shown.unidentifiable), _NAMED)
    used = dict.fromkeys(m.name for m in margins if m.fraction < _USED_UP)
    wider = f"wider limits of {' and '.join(used)}, which the motion uses up, " if used else ""
    # A motion that nothing slows down shows more when it is faster.
    time = "longer" if used.keys() & {"velocity", "acceleration", "torque", "power", "total power"} else "shorter"
    return (
        f"This motion cannot identify what was asked: with torque noise of {TORQUE_NOISE:.0%} the standard deviations "
        f"of {len(shown.unidentifiable)} of {count} parameters exceed the size of all base parameters together "
        f"({names}); try {wider}a period {time} than {period:g} s, or fewer "
        "terms or parameters."
    )


def _not_judged(model: Model) -> str:
    """Return the remark that a motion is planned without what terms need beside the motion of one instant."""
    base, judged = model.base_parameters(), model.without_channels.base_parameters().expressions
    kinds = " and ".join(term.kind for term in model.robot.terms if term.channels)
    left = [_short(one) for one in base.expressions if one not in judged]
    return (
        f"The motion was judged by {len(judged)} of {base.count} base parameters, without {listed(left)}: the torque "
        f"of {kinds} follows from more than the motion of one instant; it counted as in steady sliding, without "
        "channels."
    )


def _short(expression: str) -> str:
    """Return the first terms of the expression of a base parameter."""
    return expression if len(expression) <= _SHORT else expression[: expression.rindex(" ", 0, _SHORT)] + " ..."


def _torque(model: Model, motion: tuple[Array, ...], parameters: ArrayLike | None) -> Array | None:
    """Return the torques (S, N) that are predicted; None where the inertia of some link is not known."""
    if parameters is None and np.isnan(model.robot.parameters[_link_columns(model)]).any():
        return None
    q, dq, ddq = motion
    return model.inverse_dynamics(q, dq, ddq, predicted_parameters(model, parameters))


def _without_friction(model: Model, margins: Sequence[Margin]) -> list[str]:
    """Return the remark on torques and power that friction, which nobody states, may drive beyond their limits."""
    # An offset is what a sensor reads at rest; no drive has to make it.
    left = "; ".join(one for one in model.terms_left_open.split("; ") if not one.startswith("offset "))
    torques = ("torque", "power", "total power")
    near = next((one for one in margins if one.name in torques and one.fraction < _ROOM_FOR_FRICTION), None)
    if near is None or not left:
        return []
    return [
        f"Torques were predicted without terms of which the description gives no numbers ({left}): {near.name}, "
        f"{near.label}, comes to {1.0 - near.fraction:.0%} of its limit without them, and on the robot it may pass it; "
        "lower this limit by as much as friction takes, or give an estimate of an identification with a gentler motion."
    ]


def _not_limited(limits: MotionLimits, motion: tuple[Array, ...], torque: Array | None) -> list[str]:
    """Return the remark on what no limit was given for, with what the motion reaches there."""
    found = []
    reached = [("velocity", motion[1], "rad/s or m/s"), ("acceleration", motion[2], "rad/s² or m/s²")]
    if torque is not None:
        reached.append(("torque", torque, "N·m or N"))
    for name, values, unit in reached:
        free = np.flatnonzero(np.isinf(getattr(limits, name)))
        if len(free):
            whose = (
                "all joints" if len(free) == len(limits.joint_names) else listed([limits.joint_names[k] for k in free])
            )
            found.append(f"the {name} of {whose}, which reaches {np.abs(values[:, free]).max():.3g} {unit}")
    return [f"No limit was given for {' and '.join(found)}."] if found else []


def _notes(status: str, finished: int, starts: int) -> list[str]:
    if status == "interrupted":
        return [f"The search was interrupted after {finished} of {starts} starts; this is the best motion so far."]
    if status == "time limit":
        return [f"The time limit came after {finished} of {starts} starts; this is the best motion so far."]
    return []


FORMAT = "steelyard-excitation-1"
MOTION_FILES = tuple(f"trajectory.{suffix}" for suffix in ("csv", "parquet", "yaml", "json"))
RECORD = "excite.json"


@dataclass(frozen=True, eq=False)
class ExcitationDesign:
    """The result of :func:`steelyard.design_excitation`.

    Attributes
    ----------
    robot_name : str
    joint_names : tuple of str
    trajectory : Trajectory
        The whole motion, from rest to rest.
    excitation : Trajectory
        The period to which the criterion applies: a Fourier series without its ramp-up and ramp-down; otherwise the
        whole motion.
    condition_number : float
        Condition number of the base regressor over one period at `rate`, with equal weights of all joints and the exact
        sign of Coulomb friction. It equals :attr:`steelyard.Information.condition_number` of the samples.
    combined_condition_number : float or None
        Condition number of this motion and the prior information together.
    criterion : {"condition", "d", "a", "friction"}
    figure : float
        Value of the criterion for the chosen weights, subset and prior information: condition number, logarithm of the
        determinant of the information (of the laws of friction with ``"friction"``), or trace of its inverse.
    subset : tuple of str
        The parameters that the motion was to identify, where not all were.
    terms : tuple of str
        Terms of the model besides rigid links, such as ``"viscous"``.
    parameter_count, base_count : int
        Numbers of parameters and of base parameters of the model. A remark says which of them the motion was not judged
        by, as the state of friction or a temperature alone shows them.
    uncertainty : float
        Expected standard deviation, with torque noise of one per cent and the prior information, of the least certain
        combination of the parameters in the subset, relative to the 2-norm of all base parameters. Above 1 the motion
        does not identify what was asked, see `identifies`. With the criterion ``"friction"`` it is that of all
        parameters of the stated model.
    unidentifiable : tuple of str
        Where the uncertainty is above 1, the parameters that cause it, the least certain first.
    unchecked : tuple of str
        Collisions that were not checked, in sentences with the reason and the remedy.
    limits : MotionLimits
        The limits of the design, reduced by the fraction that was to be left free.
    margins : tuple of Margin
        Margins of every limit over the whole motion at 1 kHz or finer, the smallest first.
    family, method, status : str
        Family of trajectories, method of the search, and how the search ended: ``"finished"``, ``"time limit"`` or
        ``"interrupted"``. In the latter two cases the result is the best motion so far.
    rate : float
        Rate at which the motion will be recorded, Hz.
    ramp_time : float
        Duration of the ramp-up, and of the ramp-down, s.
    slow_time : float
        Duration of each slow passage, s.
    seed, starts, finished_starts : int
        Seed of the search, number of starts, and number of starts that were finished.
    remarks : tuple of str
        Remarks for the user, in sentences.
    geometry : tuple of MotionConstraint
        The constraints beyond the limits of joints that the motion keeps, such as distances of links.
    """

    robot_name: str
    joint_names: tuple[str, ...]
    trajectory: Trajectory
    excitation: Trajectory
    condition_number: float
    combined_condition_number: float | None
    criterion: str
    figure: float
    subset: tuple[str, ...]
    terms: tuple[str, ...]
    parameter_count: int
    base_count: int
    uncertainty: float
    unidentifiable: tuple[str, ...]
    unchecked: tuple[str, ...]
    limits: MotionLimits
    margins: tuple[Margin, ...]
    family: str
    method: str
    status: str
    rate: float
    ramp_time: float
    seed: int
    starts: int
    finished_starts: int
    slow_time: float = 0.0
    remarks: tuple[str, ...] = ()
    geometry: tuple[MotionConstraint, ...] = field(default=(), repr=False)

    @property
    def identifies(self) -> bool:
        """Whether the motion can identify what was asked, with torque noise of one per cent."""
        return self.uncertainty <= 1.0

    @property
    def shown(self) -> str:
        """What the motion was to show, in words."""
        if self.criterion == "friction":
            return "laws of friction at all joints"
        return ", ".join(self.subset) or "all parameters"

    @property
    def warnings(self) -> tuple[str, ...]:
        """The most important remarks: parameters that cannot be identified, and collisions that were not checked."""
        return self.remarks[: bool(self.unidentifiable) + len(self.unchecked)]

    @property
    def start(self) -> dict[str, float]:
        """Position of each joint at the beginning of the motion, rad or m."""
        q = self.trajectory.motion([0.0])[0][0]
        return dict(zip(self.joint_names, q.tolist(), strict=True))

    def sample(self, rate: float) -> tuple[Array, Array, Array, Array]:
        """Return t (S,), q, dq and ddq (S, N) of `excitation` at `rate` (Hz).

        The whole motion with its ramp-up and ramp-down is ``trajectory.sample(rate)``.
        """
        return self.excitation.sample(rate)

    def save(self, path: str | Path, *, rate: float | None = None) -> None:
        """Write the whole motion, as :func:`steelyard.excitation.save_trajectory` does, with the joints' names."""
        save_trajectory(self.trajectory, path, rate=rate, joint_names=self.joint_names)

    def save_all(self, folder: str | Path, pages: Mapping[str, str] | None = None) -> tuple[Path, ...]:
        """Write ``trajectory.csv``, ``.parquet``, ``.yaml`` and ``.json`` and ``excite.json`` into a folder.

        Parameters
        ----------
        folder : str or Path
            The folder is made where it is missing; files of the same names are replaced.
        pages : mapping from str to str, optional
            Names and content of further files that appear together with these.
        """
        with replaced_folder(folder, record=RECORD) as made:
            for name in MOTION_FILES:
                self.save(made / name)
            for name, text in (pages or {}).items():
                write_text(text, made / name)
            write_json(self.to_dict(), made / RECORD, indent=2)
        return tuple(Path(folder) / name for name in (*MOTION_FILES, RECORD, *(pages or {})))

    def to_dict(self) -> dict[str, Any]:
        """Return the options, results and margins of the design as plain data."""
        margins = [
            {
                "limit": m.name,
                "part": m.label,
                "margin": m.clearance,
                "fraction": m.fraction,
                "time": None if m.beyond else m.time,
                "beyond": m.beyond,
            }
            for m in self.margins
        ]
        return {
            "format": FORMAT,
            "robot": self.robot_name,
            "joint_names": list(self.joint_names),
            "family": self.family,
            "duration": self.trajectory.duration,
            "period": self.excitation.duration,
            "ramp_time": self.ramp_time,
            "slow_time": self.slow_time,
            "start": self.start,
            "rate": self.rate,
            "condition_number": self.condition_number,
            "combined_condition_number": self.combined_condition_number,
            "criterion": self.criterion,
            "figure": self.figure,
            "subset": list(self.subset),
            "terms": list(self.terms),
            "parameters": self.parameter_count,
            "base_parameters": self.base_count,
            "identifies": self.identifies,
            "uncertainty": self.uncertainty,
            "unidentifiable": list(self.unidentifiable),
            "unchecked": list(self.unchecked),
            "method": self.method,
            "status": self.status,
            "seed": self.seed,
            "starts": self.starts,
            "finished_starts": self.finished_starts,
            "limits": self.limits.to_dict(),
            "margins": margins,
            "remarks": list(self.remarks),
        }

    def nearest(self) -> tuple[Margin, ...]:
        """Return for each constraint its smallest margin, relative to its scale."""
        first: dict[str, Margin] = {}
        for margin in self.margins:
            first.setdefault(margin.name, margin)
        return tuple(first.values())

    def __repr__(self) -> str:
        together = "" if self.combined_condition_number is None else f", together {self.combined_condition_number:.4g}"
        near = f"; nearest limit: {self.margins[0]}" if self.margins else ""
        return (
            f"ExcitationDesign({self.robot_name}: {self.family}, {self.trajectory.duration:g} s, condition number "
            f"{self.condition_number:.4g}{together}, {self.status}{near})"
        )

    def _repr_html_(self) -> str:
        rows = [(m.name, m.label, *m.cells) for m in self.nearest()]
        title = (
            f"{self.robot_name}: {self.family}, {self.trajectory.duration:g} s, "
            f"condition number {self.condition_number:.4g}"
        )
        return html_table(title, ("limit", "nearest part", "margin", "time, s"), rows, self.remarks)


def nearest_first(margins: Sequence[Margin]) -> tuple[Margin, ...]:
    """Sort margins by their fraction of the scale, the smallest first."""
    return tuple(sorted(margins, key=lambda m: m.fraction))
