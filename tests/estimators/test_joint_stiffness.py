"""Stiffness of a joint from its deflection, against the truth of a spring and a damper that SciPy integrates."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from steelyard.errors import InputError
from steelyard.estimators import DeflectionRows, JointStiffness, estimate_joint_stiffness
from steelyard.estimators.joint_stiffness import stiffness_table

STIFFNESS, DAMPING, INERTIA, WEIGHT, DELAY, ZERO = 900.0, 1.5, 0.6, 5.0, 0.0006, 0.004


@pytest.fixture(scope="module")
def pendulum():
    """Motor and link of a pendulum that hangs on a spring: t, theta, dtheta, ddtheta, q and what it carries."""
    t = np.arange(0.0, 30.0, 0.01)
    theta = 0.8 * np.sin(3 * t) + np.sin(1.1 * t) + 0.3 * np.sin(5.3 * t)
    speed = 2.4 * np.cos(3 * t) + 1.1 * np.cos(1.1 * t) + 1.59 * np.cos(5.3 * t)
    acceleration = -7.2 * np.sin(3 * t) - 1.21 * np.sin(1.1 * t) - 8.427 * np.sin(5.3 * t)

    def spring(time, q, dq):
        place = 0.8 * np.sin(3 * time) + np.sin(1.1 * time) + 0.3 * np.sin(5.3 * time)
        velocity = 2.4 * np.cos(3 * time) + 1.1 * np.cos(1.1 * time) + 1.59 * np.cos(5.3 * time)
        return STIFFNESS * (place - q) + DAMPING * (velocity - dq)

    def rate(time, state):
        return [state[1], (spring(time, *state) - WEIGHT * np.cos(state[0])) / INERTIA]

    start = [-WEIGHT / STIFFNESS, speed[0]]
    found = solve_ivp(rate, (0.0, 30.0), start, rtol=1e-8, atol=1e-10, dense_output=True)
    q, dq = found.sol(t)
    late = found.sol(np.maximum(t - DELAY, 0.0))[0]
    return t, theta, speed, acceleration, q, late, spring(t, q, dq)


def rows_of(pendulum, noise):
    t, theta, speed, acceleration, q, late, torque = pendulum
    random = np.random.default_rng(3)
    deflection = theta - late + ZERO + noise * random.normal(size=t.size)
    return DeflectionRows(deflection, speed, acceleration, q, torque, np.gradient(torque, t))


@pytest.mark.slow
def test_stiffness_damping_zero_and_delay_are_found_together(pendulum):
    found = estimate_joint_stiffness("elbow", rows_of(pendulum, 3e-4))
    low, high = found.stiffness_interval
    assert found.verdict == "measured"
    assert abs(found.stiffness / STIFFNESS - 1.0) < 0.01
    assert low < STIFFNESS < high < 1.05 * low
    assert abs(found.delay - DELAY) < 3e-5
    assert abs(found.zeros[0] - ZERO) < 1e-4
    assert 0.0 <= DAMPING <= found.damping_bound
    # Where the delay is not looked for, it stands in the residual.
    slow = estimate_joint_stiffness("elbow", rows_of(pendulum, 3e-4), delay_is_given=True)
    assert slow.unexplained > 2 * found.unexplained


def test_the_inertia_of_the_motor_is_found_where_it_is_not_known(pendulum):
    """The torque is computed with a wrong split between link and motor, which the deflection corrects."""
    rows = rows_of(pendulum, 1e-5)
    wrong = DeflectionRows(
        rows.deflection, rows.velocity, rows.acceleration, rows.position, rows.torque + 0.2 * rows.acceleration,
        rows.torque_rate,
    )  # fmt: skip
    found = estimate_joint_stiffness("elbow", wrong, motor_inertia=0.1, motor_inertia_error=np.inf)
    # 0.2 of the motor's 0.3 kg m² were counted to the link, of which 0.1 is known.
    assert abs(found.stiffness / STIFFNESS - 1.0) < 0.01
    assert abs(found.motor_inertia - 0.3) < 4 * found.motor_inertia_standard_error + 0.005


@pytest.mark.parametrize("noise", [1e-5, 3e-3])
def test_an_inertia_that_torques_tell_poorly_is_weighed_against_the_deflection(pendulum, noise):
    """Torques tell the inertia of a motor of 0.3 kg m² as 0.1, and have a standard error of 0.15."""
    rows = rows_of(pendulum, noise)
    wrong = replace(rows, torque=rows.torque + 0.2 * rows.acceleration)
    found = estimate_joint_stiffness("elbow", wrong, motor_inertia=0.1, motor_inertia_error=0.15)
    alone = estimate_joint_stiffness("elbow", wrong, motor_inertia=0.1, motor_inertia_error=np.inf)
    taken = estimate_joint_stiffness("elbow", wrong, motor_inertia=0.1)
    assert abs(found.motor_inertia - 0.3) < 3.0 * found.motor_inertia_standard_error + 0.005
    assert found.motor_inertia_standard_error < min(0.15, alone.motor_inertia_standard_error) + 1e-9
    assert found.compliance_standard_error < 1.001 * alone.compliance_standard_error
    low, high = found.stiffness_interval
    assert low < STIFFNESS < high
    if noise < 1e-4:
        assert abs(found.stiffness / STIFFNESS - 1.0) < 0.005
        assert not taken.stiffness_interval[0] < STIFFNESS < taken.stiffness_interval[1]


def test_a_torque_of_acceleration_alone_leaves_the_scatter_of_the_inertia_to_the_stiffness(pendulum):
    """Nothing but the torques tells motor and link apart there: 0.6 kg m² of a link beside 0.06 of uncertainty."""
    rows = rows_of(pendulum, 0.0)
    noise = 1e-6 * np.random.default_rng(5).normal(size=rows.torque.size)
    torque = INERTIA * rows.acceleration
    spun = replace(rows, deflection=torque / STIFFNESS + noise, torque=torque, torque_rate=0.0 * torque)
    found = estimate_joint_stiffness("elbow", spun, motor_inertia=0.3, motor_inertia_error=0.06, encoder_errors="none")
    assert abs(found.stiffness / STIFFNESS - 1.0) < 0.01
    assert abs(found.compliance_standard_error * STIFFNESS - 0.1) < 0.01
    assert found.motor_inertia_standard_error == pytest.approx(0.06, rel=0.05)


def test_a_deflection_below_the_resolution_gives_a_lower_bound(pendulum):
    found = estimate_joint_stiffness("elbow", rows_of(pendulum, 0.2))
    low, high = found.stiffness_interval
    assert (found.verdict, high) == ("bounded", np.inf)
    assert 0.0 < low < STIFFNESS
    assert "is at least" in found.sentence


def test_a_spring_that_pulls_the_wrong_way_is_no_spring(pendulum):
    rows = rows_of(pendulum, 1e-5)
    swapped = DeflectionRows(
        -rows.deflection, rows.velocity, rows.acceleration, rows.position, rows.torque, rows.torque_rate
    )
    with pytest.raises(InputError, match="the encoders stand in each other's place, or the torque has the wrong sign"):
        estimate_joint_stiffness("elbow", swapped, encoder_errors="none")


def test_what_the_log_tells_to_five_percent_is_told_as_an_interval():
    near = JointStiffness.of_compliance("elbow", 1e-3, 5e-6, "N·m/rad")
    wide = JointStiffness.of_compliance("elbow", 1.0123e-3, 3e-5, "N·m/rad")
    assert near.sentence == "elbow: the stiffness is 1000 N·m/rad, 95 % interval 990.3 to 1010."
    assert wide.sentence == "elbow: the stiffness lies between 933.6 and 1049 N·m/rad (95 %), at best near 990."
    assert [row[2] for row in stiffness_table([near, wide])[1]] == ["1000", "near 990"]


def test_it_is_kept_in_files(pendulum):
    found = estimate_joint_stiffness("elbow", rows_of(pendulum, 0.2))
    read = JointStiffness.from_dict(json.loads(json.dumps(found.to_dict())))
    assert read.sentence == found.sentence
    assert read.stiffness_interval == found.stiffness_interval
    with pytest.raises(InputError, match="'delay' of an elastic joint is 'soon'; identify it anew"):
        JointStiffness.from_dict({**found.to_dict(), "delay": "soon"}, "estimate.json")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"deflection": np.full(3000, 0.1)}, "both are one encoder"),
        ({"torque": np.ones(3000)}, "carries a constant torque"),
    ],
)
def test_what_shows_no_stiffness_is_refused(pendulum, change, message):
    rows = rows_of(pendulum, 1e-5)
    with pytest.raises(InputError, match=f"^elbow: .*{message}"):
        estimate_joint_stiffness("elbow", DeflectionRows(**{**vars(rows), **change}))
