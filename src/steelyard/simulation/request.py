"""The checked arguments of a simulation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.files.arguments import positive

from .actuators import Actuators
from .contact import Contact, Environment
from .controller import Controller
from .events import Event
from .integrators import FIXED_STEP_METHODS, LIBRARY_METHODS
from .sensors import Sensors
from .stopping_conditions import StoppingConditions

__all__ = ["METHODS", "Request"]

Array = NDArray[np.float64]
METHODS = ("automatic", "dormand_prince", *LIBRARY_METHODS, *FIXED_STEP_METHODS)
DEFAULT_RATE = 1000.0  # Hz, of the output samples
# Largest steps, s. With 0.25 ms `rosenbrock` is within 5e-6 rad of Radau in a loop at 1 kHz with the friction of a WAM
# (sign width 1e-4 rad/s), at 0.25 s of computing for 10 s; with 1 ms it is within 7e-5 rad.
DEFAULT_STEP = {"runge_kutta_4": 1e-3, "rosenbrock": 2.5e-4}


@dataclass
class Request:
    """The arguments of :func:`steelyard.simulate`, checked and converted.

    Parameters
    ----------
    model, parameters, q0, dq0, duration, torque, base, method, sign_width, step, events, sample_time, sensors, \
actuators, environment, stopping_conditions, rate
        See :func:`steelyard.simulate`.

    Raises
    ------
    InputError
        If an argument does not fit.
    """

    model: Model
    parameters: Any
    q0: Any
    dq0: Any
    duration: float
    torque: Any
    base: bool
    method: str
    sign_width: float
    step: float | None
    events: Any
    sample_time: float | None
    sensors: Sensors | None
    actuators: Actuators | None
    environment: Environment | None
    stopping_conditions: StoppingConditions | None
    rate: float | None

    def __post_init__(self) -> None:
        self.duration = positive(self.duration, "duration", "s")
        self._arrays()
        self._torque()
        self._classes()
        if isinstance(self.sign_width, bool) or not (np.isfinite(self.sign_width) and self.sign_width >= 0.0):
            raise InputError(f"sign_width must be at least 0 rad/s (0: the exact sign), got {self.sign_width!r}.")
        if self.method not in METHODS:
            raise InputError(f"method must be one of {', '.join(METHODS)}, got {self.method!r}.")
        if self.method == "automatic":
            self.method = self._best_method()
        if self.step is not None:
            positive(self.step, "step", "s")
            if self.method not in FIXED_STEP_METHODS:
                raise InputError(
                    f"step is for the fixed-step methods ({', '.join(FIXED_STEP_METHODS)}); {self.method} chooses its "
                    "own by relative_tolerance and absolute_tolerance."
                )
        self._rates()

    def _arrays(self) -> None:
        n = self.model.dof
        given = {"q0": self.q0, "dq0": self.dq0, "parameters": self.parameters}
        arrays: dict[str, Array] = {}
        for name, value in given.items():
            try:
                arrays[name] = np.array(value, dtype=np.float64)
            except (TypeError, ValueError):
                raise InputError(f"{name} must be an array of numbers, got {type(value).__name__}.") from None
        size = self.model.base_parameters().count if self.base else self.model.parameter_count
        kind = "base parameters" if self.base else "parameters"
        for name, width, what in (("q0", n, "joints"), ("dq0", n, "joints"), ("parameters", size, kind)):
            shape = arrays[name].shape
            if len(shape) not in (1, 2) or shape[-1] != width:
                raise InputError(
                    f"{self.model.robot.name} has {width} {what}: {name} must have shape ({width},), or (R, {width}) "
                    f"for R runs, got {shape}."
                )
        self._refuse_unknown(arrays)
        sizes = {len(a) for a in arrays.values() if a.ndim == 2}
        if len(sizes) > 1:
            shapes = ", ".join(f"{name} {a.shape}" for name, a in arrays.items())
            raise InputError(f"q0, dq0 and parameters must agree on the number of runs, got {shapes}.")
        self.is_batch = bool(sizes)
        self.runs = sizes.pop() if sizes else 1
        if self.runs == 0:
            raise InputError("A batch needs one run at least, got none.")
        self.each = arrays["parameters"].ndim == 2
        self.parameters = arrays["parameters"]
        self.state = np.concatenate([np.broadcast_to(arrays[name], (self.runs, n)) for name in ("q0", "dq0")], axis=1)

    def _refuse_unknown(self, arrays: dict[str, Array]) -> None:
        for name, array in arrays.items():
            if np.isfinite(array).all():
                continue
            if name == "parameters" and not self.base:
                unknown = np.flatnonzero(~np.isfinite(np.atleast_2d(array)).all(axis=0))
                names = [self.model.parameter_names[k] for k in unknown]
                listed = ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")
                raise InputError(
                    f"The parameters {listed} of {self.model.robot.name} are not finite numbers; "
                    "give an estimate, or values for what the description leaves out."
                )
            raise InputError(
                f"{name} must be finite, got {array.tolist() if array.size < 20 else 'values that are not'}."
            )

    def _torque(self) -> None:
        torque = self.torque
        self.controller: Controller | None = None
        self.function: Callable[..., Any] | None = None
        if self.sample_time is not None:
            positive(self.sample_time, "sample_time", "s")
        if torque is None:
            if self.sample_time is not None:
                raise InputError("sample_time is for a torque; without one (motors off) leave it out, or give rate.")
        elif isinstance(torque, Controller):
            own = positive(torque.sample_time, f"sample time of {type(torque).__name__}", "s")
            if self.sample_time not in (None, own):
                raise InputError(
                    f"{type(torque).__name__} works at a sample time of {own:.6g} s, but sample_time is "
                    f"{self.sample_time:.6g}; leave it out."
                )
            self.controller, self.sample_time = torque, own
        elif callable(torque):
            self.function = torque
        else:
            raise InputError(
                "torque must be None (motors off), a function of t, q and dq, or a controller with sample_time, start "
                f"and torque, got {type(torque).__name__}."
            )
        if self.actuators is not None and self.sample_time is None:
            raise InputError(
                "actuators act on torques that are held; give a controller, or a sample_time for the function."
            )

    def _classes(self) -> None:
        for value, kind, name in (
            (self.sensors, Sensors, "sensors"),
            (self.actuators, Actuators, "actuators"),
            (self.stopping_conditions, StoppingConditions, "stopping_conditions"),
        ):
            if value is not None and not isinstance(value, kind):
                raise InputError(f"{name} must be a {kind.__name__} object, got {type(value).__name__}.")
        events = (self.events,) if isinstance(self.events, Event) else tuple(self.events)
        for event in events:
            if not isinstance(event, Event):
                raise InputError(f"events must be Event objects, got {type(event).__name__}; wrap a function in Event.")
        self.events: Sequence[Event] = events
        self.contact = None if self.environment is None else Contact(self.model, self.environment)

    def _best_method(self) -> str:
        """Choose a method; docs/how-to/simulate.md has the measurements behind the choice."""
        if not self._has_coulomb_friction():
            return "runge_kutta_4" if self.sample_time is not None else "dormand_prince"
        return "rosenbrock" if self.sample_time is not None or self.is_batch else "radau"

    def _has_coulomb_friction(self) -> bool:
        """Return whether there is Coulomb friction: torques that jump where a velocity changes its sign."""
        n, rows = self.model.dof, np.atleast_2d(self.parameters)
        kernel = self.model.kernel("drive_torque", base=self.base)
        # Velocities so small that viscous friction is far below 1e-9 N·m, and different for each joint, so that jumps
        # of coupled joints do not cancel.
        slow, still = 1e-12 * (1.0 + np.arange(n) / 7.0), np.zeros(n)
        jumps = [kernel.sample(still, slow, still, p) - kernel.sample(still, -slow, still, p) for p in rows]
        return bool(np.abs(jumps).max(initial=0.0) > 1e-9)

    def _rates(self) -> None:
        """Choose the ticks, at which torques are set and stopping conditions checked, and the samples among them."""
        if self.rate is not None:
            positive(self.rate, "rate", "Hz")
        self.is_ticked = (
            self.sample_time is not None or self.stopping_conditions is not None or self.method in FIXED_STEP_METHODS
        )
        if self.sample_time is None:
            self.tick = 1.0 / (DEFAULT_RATE if self.rate is None else self.rate)
            self.every = 1
        else:
            self.tick = self.sample_time
            ratio = 1.0 if self.rate is None else 1.0 / (self.rate * self.sample_time)
            self.every = round(ratio)
            if self.every < 1 or abs(ratio - self.every) > 1e-6 * ratio:
                raise InputError(
                    f"rate must be the control rate {1.0 / self.sample_time:.6g} Hz divided by a whole number, "
                    f"got {self.rate:.6g} Hz."
                )
        count = int(np.ceil(self.duration / self.tick - 1e-9))
        self.ticks = np.minimum(np.arange(count + 1) * self.tick, self.duration)
        if self.ticks[-1] - self.ticks[-2] < 1e-6 * self.tick:
            self.ticks = np.append(self.ticks[:-2], self.duration)
        self.times = self.ticks[:: self.every]
        self.largest_step = DEFAULT_STEP.get(self.method, 0.0) if self.step is None else self.step

    def summary(self) -> dict[str, ArrayLike | str | None]:
        """Return the options in plain numbers and texts."""
        return {
            "duration": self.duration,
            "method": self.method,
            "base": self.base,
            "sign_width": self.sign_width,
            "step": self.largest_step if self.method in FIXED_STEP_METHODS else None,
            "sample_time": self.sample_time,
            "rate": 1.0 / (self.tick * self.every),
            "runs": self.runs if self.is_batch else None,
            "torque": "none" if self.torque is None else type(self.torque).__name__,
        }
