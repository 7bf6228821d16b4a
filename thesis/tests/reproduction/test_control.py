"""The experiment of thesis section 5.2, on a simulated arm with the parameters of table 4.9."""

from functools import cache

import numpy as np
import pytest

from steelyard.control import PositionTracking
from steelyard.identification.wam import TRAJECTORIES
from steelyard.simulation import Sensors, Status, StoppingConditions, simulate
from steelyard_thesis.reproduction.published import column as published

B = TRAJECTORIES["B"]
COUNTS = 4096.0 * np.array([42.0, 28.25, 28.25, 18.0, 10.27, 10.27, 14.93])


@pytest.fixture(scope="module")
def run(wam):
    @cache
    def play(column, gains):
        controller = PositionTracking(
            wam,
            published("4.9", column),
            B,
            kp=published(gains, "Kp"),
            kd=published(gains, "Kd"),
            control_start=2.0,
            reference_start=4.0,
            base=True,
        )
        start = B.motion([0.0])[0][0]
        result = simulate(
            wam,
            published("4.9", "WLS_feasible"),
            start,
            0 * start,
            16.5,
            controller,
            base=True,
            sensors=Sensors(encoder_resolution=2 * np.pi / COUNTS),
            stopping_conditions=StoppingConditions(velocity=10.0),
        )
        return controller, result

    return play


@pytest.mark.slow
@pytest.mark.parametrize(
    "column",
    ["WLS_feasible", *(pytest.param(c, marks=pytest.mark.slow) for c in ("WLS_feasible_extra", "WLS_corrected"))],
)
def test_feasible_parameters_track_trajectory_b(run, column):
    controller, result = run(column, "5.1")
    assert result.status is Status.FINISHED
    wanted = np.array([controller.wanted(t) for t in result.t])
    error = result.q - wanted
    still, playing = result.t < 4.0, result.t >= 4.0
    assert np.abs(error[still]).max() < 0.06  # what gravity compensation leaves to friction
    # The lag of the loop without velocity reference, Kd / Kp, and friction make the error.
    speed = np.array([B.motion([min(max(t - 4.0, 0.0), 12.5)])[1][0] for t in result.t[playing]])
    lag = np.array([0.16] * 4 + [0.18] * 3) * np.sqrt(np.mean(speed**2, axis=0))
    rms = np.sqrt(np.mean(error[playing] ** 2, axis=0))
    assert (rms < 3.5 * lag).all()
    assert (rms[:2] < 1.4 * lag[:2]).all()


@pytest.mark.slow
def test_higher_gains_track_better(run):
    found = []
    for gains in ("5.1", "5.2"):
        controller, result = run("WLS_feasible", gains)
        assert result.status is Status.FINISHED
        wanted = np.array([controller.wanted(t) for t in result.t])
        found.append(np.sqrt(np.mean((result.q - wanted)[result.t >= 4.0] ** 2, axis=0)))
    assert (found[1] < 0.5 * found[0]).all()


@pytest.mark.slow
def test_infeasible_parameters_diverge_when_the_reference_moves(run):
    """At rest they hold the arm, as in the thesis, and within half a second of motion the safety stop ends it."""
    _, result = run("WLS", "5.1")
    assert result.status is Status.STOPPED
    assert 4.0 < result.end_time < 4.5
    assert "joint" in result.message
    assert np.abs(result.q[result.t < 4.0] - result.q[0]).max() < 0.06
