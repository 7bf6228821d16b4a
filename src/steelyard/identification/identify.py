"""The main job: from a robot and its logs to a physically feasible model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.dynamics.threads import in_one_thread
from steelyard.errors import InputError, SolverError
from steelyard.estimators import fit
from steelyard.estimators.cross_validation import FEWEST_FOLDS, MANY_PARAMETERS
from steelyard.estimators.estimator import Estimator, estimate_with, find_estimator
from steelyard.estimators.marginal_likelihood import body_priors
from steelyard.estimators.physical_prior import PhysicalPrior
from steelyard.estimators.plausible_fit import PlausibleFit, plausible_fit, tried_prior
from steelyard.feasibility import FeasibleSet, check
from steelyard.feasibility.constraints import Constraint
from steelyard.files import shown
from steelyard.recording import LogColumns, Processing
from steelyard.recording.chunks import CHUNK_ROWS
from steelyard.recording.filters import Butterworth
from steelyard.recording.formats import require_unwritten, written_states
from steelyard.regression import Estimate, Information, least_squares
from steelyard.regression.reduction import errors_of, residuals
from steelyard.regression.time_blocks import FOLDS
from steelyard.robot.described_inertia import remark_on_base

from .default_terms import RotorDecision, decide_rotors
from .doubts import doubts_of, heavy_ends
from .given import (
    Data,
    GivenRobot,
    GivenSamples,
    UnusableLogs,
    UnusableLogsError,
    describes_masses,
    digests,
    given_constraints,
    given_logs,
    given_robot,
    given_settings,
    wider_model,
    without_informations,
)
from .late_logs import LateLog, late_hypotheses, late_logs
from .log_reader import LogReader, LogReduction, Progress, ReducedLog
from .near_standstill import standstill_errors
from .parameter_table import parameter_table
from .prediction_verdict import FewRows, few_rows_of, prediction_verdict
from .reduced_logs import reduced_logs, require_once
from .result import Identification, Prediction, Trace

if TYPE_CHECKING:
    from .chosen_friction import FrictionChoice

__all__ = ["identify"]

Array = NDArray[np.float64]

COARSE, LEAST_COARSE = 0.1, 2e-4
"""Part of the accelerations that differences take away, from which it is told: relative to the error that the answer
leaves, and by itself. Real logs leave percents of the torques, in which a thousandth does not show."""


@in_one_thread
def identify(
    robot: GivenRobot,
    data: Data,
    validate: Data | None = None,
    *,
    columns: LogColumns | Mapping[str, Any] | None = None,
    processing: Processing | Mapping[str, Any] | None = None,
    constraints: Sequence[Constraint] | None = None,
    weights: Literal["joint"] | None = "joint",
    consistency: Literal["full", "inertia"] = "full",
    prior: Literal["auto"] | None = "auto",
    prior_weight: float | Literal["auto"] = "auto",
    prefer: Literal["auto", "lightest", "cad"] | None = "auto",
    residual_slack: float = 5e-4,
    estimator: str | Estimator = "fit",
    friction: Literal["auto"] | None = None,
    chunk_rows: int = CHUNK_ROWS,
    reduction: LogReduction | None = None,
    progress: Progress | None = None,
) -> Identification:
    """Identify the dynamic parameters of a robot from its logs.

    The logs are processed chunk by chunk and reduced to an Information, from which the unconstrained estimate, its
    verdict and the feasible estimate come without the data. The answer stays as near to what is known of the robot as
    costs nothing on stretches of the logs that are left out in turn; every number says what it rests on, and a second
    verdict says whether the model predicts.

    Parameters
    ----------
    robot : str, Path, RobotFile, Robot or Model
        A URDF, or a robot.toml with terms, log columns, processing and constraints, or elastic joints, see
        :class:`steelyard.identification.SecondEncoders`; or a robot in memory. A Robot
        without terms gets those of a URDF, viscous friction, Coulomb friction and an offset at each joint, and rotor
        inertia where the logs show it; a Model is taken as it is.
    data : path, Recording, Samples, data frame, mapping of arrays, structured array, or sequence of these
        Each is one log. Paths: files recorded side by side are joined by ``+``. Columns of data frames (pandas, Polars,
        PyArrow) and of arrays are found by their names as those of a file are; an array (S, N) stands for N columns.
        A ``.json`` is an Information of logs that were reduced before; no log is needed beside it.
        A Recording is in SI units already, and Samples need no processing either.
    validate : the same, optional
        Logs on which both estimates are tried without refitting.
    columns : LogColumns or mapping, optional
        Keys of ``[log]``, such as ``{"position_unit": "deg"}``, in place of those of the robot file.
    processing : Processing or mapping, optional
        Keys of ``[processing]``, such as ``{"cutoff": 5.0}``, in place of those of the robot file.
    constraints : sequence of Constraint, optional
        Such as ``[sy.TotalMass(maximum=20.0)]``, beside those of the robot file.
    weights : {"joint", None}
        See :func:`steelyard.least_squares`.
    consistency : {"full", "inertia"}
        See :class:`steelyard.FeasibleSet`.
    prior : {"auto", None}
        ``"auto"``: what the description, else the shape, else the kinematics say of each link, as a prior, and centres
        of mass within the bounds of their links. None: the best feasible fit, and what `prefer` says.
    prior_weight : float or "auto"
        Of the prior; ``"auto"`` by cross-validation.
    prefer : {"auto", "lightest", "cad", None}
        Without a prior, see :func:`steelyard.fit`; if it is not ``"auto"``, there is no prior. ``"auto"`` is ``"cad"``
        where the description has a mass for every link, otherwise ``"lightest"``.
    residual_slack : float
        See :func:`steelyard.fit`.
    estimator : str or callable
        What estimates the parameters: :func:`steelyard.fit`; ``"maximum_likelihood"``, which whitens the rows by the
        noise that it finds and reads the logs several times, see :func:`steelyard.estimators.likelihood_information`;
        ``"momentum"`` or ``"energy"``, whose balances over short windows need no accelerations, see
        :func:`steelyard.estimators.momentum_information`;
        ``"instrumental_variables"`` or ``"output_error"``, which read the logs whole and go by the table [controller],
        see :func:`steelyard.instrumental_variables` and :func:`steelyard.output_error`;
        an estimator that another package adds, by its name; or a function ``estimator(info, feasible_set,
        **options)``. The options are `weights`, `prefer` and `residual_slack`.
    friction : {"auto", None}
        ``"auto"``: laws of friction that the logs call for are added to the terms, joint by joint, see
        :func:`steelyard.estimators.select_friction`; the answer says which, and how they were chosen.
    chunk_rows : int
        Rows of a log that stand in memory together.
    reduction : callable, optional
        What reduces the logs: a :class:`steelyard.fleet.LogReduction`, in several processes or on a cluster, and with
        checkpoints; one after the other in this process by default. The result is the same.
    progress : callable, optional
        Called with a few words before each step.

    Returns
    -------
    Identification
        Nothing is written unless its ``save(folder)`` is called.

    Raises
    ------
    InputError
        If the robot, a log or an option cannot be used; the message says why and what to do.

    Examples
    --------
    A pendulum whose mass times its lever is 0.51 kg m, from arrays:

    >>> import numpy as np
    >>> import steelyard as sy
    >>> robot = sy.Robot.from_dh([(0, 0.3, 0, "q")], gravity=(0, -9.81, 0), name="pendulum")
    >>> t = np.arange(0.0, 20.0, 0.01)
    >>> q = 0.8 * np.sin(3 * t) + np.sin(1.1 * t)
    >>> tau = 0.6 * (-7.2 * np.sin(3 * t) - 1.21 * np.sin(1.1 * t)) + 5.0 * np.cos(q)
    >>> result = sy.identify(robot, {"t": t, "q1": q, "tau1": tau}, processing={"cutoff": "none"})
    >>> result.prediction.word, result.estimate.base_expressions[1], round(float(result.estimate.base[1]), 2)
    ('good', 'lx1 + 0.3*m1', 0.51)
    """
    say = progress or (lambda _: None)
    data_of_logs, earlier = without_informations(data)
    passed_over: list[str] = []
    logs, validation = given_logs(data_of_logs, validate, passed_over)
    if not logs and not earlier:
        raise InputError(
            "At least one log is needed to identify a robot; give the path of one, such as a CSV or a bag."
        )
    written = written_states((*logs, *validation))
    # An unknown estimator is refused before logs are read; some make rows of their own.
    found = find_estimator(estimator)
    own_rows, motion_rows = (getattr(found, name, None) for name in ("rows", "rows_of_motion"))
    file, model = given_robot(robot)
    file = given_settings(file, columns, processing)
    if motion_rows is not None:
        from .known_controller import ControllerSettings, motions_of_logs  # other estimators need no motion

        controller = ControllerSettings.of_file(file, getattr(found, "needs_controller", False))
    own_prior = getattr(found, "has_prior", False)
    takes_prior = _takes_prior(estimator, own_prior, own_rows or motion_rows, prior, prior_weight, prefer)
    if friction not in ("auto", None):
        raise InputError(f'friction must be "auto" or None, got {shown(friction)}.')
    if earlier and (friction == "auto" or own_rows is not None or motion_rows is not None or file.section("elastic")):
        raise InputError(
            f"{earlier[0]}: holds no rows, which elastic joints, a choice of friction and most estimators need; give "
            "logs alone, or leave these out."
        )
    unusable, informations = UnusableLogs(), list[tuple[str, Information]]()
    for path in earlier:
        with unusable.noting(path, len(earlier)):
            informations.append((path, Information.load(path)))
    unusable.refuse(earlier)
    if earlier:
        require_once(logs, informations)
        require_once(validation, informations)
    if file.section("elastic"):
        model.refuse_presliding("identified together with the stiffness of [elastic]")
        if motion_rows is not None:
            raise InputError(
                f"{file.path}: the estimator {estimator} needs the motion of a rigid robot under its controller, and "
                "[elastic] says that joints give way; take another estimator, such as fit or momentum."
            )
        # Loaded where a robot file names such joints.
        if friction == "auto":
            from .elastic.elastic_friction import with_chosen_friction as with_elastic_joints
        else:
            from .elastic.elastic_joints import with_elastic_joints

        return with_elastic_joints(
            identify,
            file,
            data,
            validate,
            constraints=constraints,
            weights=weights,
            consistency=consistency,
            prior=prior,
            prior_weight=prior_weight,
            prefer=prefer,
            residual_slack=residual_slack,
            estimator=estimator,
            chunk_rows=chunk_rows,
            reduction=reduction,
            progress=progress,
        )
    reader = LogReader(file, model, chunk_rows)
    reader.require_torques()
    reader.remarks.extend(passed_over)
    limits = given_constraints(file, constraints)

    say(f"{model.robot.name}: {model.dof} joints, {model.base_parameters().count} base parameters")
    reader.decide(logs or validation, say)
    friction_choice: FrictionChoice | None = None
    if friction == "auto":
        from .chosen_friction import choose_friction  # what is not asked for is not loaded

        with suppress(UnusableLogsError):  # which are told with the others, once all were read
            friction_choice = choose_friction(reader, logs, model, wider_model(file, model) or model, say)
            if friction_choice.selection.chosen:
                model = reader.model = Model(model.robot.with_terms(*friction_choice.terms))
            reader.remarks.extend(friction_choice.remarks)
    feasible_set = FeasibleSet(model, consistency, limits)
    wider = wider_model(file, model)
    for path, one in informations:
        with unusable.noting(path, len(informations)):
            if one.model_among([wider or model, model], path) is model:
                wider = None  # it was reduced without rotors, and all of them are to be
    for path, one in informations:
        with unusable.noting(path, len(informations)):
            one.model_among([wider or model], path)
    unusable.refuse(earlier)
    read = reduced_logs(reader, logs, validation, wider or model, reduction, say, informations)
    information = read.information
    folds = FEWEST_FOLDS if model.parameter_count > MANY_PARAMETERS else FOLDS
    stretches = (*information.stretches(read.blocks, folds), *_stretches(read.earlier, folds))
    rotors: RotorDecision | None = None
    why_no_rotors = ""
    if wider is not None:
        say("have the rotors an inertia that shows?")
        rotors = decide_rotors(feasible_set, wider, information, stretches, weights)
        feasible_set, information, stretches = rotors.feasible_set, rotors.information, rotors.stretches
        if rotors.taken:
            model = reader.model = wider
            reader.remarks.append(rotors.sentence(file.path.name))
        else:
            why_no_rotors = rotors.reason
            read = read.narrowed(wider, model)
    _require_excitation(information, model)
    measured = information
    if own_rows is not None:
        say("rows of the estimator")
        information, stretches = own_rows(model, lambda: reader.samples(logs), count=folds)
    if motion_rows is not None:
        say("the motion without noise, and what the estimator makes of it")
        samples, motions = motions_of_logs(reader, logs, model, controller)
        information, stretches = motion_rows(samples, feasible_set, motions, weights=weights, count=folds)
    if information is not measured:
        rotors = None  # whose fits are of other rows
        _require_excitation(information, model, "rows of the estimator")

    say("least squares")
    unconstrained = rotors.unconstrained if rotors is not None else None
    unconstrained = unconstrained or least_squares(information, weights)
    if information is not measured:
        reader.remarks.append(
            "Plain least squares beside this answer is that of the estimator's own rows: "
            f"{unconstrained.method} without conditions."
        )
    say("is it physically possible?")
    verdict = check(feasible_set, base=unconstrained.base)
    say("feasible fit")
    plausible: PlausibleFit | None = None
    known: PhysicalPrior | None = None
    if takes_prior:
        tried = rotors.tried if rotors is not None and prior_weight == "auto" else None
        if tried is None:
            tried = tried_prior(information, stretches, feasible_set, unconstrained, prior_weight=prior_weight)
        known, plausible = tried.known, plausible_fit(information, feasible_set, unconstrained, tried)
        estimate = plausible.estimate
        held_out = plausible.held_out_error
    else:
        if prefer == "auto" and not own_prior:
            prefer = "cad" if describes_masses(model) else "lightest"
        options = {"weights": weights, "prefer": prefer, "residual_slack": residual_slack}
        estimate = estimate_with(estimator, information, feasible_set, **options)
        say("how well it predicts stretches that are left out")
        held_out = _held_out(stretches, lambda data: estimate_with(estimator, data, feasible_set, **options))
    description = _description(file.description, model, estimate)
    if friction_choice is not None and friction_choice.selection.chosen:
        description["terms"] = [term.to_dict() for term in model.robot.terms]
    estimate = replace(estimate, description=description, unconstrained_base=unconstrained.base)
    say("what the numbers rest on")
    predictions = tuple(_predict(model, unconstrained, estimate, log) for log in read.logs)
    prediction = prediction_verdict(
        measured,
        estimate.base,
        validation=[log.information for k, log in enumerate(read.logs) if not log.fitted and k not in read.copies],
        held_out_error=held_out,
        fold_count=len(stretches),
        units=model.robot.torque_units,
        few_rows=[
            few
            for log, one in zip(read.logs, predictions, strict=True)
            for few in _few_rows(model, estimate, log, one.trace)
        ],
    )
    late: list[LateLog] = []
    # Rows that an estimator made have other sums, and the numbers of a robot that changes are those of none.
    if information is measured and prediction.word != "wrong" and not read.changes:
        residuals_of_logs = [one.trace.residuals for one in predictions]
        late = late_logs(reader, logs, read.logs, information, residuals_of_logs, unconstrained)
    table, tilted = None, None
    if estimate.parameters is not None:
        if information is measured and prediction.word != "wrong" and not read.changes and not late:
            from .tilted_base import tilted_base  # robots that are not identified, and wrong ones, need none

            rows = [log.samples for log in read.logs if log.fitted]
            tilted = tilted_base(model, information, rows, estimate.parameters, unconstrained)
        standstill = None
        left_of_fit = [
            stretch
            for one, log in zip(predictions, read.logs, strict=True)
            if log.fitted
            for stretch in zip(log.drawn.windows, one.trace.residuals, strict=True)
        ]
        if information is measured or getattr(found, "counts_slow_rows", False):
            plain = unconstrained if information is measured else least_squares(measured, weights)
            standstill = standstill_errors(model, measured, plain, left_of_fit, estimate.base)
        information = information.with_returning(left_of_fit, read.earlier, measured)
        error = np.sum([one.change for one in late], axis=0) if late else None if tilted is None else tilted.change
        table = parameter_table(
            information,
            feasible_set if plausible is None else plausible.plausible_set,
            estimate,
            unconstrained,
            term_scales=None if plausible is None else plausible.term_deviations,
            drifts=[drift for found in read.drifts.values() for drift in found],
            error=error,
            error_of="the delay of the torques" if tilted is None else "the tilt of the base",
            standstill=standstill,
        )
        assert table.covariance is not None
        estimate = replace(
            estimate,
            parameter_table=tuple(table.to_list()),
            standard_error=table.covariance.standard_error,
            error_correlation=table.covariance.error_correlation,
        )

    def free() -> Estimate:
        # Within the masses of the prior torques in wrong units find no robot; without, one of another weight.
        wrong = plausible is not None and prediction.word == "wrong"
        return fit(information, feasible_set, weights=weights) if wrong else estimate

    remarks = dict.fromkeys(reader.remarks)
    if information is measured:
        derived = {str(log) for log in logs if not isinstance(log, GivenSamples)}
        from_positions = [one for one in predictions if one.name in derived]
        remarks.update(dict.fromkeys(_coarse(reader.processing, from_positions, estimate.relative_error)))
    of_numbers = late_hypotheses(late, reader.processing.delay, model.robot.joint_names)
    if tilted is not None:
        first = next(log.name for log in read.logs if log.fitted)
        of_numbers = {first: (tilted.hypothesis(reader, first),)}
    doubts = doubts_of(reader, read, predictions, prediction, of_numbers, body_priors(model, limits, known), free, say)
    remarks.update(dict.fromkeys(doubts.remarks))
    if not doubts.of_log:
        remarks.update(dict.fromkeys(_dear(unconstrained, estimate)))
    if not doubts.of_log and not reader.units_are_suspect and table is not None:
        remarks.update(dict.fromkeys(heavy_ends(model, table, doubts.prediction).values()))
    remarks.update(dict.fromkeys(model.robot.remarks))
    if of_base := remark_on_base(model.robot):
        remarks[of_base] = None
    missed = None
    if model.robot.source is not None:
        holds = any(one.locked for link in model.robot.links for one in link.attachments)
        if holds and estimate.parameters is not None:
            from steelyard.robot.description_changes import remark_on_held  # few robots have locked joints

            if of_held := remark_on_held(model.robot, estimate.parameters):
                remarks[of_held] = None
        from .missed_terms import missed_terms  # there is no description otherwise

        missed = missed_terms(model, estimate, [log.samples for log in read.logs])
        if missed is not None:
            remarks[missed.sentence] = None
    require_unwritten(written)
    return Identification(
        model=model,
        information=information,
        feasible_set=feasible_set,
        unconstrained=unconstrained,
        verdict=verdict,
        estimate=estimate,
        predictions=predictions,
        prediction=doubts.prediction,
        parameters=table,
        plausible=plausible,
        weak=unconstrained.weak,
        remarks=tuple(remarks),
        mistakes=doubts.mistakes,
        changes=read.changes,
        scale=doubts.scale,
        drifts=() if doubts.of_log else read.drift_sentences,
        why_no_rotors=why_no_rotors,
        missed_by_description=missed.sentence if missed is not None and missed.matters else "",
        robot_file=file.path if file.path.is_file() else None,
        logs=tuple(map(str, logs)),
        validation_logs=tuple(map(str, validation)),
        informations=earlier,
        in_memory=digests((*logs, *validation)),
        options={
            "weights": weights,
            "consistency": consistency,
            "prior": "auto" if own_prior or plausible is not None else None,
            "prior_weight": None if plausible is None else plausible.prior_weight,
            "prefer": prefer,
            "residual_slack": residual_slack,
            "estimator": estimator if isinstance(estimator, str) else getattr(estimator, "__name__", repr(estimator)),
            "margin": feasible_set.margin,
            "terms": [term.kind for term in model.robot.terms],
            **({"friction": friction} if friction else {}),
            "chunk_rows": chunk_rows,
            "log": reader.columns.to_dict(),
            "processing": reader.stated.to_dict(),
            "decided": reader.decided,
            "constraints": file.section("constraints"),
            **({"further_constraints": [str(one) for one in constraints]} if constraints else {}),
        },
        cutoff_choices=tuple(reader.cutoff_choices),
        layouts=reader.layouts,
        friction=friction_choice,
    )


def _takes_prior(
    estimator: str | Estimator,
    own_prior: bool,
    makes_rows: object,
    prior: object,
    prior_weight: object,
    prefer: object,
) -> bool:
    """Tell whether the answer stays near what is known of the robot; refuse options that exclude one another."""
    if prior not in ("auto", None):
        raise InputError(f'prior must be "auto" or None, got {shown(prior)}.')
    if own_prior and not (prior == prefer == prior_weight == "auto"):
        raise InputError(
            f"The estimator {estimator} has a prior of its own; leave out prior, prior_weight and prefer (--prior, "
            "--prior-weight and --prefer)."
        )
    takes_prior = prior == "auto" and prefer == "auto" and bool(estimator == "fit" or makes_rows)
    if prior_weight != "auto" and not takes_prior:
        raise InputError(
            "prior_weight (--prior-weight) is that of the prior, which prior=None, prefer and estimators of other "
            "packages leave out; leave out one of them."
        )
    return takes_prior


def _stretches(informations: Sequence[Information], most: int) -> list[Information]:
    """Return at most so many parts of what was reduced before, each of which is left out in turn."""
    groups = [group for group in np.array_split(np.arange(len(informations)), most) if len(group)]
    parts = [Information.total([informations[index] for index in group]) for group in groups]
    return [replace(part, batch_means=(), contents=()) for part in parts]


def _require_excitation(information: Information, model: Model, what: str = "rows") -> None:
    rows = information.count
    if rows <= information.base_count:
        raise InputError(
            f"The logs leave {rows} {what} for {information.base_count} base parameters of {model.robot.name}; "
            "record a longer motion, trim less or lower velocity_threshold."
        )


def _held_out(stretches: Sequence[Information], estimate: Callable[[Information], Estimate]) -> Array | None:
    """Root mean square of the residuals of each joint on stretches, of which each is left out of an estimate in turn.

    None where the logs are too short for it, or what is left of them has no estimate.
    """
    if len(stretches) < FEWEST_FOLDS:
        return None
    try:
        squares = Information.held_out_squares(stretches, lambda others: estimate(others).base)
    except SolverError:
        return None
    counts = np.sum([[factor.count for factor in one.measured] for one in stretches], axis=0)
    return np.asarray(np.sqrt(squares / np.maximum(counts, 1)))


def _dear(unconstrained: Estimate, estimate: Estimate) -> tuple[str, ...]:
    """Warn where the feasible fit explains the data far worse than plain least squares."""
    before, after = unconstrained.relative_error, estimate.relative_error
    if after < 2.0 * before or after < 0.05:
        return ()
    return (
        f"No possible robot explains these torques well ({after:.0%} error, plain least squares {before:.0%}): "
        "check the signs, units and order of the columns, the direction of gravity, and the constraints.",
    )


def _coarse(processing: Processing, predictions: Sequence[Prediction], error: float) -> tuple[str, ...]:
    """Warn where central differences take so much off the motion that inertias come out wrong, and no interval says so.

    Where the rate is below 27 times the frequency of the motion, in an answer with little error.
    """
    if processing.filter.kind != Butterworth.kind or processing.decimate:
        return ()
    told: list[tuple[float, float, str]] = []
    for one in predictions:
        samples = one.trace.samples
        if samples is None or not np.isfinite(one.trace.interval):
            continue
        speeds = np.sqrt(np.sum(samples.dq**2, axis=0))
        moving = speeds > 0.0
        if not moving.any():
            continue
        w = np.sqrt(np.sum(samples.ddq[:, moving] ** 2, axis=0)) / speeds[moving]
        rate = 1.0 / one.trace.interval
        kept = Butterworth().response(float(np.median(w)) / (2.0 * np.pi), rate)
        lost = 1.0 - float(kept.velocity if processing.velocity == "measured" else kept.acceleration)
        if lost > max(COARSE * error, LEAST_COARSE):
            told.append((lost, rate, one.name))
    if not told:
        return ()
    lost, rate, name = max(told)
    return (
        f"{name}: {rate:.4g} samples a second are few for this motion: central differences take {lost:.2%} off its "
        "accelerations, and inertias come out wrong by about as much. Record more samples a second, or move "
        "more slowly.",
    )


def _predict(model: Model, unconstrained: Estimate, estimate: Estimate, log: ReducedLog) -> Prediction:
    drawn, information, samples = log.drawn, log.information, log.drawn.samples
    assert samples.t is not None
    # By the rows of the regression: where torques are filtered, what is predicted is, too.
    both = np.column_stack([unconstrained.base, estimate.base])
    of_both = np.concatenate([errors for _, errors in residuals(model, samples, both)])
    gaps = [np.diff(window.t) for window in drawn.windows if window.t is not None]
    trace = Trace(
        samples.t,
        samples.torque,
        samples.torque - of_both[..., 0],
        samples.torque - of_both[..., 1],
        samples=samples,
        log_rows=drawn.seen,
        piece_rows=drawn.piece,
        residuals=tuple(errors_of(model, window, estimate.base) for window in drawn.windows),
        interval=float(np.median(np.concatenate(gaps))) if gaps else float("nan"),
    )
    return Prediction(
        name=log.name,
        role=log.role,
        row_count=information.count,
        unconstrained_error=information.relative_error(unconstrained.base),
        feasible_error=information.relative_error(estimate.base),
        joint_unconstrained_error=information.joint_relative_error(unconstrained.base),
        joint_feasible_error=information.joint_relative_error(estimate.base),
        trace=trace,
        samples=log.samples,
    )


def _few_rows(model: Model, estimate: Estimate, log: ReducedLog, trace: Trace) -> tuple[FewRows, ...]:
    left = trace.measured - trace.feasible, trace.residuals
    return few_rows_of(log.name, log.role, log.information, model, estimate.base, log.drawn, left)


def _description(read: Mapping[str, Any], model: Model, estimate: Estimate) -> dict[str, Any]:
    """Return what of the description was read, with what few formats hold, as springs, and where its joints are."""
    drives = {} if estimate.parameters is None else model.drives(estimate.parameters).told_where_present()
    told = {"drives": {name: values.tolist() for name, values in drives.items()}} if drives else {}
    return {**estimate.description, **read, **told}
