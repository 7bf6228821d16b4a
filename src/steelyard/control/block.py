"""The base class of the model-based controllers: sample time, model, velocity estimator, check of the gains."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.files.arguments import positive
from steelyard.recording.samples import is_finite
from steelyard.simulation import Measurement

from .model_part import ModelPart
from .sampled_loop import Feedback, SampledLoop
from .velocities import NumericalDifference, VelocityEstimator

__all__ = ["ControlBlock"]

Array = NDArray[np.float64]

# The search for a gain margin ends at 1e-3. A margin near this end says that reducing all gains by a common factor does
# not make the loop stable, so that the message names another remedy.
_SMALLEST_MARGIN = 2e-3
# Configurations at which gains are checked. Each takes about 1 ms for seven joints, so that a controller is made within
# some hundredths of a second.
_CHECKED_CONFIGURATIONS = 32


class ControlBlock(ABC):
    """A controller with a model of the robot; see :class:`steelyard.simulation.Controller`.

    A controller checks the stability of its loop near rest, see :class:`SampledLoop`, with the inertia of the robot in
    the model, the sample time and the lag of the velocity estimates. It does so when it is made, at configurations of
    its reference, and once more at the configuration in which it starts. With a reference for a tool it checks random
    configurations, of which half must be stable, because no motion visits all of them.

    Parameters
    ----------
    part : ModelPart
        The functions of the model that the controller calls.
    sample_time : float
        Time between two calls, s.
    velocity : VelocityEstimator, optional
        How velocities are obtained; by numerical differences by default.

    Attributes
    ----------
    sample_time : float
        Time between two calls, s.
    """

    def __init__(self, part: ModelPart, sample_time: float, velocity: VelocityEstimator | None = None) -> None:
        self._part = part
        self.sample_time = positive(sample_time, "sample_time", "s")
        self._velocity = NumericalDifference() if velocity is None else velocity
        self._shape: tuple[int, ...] | None = None

    def __repr__(self) -> str:
        robot = self._part.model.robot
        return f"{type(self).__name__}({robot.name}: {robot.dof} joints, every {self.sample_time:g} s)"

    @property
    def functions(self) -> tuple[str, ...]:
        """Names of the functions of the model that the controller computes each sample time."""
        return self._part.functions

    def generate(self, language: str, directory: str | Path, *, fixed: bool = False) -> tuple[Path, ...]:
        """Write the model part of the controller, its `functions`, as source with a self-test.

        Parameters
        ----------
        language : str
            ``"c"`` or another language of :meth:`steelyard.Model.generate`.
        directory : str or Path
            Folder of the files; made where it is missing.
        fixed : bool
            Whether the parameters of the controller are written as numbers, instead of being an argument.

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

    def gain_margin(self, q: ArrayLike) -> float:
        """Return the factor by which all gains can be multiplied before the loop becomes unstable.

        The robot is taken to be as its model.

        Parameters
        ----------
        q : array_like
            (..., N) configurations, rad or m; the smallest of their margins is returned.

        Returns
        -------
        float
            Below 1 where the loop is unstable as it is, and at most 1000. Infinite where nothing is fed back, or where
            the inertia matrix of the model is not positive definite.
        """
        places = np.asarray(q, dtype=np.float64)
        count = self._part.dof
        if places.ndim == 0 or places.shape[-1] != count or not np.isfinite(places).all():
            raise InputError(f"A gain margin needs finite positions of {count} joints, (..., {count}), got {q!r}.")
        found = self._loop(places.reshape(-1, count))
        return math.inf if found is None else found[0].gain_margin(found[1])

    def _feedback(self, q: Array) -> Feedback | None:
        """Return the linear feedback near rest at configurations (P, N); None where it is not known."""
        return None

    def _loop(self, q: Array) -> tuple[SampledLoop, Feedback] | None:
        """Return the linear loop at configurations (P, N) and its feedback; None where one of them is not known."""
        inertia, friction = self._part.resistance(q)
        # Parameters that no robot can have give no loop that could be checked.
        for matrix in (inertia, self._part.nominal("inertia_matrix", q)):
            if not (np.linalg.eigvalsh(matrix)[:, 0] > 0.0).all():
                return None
        feedback = self._feedback(q)
        if feedback is None:
            return None
        transfer = getattr(self._velocity, "transfer", None)
        known = None if transfer is None else transfer(self.sample_time)
        return SampledLoop(inertia, friction, self.sample_time, known), feedback

    def _check_gains(self, q: Array, share: float = 0.0) -> None:
        """Raise InputError where the loop is unstable at more than a share of configurations (P, N)."""
        places = q[np.isfinite(q).all(axis=1)][:_CHECKED_CONFIGURATIONS]
        found = self._loop(places) if len(places) else None
        if found is None:
            return
        loop, feedback = found
        growth = loop.growth(feedback)
        if np.count_nonzero(~loop.is_stable(feedback)) <= share * len(growth):
            return
        worst = int(np.argmax(growth))
        margin = self.gain_margin(places[[worst]])
        joint = self._part.model.robot.joint_names[loop.fastest(feedback, worst)]
        remedy = (
            f"With all its gains multiplied by {0.5 * margin:.2g} it has a margin of two; lower them where damping "
            "times sample time is above the inertia that it acts on"
            if margin > _SMALLEST_MARGIN
            else "No common factor makes it stable: raise the damping against the other gains"
        )
        raise InputError(
            f"{type(self).__name__} is unstable with these gains on {self._part.model.robot.name}: near rest at "
            f"q = {np.round(places[worst], 3).tolist()} errors grow by a factor of {growth[worst]:.3g} every "
            f"{self.sample_time:g} s, most of all at joint {joint!r}. {remedy}, shorten the sample time, or take "
            "velocities that lag less."
        )

    def start(self, measurement: Measurement) -> None:
        """Forget all state and begin at this measurement.

        Raises
        ------
        InputError
            If the measurement has another number of joints, is not finite, or lacks what the controller reads; or if
            the loop is unstable at this configuration.
        """
        self._shape = None
        self._accept(measurement)
        self._shape = measurement.q.shape
        self._velocity.start(measurement)
        self._check_gains(measurement.q.reshape(-1, self._part.dof))

    def torque(self, measurement: Measurement) -> Array:
        """Return the commanded joint torques (..., N), N·m or N.

        In a batch, a run whose measurement is not finite gets torques that are not finite; the other runs go on.

        Raises
        ------
        InputError
            If the measurement has another shape than the first one, or if that of a single run is not finite.
        """
        self._accept(measurement)
        return self._command(measurement)

    @abstractmethod
    def _command(self, measurement: Measurement) -> Array:
        """Return the torques (..., N) for a measurement that has been checked."""

    def _accept(self, measurement: Measurement) -> None:
        """Check a measurement before any part of the controller keeps it."""
        q, dq, force = measurement.q, measurement.dq, measurement.force
        shape = getattr(q, "shape", None) if self._shape is None else self._shape
        right = isinstance(q, np.ndarray) and q.ndim > 0 and q.shape == shape and q.shape[-1] == self._part.dof
        if not right or q.dtype.kind not in "fi":
            self._refuse("positions", q, f"(..., {self._part.dof})" if self._shape is None else f"{shape}")
        if dq is not None and not (isinstance(dq, np.ndarray) and dq.shape == shape and dq.dtype.kind in "fi"):
            self._refuse("velocities", dq, f"{q.shape}")
        wanted = (*q.shape[:-1], 6)
        if force is not None and not (
            isinstance(force, np.ndarray) and force.shape == wanted and force.dtype.kind in "fi"
        ):
            self._refuse("forces", force, f"{wanted}")
        if not math.isfinite(measurement.t):
            raise InputError(f"The time of a measurement must be a finite number of seconds, got {measurement.t!r}.")
        if q.ndim > 1:  # a run that diverged must not stop the others of its batch
            return
        if not all(values is None or is_finite(values) for values in (q, dq, force)):
            self._stop(measurement)

    def _refuse(self, what: str, found: object, expected: str) -> None:
        kind = (
            f"of shape {found.shape}, {found.dtype}"
            if isinstance(found, np.ndarray)
            else f"as a {type(found).__name__}"
        )
        raise InputError(
            f"The controller is for {self._part.model.robot.name} with {self._part.dof} joints, got {what} "
            f"{kind}; they must be an array of numbers of shape {expected}."
        )

    def _stop(self, measurement: Measurement) -> None:
        """Raise InputError with the part of a measurement that is not finite."""
        names = self._part.model.robot.joint_names
        for what, values in (("position", measurement.q), ("velocity", measurement.dq), ("force", measurement.force)):
            bad = [] if values is None else np.flatnonzero(~np.isfinite(values)).tolist()
            if bad and values is not None:
                whose = f"component {bad[0]}" if what == "force" else f"joint {names[bad[0]]!r}"
                raise InputError(
                    f"At {measurement.t:.6g} s the measured {what} of {whose} is {values[bad[0]]}, so that no torque "
                    "is commanded; stop the robot, or give the last good measurement until the sensor is back."
                )
