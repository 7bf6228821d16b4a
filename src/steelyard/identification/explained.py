"""What a saved estimate tells: why it is impossible, or what is possible although the motion does not show it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from steelyard.feasibility import (
    InfeasibilityExplanation,
    LightestRobot,
    ParameterIntervals,
    check,
    explain_infeasibility,
    lightest_robot,
    parameter_intervals,
)
from steelyard.files import write_json

from .saved import set_and_estimate

__all__ = ["EstimateExplanation", "explain_estimate"]


@dataclass(frozen=True, eq=False)
class EstimateExplanation:
    """Answer of `explain_estimate`.

    Attributes
    ----------
    feasible : bool or None
        None where it is too close to the boundary to tell.
    reasons : InfeasibilityExplanation or None
        Where the estimate is infeasible.
    lightest : LightestRobot or None
        Where it is feasible.
    intervals : ParameterIntervals or None
        Where it is feasible.
    """

    feasible: bool | None
    reasons: InfeasibilityExplanation | None
    lightest: LightestRobot | None
    intervals: ParameterIntervals | None

    def __str__(self) -> str:
        parts = [part for part in (self.reasons, self.lightest, self.intervals) if part is not None]
        return "\n\n".join(map(str, parts)) or "Too close to the boundary to tell whether it is feasible."

    def to_dict(self) -> dict[str, Any]:
        """As plain data."""
        parts = {"reasons": self.reasons, "lightest": self.lightest, "intervals": self.intervals}
        return {"feasible": self.feasible, **{key: part.to_dict() for key, part in parts.items() if part is not None}}

    def save(self, path: str | Path) -> None:
        """Write it as JSON, numbers that are not finite as null; the file appears whole or not at all."""
        write_json(self.to_dict(), path)


def explain_estimate(
    robot: str | Path, estimate: str | Path, consistency: Literal["full", "inertia"] = "full"
) -> EstimateExplanation:
    """Tell why a saved estimate is impossible, or, where it is possible, what is known of each parameter.

    Parameters
    ----------
    robot : str or Path
        URDF or robot.toml, whose constraints count too.
    estimate : str or Path
        What :meth:`steelyard.Estimate.save` wrote; its base parameters are what counts.
    consistency : {"full", "inertia"}
        See :class:`steelyard.FeasibleSet`.

    Returns
    -------
    EstimateExplanation

    Raises
    ------
    InputError
        If a file cannot be used, or the estimate belongs to another robot.
    """
    _, feasible, loaded = set_and_estimate(robot, estimate, consistency)
    verdict = check(feasible, base=loaded.base)
    if verdict.feasible is False:
        errors = loaded.standard_error
        known = not loaded.filtered_torque and bool(np.all(np.isfinite(errors)) and np.all(errors > 0))
        covariance = np.diag(errors**2) if known else None
        return EstimateExplanation(
            False, explain_infeasibility(feasible, base=loaded.base, covariance=covariance), None, None
        )
    if verdict.feasible is None:
        return EstimateExplanation(None, None, None, None)
    return EstimateExplanation(
        True, None, lightest_robot(feasible, loaded.base), parameter_intervals(feasible, base=loaded.base)
    )
