"""Every method against solutions in closed form: the pendulum by elliptic functions, the damped oscillator."""

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

import steelyard as sy
from steelyard.simulation import simulate

ADAPTIVE = ("dormand_prince", "dop853", "radau", "bdf", "lsoda")
FIXED = {"runge_kutta_4": 4, "rosenbrock": 2}


def pendulum_motion(t, amplitude, g=9.81):
    """A pendulum of length 1 that is let go at `amplitude`: theta = 2 asin(k sn(K - w t, k))."""
    m = np.sin(amplitude / 2) ** 2
    sn, cn, dn, _ = ellipj(ellipk(m) - np.sqrt(g) * t, m)
    k = np.sqrt(m)
    return 2 * np.arcsin(k * sn), -2 * k * np.sqrt(g) * cn * dn / np.sqrt(1 - m * sn**2)


def oscillator_motion(t, mass=2.0, stiffness=50.0, damping=3.0):
    """Let go at x = 1 m."""
    decay = damping / (2 * mass)
    w = np.sqrt(stiffness / mass - decay**2)
    x = np.exp(-decay * t) * (np.cos(w * t) + decay / w * np.sin(w * t))
    return x, -np.exp(-decay * t) * (w + decay**2 / w) * np.sin(w * t)


QUICK = [pytest.param(m, marks=pytest.mark.slow if m != "dormand_prince" else ()) for m in ADAPTIVE]


@pytest.mark.parametrize("method", QUICK)
def test_adaptive_methods_follow_the_pendulum_to_their_tolerance(pendulum, method):
    model, delta = pendulum
    exact, speed = pendulum_motion(np.arange(2001) / 1000, 2.5)
    errors = []
    for tolerance in (1e-6, 1e-9):
        result = simulate(
            model, delta, [2.5], [0.0], 2.0, method=method, relative_tolerance=tolerance, absolute_tolerance=tolerance
        )
        assert result.status == "finished"
        errors.append(max(np.abs(result.q[:, 0] - exact).max(), np.abs(result.dq[:, 0] - speed).max()))
    assert errors[1] < 1e-6
    assert errors[1] < errors[0] / 30


@pytest.mark.parametrize(("method", "order"), FIXED.items())
def test_fixed_steps_converge_with_their_order(pendulum, oscillator, method, order):
    for (model, delta), motion, start in (
        (pendulum, lambda t: pendulum_motion(t, 2.5), 2.5),
        (oscillator, oscillator_motion, 1.0),
    ):
        errors = []
        for step in (8e-3, 4e-3, 2e-3):
            result = simulate(model, delta, [start], [0.0], 2.0, method=method, step=step, rate=125.0)
            q, dq = motion(result.t)
            errors.append(np.abs(np.stack([result.q[:, 0] - q, result.dq[:, 0] - dq])).max())
        orders = np.log2(np.divide(errors[:-1], errors[1:]))
        assert np.abs(orders - order).max() < 0.25, (errors, orders)


@pytest.mark.slow
def test_dormand_prince_is_of_order_five(pendulum):
    """The error falls with the fifth power of the number of steps."""
    model, delta = pendulum
    steps, errors = [], []
    for tolerance in (1e-5, 1e-7, 1e-9, 1e-11):
        result = simulate(
            model,
            delta,
            [2.5],
            [0.0],
            1.5,
            method="dormand_prince",
            relative_tolerance=tolerance,
            absolute_tolerance=tolerance,
        )
        steps.append(len(result.pieces))
        errors.append(abs(result.final_q[0] - pendulum_motion(1.5, 2.5)[0]))
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert -5.8 < slope < -4.6


@pytest.mark.slow
def test_rosenbrock_neither_gains_nor_loses_energy(pendulum):
    model, delta = pendulum
    result = simulate(model, delta, [1.0], [0.0], 25.0, method="rosenbrock", step=5e-3, rate=200.0)
    early, late = np.ptp(result.energy[:1000]), np.ptp(result.energy[-1000:])
    assert late < 1.1 * early < 0.02


@pytest.mark.parametrize("method", [*QUICK, *FIXED])
def test_energy_of_a_conservative_robot_stays(two_links, method):
    model, delta = two_links
    result = simulate(
        model,
        delta,
        [0.3, -0.4],
        [0.0, 1.0],
        0.25 if method in ("radau", "bdf") else 1.0,
        method=method,
        relative_tolerance=1e-12,
        absolute_tolerance=1e-12,
        **({"step": 5e-4} if method in FIXED else {}),
    )
    bound = {"rosenbrock": 5e-5, "bdf": 1e-6}.get(method, 1e-8)
    assert np.ptp(result.energy) < bound * np.ptp(result.potential_energy)
    assert np.abs(result.dissipated).max() == 0.0


@pytest.mark.parametrize("method", ["dormand_prince", "dop853", "radau", "lsoda", "runge_kutta_4"])
def test_values_between_samples(pendulum, method):
    model, delta = pendulum
    result = simulate(model, delta, [2.5], [0.0], 1.0, method=method, rate=50.0 if method in ADAPTIVE else None)
    t = np.array([0.0, 0.01234, 0.5017, 0.99999, 1.0])
    q, dq = result.at(t)
    exact, speed = pendulum_motion(t, 2.5)
    assert np.abs(q[:, 0] - exact).max() < 2e-6
    assert np.abs(dq[:, 0] - speed).max() < 2e-5
    np.testing.assert_allclose(result.at(0.5017)[0], q[2])
    with pytest.raises(sy.errors.InputError, match=r"from 0 to 1 s, got 1.5"):
        result.at(1.5)
    with pytest.raises(sy.errors.InputError, match=r"one time or a row of times, got an array of shape \(1, 2\)"):
        result.at([[0.1, 0.2]])


def test_accelerations_are_those_of_the_motion(pendulum):
    model, delta = pendulum
    result = simulate(model, delta, [1.0], [0.0], 1.0)
    np.testing.assert_allclose(result.ddq[:, 0], -9.81 * np.sin(result.q[:, 0]), atol=1e-12)


@pytest.mark.slow
def test_torque_functions_act_within_the_steps(oscillator):
    """Resonance: the steady response to a force that changes within every step, in closed form."""
    model, delta = oscillator
    amplitude = 4.0 / np.hypot(50.0 - 2.0 * 25.0, 3.0 * 5.0)
    for method in ("dormand_prince", "dop853", "radau", "runge_kutta_4", "rosenbrock"):
        step = {"step": 2.5e-4} if method in FIXED else {}
        result = simulate(
            model,
            delta,
            [0.0],
            [5.0 * amplitude],
            0.6,
            lambda t, q, dq: 4.0 * np.cos(5.0 * t) * np.ones(1),
            method=method,
            rate=100.0,
            **step,
        )
        exact = amplitude * np.sin(5.0 * result.t)  # in resonance it lags by a quarter of a sample time
        assert np.abs(result.q[:, 0] - exact).max() < 1e-6, method
        assert result.torque[0, 0] == 4.0
