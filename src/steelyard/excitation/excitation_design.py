"""The result of a design of excitation: the motion, how good it is, and how near it comes to its limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.display import html_table
from steelyard.files import replaced_folder, write_json

from .limit_margins import Margin
from .motion_limits import MotionLimits
from .trajectory import Trajectory, save_trajectory

__all__ = ["FORMAT", "ExcitationDesign", "nearest_first"]

Array = NDArray[np.float64]
FORMAT = "steelyard-excitation-1"


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
        The period that is judged: the series of a Fourier motion without its ramp-up and ramp-down; otherwise the whole
        motion.
    condition_number : float
        Of the base regressor over one period at `rate`, all joints weighted alike and with the exact sign of Coulomb
        friction: the same as :attr:`steelyard.Information.condition_number` of its samples.
    combined_condition_number : float or None
        The same of this motion and the prior information together.
    criterion : {"condition", "d", "a"}
    figure : float
        Of the criterion, for the chosen weights, subset and prior_information: condition number, logarithm of the
        determinant of the information, or trace of its inverse.
    subset : tuple of str
        The parameters that count, where not all do.
    terms : tuple of str
        What the model has at the joints besides rigid links, such as ``"viscous"``.
    parameter_count, base_count : int
        Of the model.
    uncertainty : float
        What torque noise of one percent leaves of the parameters that count (and of the prior information): the
        deviation of their least certain combination in units of the size of all base parameters. Above 1 the motion
        does not identify what was asked, see `identifies`.
    unshown : tuple of str
        In that case the parameters that are at fault, the least certain first.
    unchecked : tuple of str
        What the motion may run into because it was not looked at, in sentences that say why, and what to do.
    limits : MotionLimits
        Less the fraction that was to be left free.
    margins : tuple of Margin
        Of every limit over the whole motion at 1 kHz, the nearest first.
    family, method, status : str
        Status: ``"finished"``, ``"time limit"`` or ``"interrupted"``; the latter two hold the best so far.
    rate : float
        Hz.
    ramp_time : float
        Time of the ramp-up, and of the ramp-down, s.
    seed, starts, finished_starts : int
    remarks : tuple of str
        What the user should know, in sentences.
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
    unshown: tuple[str, ...]
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
    remarks: tuple[str, ...] = ()

    @property
    def identifies(self) -> bool:
        """Whether the motion can identify what was asked, with torque noise of one percent."""
        return self.uncertainty <= 1.0

    @property
    def warnings(self) -> tuple[str, ...]:
        """Those of the remarks that come before all the rest: what the motion does not show, what was not checked."""
        return self.remarks[: bool(self.unshown) + len(self.unchecked)]

    @property
    def start(self) -> dict[str, float]:
        """Where each joint is when the motion begins, rad or m."""
        q = self.trajectory.motion([0.0])[0][0]
        return dict(zip(self.joint_names, q.tolist(), strict=True))

    def sample(self, rate: float) -> tuple[Array, Array, Array, Array]:
        """Return t (S,), q, dq and ddq (S, N) of the period that is judged, at `rate` Hz.

        The whole motion with its ramp-up and ramp-down is ``trajectory.sample(rate)``.
        """
        return self.excitation.sample(rate)

    def save(self, path: str | Path, *, rate: float | None = None) -> None:
        """Write the whole motion, as :func:`steelyard.excitation.save_trajectory` does, with the joints' names."""
        save_trajectory(self.trajectory, path, rate=rate, joint_names=self.joint_names)

    def save_all(self, folder: str | Path) -> tuple[Path, ...]:
        """Write ``trajectory.csv``, ``.parquet``, ``.yaml`` and ``.json`` and ``excite.json`` into a folder.

        Parameters
        ----------
        folder : str or Path
            Made where it is missing; files of the same names are replaced.

        Returns
        -------
        tuple of Path
        """
        names = [*(f"trajectory.{suffix}" for suffix in ("csv", "parquet", "yaml", "json")), "excite.json"]
        with replaced_folder(folder, record=names[-1]) as made:
            for name in names[:-1]:
                self.save(made / name)
            write_json(self.to_dict(), made / names[-1], indent=2)
        return tuple(Path(folder) / name for name in names)

    def to_dict(self) -> dict[str, Any]:
        """Return how the motion came about and what it keeps, as plain data."""
        margins = [
            {"limit": m.name, "part": m.label, "margin": m.clearance, "fraction": m.fraction, "time": m.time}
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
            "unshown": list(self.unshown),
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
        """Return for each constraint its least margin, in units of its scale."""
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
        rows = [(m.name, m.label, f"{m.clearance:.4g}", f"{m.time:.3f}") for m in self.nearest()]
        title = (
            f"{self.robot_name}: {self.family}, {self.trajectory.duration:g} s, "
            f"condition number {self.condition_number:.4g}"
        )
        return html_table(title, ("limit", "nearest part", "margin", "time, s"), rows, self.remarks)


def nearest_first(margins: Sequence[Margin]) -> tuple[Margin, ...]:
    """Sort margins by their fraction of the scale."""
    return tuple(sorted(margins, key=lambda m: m.fraction))
