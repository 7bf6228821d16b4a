"""Forward dynamics in time (thesis section 5.1)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.dynamics import Model
from steelyard.dynamics.threads import one_thread
from steelyard.errors import InputError

from .actuators import Actuators
from .arguments import positive
from .contact import Environment
from .controller import Controller
from .events import Event
from .experiment import Experiment
from .plant import TorqueFunction
from .request import Request
from .sensors import Sensors
from .simulation_result import SimulationResult
from .stopping_conditions import StoppingConditions

__all__ = ["simulate"]


def simulate(
    model: Model,
    parameters: ArrayLike,
    q0: ArrayLike,
    dq0: ArrayLike,
    duration: float,
    torque: TorqueFunction | Controller | None = None,
    *,
    base: bool = False,
    method: str = "automatic",
    relative_tolerance: float = 1e-8,
    absolute_tolerance: float = 1e-10,
    step: float | None = None,
    sign_width: float = 1e-3,
    events: Sequence[Event] | Event = (),
    sample_time: float | None = None,
    sensors: Sensors | None = None,
    actuators: Actuators | None = None,
    environment: Environment | None = None,
    stopping_conditions: StoppingConditions | None = None,
    rate: float | None = None,
    seed: int = 0,
) -> SimulationResult:
    """Simulate a robot, or many at once: the motion that torques, gravity, friction and contact cause.

    A run that cannot be continued ends with a status and the time, not with an exception, and does not stop the others
    of its batch.

    Parameters
    ----------
    model : Model
    parameters : array_like
        (n,), or (n_b,) with `base`; (R, n) for runs of different robots.
    q0, dq0 : array_like
        (N,) at the start, rad or m and per s; (R, N) for R runs.
    duration : float
        s.
    torque : callable, Controller or None
        None: the motors are off. A function of t, q and dq that returns torques (N,), N·m or N, within every step; in
        a batch t is (R, 1) and the others are (R, N). A :class:`Controller` is called once a sample time, and its
        torques are held.
    base : bool
        The parameters are base parameters.
    method : str
        ``"dormand_prince"`` (adaptive, order 5, all the runs of a batch at once), ``"dop853"`` (adaptive, order 8),
        ``"radau"``, ``"bdf"``, ``"lsoda"`` (adaptive, for stiff friction), ``"runge_kutta_4"`` and ``"rosenbrock"``
        (fixed steps, the latter for tight friction in control loops), or ``"automatic"``.
    relative_tolerance, absolute_tolerance : float
        Of the local error of the adaptive methods.
    step : float, optional
        s, largest of the fixed-step methods; where not given 1 ms for ``"runge_kutta_4"`` and 0.25 ms for
        ``"rosenbrock"``.
    sign_width : float
        rad/s or m/s: Coulomb friction is ``Fc v / sqrt(v² + w²)``. 0 for the exact sign, with which joints that stick
        chatter.
    events : Event or sequence of Event
    sample_time : float, optional
        s: calls a torque *function* once a sample time only, and holds what it returns.
    sensors : Sensors, optional
        Between the motion and the controller, and in what is recorded; exact where not given.
    actuators : Actuators, optional
        Between the controller and the joints; ideal where not given.
    environment : Environment, optional
        Such as :class:`ElasticContact`.
    stopping_conditions : StoppingConditions, optional
        Ends a run that leaves its limits.
    rate : float, optional
        Hz, of the samples returned: the control rate where there is one, otherwise 1000 Hz.
    seed : int
        Of the sensors' noise.

    Returns
    -------
    SimulationResult

    Raises
    ------
    InputError
        If something that was given does not fit; never for what happens in the simulation.

    References
    ----------
    Sousa 2014, section 5.1; Dormand and Prince 1980; Verwer, Spee, Blom and Hundsdorfer 1999.

    Examples
    --------
    >>> import numpy as np
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> point_mass = np.zeros(10)
    >>> point_mass[9] = 2.0
    >>> fall = simulate(model, point_mass, q0=[0.0], dq0=[0.0], duration=1.0)
    >>> fall.status.value, bool(np.ptp(fall.energy) < 1e-5)
    ('finished', True)
    """
    positive(relative_tolerance, "relative_tolerance", "1")
    positive(absolute_tolerance, "absolute_tolerance", "rad")
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or seed < 0:
        raise InputError(f"seed must be a whole number of at least 0, got {seed!r}.")
    request = Request(
        model,
        parameters,
        q0,
        dq0,
        duration,
        torque,
        base,
        method,
        sign_width,
        step,
        events,
        sample_time,
        sensors,
        actuators,
        environment,
        stopping_conditions,
        rate,
    )
    options: dict[str, Any] = {
        **request.summary(),
        "relative_tolerance": relative_tolerance,
        "absolute_tolerance": absolute_tolerance,
        "seed": seed,
    }
    # A run that diverges passes through infinity: its status says so, not a warning.
    with one_thread(), np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return Experiment(request, relative_tolerance, absolute_tolerance, seed, options).result()
