"""Simulated robots whose friction remembers the motion, beside SciPy's integration of the equations."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import steelyard as sy
from steelyard.dynamics import ByJoint, ChannelFriction, Dahl, LuGre, Viscous

D, RATIO, SPEED = 0.02, 0.5, 0.1
NUMBERS = {"Fcj1": 2.0, "Fbj1": 1.0, "Fvj1": 0.7, "Lzz1": 0.8, "lx1": 0.5}


def pendulum(term):
    robot = sy.Robot.from_dh([(0, 0.5, 0, "q")], gravity=(0, -9.81, 0), name="pendulum")
    model = sy.Model(robot.with_terms(term))
    return model, np.array([NUMBERS.get(name, 0.0) for name in model.parameter_names])


def exact(t, ratio, damping, viscous, torque):
    """Angle, speed and bristles of the pendulum of ``lx1`` about the end of its link, from rest at 0.3 rad."""
    model, numbers = pendulum(Dahl(D))
    inertia = float(model.inertia_matrix([0.0], numbers)[0, 0])
    weight = float(model.gravity([0.0], numbers)[0])

    def slope(time, y):
        q, v, u = y
        rate = v - abs(v) * u / (1.0 + ratio * np.exp(-((v / SPEED) ** 2)))
        friction = 2.0 * u + damping * rate + viscous * v
        return [v, (torque(time) - weight * np.cos(q) - friction) / inertia, rate / D]

    return solve_ivp(slope, (0.0, t[-1]), [0.3, 0.0, 0.0], t_eval=t, rtol=1e-9, atol=1e-11, method="Radau").y


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.0, RATIO])
def test_a_pendulum_moves_as_its_equations_say(ratio):
    term = LuGre(D, RATIO, SPEED) if ratio else Dahl(D)
    model, numbers = pendulum(term)
    drive = lambda t: 4.5 + 8.0 * np.cos(6.0 * t)  # noqa: E731
    found = sy.simulate(model, numbers, [0.3], [0.0], 1.2, torque=lambda t, q, dq: np.array([drive(t)]), rate=500)
    assert found.status.value == "finished"
    damping, viscous = (1.0, 0.7) if ratio else (0.0, 0.0)
    q, dq, _ = exact(found.t, ratio, damping, viscous, drive)
    assert (np.diff(np.sign(dq[np.abs(dq) > 1e-3])) != 0).any()  # it turns around
    np.testing.assert_allclose(found.q[:, 0], q, atol=2e-4)
    np.testing.assert_allclose(found.dq[:, 0], dq, atol=2e-3)
    again = model.inverse_dynamics(
        found.q, found.dq, found.ddq, numbers, channels={"presliding": model.presliding(found.q, found.dq)}
    )
    np.testing.assert_allclose(again, found.torque, atol=0.05)  # of samples 2 ms apart


@pytest.mark.slow
def test_energy_is_kept():
    robot = sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")], gravity=(0, -9.81, 0))
    model = sy.Model(robot.with_terms(ByJoint([LuGre(D, RATIO, SPEED, joints=[1]), Dahl(0.05, joints=[2]), Viscous()])))
    known = {**NUMBERS, "m1": 2.0, "Lzz2": 0.2, "lx2": 0.1, "m2": 1.0, "Fcj2": 0.5, "Fvj2": 0.1, "Fbj2": 3.0}
    numbers = np.array([known.get(name, 0.0) for name in model.parameter_names])
    fall = sy.simulate(model, numbers, [0.3, 0.2], [0.0, 0.0], 1.0)
    total = fall.energy + fall.dissipated
    assert np.ptp(fall.energy) > 1.0
    assert np.ptp(total) < 2e-4 * np.ptp(fall.energy)
    assert np.all(np.diff(fall.dissipated) > -1e-9)
    base = model.base_parameters()
    alike = sy.simulate(model, base.K @ numbers, [0.3, 0.2], [0.0, 0.0], 0.1, base=True)
    np.testing.assert_allclose(alike.q, fall.q[: len(alike.q)], atol=1e-9)
    both = sy.simulate(model, np.array([numbers, 1.1 * numbers]), [0.3, 0.2], [0.0, 0.0], 0.1)
    np.testing.assert_allclose(both.q[0], fall.q[: len(alike.q)], atol=1e-5)
    with pytest.raises(sy.InputError, match="'runge_kutta_4' alone"):
        sy.simulate(model, numbers, [0.3, 0.2], [0.0, 0.0], 0.2, method="radau")


@pytest.mark.slow
def test_torque_over_position_draws_a_loop():
    """A force that grows and falls below Coulomb friction moves the joint to and fro, on two branches (hysteresis)."""
    model, _ = pendulum(ByJoint([Dahl(D), Viscous()]))
    values = {"Fcj1": 2.0, "Fvj1": 2.0, "Lzz1": 0.05}
    numbers = np.array([values.get(name, 0.0) for name in model.parameter_names])
    force = lambda t, q, dq: np.array([1.5 * np.sin(0.5 * np.pi * t)])  # noqa: E731
    found = sy.simulate(model, numbers, [0.0], [0.0], 8.0, torque=force, rate=50, method="runge_kutta_4", step=0.004)
    last = found.t >= 4.0
    q, torque = found.q[last, 0], found.torque[last, 0]
    loop = np.sum(0.5 * (torque[1:] + torque[:-1]) * np.diff(q))
    viscous = 2.0 * np.sum(found.dq[last, 0] ** 2) * 0.02
    # Where it moves one way, Dahl's u between -0.75 and 0.75 has dq = d du / (1 - u), and back dq = d du / (1 + u).
    u = np.linspace(-0.75, 0.75, 10001)
    expected = 2.0 * D * np.sum(u / (1.0 - u) - u / (1.0 + u)) * (u[1] - u[0])
    assert loop - viscous == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("base", [pytest.param(False, marks=pytest.mark.slow), True])
def test_friction_by_a_channel_is_that_at_its_reference(base):
    robot = sy.Robot.from_dh([(0, 0.5, 0, "q")], gravity=(0, -9.81, 0), name="pendulum")

    def end(*terms):
        model = sy.Model(robot.with_terms(*terms))
        numbers = np.array([NUMBERS.get(name, 0.2) for name in model.parameter_names])
        given = model.base_parameters().values(numbers) if base else numbers
        return sy.simulate(model, given, [0.3], [1.0], 0.2, base=base).q[-1]

    plain = end(sy.Coulomb(), Viscous())
    np.testing.assert_allclose(end(ChannelFriction("temperature", range=[15, 60], reference=25)), plain, atol=1e-8)
