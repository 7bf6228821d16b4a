"""Payloads from two logs, or one: against Pinocchio's robots, closed forms, and regressions put together by hand."""

from dataclasses import replace

import numpy as np
import pytest
from payload_logs import Payload, SimulatedArm

import steelyard as sy
from steelyard.dynamics import ChannelFriction
from steelyard.errors import InputError
from steelyard.estimators import CarriedBody, KnownRobot, estimate_payload
from steelyard.estimators.carried_body import CarryingModel, changing_parameters, mounting
from steelyard.estimators.pooling import Share, pooled
from steelyard.robot.placement import rpy_rotation


@pytest.fixture(scope="module", params=["ur5", "panda"])
def arm(request):
    return SimulatedArm(request.param)


@pytest.fixture(scope="module")
def ur5():
    return SimulatedArm("ur5")


def last(arm, changes="friction", placement=None):
    return CarriedBody(arm.model, arm.model.dof - 1, np.eye(4) if placement is None else placement, changes)


def thinned(motion):
    return tuple(array[::10] for array in motion)


def information(arm, random, payload=None, **options):
    return sy.Information.from_samples(arm.model, arm.samples(random, payload, **options))


@pytest.mark.parametrize(
    ("name", "mass"),
    [("ur5", 5.0), *(pytest.param(*case, marks=pytest.mark.slow) for case in (("ur5", 0.5), ("panda", 2.0)))],
)
def test_without_noise_the_payload_is_exact(name, mass):
    arm = SimulatedArm(name)
    random = np.random.default_rng(3)
    held = Payload.random(random, mass)
    both = [information(arm, random, p, noise=0.0, motion=thinned(arm.motion(random))) for p in (None, held)]
    found = estimate_payload(last(arm), both[1], both[0])
    assert found.mass == pytest.approx(mass, rel=1e-6)
    np.testing.assert_allclose(found.center_of_mass, held.com, atol=1e-6)
    np.testing.assert_allclose(found.inertia, held.about_com, atol=1e-6 * mass)
    assert {one.standing for one in found.quantities} == {"measured"}
    assert all(one.upper - one.lower < 2e-2 for one in found.quantities)
    assert found.distance == pytest.approx(0.0, abs=1e-6)
    assert found.robot_alone_error > 0.05 > 1e-9 > found.loaded_error


def test_the_mounting_frame_moves_the_payload(ur5):
    """Pinocchio mounts it in a frame that is turned and shifted; what comes out is told in that frame."""
    placement = rpy_rotation(0.3, -0.7, 1.1)
    placement[:3, 3] = 0.02, -0.05, 0.08
    random = np.random.default_rng(4)
    held, motion = Payload.random(random, 2.0), thinned(ur5.motion(random))
    both = [information(ur5, random, p, noise=0.0, motion=motion, frame=placement) for p in (None, held)]
    found = estimate_payload(last(ur5, placement=placement), both[1], both[0])
    np.testing.assert_allclose(found.parameters, held.parameters, atol=1e-6)


def test_frames_have_names(ur5):
    model = ur5.model
    link, placement, name = mounting(model, "tool0", None)
    assert (link, name) == (5, "tool0")
    np.testing.assert_allclose(placement, model.robot.frame("tool0")[1])
    assert mounting(model, None, None)[2] == "wrist_3_link"
    with pytest.raises(InputError, match="does not move"):
        mounting(model, "base_link", None)
    fork = sy.Robot.from_urdf(ur5.path)
    joints = [replace(joint, parent=min(joint.parent, 3)) for joint in fork.joints]
    with pytest.raises(InputError, match="several last links, wrist_2_link, wrist_3_link"):
        mounting(sy.Model(replace(fork, joints=tuple(joints))), None, None)


@pytest.mark.parametrize("changes", ["nothing", "friction", "friction-and-offset"])
def test_pooling_is_the_regression_of_all_rows(ur5, changes):
    """Stacked by hand from the regressor of both logs and solved by NumPy."""
    random = np.random.default_rng(5)
    held, motion = Payload.random(random, 1.0), tuple(array[::200] for array in ur5.motion(random))
    samples = [ur5.samples(random, p, motion=motion) for p in (None, held)]
    model, body = ur5.model, last(ur5, changes)
    both = CarryingModel(body)
    base = both.base_parameters()
    shares = [Share(sy.Information.from_samples(model, s), [m]) for s, m in zip(samples, both.maps, strict=True)]
    information = pooled(shares, base.names)
    W = [model.regressor(s.q, s.dq, s.ddq).reshape(-1, model.parameter_count) for s in samples]
    own = np.arange(model.parameter_count)
    carried = W[1][:, model.link_columns[-1]]
    friction = body.friction
    alone = np.hstack([W[0], np.zeros((len(W[0]), 10 + len(friction)))])
    loaded = np.hstack([np.where(np.isin(own, friction), 0.0, W[1]), carried, W[1][:, friction]])
    rows = np.vstack([alone, loaded])
    torque = np.concatenate([s.torque.ravel() for s in samples])
    residual = torque - rows @ np.linalg.lstsq(rows, torque)[0]
    assert np.linalg.matrix_rank(rows, tol=1e-7 * np.linalg.norm(rows)) == base.count
    estimate = sy.least_squares(information, None)
    assert estimate.relative_error == pytest.approx(np.linalg.norm(residual) / np.linalg.norm(torque), rel=1e-9)
    # The base parameters are those combinations of all parameters that the rows show.
    np.testing.assert_allclose(rows, rows[:, base.independent] @ base.K, atol=1e-9)
    np.testing.assert_allclose(rows[:, base.independent] @ estimate.base, torque - residual, atol=1e-7)


@pytest.mark.slow
def test_friction_that_grows_with_the_load(ur5):
    """Shared friction takes it for weight; friction of its own leaves less than half of that."""
    errors = {"nothing": [], "friction": []}
    for seed in range(3):
        random = np.random.default_rng(seed)
        held, motion = Payload.random(random, 5.0), thinned(ur5.motion(random))
        both = [information(ur5, random, p, noise=0.0, motion=motion, load_friction=0.1) for p in (None, held)]
        for changes, own in errors.items():
            own.append(abs(estimate_payload(last(ur5, changes), both[1], both[0]).mass - 5.0))
    assert np.mean(errors["friction"]) < 0.6 * np.mean(errors["nothing"])


def test_what_may_change_is_friction(ur5):
    names = np.array(ur5.model.parameter_names)
    viscous, coulomb, offset = ([f"{symbol}{joint}" for joint in range(1, 7)] for symbol in ("Fvj", "Fcj", "Foj"))
    assert set(names[changing_parameters(ur5.model)]) == {*viscous, *coulomb}
    assert set(names[changing_parameters(ur5.model, "friction-and-offset")]) == {*viscous, *coulomb, *offset}
    with pytest.raises(InputError, match=r"changes must be one of .* did you mean \"friction\""):
        changing_parameters(ur5.model, "frition")


def test_changed_friction_is_told(ur5):
    random = np.random.default_rng(6)
    held, motion = Payload.random(random, 2.0), thinned(ur5.motion(random))
    alone = information(ur5, random, noise=0.0, motion=motion)
    before = ur5.coulomb
    try:
        ur5.coulomb = 1.5 * before
        loaded = information(ur5, random, held, noise=0.0, motion=motion)
    finally:
        ur5.coulomb = before
    found = estimate_payload(last(ur5), loaded, alone)
    names = list(found.friction_names)
    places = [names.index(f"Fcj{joint}") for joint in range(1, 7)]
    np.testing.assert_allclose(found.friction[places], before, rtol=1e-4)
    np.testing.assert_allclose(found.loaded_friction[places], 1.5 * before, rtol=1e-4)
    assert found.mass == pytest.approx(2.0, rel=1e-5)


@pytest.mark.parametrize("arm", ["ur5", pytest.param("panda", marks=pytest.mark.slow)], indirect=True)
def test_one_log_and_a_known_robot(arm):
    random = np.random.default_rng(7)
    held, motion = Payload.random(random, 1.5), thinned(arm.motion(random))
    alone, loaded = (information(arm, random, p, motion=motion) for p in (None, held))
    robot = sy.least_squares(alone)
    exact = estimate_payload(last(arm), loaded, robot=KnownRobot(robot.base))
    full = sy.regression.ParameterCovariance.of(alone).matrix
    known = estimate_payload(last(arm), loaded, robot=KnownRobot(robot.base, full))
    both = estimate_payload(last(arm), loaded, alone)
    assert abs(exact.mass - 1.5) < 0.03
    assert known["mass"].lower <= 1.5 <= known["mass"].upper
    widths = [one["mass"].upper - one["mass"].lower for one in (exact, known, both)]
    assert widths[0] < widths[1]
    assert widths[1] == pytest.approx(widths[2], rel=0.3)  # the same errors of the robot count in both
    assert np.isnan(exact.unloaded_error)


def test_a_pendulum_shows_no_mass_but_bounds_it():
    """It tells Lzz, lx and ly; by Cauchy and Schwarz no body is lighter than (lx² + ly²) / Lzz."""
    model = sy.Model(sy.Robot.from_dh([(0, 0, 0, "q")], gravity=(0, -9.81, 0)))
    t = np.arange(0, 10, 0.01)[:, None]
    q, dq, ddq = np.sin(2 * t), 2 * np.cos(2 * t), -4 * np.sin(2 * t)
    robot = sy.Inertia.from_com(1.0, [0.2, 0.0, 0.0], 0.01 * np.eye(3)).parameters
    held = sy.Inertia.from_com(0.5, [0.3, 0.1, 0.0], 0.005 * np.eye(3)).parameters
    both = [
        sy.Information.from_samples(
            model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=model.inverse_dynamics(q, dq, ddq, parameters))
        )
        for parameters in (robot, robot + held)
    ]
    found = estimate_payload(CarriedBody(model, 0), both[1], both[0])
    assert np.isnan(found.mass)
    least = (held[6] ** 2 + held[7] ** 2) / held[5]
    assert found["mass"].lower == pytest.approx(least, rel=1e-2)
    assert found["mass"].standing == "open"
    assert found["mass"].upper == np.inf
    assert 0.3 in found["cx"]
    assert 0.1 in found["cy"]
    assert found["cz"].standing == "open"


def test_nothing_carried_is_said(ur5):
    random = np.random.default_rng(8)
    motion = thinned(ur5.motion(random))
    both = [information(ur5, random, motion=motion) for _ in range(2)]
    found = estimate_payload(last(ur5), both[1], both[0])
    assert found["mass"].lower == 0.0
    assert found["mass"].upper < 0.1
    assert np.isnan(found.center_of_mass).all()
    assert not found.remarks


@pytest.mark.slow
@pytest.mark.parametrize("known", [False, True])
def test_nothing_carried_is_seldom_something(ur5, known):
    """Noise in the first moments and the inertia asks for some mass, too, wherever that of the mass itself is."""
    body, claims = last(ur5), []
    motion = thinned(ur5.motion(np.random.default_rng(9)))
    for seed in range(30):
        random = np.random.default_rng([seed, 9])
        alone, loaded = (information(ur5, random, motion=motion) for _ in range(2))
        estimate = sy.least_squares(alone)
        robot = {"robot": KnownRobot(estimate.base, estimate.covariance)} if known else {"unloaded": alone}
        claims.append(estimate_payload(body, loaded, **robot)["mass"].lower > 0.0)
    assert sum(claims) <= 4  # of 30 draws of 5 %, more come in one case of a hundred


def test_swapped_logs_are_refused(ur5):
    random = np.random.default_rng(9)
    held, motion = Payload.random(random, 2.0), thinned(ur5.motion(random))
    alone, loaded = (information(ur5, random, p, motion=motion) for p in (None, held))
    with pytest.raises(InputError, match=r"a mass of -[12]\.\d+ kg: more was carried in the unloaded log"):
        estimate_payload(last(ur5), alone, loaded)
    with pytest.raises(InputError, match="give one of unloaded= and robot="):
        estimate_payload(last(ur5), loaded)


def test_another_model_is_refused(ur5):
    random = np.random.default_rng(10)
    motion = tuple(array[::100] for array in ur5.motion(random))
    samples = ur5.samples(random, motion=motion)
    other = sy.Model(ur5.model.robot.with_terms(sy.Viscous()))
    wrong = sy.Information.from_samples(other, samples)
    right = sy.Information.from_samples(ur5.model, samples)
    with pytest.raises(InputError, match="The loaded log was reduced for another model"):
        estimate_payload(last(ur5), wrong, right)


def test_robot_and_payload_are_proved_feasible(ur5):
    """The smallest payload with the most noise: least squares alone have an impossible inertia."""
    random = np.random.default_rng(11)
    held, motion = Payload.random(random, 0.2), thinned(ur5.motion(random))
    alone, loaded = (information(ur5, random, p, motion=motion, noise=0.05) for p in (None, held))
    found = estimate_payload(last(ur5), loaded, alone)
    bodies = found.robot_and_payload[: ur5.model.parameter_count]
    matrices = [sy.Inertia.from_parameters(bodies[columns]).pseudo_inertia for columns in ur5.model.link_columns]
    matrices.append(sy.Inertia.from_parameters(found.parameters).pseudo_inertia)
    assert min(np.linalg.eigvalsh(matrix)[0] for matrix in matrices) > 0
    assert found.distance > 0.1
    assert found.certificate["verdict"] == "feasible"
    for one in found.quantities:
        assert not one.value < one.lower
        assert not one.value > one.upper


def test_filtered_torques_have_no_interval(ur5):
    random = np.random.default_rng(12)
    held, motion = Payload.random(random, 2.0), thinned(ur5.motion(random))
    both = [
        sy.Information.from_samples(ur5.model, replace(ur5.samples(random, p, motion=motion), filtered_torque=True))
        for p in (None, held)
    ]
    found = estimate_payload(last(ur5), both[1], both[0])
    assert abs(found.mass - 2.0) < 0.1
    assert np.isnan([found["mass"].lower, found["mass"].upper]).all()
    assert any("No interval" in remark for remark in found.remarks)


@pytest.mark.slow
@pytest.mark.parametrize("mass", [0.5, 5.0])
def test_intervals_hold_the_truth(arm, mass):
    """Of 20 logs with noise of 1.5 % on torques, and on encoders; `benchmarks/payload.py` prints 100 of each."""
    inside, errors = [], []
    for seed in range(20):
        random = np.random.default_rng([seed, 77])
        held, motion = Payload.random(random, mass), arm.motion(random)
        both = [
            sy.Information.from_samples(
                arm.model, arm.log(random, p, motion=motion).process(cutoff=5.0, velocity_threshold=0.005)
            )
            for p in (None, held)
        ]
        found = estimate_payload(last(arm), both[1], both[0])
        errors.append(found.mass / mass - 1.0)
        inside.append([mass in found["mass"], *(c in found[f"c{a}"] for a, c in zip("xyz", held.com, strict=True))])
    assert np.abs(errors).max() < 0.02
    assert np.mean(inside) > 0.88  # of 80 draws with 95 % each, fewer than 71 come in one case of a hundred


ODD = {
    "gantry": [("pi/2", 0, "q", 0)] * 3,
    "scara": [(0, 0.3, 0.3, "q"), ("pi", 0.3, 0, "q"), (0, 0, "q", 0)],
    "arm": [("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q"), ("pi/2", 0.3, 0, "q")],
}
SHOWN = {
    # A gantry accelerates its payload and never turns it; a SCARA turns it about vertical axes alone.
    ("gantry", 2): {"mass": "measured", "cx": "open", "cy": "open", "cz": "open", "Ixx": "open"},
    ("scara", 2): {"mass": "measured", "cx": "measured", "cy": "measured", "cz": "open", "Ixx": "open"},
    ("arm", 2): dict.fromkeys(("mass", "cx", "cy", "cz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz"), "measured"),
    # The first link of the arm turns about a vertical axis, where friction with the load is another one.
    ("arm", 0): {"mass": "open", "cx": "open", "Ixx": "open"},
}


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "link"), SHOWN)
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_what_other_robots_show_of_a_payload(kind, link, noise):
    robot = sy.Robot.from_dh(ODD[kind])
    terms = [sy.Viscous(), sy.Coulomb(), sy.Offset()]
    if kind == "arm":
        terms = [sy.MotorSide(coupling=[[1, 0, 0], [0, 1, 1], [0, 0, 1]])]
    model = sy.Model(robot.with_terms(*terms))
    random = np.random.default_rng(15)
    q, dq, ddq = random.normal(size=(3, 500, 3))
    alone = np.full(model.parameter_count, 0.3)
    for columns in model.link_columns:
        alone[columns] = sy.Inertia.from_com(2.0, random.uniform(-0.1, 0.1, 3), 0.02 * np.eye(3)).parameters
    truth = {"mass": 0.7, "cx": 0.03, "cy": -0.02, "cz": 0.1, "Ixx": 0.004, "Iyy": 0.004, "Izz": 0.004}
    held = sy.Inertia.from_com(0.7, [0.03, -0.02, 0.1], 0.004 * np.eye(3)).parameters
    loaded = alone.copy()
    loaded[model.link_columns[link]] += held
    both = []
    for parameters in (alone, loaded):
        torque = model.inverse_dynamics(q, dq, ddq, parameters)
        torque = torque + noise * np.sqrt(np.mean(torque**2, axis=0)) * random.normal(size=torque.shape)
        both.append(sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque)))
    found = estimate_payload(CarriedBody(model, link), both[1], both[0])
    assert {name: found[name].standing for name in SHOWN[kind, link]} == SHOWN[kind, link]
    for name, value in truth.items():
        one = found[name]
        width = one.upper - one.lower
        assert one.lower - 0.5 * width <= value <= one.upper + 0.5 * width, name  # far outside 95 % intervals
        assert not (np.isnan(one.value) and one.standing == "measured")
        assert np.isnan(one.value) or one.standing != "open"
        if noise == 0.0 and one.standing == "measured":
            assert one.value == pytest.approx(value, abs=1e-7)


def test_friction_by_a_signal_may_change_like_any_other():
    robot = sy.Robot.from_dh([(0, 1.0, 0, "q")])
    warm = sy.Model(robot.with_terms(ChannelFriction("temperature", range=[15, 60], reference=25), sy.Offset()))
    assert [warm.parameter_names[k] for k in changing_parameters(warm)] == ["Fcj1", "Fvj1"]
