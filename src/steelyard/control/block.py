"""What all the model-based controllers share: a period, a model part, a velocity estimator."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.simulation import Measurement

from .gains import positive
from .model_part import ModelPart
from .velocities import NumericalDifference, VelocityEstimator

__all__ = ["ControlBlock"]

Array = NDArray[np.float64]


class ControlBlock(ABC):
    """A controller with a model of the robot; see :class:`steelyard.simulation.Controller`.

    Parameters
    ----------
    part : ModelPart
        What it computes of the model.
    period : float
        Time between two calls, s.
    velocity : VelocityEstimator, optional
        Numerical differences where not given.

    Attributes
    ----------
    period : float
        Time between two calls, s.
    """

    def __init__(self, part: ModelPart, period: float, velocity: VelocityEstimator | None = None) -> None:
        self._part = part
        self.period = positive(period, "period")
        self._velocity = NumericalDifference() if velocity is None else velocity

    def __repr__(self) -> str:
        robot = self._part.model.robot
        return f"{type(self).__name__}({robot.name}: {robot.dof} joints, every {self.period:g} s)"

    @property
    def functions(self) -> tuple[str, ...]:
        """Names of the functions of the model that the controller computes each period."""
        return self._part.functions

    def generate(self, language: str, directory: str | Path, *, fixed: bool = False) -> tuple[Path, ...]:
        """Write the model part of the controller, its `functions`, as source with a self-test.

        Parameters
        ----------
        language : str
            ``"c"`` or another language of :meth:`steelyard.Model.generate`.
        directory : str or Path
            Where the files go; made where it is missing.
        fixed : bool
            Whether the controller's parameters stand in the source as numbers, instead of an argument.

        Returns
        -------
        tuple of Path
            The files.

        Raises
        ------
        InputError
            If the language is unknown, or the directory cannot be written.
        """
        return self._part.generate(language, directory, fixed=fixed)

    def start(self, measurement: Measurement) -> None:
        """Forget all state and begin at this measurement.

        Raises
        ------
        InputError
            If it is of another number of joints, or lacks what the controller reads.
        """
        count = self._part.joint_count
        if measurement.q.ndim == 0 or measurement.q.shape[-1] != count:
            raise InputError(
                f"The controller is for {self._part.model.robot.name} with {count} joints, got positions of shape "
                f"{measurement.q.shape}."
            )
        self._velocity.start(measurement)

    @abstractmethod
    def torque(self, measurement: Measurement) -> Array:
        """Return the commanded joint torques (..., N), N·m or N."""
