"""The result of an excitation design: the motion, its quality, and its margins to the limits."""

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
        The period to which the criterion applies: a Fourier series without its ramp-up and ramp-down; otherwise the
        whole motion.
    condition_number : float
        Condition number of the base regressor over one period at `rate`, with equal weights of all joints and the exact
        sign of Coulomb friction. It equals :attr:`steelyard.Information.condition_number` of the samples.
    combined_condition_number : float or None
        Condition number of this motion and the prior information together.
    criterion : {"condition", "d", "a"}
    figure : float
        Value of the criterion for the chosen weights, subset and prior information: condition number, logarithm of the
        determinant of the information, or trace of its inverse.
    subset : tuple of str
        The parameters that the motion was to identify, where not all were.
    terms : tuple of str
        Terms of the model besides rigid links, such as ``"viscous"``.
    parameter_count, base_count : int
        Numbers of parameters and of base parameters of the model.
    uncertainty : float
        Expected standard deviation, with torque noise of one per cent and the prior information, of the least certain
        combination of the parameters in the subset, relative to the 2-norm of all base parameters. Above 1 the motion
        does not identify what was asked, see `identifies`.
    unidentifiable : tuple of str
        Where the uncertainty is above 1, the parameters that cause it, the least certain first.
    unchecked : tuple of str
        Collisions that were not checked, in sentences with the reason and the remedy.
    limits : MotionLimits
        The limits of the design, reduced by the fraction that was to be left free.
    margins : tuple of Margin
        Margins of every limit over the whole motion at 1 kHz, the smallest first.
    family, method, status : str
        Family of trajectories, method of the search, and how the search ended: ``"finished"``, ``"time limit"`` or
        ``"interrupted"``. In the latter two cases the result is the best motion so far.
    rate : float
        Rate at which the motion will be recorded, Hz.
    ramp_time : float
        Duration of the ramp-up, and of the ramp-down, s.
    seed, starts, finished_starts : int
        Seed of the search, number of starts, and number of starts that were finished.
    remarks : tuple of str
        Remarks for the user, in sentences.
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
    remarks: tuple[str, ...] = ()

    @property
    def identifies(self) -> bool:
        """Whether the motion can identify what was asked, with torque noise of one per cent."""
        return self.uncertainty <= 1.0

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

    def save_all(self, folder: str | Path) -> tuple[Path, ...]:
        """Write ``trajectory.csv``, ``.parquet``, ``.yaml`` and ``.json`` and ``excite.json`` into a folder.

        Parameters
        ----------
        folder : str or Path
            The folder is made where it is missing; files of the same names are replaced.

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
        """Return the options, results and margins of the design as plain data."""
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
        rows = [(m.name, m.label, f"{m.clearance:.4g}", f"{m.time:.3f}") for m in self.nearest()]
        title = (
            f"{self.robot_name}: {self.family}, {self.trajectory.duration:g} s, "
            f"condition number {self.condition_number:.4g}"
        )
        return html_table(title, ("limit", "nearest part", "margin", "time, s"), rows, self.remarks)


def nearest_first(margins: Sequence[Margin]) -> tuple[Margin, ...]:
    """Sort margins by their fraction of the scale, the smallest first."""
    return tuple(sorted(margins, key=lambda m: m.fraction))
