"""The result of an identification: both estimates, the verdict, and how well they predict."""

from __future__ import annotations

import importlib
import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from steelyard.display import html_sentences, html_table
from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.estimators.plausible_fit import PlausibleFit
from steelyard.feasibility import FeasibleSet, Verdict
from steelyard.files import shown
from steelyard.recording import CutoffChoice, Layout, Samples
from steelyard.regression import Estimate, Information

from .mistakes import Hypothesis, sentence
from .parameter_table import ParameterTable
from .prediction_verdict import PredictionVerdict

if TYPE_CHECKING:
    from steelyard.estimators import JointStiffness
    from steelyard.regression.body_change import BodyChange

    from .chosen_friction import FrictionChoice
    from .elastic.elastic_model import ElasticModel
    from .wrong_scale import WrongScale

__all__ = ["Identification", "Prediction", "Trace"]

Array = NDArray[np.float64]
IDENTIFICATION_FORMAT = "steelyard-identification-1"


@dataclass(frozen=True, eq=False)
class Trace:
    """Measured and predicted torques of one log, for drawing.

    All rows of a short log; of each piece of a long one those at which the torque, or the residual, of some joint is
    least or greatest, so that peaks stay.

    Attributes
    ----------
    t : ndarray
        (S,) s.
    measured, unconstrained, feasible : ndarray
        (S, N) N·m or N: as recorded, and as predicted by either estimate.
    samples : Samples or None
        The rows themselves: motion, torque, and which of them were used.
    log_rows, piece_rows : int
        Rows of the log, and of each of its pieces; 1 where all rows are there.
    residuals : tuple of ndarray
        (L, N) each: what the answer leaves of the torques in stretches of neighbouring rows, spread over the log; NaN
        where a row was not used.
    interval : float
        Time between rows, s; NaN where it is not known.
    """

    t: Array
    measured: Array
    unconstrained: Array
    feasible: Array
    samples: Samples | None = None
    log_rows: int = 0
    piece_rows: int = 1
    residuals: tuple[Array, ...] = ()
    interval: float = float("nan")


@dataclass(frozen=True, eq=False)
class Prediction:
    """The errors with which both estimates predict the torques of one log.

    Attributes
    ----------
    name : str
        The log.
    role : str
        ``"identification"`` or ``"validation"`` (not used in the regression).
    row_count : int
        Rows used: samples times joints, less what was masked.
    unconstrained_error, feasible_error : float
        Relative error over all the joints (thesis eq. 4.37); 0.05 means 5 %.
    joint_unconstrained_error, joint_feasible_error : ndarray
        (N,) relative errors.
    trace : Trace
    samples : Samples or None
        Rows at equal distances, at most some thousands, of which averages are those of the log.
    """

    name: str
    role: str
    row_count: int
    unconstrained_error: float
    feasible_error: float
    joint_unconstrained_error: Array
    joint_feasible_error: Array
    trace: Trace
    samples: Samples | None = None


@dataclass(frozen=True, eq=False)
class Identification:
    """The result of :func:`steelyard.identify`.

    Attributes
    ----------
    model : Model
    information : Information
        Of all the logs used for identification.
    feasible_set : FeasibleSet
    unconstrained : Estimate
        Least squares without regard to physics.
    verdict : Verdict
        Whether a robot with the unconstrained base parameters could exist.
    estimate : Estimate
        The answer: physically possible, with parameters of every link.
    predictions : tuple of Prediction
        First those of the identification logs, then the validation logs.
    prediction : PredictionVerdict
        Whether the model predicts torques that it has not seen.
    parameters : ParameterTable or None
        What every number of the answer rests on; None where the answer has base parameters alone.
    plausible : PlausibleFit or None
        The prior, its weight and its price; None where the answer has no prior.
    weak : tuple of str
        Base parameters that are smaller than twice their standard error.
    remarks : tuple of str
        What the user should know about the data, a sentence each.
    robot_file : Path or None
    logs, validation_logs, informations : tuple of str
        As they were given; the last are files of what was reduced before, which the fit counts as well.
    options : dict
        All the choices, as plain data.
    mistakes : dict from str to tuple of Hypothesis
        What is probably wrong with a log, or with the robot file, by log: the likeliest mistake first, then those that
        the log cannot tell from it. Nothing is changed silently.
    changes : mapping from str to BodyChange
        The body that the robot picks up or puts down in the course of a log, by log.
    scale : WrongScale or None
        That torques, or times, have another size than the weight, or the inertia, of the robot needs.
    drifts : tuple of str
        A sentence for each log in which friction grows or falls steadily with time, as it does while gears warm up.
    cutoff_choices : tuple of (str, CutoffChoice)
        Log, and the evidence, where the cutoff of the position filter was chosen from the data.
    in_memory : dict from str to str
        SHA-256 hashes of the logs that were no files, by name.
    layouts : mapping from str to Layout
        What the columns of each log were understood to be.
    elastic_joints : tuple of JointStiffness
        Where the robot file has a section ``[elastic]``.
    elastic_model : ElasticModel or None
        Where a stiffness was measured: the model with the coordinates of links and of motors, which can be simulated,
        and what is proved of it.
    friction : FrictionChoice or None
        Which laws of friction were chosen, and how; None where that was not asked for.
    why_no_rotors : str
        Why the model has no inertia of rotors, as a clause, where nobody states the terms and it was tried; else empty.
    missed_by_description : str
        What the written description cannot hold, where it predicts much worse without that; else empty. It stands among
        the remarks as well.
    """

    model: Model
    information: Information
    feasible_set: FeasibleSet
    unconstrained: Estimate
    verdict: Verdict
    estimate: Estimate
    predictions: tuple[Prediction, ...]
    prediction: PredictionVerdict
    parameters: ParameterTable | None
    plausible: PlausibleFit | None
    weak: tuple[str, ...]
    remarks: tuple[str, ...]
    robot_file: Path | None
    logs: tuple[str, ...]
    validation_logs: tuple[str, ...]
    options: dict[str, object]
    mistakes: Mapping[str, tuple[Hypothesis, ...]] = field(default_factory=dict)
    changes: Mapping[str, BodyChange] = field(default_factory=dict)
    scale: WrongScale | None = None
    drifts: tuple[str, ...] = ()
    cutoff_choices: tuple[tuple[str, CutoffChoice], ...] = ()
    in_memory: Mapping[str, str] = field(default_factory=dict)
    layouts: Mapping[str, Layout] = field(default_factory=dict)
    elastic_joints: tuple[JointStiffness, ...] = ()
    elastic_model: ElasticModel | None = None
    friction: FrictionChoice | None = None
    informations: tuple[str, ...] = ()
    why_no_rotors: str = ""
    missed_by_description: str = ""

    def save(self, folder: str | Path, *, force: bool = False, stale: Collection[str] = ()) -> tuple[Path, ...]:
        """Write what ``steelyard identify --output folder`` writes; see :func:`steelyard.report.save_results`.

        Parameters
        ----------
        folder : str or Path
            Made where it is missing; files of an earlier identification are replaced together.
        force : bool
            Write the robot description even where the model does not predict the robot.
        stale : collection of str
            Names of further files in the folder that go when these appear, such as the checkpoints of the run.

        Returns
        -------
        tuple of Path
            The files.
        """
        if not isinstance(folder, str | os.PathLike):
            raise InputError(f"The folder for the results is {shown(folder)}; give its path.")
        report = _report_room()
        report.require_folder(Path(folder))
        written: tuple[Path, ...] = report.save_results(self, Path(folder), force=force, stale=stale)
        return written

    def report(self, target: str | Path | None = None) -> str | Path:
        """Return the report, one self-contained HTML page; or write it, and return where.

        Parameters
        ----------
        target : str or Path, optional
            An ``.html`` file, replaced where it is there.
        """
        if target is None:
            text: str = _report_room().report_html(self)
            return text
        _report_room().write_report(self, target)
        return Path(target)

    def plot(self, log: str | int | None = None, joints: Sequence[str] | None = None) -> Any:
        """Return measured and predicted torques as a Plotly figure, a row for each joint.

        Parameters
        ----------
        log : str or int, optional
            Its name or its number among `predictions`; by default the first for validation, or else the first.
        joints : sequence of str, optional
            Names of those that are shown; all by default.

        Returns
        -------
        plotly.graph_objects.Figure
        """
        return _report_room().torque_plot(self, log, joints)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        """Return the parameters of the answer, so that functions of models take a result in their place."""
        return self.estimate.__array__(dtype, copy)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters of the answer."""
        return self.estimate.parameter_names

    @property
    def base_expressions(self) -> tuple[str, ...]:
        """The base parameters of the answer, in words."""
        return self.estimate.base_expressions

    @property
    def base(self) -> Array:
        """The base parameters of the answer, (n_b,)."""
        return self.estimate.base

    @property
    def total_mass(self) -> float:
        """Mass of all the moving links in the answer, kg."""
        assert self.estimate.parameters is not None
        return float(sum(self.estimate.parameters[columns[9]] for columns in self.model.link_columns))

    @property
    def possible(self) -> bool | None:
        """Whether the answer meets all the conditions, tried anew; None where it has base parameters alone."""
        parameters = self.estimate.parameters
        return None if parameters is None else self.feasible_set.contains(parameters)

    @property
    def headline(self) -> str:
        """Both verdicts in one sentence: whether the answer can exist, and whether it predicts."""
        exists = {
            True: "The answer can exist",
            False: "The answer is not proved to be possible",
            None: "The answer has base parameters alone, so that no link can be checked",
        }[self.possible]
        agree = (self.possible is True) == self.prediction.is_usable
        joined = " and " if agree else ", but "
        # Torques of another size are predicted as well, and who reads on to the first step may be few.
        doubt = f"; but the scale of the {self.scale.of} is in doubt" if self.scale else ""
        return f"{exists}{joined}{'' if self.possible else 'it '}{self.prediction.clause}{doubt}."

    @property
    def is_usable(self) -> bool:
        """Whether the model predicts well enough to be used, and no scale of torques or times is in doubt."""
        return self.prediction.is_usable and self.scale is None

    @property
    def mistake_sentences(self) -> tuple[str, ...]:
        """What is probably wrong, a sentence for each log; they stand among the remarks as well."""
        return tuple(f"{log}: {sentence(found)}" for log, found in self.mistakes.items())

    @property
    def told_first(self) -> tuple[str, ...]:
        """Remarks that are told beside the verdicts and the steps, and need not be repeated."""
        changes = (change.sentence(log) for log, change in self.changes.items())
        return (*changes, *self.mistake_sentences, self.missed_by_description)

    @property
    def caveat(self) -> str:
        """What is to be known beside the numbers where the model misses torques, or the prior contradicts the data."""
        table, missed = self.parameters, self.prediction.missed
        if table is None:
            return ""
        words = ""
        if missed and table.count("measured") + table.count("bounded"):
            words = (
                "The words measured and bounded, and all intervals, hold under this model alone, and it misses "
                f"{missed}."
            )
        return f"{words} {table.conflict}".strip()

    def columns(self) -> list[tuple[Layout, tuple[str, ...]]]:
        """Return what columns were understood to be, once for all the logs with the same columns, which are named."""
        found: list[tuple[Layout, list[str]]] = []
        for log, layout in self.layouts.items():
            logs = next((logs for one, logs in found if one == layout), None)
            if logs is None:
                found.append((layout, [log]))
            else:
                logs.append(log)
        return [(layout, tuple(logs)) for layout, logs in found]

    def columns_to_list(self) -> list[dict[str, Any]]:
        """Return what columns were understood to be as plain data: the logs that have the same, and their table."""
        return [{"logs": list(logs), "table": layout.to_list()} for layout, logs in self.columns()]

    def joint_table(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """The table of how well each joint is predicted: its heads and its rows, the last of them all the joints."""
        told = self.prediction

        def written(value: float) -> str:
            return f"{value:.3g}" if np.isfinite(value) else "-"

        columns = (told.joint_names, told.joint_relative_error, told.joint_error, told.noise_floor, told.units)
        rows = [
            (name, f"{error:.1%}" if np.isfinite(error) else "-", written(size), written(floor), unit)
            for name, error, size, floor, unit in zip(*columns, strict=True)
        ]
        return ("joint", "error", "RMS", "noise", "unit"), [*rows, ("all", f"{told.relative_error:.1%}", "", "", "")]

    def elastic_table(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """The table of elastic joints: its heads and its rows; no row where the robot file names none."""
        from steelyard.estimators.joint_stiffness import stiffness_table  # loaded for elastic joints alone

        return stiffness_table(self.elastic_joints)

    @property
    def elastic_sentences(self) -> tuple[str, ...]:
        """What is proved of the robot with its elastic joints; empty where no stiffness was measured."""
        return () if self.elastic_model is None else (self.elastic_model.sentence,)

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data: verdicts, parameters, errors of each log, what may be wrong.

        The estimate with its certificate has a form of its own, ``estimate.to_dict()``.
        """
        errors = ("row_count", "unconstrained_error", "feasible_error")
        arrays = ("joint_unconstrained_error", "joint_feasible_error")
        return {
            "format": IDENTIFICATION_FORMAT,
            "robot": self.model.robot.name,
            "headline": self.headline,
            "possible": self.possible,
            "prediction": self.prediction.to_dict(),
            "least_squares": self.verdict.to_dict(),
            "total_mass": None if self.estimate.parameters is None else self.total_mass,
            "parameters": [] if self.parameters is None else self.parameters.to_list(),
            "caveat": self.caveat,
            "logs": [
                {"name": one.name, "role": one.role}
                | {key: getattr(one, key) for key in errors}
                | {key: getattr(one, key).tolist() for key in arrays}
                for one in self.predictions
            ],
            "changes": [{"log": log} | asdict(one) for log, one in self.changes.items()],
            "wrong_scale": None if self.scale is None else self.scale.to_dict(),
            "drifts": self.drifts,
            "mistakes": [
                {"log": log, "kind": one.kind, "statement": one.statement, "evidence": one.evidence, "toml": one.toml}
                for log, found in self.mistakes.items()
                for one in found
            ],
            "columns": self.columns_to_list(),
            "friction": None if self.friction is None else self.friction.to_dict(),
            "remarks": list(dict.fromkeys((*self.estimate.remarks, *self.remarks))),
            "options": self.options,
            **({"elastic_joints": [one.to_dict() for one in self.elastic_joints]} if self.elastic_joints else {}),
        }

    def _repr_html_(self) -> str:
        parts = [html_sentences(self.headline, self.mistake_sentences[:3], strong=True)]
        parts.append(_report_room().robot_svg(self))
        heads, rows = self.joint_table()
        parts.append(html_table(f"Prediction of {self.prediction.source}", heads, rows, self.prediction.sentences[1:]))
        if self.elastic_joints:
            parts.append(html_table("Elastic joints", *self.elastic_table(), self.elastic_sentences))
        if self.parameters is not None:
            parts.append(html_table("Links", *self.parameters.link_table()))
            parts.append(html_sentences(f"{self.parameters.counts} {self.caveat}".rstrip()))
        if self.plausible is not None and self.plausible.price is not None:
            parts.append(html_sentences(self.plausible.price.sentence))
        return "".join(parts)

    def __repr__(self) -> str:
        before, after = self.unconstrained.relative_error, self.estimate.relative_error
        return (
            f"Identification({self.model.robot.name}: relative error {before:.2%} unconstrained "
            f"({self.verdict.status}), {after:.2%} feasible; the prediction is {self.prediction.word})"
        )


def _report_room() -> Any:
    """Return the room that writes and draws results, which stands above this one and is loaded when it is asked for."""
    return importlib.import_module("steelyard.report")
