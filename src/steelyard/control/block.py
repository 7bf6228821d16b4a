"""What all the model-based controllers share: a sample time, a model part, a velocity estimator."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.simulation import Measurement
from steelyard.simulation.arguments import positive

from .model_part import ModelPart
from .sampled_loop import Feedback, SampledLoop
from .velocities import NumericalDifference, VelocityEstimator

__all__ = ["ControlBlock"]

Array = NDArray[np.float64]

_SMALLEST = 2e-3  # of gain margins that mean something: the search ends at 1e-3
_LOOKED_AT = 32  # configurations at which gains are checked; about 1 ms each for seven joints


class ControlBlock(ABC):
    """A controller with a model of the robot; see :class:`steelyard.simulation.Controller`.

    Its gains are checked against the inertia of the robot in the model, the sample time and the lag of the velocities:
    when it is made, at configurations of its reference (where that is of a tool, at random ones, of which it must hold
    half), and once more where it starts. What is checked is the linear loop near rest, see :class:`SampledLoop`.

    Parameters
    ----------
    part : ModelPart
        What it computes of the model.
    sample_time : float
        Time between two calls, s.
    velocity : VelocityEstimator, optional
        Numerical differences where not given.

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

    def gain_margin(self, q: ArrayLike) -> float:
        """Return by what factor all gains may grow before the loop is unstable, on a robot that is as the model says.

        Parameters
        ----------
        q : array_like
            (..., N) configurations, rad or m; the smallest margin of them counts.

        Returns
        -------
        float
            Below 1 where the loop is unstable as it is; at most 1000, and infinite where nothing is fed back or the
            inertia in the model is not that of a robot.
        """
        places = np.asarray(q, dtype=np.float64)
        count = self._part.dof
        if places.ndim == 0 or places.shape[-1] != count or not np.isfinite(places).all():
            raise InputError(f"A gain margin needs finite positions of {count} joints, (..., {count}), got {q!r}.")
        found = self._loop(places.reshape(-1, count))
        return math.inf if found is None else found[0].gain_margin(found[1])

    def _feedback(self, q: Array) -> Feedback | None:
        """Return what the controller feeds back near rest at configurations (P, N); None where that is not known."""
        return None

    def _loop(self, q: Array) -> tuple[SampledLoop, Feedback] | None:
        """Return the loop at configurations (P, N) and the feedback in it; None where nothing is known of either."""
        inertia, friction = self._part.resistance(q)
        # Parameters that no robot can have say nothing about a robot: there is nothing to check against.
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
        """Refuse gains with which the loop is unstable at more than a share of configurations (P, N)."""
        places = q[np.isfinite(q).all(axis=1)][:_LOOKED_AT]
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
            if margin > _SMALLEST
            else "No common factor makes it stable: raise the damping against the other gains"
        )
        raise InputError(
            f"{type(self).__name__} is unstable with these gains on {self._part.model.robot.name}: near rest at "
            f"q = {np.round(places[worst], 3).tolist()} errors grow by a factor of {growth[worst]:.3g} every "
            f"{self.sample_time:g} s, most of all at joint {joint!r}. {remedy}, shorten the sample time, or take "
            "velocities that "
            "lag less."
        )

    def start(self, measurement: Measurement) -> None:
        """Forget all state and begin at this measurement.

        Raises
        ------
        InputError
            If it is of another number of joints, not finite, or lacks what the controller reads; if the loop is
            unstable there.
        """
        self._shape = None
        self._accept(measurement)
        self._shape = measurement.q.shape
        self._velocity.start(measurement)
        self._check_gains(measurement.q.reshape(-1, self._part.dof))

    def torque(self, measurement: Measurement) -> Array:
        """Return the commanded joint torques (..., N), N·m or N.

        In a batch, a run whose measurement is not a number gets torques that are not numbers; the others go on.

        Raises
        ------
        InputError
            If the measurement is of another shape than the first, or, of a single run, not finite.
        """
        self._accept(measurement)
        return self._command(measurement)

    @abstractmethod
    def _command(self, measurement: Measurement) -> Array:
        """Return the torques (..., N) of a measurement that was accepted."""

    def _accept(self, measurement: Measurement) -> None:
        """Refuse what would make wrong torques, before anything remembers it."""
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
        # A sum is finite only if all of its terms are, and costs a third of looking at each of them.
        known = q.sum() + (0.0 if dq is None else dq.sum()) + (0.0 if force is None else force.sum())
        if not math.isfinite(known):
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
        """Say what of a measurement is not a number."""
        names = self._part.model.robot.joint_names
        for what, values in (("position", measurement.q), ("velocity", measurement.dq), ("force", measurement.force)):
            bad = [] if values is None else np.flatnonzero(~np.isfinite(values)).tolist()
            if bad and values is not None:
                whose = f"component {bad[0]}" if what == "force" else f"joint {names[bad[0]]!r}"
                raise InputError(
                    f"At {measurement.t:.6g} s the measured {what} of {whose} is {values[bad[0]]}, so that no torque "
                    "is commanded; stop the robot, or give the last good measurement until the sensor is back."
                )
