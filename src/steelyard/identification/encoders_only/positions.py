"""Identification of drives from commands and measured positions alone: no torque, no current."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError
from steelyard.files import shown, suggestion
from steelyard.regression.parameter_covariance import NORMAL
from steelyard.robot import Robot, RobotFile
from steelyard.robot.inertia import parameters_of_pseudo_inertia, pseudo_inertia
from steelyard.simulation.driven_joints import COULOMB, DRIVE_PARAMETERS, Branch, branches_of

from ..given import given_robot
from ..saved import parameters_of_description
from .drive_choice import DriveChoice, choose_drive_terms
from .drive_logs import read_drive_logs, refuse_still, rms_of_joints
from .drive_remarks import (
    PASSING,
    above_noise,
    remarks_on_gains,
    remarks_on_logs,
    remarks_on_missing_commands,
    remarks_on_missing_terms,
    remarks_on_rate,
    remarks_on_rows,
    remarks_on_settings,
    remarks_on_values,
    remarks_on_zeros,
    unbelievable,
)
from .drive_result import DriveValue, PositionIdentification, described_alike, descriptions_of_results
from .drive_settings import (
    BY_LOAD,
    BY_POSITION,
    FIND,
    FRICTION_LAWS,
    FURTHER_TERMS,
    SPRING,
    TERMS,
    TORQUE_LOSS,
    DriveSettings,
)
from .shooting import COARSEST_STEP, PassingLog, PositionLog, Shooting, ShootingResult, Unknown

__all__ = ["identify_from_positions"]

Array = NDArray[np.float64]

LONGEST_STEP = 6.25e-4
"""s. With steps of 1.25 ms rotor inertias of 0.012 kg·m² of a simulated leg are up to 0.6 % too large and the delay is
18 µs too short, about half a standard error at 0.2 mrad of noise; with these steps up to 0.1 % and 7 µs."""

KNOWN = 0.1
"""Half an interval relative to its value, up to which a value counts as measured."""

BOUNDS = {"offset": (-math.inf, math.inf), "gain": (-math.inf, math.inf), "load_friction": (0.0, 0.9)}
"""The bounds of what may be found; what has no entry is 0 or above. Friction that grew by as much as the load would
lock a joint."""

FREED = 0.3
"""Standard deviation of what is freed of a link's inertia, about its description: each factor of its pseudo-inertia
changes by so much relative to itself. What the motion does not show stays at the description so."""

SMALL = {"offset": 0.1, "encoder": 0.02, "delay": 2e-3}
"""Sizes that would matter of what may well be zero, relative to which it counts as measured."""

UNITS = {
    "rotor_inertia": "kg·m²",
    "viscous": "N·m·s/rad",
    "coulomb": "N·m",
    **dict.fromkeys(COULOMB, "N·m"),
    "load_friction": "1",
    "stiffness": "N·m/rad",
    "offset": "N·m",
    "encoder": "rad",
    "kp": "N·m/rad",
    "kd": "N·m·s/rad",
    "gain": "N·m a unit",
    "torque_loss": "1/(N·m)",
    "delay": "s",
}


@in_one_thread
def identify_from_positions(
    robot: str | Path | RobotFile | Robot,
    logs: Any,
    *,
    validate: Any = (),
    settings: DriveSettings | Mapping[str, Any] | None = None,
    weights: Literal["joint", "equal"] = "joint",
    friction: Literal["auto"] | None = None,
    progress: Callable[[str], None] | None = None,
) -> PositionIdentification:
    """Identify the drives of a robot on a fixed base from commands and measured positions alone.

    Rotor inertia, viscous and Coulomb friction, a bias, one delay, and gains where they are unknown are those with
    which the robot, simulated from its commands, moves as it was measured: trajectory matching by multiple shooting,
    see :mod:`steelyard.identification.encoders_only.shooting`. Inertias and friction are at least 0, and freed links
    keep a density that is positive everywhere, by construction. A floating base that is held on a stand counts as
    fixed.

    Parameters
    ----------
    robot : str, Path, RobotFile or Robot
        A robot.toml with a section ``[drive]``, or a description together with `settings`.
    logs : path, mapping of arrays, or a sequence of them
        With times, positions and commands. Where times have a gap, a log is parted.
    validate : likewise
        Logs that are simulated with what was found, from their commands alone.
    settings : DriveSettings or mapping, optional
        In place of ``[drive]``.
    weights : {"joint", "equal"}
        Whether each joint's errors count relative to what is left of them, or all alike.
    friction : {"auto", None}
        ``"auto"``: Coulomb friction that varies over the travel or grows with the load, and springs, are added at the
        joints whose motion in stretches that are left out they predict better; see
        :func:`steelyard.identification.encoders_only.drive_choice.choose_drive_terms`. The answer says which.
    progress : callable, optional
        Is told what is being done.

    Raises
    ------
    InputError
        Where a column of commands is missing, commands are the positions themselves, a joint stands still, or the
        settings cannot be used.

    Examples
    --------
    A pendulum on a drive with known gains, simulated here with steps of its own:

    >>> import numpy as np
    >>> import steelyard as sy
    >>> text = '''<robot name="pendulum"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 -0.2"/>
    ... <mass value="0.5"/><inertia ixx="2e-3" iyy="2e-3" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
    ... <joint name="hinge" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint>
    ... </robot>'''
    >>> path = getfixture("tmp_path") / "pendulum.urdf"
    >>> _ = path.write_text(text)
    >>> t = np.arange(300) * 0.005
    >>> command = 0.8 * np.sin(3.0 * t + 2.0 * np.sin(t))
    >>> inertia, q, dq, rows = 2e-3 + 0.5 * 0.2**2 + 0.015, 0.0, 0.0, []
    >>> for target in command:
    ...     rows.append(q)
    ...     for _ in range(50):  # rotor inertia 0.015, viscous friction 0.08, Coulomb friction 0.03
    ...         torque = 6.0 * (target - q) - 0.3 * dq - 0.5 * 9.81 * 0.2 * np.sin(q)
    ...         dq += 1e-4 * (torque - 0.08 * dq - 0.03 * np.tanh(dq / 1e-3)) / inertia
    ...         q += 1e-4 * dq
    >>> log = {"t": t, "q": np.array(rows), "target": command}
    >>> found = sy.identification.identify_from_positions(
    ...     sy.Robot.from_urdf(path), log,
    ...     settings={"command": ["target"], "kp": 6.0, "kd": 0.3, "delay": 0.0, "friction": "coulomb"})
    >>> print(*(f"{float(x[0]):.3f}" for x in (found.rotor_inertia, found.viscous, found.coulomb)))
    0.015 0.080 0.030
    """
    if friction not in ("auto", None):
        raise InputError(f'friction must be "auto" or None, got {shown(friction)}.')
    file, _ = given_robot(robot)
    body = file.robot
    if settings is None:
        if not file.section("drive"):
            raise InputError(
                f"{file.path} has no section [drive]; say there which columns hold the commands, and the gains: "
                'command = "q_des{}", kp = 20, kd = 1.5.'
            )
        chosen = DriveSettings.from_dict(file.section("drive"), f"{file.path}, [drive]")
    else:
        chosen = settings if isinstance(settings, DriveSettings) else DriveSettings.from_dict(settings)
    say = progress or (lambda _: None)
    fitted, held_out, of_units = read_drive_logs(file, chosen, logs, validate)
    if not fitted:
        raise InputError("There is no log; give one with commands and positions.")
    refuse_still(body, fitted)
    for source in descriptions_of_results(body, file.path, chosen)[body.source is not None :]:
        described_alike(body, source)  # before the search, which takes its time
    remarks = remarks_on_settings(file, chosen)
    terms: Sequence[frozenset[str]] = [frozenset(chosen.find) & frozenset(FURTHER_TERMS)] * body.dof
    branches = branches_of(body)
    choice: DriveChoice | None = None
    if friction == "auto":
        choice = choose_drive_terms(
            lambda tried: _problem(body, branches, chosen, fitted, tried), fitted, terms, weights, say
        )
        terms = choice.terms
        remarks += choice.remarks(body)
    problem = _problem(body, branches, chosen, fitted, terms)
    found = problem.solve(weights, tell=say)
    drives, encoder = problem.drives(found.values)
    parameters = np.empty(10 * len(body.links))
    for number, branch in enumerate(problem.branches):
        own, _ = problem.inertials(number, problem.freed(number, found.values))
        for place, link in enumerate(branch.links):
            parameters[10 * link : 10 * link + 10] = own[10 * place : 10 * place + 10]
    values = _values(body, problem.unknowns, found.values, np.sqrt(np.diag(found.covariance)))
    validation = None
    if held_out:
        say("simulating the logs that were held out")
        validation = rms_of_joints(
            [log.q - q for log, q in zip(held_out, problem.predict(found.values, held_out), strict=True)]
        )
    is_position = chosen.law == "position"
    tracking = rms_of_joints([log.command - log.q for log in fitted]) if is_position else np.full(body.dof, np.nan)
    if not found.settled:
        remarks.append(
            f"The search did not settle in {found.steps} steps: the values are those of the least error that it met."
        )
    error = rms_of_joints(found.residuals)
    above = above_noise(fitted, error)
    doubts = unbelievable(body, chosen, fitted, error)
    if is_position and chosen.kp != FIND and above.any() and not doubts:
        say("looking whether other gains explain more")
        other = _problem(body, branches, replace(chosen, kp=FIND, kd=FIND), fitted, terms)
        doubts = _doubtful_gains(body, replace(other, longest_step=COARSEST_STEP), drives, error, weights, above)
    # A delay that is found makes up for most of what missing commands spoil. Gains that are too small look like them,
    # and are told first.
    early = drives[DRIVE_PARAMETERS.index("delay")].max() <= 0.0 or chosen.delay != FIND
    explicable = above_noise(fitted, error, 1.0 / PASSING).any()
    if early and explicable and not doubts and _change_at_every_row(fitted):
        say("looking whether commands changed between rows")
        doubts = remarks_on_missing_commands(body, error, _passing_error(problem, found, weights))
    explained = [
        *doubts,
        *of_units,
        *remarks_on_rows(body, fitted, found.residuals, above),
        *remarks_on_logs(body, chosen, fitted, drives, above),
    ]
    remarks = [
        *(explained or remarks_on_missing_terms(body, fitted, error, above, friction == "auto")),
        *remarks_on_zeros(body, drives),
        *remarks_on_rate(body, chosen, drives, values),
        *remarks,
        *remarks_on_values(values),
    ]
    return PositionIdentification(
        robot=body,
        settings=chosen,
        values=values,
        drives=drives,
        encoder=encoder,
        travel=problem.travel,
        choice=choice,
        parameters=parameters,
        error=error,
        validation_error=validation,
        tracking_error=tracking,
        remarks=tuple(remarks),
        logs=tuple(dict.fromkeys(log.name for log in fitted)),
        validation_logs=tuple(dict.fromkeys(log.name for log in held_out)),
        settled=found.settled,
        robot_file=file.path,
    )


def _change_at_every_row(logs: Sequence[PositionLog]) -> bool:
    """Whether a command that changed mostly changes at the next row again: then more may have come between rows."""
    changes = [np.diff(log.command, axis=0) != 0.0 for log in logs]
    again = sum(int((one[1:] & one[:-1]).sum()) for one in changes)
    return again > 0.5 * sum(int(one[:-1].sum()) for one in changes)


def _passing_error(problem: Shooting, found: ShootingResult, weights: str) -> Array:
    """The least error (N,) if commands pass in lines from row to row; infinite where no values are found."""
    unknowns = [replace(one, start=float(value)) for one, value in zip(problem.unknowns, found.values, strict=True)]
    logs = [PassingLog(log.t, log.q, log.command, log.name, log.begin) for log in problem.logs]
    try:
        return rms_of_joints(replace(problem, unknowns=unknowns, logs=logs).solve(weights).residuals)
    except InputError:
        return np.full(problem.fixed.shape[1], np.inf)


def _doubtful_gains(
    robot: Robot, other: Shooting, drives: Array, error: Array, weights: str, above: NDArray[np.bool_]
) -> list[str]:
    """Say where the gains that another problem finds explain the motion better than those of the drives (12, N)."""
    try:
        found = other.solve(weights)
    except InputError:  # without a motion there is nothing to compare
        return []
    gain = DRIVE_PARAMETERS.index("kp")
    nearer = rms_of_joints(found.residuals)
    return remarks_on_gains(robot, drives[gain], other.drives(found.values)[0][gain], error, nearer, above)


def _each(value: str | tuple[float, ...] | None, count: int, key: str, robot: Robot) -> Array:
    if value is None or isinstance(value, str):
        return np.zeros(count)
    if len(value) not in (1, count):
        raise InputError(
            f"[drive], key {key!r}, has {len(value)} numbers, but {robot.name} has {count} joints; give one, or one "
            "each."
        )
    return np.broadcast_to(np.array(value), count).copy()


def _problem(
    robot: Robot,
    branches: Sequence[Branch],
    settings: DriveSettings,
    logs: Sequence[PositionLog],
    further: Sequence[frozenset[str]],
) -> Shooting:
    """State the trajectory matching problem, with starting values from least squares on differentiated positions.

    `further` are the terms of each joint beside rotor inertia, viscous and constant Coulomb friction.
    """
    count = robot.dof
    links = parameters_of_description(Model(replace(robot, terms=())))
    driving = [robot.joints[index] for index in robot.driving_joints]
    described = np.nan_to_num(np.array([[joint.rotor_inertia, joint.damping, joint.friction] for joint in driving])).T
    given = dict.fromkeys(DRIVE_PARAMETERS, np.zeros(count))
    given |= {"rotor_inertia": described[0], "viscous": described[1]} | dict.fromkeys(COULOMB, described[2])
    given["kp"] = _each(settings.kp if settings.law == "position" else None, count, "kp", robot)
    given["kd"] = _each(settings.kd, count, "kd", robot)
    if settings.law == "signal":
        given["gain"] = _each(settings.gain, count, "gain", robot)
    given["delay"] = np.full(count, 0.0 if isinstance(settings.delay, str) else settings.delay)
    fixed = np.stack([given[kind] for kind in DRIVE_PARAMETERS])
    travel = np.stack(
        [np.min([log.q.min(axis=0) for log in logs], axis=0), np.max([log.q.max(axis=0) for log in logs], axis=0)]
    )
    unknown = [kind for kind in TERMS if kind in settings.find and not (kind == "viscous" and settings.kd == FIND)]
    unknown += ["offset"] if settings.bias == "torque" else []
    unknown += ["kp"] if settings.law == "position" and settings.kp == FIND else []
    unknown += ["kd"] if settings.kd == FIND else []
    unknown += ["gain"] if settings.law == "signal" and settings.gain == FIND else []
    unknown += ["torque_loss"] if TORQUE_LOSS in settings.find else []
    kinds = [_with_further(unknown, terms) for terms in further]
    starts = _first_values(branches, links, fixed, travel, kinds, logs)
    unknowns = [
        Unknown(kind, (joint,), starts[joint][kind], *BOUNDS.get(kind, (0.0, np.inf)))
        for joint in range(count)
        for kind in kinds[joint]
    ]
    if settings.bias == "encoder":
        unknowns += [Unknown("encoder", (k,), 0.0, prior=0.3) for k in range(count)]
    if settings.delay == FIND:
        start = 0.02 * settings.longest_delay
        unknowns.append(Unknown("delay", tuple(range(count)), start, 0.0, settings.longest_delay))
    for name in settings.free:
        if name not in robot.link_names:
            raise InputError(f"[drive], key 'free', names {shown(name)}; {suggestion(name, robot.link_names)}")
        index = robot.link_names.index(name)
        if not np.linalg.eigvalsh(pseudo_inertia(links[10 * index : 10 * index + 10]))[0] > 0.0:
            raise InputError(
                f"[drive], key 'free', names {shown(name)}, whose mass and inertia in the description are those of no "
                "body with a density that is positive everywhere; give it some there, about which to look."
            )
        branch = next(one for one in branches if index in one.links)
        before = [robot.link_names[link] for link in branch.links if robot.link_names[link] in settings.free]
        for k in range(10):
            place = 10 * before.index(name) + k
            unknowns.append(Unknown("inertial", branch.coordinates[:1], 0.0, place=place, prior=FREED))
    freed = [[robot.link_names[link] in settings.free for link in branch.links] for branch in branches]

    def inertials(number: int, values: Array) -> tuple[Array, Array]:
        own = [links[10 * link : 10 * link + 10] for link in branches[number].links]
        return _freed_inertials(own, freed[number], values)

    return Shooting(
        branches,
        inertials,
        fixed,
        travel,
        unknowns,
        logs,
        FRICTION_LAWS[settings.friction](),
        LONGEST_STEP,
        period=0.0 if settings.rate is None else 1.0 / settings.rate,
    )


_ROWS, _COLUMNS = np.tril_indices(4)


def _freed_inertials(links: Sequence[Array], freed: Sequence[bool], values: Array) -> tuple[Array, Array]:
    """Return parameters of links (10 n,) and their derivatives by what is freed.

    The pseudo-inertia of a freed link is ``L T T' L'`` with L of the description and T lower triangular, which is the
    exponential of its own diagonal: positive definite whatever the values. The derivatives are by complex steps.
    """
    count = 10 * sum(freed)
    parameters, derivatives = np.concatenate(links), np.zeros((10 * len(links), count))
    at = 0
    for place, (own, free) in enumerate(zip(links, freed, strict=True)):
        if not free:
            continue
        root = np.linalg.cholesky(pseudo_inertia(own))
        here = slice(10 * place, 10 * place + 10)

        def body(theta: NDArray[np.complex128], root: Any = root) -> Any:
            factor = np.zeros((4, 4), dtype=complex)
            factor[_ROWS, _COLUMNS] = theta
            factor[np.diag_indices(4)] = np.exp(np.diag(factor))
            whole = root @ factor
            return whole @ whole.T

        theta = values[at : at + 10].astype(complex)
        parameters[here] = parameters_of_pseudo_inertia(body(theta).real)
        for k in range(10):
            step = theta.copy()
            step[k] += 1e-30j
            derivatives[here, at + k] = parameters_of_pseudo_inertia(body(step).imag / 1e-30)
        at += 10
    return parameters, derivatives


def _with_further(unknown: Sequence[str], terms: frozenset[str]) -> list[str]:
    """Return what is unknown of a joint with further terms."""
    found = list(unknown)
    if BY_POSITION in terms:
        place = found.index("coulomb")
        found[place : place + 1] = COULOMB
    return found + ["load_friction"] * (BY_LOAD in terms) + ["stiffness"] * (SPRING in terms)


def _first_values(
    branches: Sequence[Branch],
    links: Array,
    fixed: Array,
    travel: Array,
    unknown: Sequence[Sequence[str]],
    logs: Sequence[PositionLog],
) -> list[dict[str, float]]:
    """Least squares within bounds on torques of differentiated positions, one joint after the other."""
    from scipy.optimize import lsq_linear

    starts: list[dict[str, float]] = [dict.fromkeys(kinds, 0.0) for kinds in unknown]
    for branch in branches:
        own = list(branch.coordinates)
        parameters = np.concatenate([links[10 * link : 10 * link + 10] for link in branch.links])
        motions = [_differentiated(log.t, log.q[:, own]) for log in logs]
        q, dq, ddq = (np.concatenate(parts) for parts in zip(*motions, strict=True))
        command = np.concatenate([log.command[:, own] for log in logs])
        torque = branch.model.inverse_dynamics(q, dq, ddq, parameters)
        for k, joint in enumerate(own):
            kinds = [kind for kind in unknown[joint] if kind != "torque_loss"]  # none to begin with
            if not kinds:
                continue
            sign = np.tanh(dq[:, k] / max(0.05 * float(np.std(dq[:, k])), 1e-9))
            low, high = travel[:, joint]
            middle = 0.5 * (low + high)
            along = np.clip((q[:, k] - middle) / max(0.5 * (high - low), 1e-9), -1.0, 1.0)
            columns = {
                "rotor_inertia": ddq[:, k],
                "viscous": dq[:, k],
                "coulomb_lower": sign * np.maximum(-along, 0.0),
                "coulomb_middle": sign * (1.0 - np.abs(along)),
                "coulomb_upper": sign * np.maximum(along, 0.0),
                "load_friction": sign * np.abs(torque[:, k]),
                "stiffness": q[:, k] - middle,
                "offset": -np.ones(len(q)),
                "kp": -(command[:, k] - q[:, k]),
                "kd": dq[:, k],
                "gain": -command[:, k],
            }
            held = dict(zip(DRIVE_PARAMETERS, fixed[:, joint], strict=True))
            hidden = COULOMB if "coulomb" in kinds else ()
            right = -torque[:, k] - sum(
                column * held[kind] for kind, column in columns.items() if kind not in kinds and kind not in hidden
            )
            matrix = np.stack([sign if kind == "coulomb" else columns[kind] for kind in kinds], axis=1)
            scale = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
            bounds = np.array([BOUNDS.get(kind, (0.0, np.inf)) for kind in kinds]).T * scale
            found = starts[joint]
            found |= zip(kinds, (lsq_linear(matrix / scale, right, bounds).x / scale).tolist(), strict=True)
            # A start at exactly 0 is on the bound, where a step inwards is as easy; but no inertia at all may be stiff.
            if "rotor_inertia" in found:
                least = 0.05 * float(np.std(torque[:, k]) / max(float(np.std(ddq[:, k])), 1e-9))
                found["rotor_inertia"] = max(found["rotor_inertia"], min(least, 1.0), 1e-6)
            if "kp" in found:
                found["kp"] = max(found["kp"], 1e-3 * float(np.std(torque[:, k]) + 1.0))
    return starts


def _differentiated(t: Array, q: Array) -> tuple[Array, Array, Array]:
    """Positions, velocities and accelerations of a log, from parabolas over 50 ms, or nine rows."""
    from scipy.signal import savgol_filter

    even = np.linspace(t[0], t[-1], len(t))
    step = (t[-1] - t[0]) / (len(t) - 1)
    width = min(max(9, 2 * round(0.025 / step) + 1), len(t) - 1 + len(t) % 2)
    on_even = np.stack([np.interp(even, t, column) for column in q.T], axis=1)
    parts = [savgol_filter(on_even, width, 2, deriv=order, delta=step, axis=0) for order in (0, 1, 2)]
    back = [np.stack([np.interp(t, even, column) for column in part.T], axis=1) for part in parts]
    return back[0], back[1], back[2]


def _values(robot: Robot, unknowns: Sequence[Unknown], values: Array, deviations: Array) -> tuple[DriveValue, ...]:
    found = []
    for unknown, value, deviation in zip(unknowns, values, deviations, strict=True):
        if unknown.kind == "inertial":
            continue
        reach = NORMAL * float(deviation)
        lower, upper = max(value - reach, unknown.lower), min(value + reach, unknown.upper)
        at_bound = not unknown.lower < value < unknown.upper
        if unknown.kind in SMALL:
            relative = reach / max(abs(value), SMALL[unknown.kind])
        else:
            relative = math.inf if value == 0.0 else reach / abs(value)
        reaches = unknown.kind != "delay" and (lower <= unknown.lower or upper >= unknown.upper)
        reaches = reaches or not math.isfinite(reach)
        word = "not seen" if at_bound or reaches else "measured" if relative <= KNOWN else "weak"
        joint = "all" if len(unknown.joints) > 1 else robot.joint_names[unknown.joints[0]]
        unit = UNITS[unknown.kind]
        if joint != "all" and robot.position_units[unknown.joints[0]] == "m":
            unit = unit.replace("N·m", "N").replace("rad", "m").replace("kg·m²", "kg")
        found.append(DriveValue(joint, unknown.kind, float(value), float(lower), float(upper), unit, word))
    return tuple(found)
