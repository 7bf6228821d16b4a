"""Drive gains from a known payload: the gains that made the currents must come out, and intervals must hold them."""

import numpy as np
import pytest
from payload_logs import Payload, SimulatedArm

import steelyard as sy
from steelyard.errors import InputError
from steelyard.estimators import CarriedBody, KnownPayload, estimate_drive_gains, gains_from_equations
from steelyard.estimators.carried_body import CarryingModel
from steelyard.estimators.drive_gains import _Given, _Search
from steelyard.estimators.pooling import Share, pooled
from steelyard.feasibility import FeasibleSet
from steelyard.feasibility.constraints import LinearBound


@pytest.fixture(scope="module")
def arm():
    return SimulatedArm("ur5")


GAINS = np.array([12.0, 11.0, 10.0, 7.0, 7.5, 6.0])


def informations(arm, random, held, gains, step=10, **options):
    motion = tuple(array[::step] for array in arm.motion(random))
    return [
        sy.Information.from_samples(arm.model, arm.samples(random, p, motion=motion, gains=gains, **options))
        for p in (None, held)
    ]


@pytest.mark.parametrize("known", [pytest.param("mass", marks=pytest.mark.slow), "center", "all"])
def test_without_noise_the_gains_are_exact(arm, known):
    random = np.random.default_rng(1)
    held = Payload.random(random, 2.0)
    alone, loaded = informations(arm, random, held, GAINS, noise=0.0)
    payload = KnownPayload(2.0, None if known == "mass" else held.com, held.about_com if known == "all" else None)
    found = estimate_drive_gains(CarriedBody(arm.model, 5), loaded, alone, payload)
    np.testing.assert_allclose(found.gains, GAINS, rtol=1e-7)
    assert found.relative_error < 1e-7
    # The robot comes with them: of its base parameters the torques are known to rounding.
    base = arm.model.base_parameters().values(found.parameters[: arm.model.parameter_count])
    torques = sy.Information.from_samples(
        arm.model, arm.samples(random, motion=tuple(a[::50] for a in arm.motion(random)), noise=0.0)
    )
    assert torques.relative_error(base) < 1e-6


def test_gains_that_are_known_stay(arm):
    random = np.random.default_rng(2)
    gains = np.where([False, True, False, False, True, False], 1.0, GAINS)
    held = Payload.random(random, 2.0)
    alone, loaded = informations(arm, random, held, gains, noise=0.0)
    found = estimate_drive_gains(CarriedBody(arm.model, 5), loaded, alone, KnownPayload(2.0), gains != 1.0)
    np.testing.assert_allclose(found.gains, gains, rtol=1e-7)
    assert np.isnan(found.lower[1])
    assert found.found.tolist() == [True, False, True, True, False, True]


def test_a_motor_that_turns_the_other_way(arm):
    random = np.random.default_rng(3)
    gains = GAINS * [1, 1, -1, 1, 1, 1]
    held = Payload.random(random, 2.0)
    alone, loaded = informations(arm, random, held, gains, noise=0.0)
    found = estimate_drive_gains(CarriedBody(arm.model, 5), loaded, alone, KnownPayload(2.0))
    np.testing.assert_allclose(found.gains, gains, rtol=1e-7)
    assert any("elbow_joint is negative" in remark for remark in found.remarks)


def test_currents_on_the_left_are_not_biased(arm):
    """Currents as regressors make gains too small where the noise is not small beside what the payload adds."""
    random = np.random.default_rng(4)
    held = Payload.random(random, 1.0)
    alone, loaded = informations(arm, random, held, GAINS, noise=0.05, step=2)
    body = CarriedBody(arm.model, 5, changes="nothing")
    found = estimate_drive_gains(body, loaded, alone, KnownPayload(1.0))
    inside = (found.lower <= GAINS) & (found.upper >= GAINS)
    assert inside.sum() >= 5
    assert np.abs(found.gains / GAINS - 1.0).max() < 0.1

    model = CarryingModel(body)
    feasible_set = FeasibleSet(model, constraints=[_Given(KnownPayload(1.0), 7)])
    shares = [Share(one, [own]) for one, own in zip((alone, loaded), model.maps, strict=True)]
    currents = pooled(shares, model.base_parameters().names)
    linear = 1.0 / _Search(currents, feasible_set, np.ones(6, dtype=bool)).started(corrected=False)[1]
    assert np.abs(linear / GAINS - 1.0).max() > 3 * np.abs(found.gains / GAINS - 1.0).max()


def test_known_link_parameters_set_the_scale():
    """A pendulum whose first moment is known tells the gain of its drive in closed form."""
    robot = sy.Robot.from_dh([(0, 0, 0, "q")], gravity=(0, -9.81, 0)).with_terms(sy.Viscous(), sy.Coulomb())
    model = sy.Model(robot)
    truth = np.array([*sy.Inertia.from_com(1.0, [0.2, 0.0, 0.0], 0.01 * np.eye(3)).parameters, 0.1, 0.2])
    t = np.arange(0, 10, 0.01)[:, None]
    q, dq, ddq = np.sin(2 * t), 2 * np.cos(2 * t), -4 * np.sin(2 * t)
    samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=model.inverse_dynamics(q, dq, ddq, truth) / 3.5)
    information = sy.Information.from_samples(model, samples)
    known = FeasibleSet(model, constraints=[LinearBound("lx1", equal=0.2)])
    assert gains_from_equations(information, known).gains[0] == pytest.approx(3.5, rel=1e-8)
    with pytest.raises(InputError, match="nothing that is known sets their scale"):
        gains_from_equations(information, FeasibleSet(model))
    # The mass alone is no base parameter, so that it says nothing.
    with pytest.raises(InputError, match="its centre of mass as well where the joints do not tell one from the other"):
        gains_from_equations(information, FeasibleSet(model, constraints=[sy.TotalMass(equal=1.0)]))


@pytest.mark.slow
def test_logs_without_the_payload_are_refused(arm):
    """The same robot twice, or the payload in the wrong log: no possible robot has such currents."""
    random = np.random.default_rng(6)
    held = Payload.random(random, 2.0)
    alone, loaded = informations(arm, random, held, GAINS)
    for first, second in ((alone, alone), (alone, loaded)):
        with pytest.raises(InputError, match=r"Check which log is which|do not tell the drive gain"):
            estimate_drive_gains(CarriedBody(arm.model, 5), first, second, KnownPayload(2.0))


def test_bad_arguments_are_refused(arm):
    with pytest.raises(InputError, match="the mass of the known payload must be a positive number of kg, got 0"):
        KnownPayload(0.0)
    with pytest.raises(InputError, match="give center_of_mass, too"):
        KnownPayload(1.0, about_com=np.eye(3))
    random = np.random.default_rng(5)
    alone, loaded = informations(arm, random, Payload.random(random, 1.0), GAINS, step=100)
    with pytest.raises(InputError, match="find must say of each of the 6 joints"):
        estimate_drive_gains(CarriedBody(arm.model, 5), loaded, alone, KnownPayload(1.0), [True])


@pytest.mark.slow
@pytest.mark.parametrize("mass", [1.0, 5.0])
def test_gains_are_within_three_percent(arm, mass):
    """Of 15 pairs of logs with noise of 1.5 % on currents; `benchmarks/payload.py --gains` prints 100 of each."""
    inside = []
    for seed in range(15):
        random = np.random.default_rng([seed, 5])
        held = Payload.random(random, mass)
        alone, loaded = informations(arm, random, held, GAINS, step=1)
        found = estimate_drive_gains(CarriedBody(arm.model, 5), loaded, alone, KnownPayload(mass))
        assert np.abs(found.gains / GAINS - 1.0).max() < 0.03
        inside.append((found.lower <= GAINS) & (found.upper >= GAINS))
    assert np.mean(inside) > 0.87
