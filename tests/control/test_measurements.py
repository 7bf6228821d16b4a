"""What a loop of one's own hands to a controller: arrays that are written again, gaps, wrong shapes, moving starts."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.control import (
    ComputedTorque,
    FeedforwardTracking,
    FilteredDifference,
    ImpedanceControl,
    MeasuredVelocity,
    NumericalDifference,
    Tool,
)
from steelyard.simulation import Measurement

ESTIMATORS = (
    lambda: NumericalDifference(),
    lambda: NumericalDifference(steps=3, order=2),
    lambda: FilteredDifference(50.0),
)


@pytest.mark.parametrize("make", ESTIMATORS)
def test_one_array_may_serve_every_measurement(make):
    """Joints at 1 and -2 rad/s, whose positions are written into the same array."""
    estimator, buffer = make(), np.zeros(2)
    for k in range(200):
        buffer[:] = 0.001 * k * np.array([1.0, -2.0])
        seen = Measurement(t=0.001 * k, q=buffer)
        if k == 0:
            estimator.start(seen)
        found = estimator.velocity(seen)
        buffer[:] = 77.0  # the caller does what it likes between two calls
    np.testing.assert_allclose(found, [1.0, -2.0], rtol=1e-9)


def test_the_force_is_copied(six, random, bent):
    model, parameters, plant, link = six
    q, dq = bent(model, random)

    def torques(reuse):
        controller = ImpedanceControl(
            model, parameters, Tool(link), plant.pose(q), stiffness=100.0, damping=10.0, inertia=2.0
        )
        buffer, found = np.zeros(6), []
        for k in range(3):
            buffer = buffer if reuse else np.zeros(6)
            buffer[:] = 5.0 * k
            seen = Measurement(t=0.001 * k, q=q, dq=dq, force=buffer)
            if k == 0:
                controller.start(seen)
            found.append(controller.torque(seen).copy())
        return np.array(found)

    np.testing.assert_array_equal(torques(True), torques(False))


@pytest.mark.parametrize("make", ESTIMATORS)
def test_estimates_begin_at_the_measured_velocity(make):
    estimator = make()
    moving = Measurement(t=0.0, q=np.zeros(2), dq=np.array([0.7, -1.2]))
    estimator.start(moving)
    np.testing.assert_array_equal(estimator.velocity(moving), [0.7, -1.2])
    estimator.start(Measurement(t=0.0, q=np.zeros(2)))
    np.testing.assert_array_equal(estimator.velocity(Measurement(t=0.0, q=np.zeros(2))), 0.0)
    again = make()
    again.start(moving)
    for k in range(1, 100):
        found = again.velocity(Measurement(t=0.001 * k, q=0.001 * k * np.array([0.7, -1.2])))
        np.testing.assert_allclose(found, [0.7, -1.2], rtol=1e-9)


def test_the_first_torque_of_a_moving_robot_has_no_kick(six, random, bent):
    """On the reference, at its velocity, the torques are those of inverse dynamics, by Pinocchio."""
    model, parameters, plant, _ = six
    q, dq = bent(model, random)
    ddq = random.normal(size=6)
    needed = plant.pin.rnea(plant.model, plant.data, q, dq, ddq)
    for make in ESTIMATORS:
        controller = ComputedTorque(model, parameters, lambda t: (q, dq, ddq), kp=400.0, kd=40.0, velocity=make())
        seen = Measurement(t=0.0, q=q, dq=dq)
        controller.start(seen)
        np.testing.assert_allclose(controller.torque(seen), needed, atol=1e-9)


def hold(six, **options):
    model, parameters, *_ = six
    return FeedforwardTracking(model, parameters, np.full(6, 0.5), kp=20.0, kd=1.0, **options)


def test_what_is_not_a_number_stops_with_its_name(six):
    controller, q = hold(six), np.full(6, 0.4)
    controller.start(Measurement(t=0.0, q=q))
    before = controller.torque(Measurement(t=0.001, q=q + 0.001))
    bad = q.copy()
    bad[2] = np.nan
    with pytest.raises(sy.InputError, match=r"At 0.002 s the measured position of joint 'elbow_joint' is nan"):
        controller.torque(Measurement(t=0.002, q=bad))
    with pytest.raises(sy.InputError, match=r"measured velocity of joint 'wrist_3_joint' is inf"):
        controller.torque(Measurement(t=0.002, q=q, dq=np.array([0.0] * 5 + [np.inf])))
    with pytest.raises(sy.InputError, match="measured force of component 3 is nan"):
        controller.torque(Measurement(t=0.002, q=q, force=np.array([0.0, 0.0, 0.0, np.nan, 0.0, 0.0])))
    with pytest.raises(sy.InputError, match="time of a measurement must be a finite number"):
        controller.torque(Measurement(t=np.nan, q=q))
    # Nothing of it is remembered: the loop goes on as if the bad measurement had not been.
    other = hold(six)
    other.start(Measurement(t=0.0, q=q))
    np.testing.assert_array_equal(other.torque(Measurement(t=0.001, q=q + 0.001)), before)
    after = Measurement(t=0.002, q=q + 0.002)
    np.testing.assert_array_equal(controller.torque(after), other.torque(after))
    with pytest.raises(sy.InputError, match="'shoulder_pan_joint' is nan"):
        controller.start(Measurement(t=0.0, q=np.full(6, np.nan)))


def test_a_bad_run_of_a_batch_does_not_stop_the_others(six):
    controller, q = hold(six, velocity=MeasuredVelocity()), np.full((3, 6), 0.4)
    controller.start(Measurement(t=0.0, q=q, dq=0 * q))
    expected = controller.torque(Measurement(t=0.001, q=q, dq=0 * q))
    bad = q.copy()
    bad[1, 2] = np.nan
    found = controller.torque(Measurement(t=0.001, q=bad, dq=0 * q))
    assert np.isnan(found[1]).any()
    np.testing.assert_array_equal(found[[0, 2]], expected[[0, 2]])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"q": [0.4] * 6}, "got positions as a list"),
        ({"q": np.zeros(7)}, r"with 6 joints, got positions of shape \(7,\)"),
        ({"q": np.zeros(())}, r"got positions of shape \(\)"),
        ({"q": np.zeros((1, 6))}, r"got positions of shape \(1, 6\), float64; they must be .* of shape \(6,\)"),
        ({"q": np.array(["a"] * 6)}, "got positions of shape"),
        ({"q": np.zeros(6), "dq": [0.0] * 6}, "got velocities as a list"),
        ({"q": np.zeros(6), "dq": np.zeros(5)}, r"got velocities of shape \(5,\)"),
        ({"q": np.zeros(6), "force": np.zeros(3)}, r"got forces of shape \(3,\)"),
        ({"q": np.zeros(6), "force": [0.0] * 6}, "got forces as a list"),
        ({"q": None}, "got positions as a NoneType"),
    ],
)
def test_wrong_shapes_and_lists_are_refused(six, given, message):
    controller = hold(six)
    controller.start(Measurement(t=0.0, q=np.zeros(6)))
    with pytest.raises(sy.InputError, match=message):
        controller.torque(Measurement(t=0.001, **given))
