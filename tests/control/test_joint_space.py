"""Controllers of the joints against Pinocchio's dynamics."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.control import (
    ComputedTorque,
    FeedforwardTracking,
    GravityCompensation,
    MeasuredVelocity,
    PositionTracking,
    Tool,
)
from steelyard.dynamics import ChannelFriction, Dahl, LuGre
from steelyard.simulation import Measurement


def test_gravity_and_coriolis_are_those_of_pinocchio(arm, random, bent):
    model, parameters, plant, _ = arm
    q, dq = bent(model, random)
    seen = Measurement(t=0.0, q=q, dq=dq)
    gravity = GravityCompensation(model, parameters)
    gravity.start(seen)
    np.testing.assert_allclose(
        gravity.torque(seen), plant.pin.computeGeneralizedGravity(plant.model, plant.data, q), atol=1e-10
    )
    both = GravityCompensation(model, parameters, coriolis=True, damping=0.03, velocity=MeasuredVelocity())
    both.start(seen)
    expected = plant.pin.nonLinearEffects(plant.model, plant.data, q, dq) - 0.03 * dq
    np.testing.assert_allclose(both.torque(seen), expected, atol=1e-10)


def test_feed_forward_is_equation_4_16(arm, random, bent):
    model, parameters, plant, _ = arm
    q, dq = bent(model, random)
    wanted = tuple(random.normal(size=(3, model.dof)))
    kp, kd = random.uniform(1.0, 9.0, (2, model.dof))
    controller = FeedforwardTracking(
        model, parameters, lambda t: wanted, kp=kp, kd=kd, sample_time=1e-5, velocity=MeasuredVelocity()
    )
    seen = Measurement(t=0.0, q=q, dq=dq)
    controller.start(seen)
    expected = plant.pin.rnea(plant.model, plant.data, q, dq, wanted[2])
    expected = expected + kp * (wanted[0] - q) + kd * (wanted[1] - dq)
    np.testing.assert_allclose(controller.torque(seen), expected, atol=1e-10)


def test_computed_torque_makes_double_integrators(arm, random, bent):
    """Equation 2.26: the accelerations that follow, by Pinocchio, are those that were commanded."""
    model, parameters, plant, _ = arm
    wanted = tuple(random.normal(size=(3, model.dof)))
    kp, kd = random.uniform(1.0, 90.0, (2, model.dof))
    controller = ComputedTorque(model, parameters, lambda t: wanted, kp=kp, kd=kd, velocity=MeasuredVelocity())
    for _ in range(10):
        q, dq = bent(model, random, 3.0)
        seen = Measurement(t=0.0, q=q, dq=dq)
        controller.start(seen)
        commanded = wanted[2] + kd * (wanted[1] - dq) + kp * (wanted[0] - q)
        found = plant.acceleration(q, dq, controller.torque(seen))
        np.testing.assert_allclose(found, commanded, rtol=1e-8, atol=1e-8)


def test_computed_torque_takes_the_measured_force_away(arm, random, bent):
    model, parameters, plant, link = arm
    q, dq = bent(model, random)
    wrench = random.normal(size=6) * [20.0, 20.0, 20.0, 2.0, 2.0, 2.0]
    controller = ComputedTorque(model, parameters, q, kp=0.0, kd=0.0, tool=Tool(link), velocity=MeasuredVelocity())
    seen = Measurement(t=0.0, q=q, dq=dq, force=wrench)
    controller.start(seen)
    found = plant.acceleration(q, dq, controller.torque(seen), wrench)
    np.testing.assert_allclose(found, 0.0, atol=1e-8)
    with pytest.raises(sy.InputError, match="measures none"):
        controller.start(Measurement(t=0.0, q=q, dq=dq))


@pytest.mark.slow
def test_computed_torque_compensates_drives(redundant, random, bent):
    model, parameters, plant, _ = redundant
    robot = model.robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.RotorInertia())
    driven = sy.Model(robot)
    values = dict(zip(model.parameter_names, parameters, strict=True))
    kinds = {"Fv": 1.3, "Fc": 0.7, "Ia": 0.2}
    delta = [values.get(name, kinds.get(name[:2])) for name in driven.parameter_names]
    plant = type(plant).__new__(type(plant))
    plant.__dict__.update(redundant[2].__dict__, viscous=1.3, coulomb=0.7, rotor=0.2)
    q, dq = bent(model, random)
    seen = Measurement(t=0.0, q=q, dq=dq)
    for width, tolerance in ((0.0, 1e-8), (1e-7, 1e-6)):
        controller = ComputedTorque(
            driven, delta, q, kp=4.0, kd=2.0, compensate_drives=True, sign_width=width, velocity=MeasuredVelocity()
        )
        controller.start(seen)
        found = plant.acceleration(q, dq, controller.torque(seen))
        np.testing.assert_allclose(found, -2.0 * dq, atol=tolerance)


def test_errors_decay_as_designed(redundant, random, bent):
    """Of a critically damped loop: e(t) = (e0 + (e0' + w e0) t) exp(-w t)."""
    model, parameters, plant, _ = redundant
    q, _ = bent(model, random)
    target = q + random.uniform(-0.3, 0.3, q.shape)
    w = 20.0
    controller = ComputedTorque(
        model, parameters, target, kp=w**2, kd=2 * w, sample_time=1e-4, velocity=MeasuredVelocity()
    )
    t, places, _ = plant.run(controller, q, 0.0 * q, 0.25)
    expected = (q - target) * ((1.0 + w * t) * np.exp(-w * t))[:, None]
    np.testing.assert_allclose(places - target, expected, atol=0.003 * np.abs(q - target).max())


def test_the_integral_removes_a_steady_torque(redundant, random, bent):
    model, parameters, plant, _ = redundant
    q, _ = bent(model, random)
    heavier = parameters.copy()
    heavier[[k for k, name in enumerate(model.parameter_names) if name[0] in "Llm"]] *= 1.05
    gains = {"kp": 300.0, "kd": 30.0, "velocity": MeasuredVelocity(), "sample_time": 0.002}
    without = ComputedTorque(model, heavier, q, **gains)
    with_it = ComputedTorque(model, heavier, q, ki=1000.0, **gains)
    ends = [plant.run(controller, q, 0 * q, 2.0)[1][-1] - q for controller in (without, with_it)]
    assert np.abs(ends[0]).max() > 1e-3
    assert np.abs(ends[1]).max() < 0.02 * np.abs(ends[0]).max()


@pytest.mark.parametrize("told", [True, False])
def test_the_integral_does_not_wind_up(six, told):
    """A step of 2 rad with the drives at their limits, of the description or lower ones: it arrives and stays."""
    model, parameters, plant, _ = six
    efforts = np.array([model.robot.joints[k].effort_limit for k in model.robot.driving_joints])
    limit = 0.7 * efforts if told else efforts
    controller = ComputedTorque(
        model,
        parameters,
        np.full(6, 2.0),
        kp=300.0,
        kd=30.0,
        ki=1000.0,
        torque_limit=limit if told else None,
        sample_time=0.004,
        velocity=MeasuredVelocity(),
    )
    q, dq = np.zeros(6), np.zeros(6)
    away = []
    for k in range(750):
        seen = Measurement(t=0.004 * k, q=q, dq=dq)
        if k == 0:
            controller.start(seen)
        torque = controller.torque(seen)
        assert (np.abs(torque) <= limit + 1e-9).all()
        for _ in range(4):
            dq = dq + 0.001 * plant.acceleration(q, dq, torque)
            q = q + 0.001 * dq
        away.append(np.abs(q - 2.0).max())
    assert max(away) < 2.6
    assert max(away[-100:]) < 1e-3


def test_limits_nobody_told_wind_nothing_up(six):
    """Drives that give half of what the description says, each clipped by itself."""
    model, parameters, plant, _ = six
    limit = 0.5 * np.array([model.robot.joints[k].effort_limit for k in model.robot.driving_joints])
    gains = {"kp": 300.0, "kd": 30.0, "ki": 1000.0, "sample_time": 0.004, "velocity": MeasuredVelocity()}
    ends = []
    for more in ({}, {"integral_limit": 1e9, "torque_limit": 1e9}):
        controller = ComputedTorque(model, parameters, np.full(6, 2.0), **gains, **more)
        q, dq = np.zeros(6), np.zeros(6)
        for k in range(1000):
            seen = Measurement(t=0.004 * k, q=q, dq=dq)
            if k == 0:
                controller.start(seen)
            torque = np.clip(controller.torque(seen), -limit, limit)
            for _ in range(4):
                dq = dq + 0.001 * plant.acceleration(q, dq, torque)
                q = q + 0.001 * dq
        ends.append(np.abs(q - 2.0).max())
    assert ends[0] < 1e-3
    assert ends[1] > 1.0  # with a limit for neither it still runs away


def test_limited_torques_keep_the_direction_of_the_acceleration(six, random, bent):
    model, parameters, plant, _ = six
    limit = np.full(6, 60.0)
    for _ in range(5):
        q, dq = bent(model, random)
        controller = ComputedTorque(
            model, parameters, q + 1.0, kp=900.0, kd=60.0, torque_limit=limit, velocity=MeasuredVelocity()
        )
        seen = Measurement(t=0.0, q=q, dq=dq)
        controller.start(seen)
        torque = controller.torque(seen)
        assert np.abs(torque).max() == pytest.approx(60.0, rel=1e-9)
        found, wanted = plant.acceleration(q, dq, torque), 900.0 - 60.0 * dq
        share = found @ wanted / (wanted @ wanted)
        assert 0.0 < share < 1.0
        np.testing.assert_allclose(found, share * wanted, atol=1e-6)


def test_positions_are_followed_in_three_stages(redundant, random, bent):
    model, parameters, plant, _ = redundant
    q, dq = bent(model, random)
    start, rate = q + 0.1, random.normal(size=q.shape)
    controller = PositionTracking(
        model,
        parameters,
        lambda t: (start + rate * t, rate, 0 * rate),
        kp=100.0,
        kd=20.0,
        control_start=2.0,
        reference_start=4.0,
        velocity=MeasuredVelocity(),
    )
    controller.start(Measurement(t=0.0, q=q, dq=dq))
    for t, wanted in (
        (0.0, None),
        (1.999, None),
        (2.0, start),
        (3.999, start),
        (4.0, start),
        (4.5, start + 0.5 * rate),
    ):
        command = 0 * q if wanted is None else 100.0 * (wanted - q) - 20.0 * dq
        expected = plant.pin.rnea(plant.model, plant.data, q, dq, command)
        np.testing.assert_allclose(controller.torque(Measurement(t=t, q=q, dq=dq)), expected, atol=1e-9)


class OnlyTwo:
    def at(self, t):
        return np.zeros(6), np.zeros(6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"kp": -1.0}, "kp must be finite and at least 0"),
        ({"kp": [1.0, 2.0]}, "one for each of 6 joints"),
        ({"kd": np.nan}, "kd must be finite"),
        ({"kp": "stiff"}, "kp must be a number"),
        ({"sample_time": 0.0}, "sample_time must be a positive number, in s"),
        ({"sample_time": True}, "sample_time must be a positive number"),
        ({"sample_time": "0.001"}, "sample_time must be a positive number"),
        ({"sample_time": np.inf}, "sample_time must be finite, in s"),
        ({"reference": [0.0, 1.0]}, r"6 joints, and the reference gives \[2\]"),
        ({"reference": OnlyTwo()}, "OnlyTwo gives 2 arrays"),
        ({"reference": None}, "A reference must be"),
        ({"reference": lambda t: np.zeros(6)}, "positions, velocities and accelerations"),
        ({"parameters": np.zeros(3)}, r"expected shape \(60,\)"),
        ({"parameters": np.full(60, np.nan)}, "Lxx1 has none"),
        ({"tool": Tool("hand")}, "hand"),
        ({"integral_limit": -1.0}, "integral_limit must be finite and at least 0"),
        ({"torque_limit": 0.0}, "torque_limit must be above 0"),
        ({"torque_limit": [1.0, 2.0]}, "one for each of 6 joints"),
    ],
)
def test_bad_input_is_refused(six, arguments, message):
    model, parameters, *_ = six
    given = {"parameters": parameters, "reference": np.zeros(6), "kp": 1.0, "kd": 1.0} | arguments
    with pytest.raises(sy.InputError, match=message):
        ComputedTorque(model, given.pop("parameters"), given.pop("reference"), **given)


def test_stages_come_in_order(six):
    model, parameters, *_ = six
    with pytest.raises(sy.InputError, match="must not start before the control"):
        PositionTracking(model, parameters, np.zeros(6), kp=1.0, kd=1.0, control_start=2.0, reference_start=1.0)


def test_a_measurement_of_another_robot_is_refused(six):
    model, parameters, *_ = six
    with pytest.raises(sy.InputError, match="with 6 joints, got positions of shape"):
        GravityCompensation(model, parameters).start(Measurement(t=0.0, q=np.zeros(7)))
    with pytest.raises(sy.InputError, match="measures none"):
        ComputedTorque(model, parameters, np.zeros(6), kp=1.0, kd=1.0, velocity=MeasuredVelocity()).start(
            Measurement(t=0.0, q=np.zeros(6))
        )


@pytest.mark.parametrize("base", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_friction_with_a_channel_is_compensated_as_in_steady_sliding_and_at_its_reference(base):
    arm = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q")], gravity=(0, 0, -9.81), name="arm")
    numbers = {"Fcj1": 2.0, "Fvj1": 0.7, "Fcj2": 1.0, "Fvj2": 0.3, "Lzz1": 0.8, "Lzz2": 0.2, "lx2": 0.4, "m2": 2.0}
    q, dq = np.array([0.3, -0.2]), np.array([0.4, -0.5])

    def torque(*terms):
        model = sy.Model(arm.with_terms(*terms))
        given = np.array([numbers.get(name, 0.1) for name in model.parameter_names])
        given = model.base_parameters().values(given) if base else given
        controller = ComputedTorque(
            model, given, [0.5, 0.1], kp=100.0, kd=20.0, base=base, compensate_drives=True, velocity=MeasuredVelocity()
        )
        seen = Measurement(t=0.0, q=q, dq=dq)
        controller.start(seen)
        return controller.torque(seen)

    plain = torque(sy.Coulomb(), sy.Viscous())
    np.testing.assert_allclose(torque(Dahl(0.01), sy.Viscous()), plain, rtol=1e-10)
    np.testing.assert_allclose(torque(LuGre(0.01, 0.5, 0.01)), plain, rtol=1e-10)  # at 40 of its velocities
    np.testing.assert_allclose(torque(ChannelFriction("temperature", range=[15, 60], reference=25)), plain, rtol=1e-10)
