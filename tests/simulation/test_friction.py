"""Coulomb friction: sticking, slipping, and what lies between."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import steelyard as sy
from steelyard.dynamics import PiecewiseFriction, Stribeck
from steelyard.simulation import simulate

METHODS = ("radau", "bdf", "lsoda", "dormand_prince", "rosenbrock")


def belt(t, q, dq):
    """A spring of 200 N/m between the block and a belt that moves at 0.1 m/s."""
    return 200.0 * (0.1 * t - q)


@pytest.fixture(scope="module")
def stick_slip():
    """The block on the spring, by SciPy's Radau on equations written for it alone."""
    width = 1e-3

    def slope(t, y):
        friction = 10.0 * y[1] / np.hypot(y[1], width)
        return [y[1], (200.0 * (0.1 * t - y[0]) - friction) / 2.0]

    t = np.arange(3001) / 1000
    found = solve_ivp(slope, (0.0, 3.0), [0.0, 0.0], method="Radau", t_eval=t, rtol=1e-9, atol=1e-11)
    return found.y


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_stick_slip(block, stick_slip, method):
    model, delta = block
    result = simulate(model, delta, [0.0], [0.0], 3.0, belt, method=method)
    q, dq = stick_slip
    assert np.count_nonzero(np.diff((dq > 0.01).astype(int)) > 0) >= 2  # it does stick and slip
    tight = method != "rosenbrock"
    assert np.abs(result.q[:, 0] - q).max() < (2e-7 if tight else 2e-5)
    assert np.abs(result.dq[:, 0] - dq).max() < (2e-6 if tight else 2e-3)


@pytest.mark.parametrize("width", [1e-3, 1e-6])
def test_rosenbrock_stops_a_block_where_it_should(block, width):
    """Thrown at 1 m/s against a deceleration of 5 m/s²: it stops after 0.1 m and stays."""
    model, delta = block
    result = simulate(model, delta, [0.0], [1.0], 0.5, method="rosenbrock", step=1e-3, sign_width=width)
    assert abs(result.final_q[0] - 0.1) < 2e-5 + 5 * width
    assert np.abs(result.dq[result.t > 0.21]).max() < width
    assert np.all(np.diff(result.energy) <= 0.0)


def test_an_exact_sign_gets_a_method_that_steps_over_its_jump(block):
    """The same throw with the method that is chosen; the adaptive ones find no step at rest."""
    model, delta = block
    result = simulate(model, delta, [0.0], [1.0], 0.5, sign_width=0.0)
    assert (result.status.value, result.options["method"]) == ("finished", "rosenbrock")
    assert abs(result.final_q[0] - 0.1) < 1e-5
    assert np.abs(result.dq[result.t > 0.21]).max() < 1e-9


def test_held_below_its_friction_a_joint_creeps_as_the_smooth_sign_says(block):
    """At 6 N against 10 N: v / sqrt(v² + w²) = 0.6."""
    model, delta = block
    for method in ("radau", "rosenbrock"):
        result = simulate(
            model, delta, [0.0], [0.0], 0.1, lambda t, q, dq: np.full(1, 6.0), method=method, sample_time=1e-3
        )
        assert abs(result.final_dq[0] - 0.75e-3) < 1e-9


@pytest.mark.slow
def test_rosenbrock_is_of_order_two_through_reversals(block, stick_slip):
    model, delta = block
    errors = []
    for step in (1e-3, 2.5e-4):
        result = simulate(model, delta, [0.0], [0.0], 1.5, belt, method="rosenbrock", step=step)
        errors.append(np.abs(result.q[:, 0] - stick_slip[0][:1501]).max())
    assert np.log2(errors[0] / errors[-1]) / 2 > 1.5, errors


def test_the_exact_sign_acts_as_it_says(block):
    model, delta = block
    for method in ("dormand_prince", "runge_kutta_4"):
        result = simulate(model, delta, [0.0], [1.0], 0.1, method=method, sign_width=0.0)
        np.testing.assert_allclose(result.final_q, [1.0 * 0.1 - 2.5 * 0.01], atol=1e-9)
    result = simulate(model, delta, [0.0], [1.0], 0.5, method="rosenbrock", sign_width=0.0, step=1e-3)
    assert abs(result.final_q[0] - 0.1) < 1e-3


def test_friction_takes_the_energy_that_is_missing(block, wam):
    model, delta = block
    result = simulate(model, delta, [0.0], [1.0], 0.5, method="radau")
    np.testing.assert_allclose(result.energy[0] - result.energy, result.dissipated, atol=2e-5)


@pytest.mark.parametrize(
    ("term", "values", "torque"),
    [
        (Stribeck(0.4), {"Fcj1": 1.0, "Fsj1": 2.0}, lambda v: 1.0 + 2.0 * np.exp(-((v / 0.4) ** 2))),
        pytest.param(
            PiecewiseFriction([0.5, 2.0]),
            {"Fn1j1": 3.0, "Fn2j1": 4.0},
            lambda v: np.interp(v, [0, 0.5, 2], [0, 3, 4]),
            marks=pytest.mark.slow,
        ),
    ],
    ids=["stribeck", "piecewise"],
)
def test_a_block_slides_out_under_friction_that_depends_on_speed(block, term, values, torque):
    """By SciPy on the formula of each law: laws with exponentials, and with signs of signs."""
    model = sy.Model(block[0].robot.with_terms(term))
    delta = np.zeros(model.parameter_count)
    for name, value in {"m1": 2.0, **values}.items():
        delta[model.parameter_names.index(name)] = value
    known = solve_ivp(lambda t, y: [y[1], -torque(y[1]) / 2.0], (0.0, 0.5), [0.0, 1.0], rtol=1e-10, atol=1e-12).y
    for method, tolerance in (("rosenbrock", 2e-6), ("dormand_prince", 1e-8)):
        result = simulate(model, delta, [0.0], [1.0], 0.5, method=method, sign_width=1e-6)
        np.testing.assert_allclose([result.final_q[0], result.final_dq[0]], known[:, -1], atol=tolerance)
