"""Whatever takes parameters takes an estimate of the same robot and terms, and no other."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.control import ComputedTorque, play
from steelyard.excitation import FourierTrajectory

ARM = sy.Robot.from_dh([("pi/2", 0.1, 0.3, "q"), (0.3, 0.4, 0.0, "q")], name="arm", gravity=(0, 0, -9.81))
REST = np.zeros(2)
LIMITS = {"lower": -1.0, "upper": 1.0, "velocity": 1.0, "acceleration": 5.0, "torque": 50.0}
WAVE = FourierTrajectory(a=[[0.1], [0.1]], b=[[0.1], [0.2]], center=REST, frequency=0.5)


@pytest.fixture(scope="module")
def estimates():
    """Of viscous and Coulomb friction, by a feasible fit and by least squares, and the truth."""
    model = sy.Model(ARM.with_terms(sy.Viscous(), sy.Coulomb()))
    body = sy.Inertia.from_com(1.0, (0.1, 0.0, 0.02), 0.05 * np.eye(3)).parameters
    truth = np.array([*body, 2.0, 0.1] * 2)
    q, dq, ddq = np.random.default_rng(1).normal(size=(3, 100, 2))
    torque = model.inverse_dynamics(q, dq, ddq, truth)
    info = sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    return model, truth, sy.fit(info, sy.FeasibleSet(model)), sy.least_squares(info)


USES = {
    "simulation": lambda model, estimate: sy.simulate(model, estimate, REST, REST + 1.0, 0.01),
    "controller": lambda model, estimate: ComputedTorque(model, estimate, REST, kp=1.0, kd=1.0),
    "played": lambda model, estimate: play(model, estimate, WAVE),
    "question": lambda model, estimate: sy.check(sy.FeasibleSet(model), parameters=estimate),
    "excitation": lambda model, estimate: sy.design_excitation(model, LIMITS, parameters=estimate),
}


@pytest.mark.parametrize("use", USES)
def test_an_estimate_of_other_terms_is_refused(estimates, use):
    """Its parameters are as many, with viscous and Coulomb friction exchanged."""
    _, _, feasible, _ = estimates
    other = sy.Model(ARM.with_terms(sy.Coulomb(), sy.Viscous()))
    with pytest.raises(sy.InputError, match="of another robot or of other terms than arm has"):
        USES[use](other, feasible)


def test_data_of_a_model_with_terms_in_another_order_is_refused(estimates):
    model, _, _, _ = estimates
    q, dq, ddq, torque = np.random.default_rng(1).normal(size=(4, 100, 2))
    info = sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    other = sy.Model(ARM.with_terms(sy.Coulomb(), sy.Viscous()))
    with pytest.raises(sy.InputError, match="base parameters of the feasible set in another order"):
        sy.fit(info, sy.FeasibleSet(other))


def test_data_of_an_arm_of_another_length_is_refused(estimates):
    """It has as many base parameters, of the same names."""
    model, _, _, _ = estimates
    q, dq, ddq, torque = np.random.default_rng(1).normal(size=(4, 100, 2))
    info = sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    rows = [("pi/2", 0.1, 0.3, "q"), (0.3, 0.55, 0.0, "q")]
    longer = sy.Model(sy.Robot.from_dh(rows, gravity=(0, 0, -9.81)).with_terms(*model.robot.terms))
    assert longer.base_parameters().names == info.base_names
    with pytest.raises(sy.InputError, match="The data is of another robot than the feasible set, or of other lengths"):
        sy.fit(info, sy.FeasibleSet(longer))


def test_base_parameters_of_an_estimate_simulate_the_robot(estimates):
    model, truth, feasible, least_squares = estimates
    wanted = sy.simulate(model, truth, REST, REST + 1.0, 0.1)
    for estimate in (feasible, least_squares):
        found = sy.simulate(model, estimate, REST, REST + 1.0, 0.1, base=True)
        np.testing.assert_allclose(found.dq, wanted.dq, atol=1e-6)
        assert sy.check(sy.FeasibleSet(model), base=estimate).feasible
        assert ComputedTorque(model, estimate, REST, kp=1.0, kd=1.0, base=True).sample_time == 0.001


def test_a_controller_keeps_its_parameters(estimates):
    model, truth, _, _ = estimates
    given = truth.copy()
    controller = ComputedTorque(model, given, REST, kp=1.0, kd=1.0)
    here = sy.simulation.Measurement(t=0.0, q=REST + 0.5, dq=REST)
    before = controller.torque(here).copy()
    given *= 2.0
    np.testing.assert_array_equal(controller.torque(here), before)
