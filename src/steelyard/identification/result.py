"""What an identification returns: both estimates, the verdict, and how well they predict."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from steelyard.dynamics import Model
from steelyard.feasibility import FeasibleSet, Verdict
from steelyard.recording import CutoffChoice
from steelyard.regression import Estimate, Information

from .parameter_table import ParameterTable
from .plausible_fit import PlausibleFit
from .prediction_verdict import PredictionVerdict

__all__ = ["Identification", "Prediction", "Trace"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Trace:
    """Measured and predicted torques of one log, thinned out for drawing.

    Attributes
    ----------
    t : ndarray
        (S,) s.
    measured, unconstrained, feasible : ndarray
        (S, N) N·m or N: as recorded, and as predicted by either estimate.
    """

    t: Array
    measured: Array
    unconstrained: Array
    feasible: Array


@dataclass(frozen=True, eq=False)
class Prediction:
    """How well both estimates predict the torques of one log.

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
    """

    name: str
    role: str
    row_count: int
    unconstrained_error: float
    feasible_error: float
    joint_unconstrained_error: Array
    joint_feasible_error: Array
    trace: Trace


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
        Base parameters whose standard error exceeds their size.
    remarks : tuple of str
        What the user should know about the data, a sentence each.
    robot_file : Path or None
    logs, validation_logs : tuple of str
        As they were given.
    options : dict
        All the choices, as plain data.
    cutoff_choices : tuple of (str, CutoffChoice)
        Log, and the evidence, where the cutoff of the position filter was chosen from the data.
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
    cutoff_choices: tuple[tuple[str, CutoffChoice], ...] = ()

    @property
    def total_mass(self) -> float:
        """Mass of all the moving links in the answer, kg."""
        assert self.estimate.parameters is not None
        return float(sum(self.estimate.parameters[columns[9]] for columns in self.model.link_columns))

    def __repr__(self) -> str:
        before, after = self.unconstrained.relative_error, self.estimate.relative_error
        return (
            f"Identification({self.model.robot.name}: relative error {before:.2%} unconstrained "
            f"({self.verdict.status}), {after:.2%} feasible; the prediction is {self.prediction.word})"
        )
