"""A demonstration: a seven-joint arm with drives picks something up, and says what it weighs while it moves on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from steelyard.display import text_table
from steelyard.dynamics import Model
from steelyard.identification.wam import TRAJECTORIES, measured, true_parameters, wam_model
from steelyard.robot import Inertia

from .change_detector import Change
from .online_estimator import OnlineEstimator
from .online_payload import OnlinePayload, OnlinePayloadEstimate

__all__ = ["PickUp", "PickUpRun", "simulated_pick_up", "watch_pick_up"]

Array = NDArray[np.float64]

SHOWN = (0.3, 0.5, 1.0, 2.0, 3.0, 5.0)
"""s after the payload was picked up, at which the table shows what is known of it."""


@dataclass(frozen=True, eq=False)
class PickUp:
    """The measurements of a simulated arm that picks something up.

    Attributes
    ----------
    model : Model
    t : ndarray
        (S,) s.
    q, torque : ndarray
        (S, N).
    when : float
        s, from which the payload hangs on the last link.
    payload : Inertia
        In the frame of the last link.
    """

    model: Model = field(repr=False)
    t: Array = field(repr=False)
    q: Array = field(repr=False)
    torque: Array = field(repr=False)
    when: float
    payload: Inertia


@dataclass(frozen=True, eq=False)
class PickUpRun:
    """The estimates of the payload of a `PickUp`, with the times at which they were made.

    Attributes
    ----------
    simulated : PickUp
    changes : tuple of Change
        That were noticed.
    told : tuple of OnlinePayloadEstimate
        What was known of the payload, one after the other.
    times : ndarray
        (len(told),) when, s after the pick-up; the delay of the filter is part of it.
    """

    simulated: PickUp
    changes: tuple[Change, ...]
    told: tuple[OnlinePayloadEstimate, ...] = field(repr=False)
    times: Array = field(repr=False)

    def at(self, seconds: float) -> OnlinePayloadEstimate | None:
        """Return the estimate at a time (s) after the pick-up; None where there was none yet."""
        known = np.flatnonzero(self.times <= seconds + 1e-9)
        return self.told[int(known[-1])] if len(known) else None

    def __str__(self) -> str:
        payload = self.simulated.payload
        rows = []
        for seconds in SHOWN:
            found = self.at(seconds)
            if found is not None and seconds <= self.times[-1] + 1e-9:
                cells = [
                    f"{one.value:.3g} ({one.lower:.3g} to {one.upper:.3g})"
                    for one in (found[name] for name in ("mass", "cx", "cy", "cz", "Izz"))
                ]
                rows.append((f"{seconds:g} s", *cells))
        truth = (payload.mass, *payload.com, payload.about_com[2, 2])
        rows.append(("true", *(f"{value:.3g}" for value in truth)))
        table = text_table(("after", "mass kg", "cx m", "cy m", "cz m", "Izz kg m²"), rows)
        noticed = [
            f"Noticed {change.noticed - self.simulated.when:.2f} s of motion after it was picked up, by "
            f"{', '.join(change.joint_names)}."
            for change in self.changes
        ]
        return "\n".join([table, *noticed])


def simulated_pick_up(
    seed: int = 2014, *, mass: float = 2.0, when: float = 25.0, duration: float = 31.0, rate: float = 1000.0
) -> PickUp:
    """Simulate the WAM arm of the thesis on trajectory A, on which it picks something up.

    It follows the motion, from a random phase of it, with encoders and torques as in `steelyard demo`. The payload is a
    box of random size, at a random place within 3 cm of 8 cm before the last joint.

    Parameters
    ----------
    seed : int
    mass : float
        kg, of the payload.
    when, duration : float
        s, of the pick-up and of the whole.
    rate : float
        Hz.

    Examples
    --------
    >>> found = simulated_pick_up(1, when=0.5, duration=1.0)
    >>> found.q.shape, found.payload.mass
    ((1000, 7), 2.0)
    """
    random = np.random.default_rng([seed, 8])
    model, alone = wam_model(), true_parameters()
    trajectory = TRAJECTORIES["A"]
    count, start = round(duration * rate), random.uniform(0.0, 12.5)
    t = np.arange(count) / rate
    q, dq, ddq = trajectory.motion(start + t)
    place = np.array([0.0, 0.0, 0.08]) + random.uniform(-0.03, 0.03, 3)
    half = random.uniform(0.03, 0.07, 3) ** 2
    payload = Inertia.from_com(mass, place, mass / 3.0 * np.diag(half.sum() - half))
    loaded = alone.copy()
    loaded[np.asarray(model.link_columns[-1])] += payload.parameters
    torque = model.inverse_dynamics(q, dq, ddq, alone)
    held = t >= when
    torque[held] = model.inverse_dynamics(q[held], dq[held], ddq[held], loaded)
    return PickUp(model, t, *measured(q, torque, random.standard_normal(q.shape), rate), when, payload)


def watch_pick_up(
    simulated: PickUp, *, every: float = 0.1, progress: Callable[[OnlinePayloadEstimate], None] | None = None
) -> PickUpRun:
    """Let an estimator see a simulated arm sample by sample, and write down what it knows of the payload.

    Parameters
    ----------
    simulated : PickUp
    every : float
        s between answers.
    progress : callable, optional
        Called with each answer.

    Examples
    --------
    >>> run = watch_pick_up(simulated_pick_up(1, when=8.0, duration=10.0))
    >>> bool(1.7 < run.told[-1].mass < 2.3)
    True
    """
    estimator = OnlineEstimator(simulated.model, detect_changes=True)
    payload = OnlinePayload(estimator)
    spacing = float(simulated.t[1] - simulated.t[0])
    chunk = max(1, round(every / spacing))
    told, times = [], []
    for start in range(0, len(simulated.t), chunk):
        part = slice(start, start + chunk)
        estimator.update(simulated.t[part], simulated.q[part], simulated.torque[part])
        found = payload.estimate()
        if found is not None:
            told.append(found)
            times.append(float(simulated.t[part][-1]) + spacing - simulated.when)
            if progress is not None:
                progress(found)
    return PickUpRun(simulated, tuple(estimator.changes), tuple(told), np.array(times))
