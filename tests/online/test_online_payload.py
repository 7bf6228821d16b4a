"""A payload that a robot picks up while it moves is noticed, and found."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import steelyard as sy
from steelyard.estimators import CarriedBody, estimate_payload
from steelyard.online import ChangeDetector, OnlinePayloadEstimate, PickUpRun, simulated_pick_up, watch_pick_up

Array = NDArray[np.float64]
LINKS = np.tile(sy.Inertia.from_com(2.0, [-0.1, 0, 0], 0.02 * np.eye(3)).parameters, 3)
HELD = sy.Inertia.from_com(0.5, [0.02, 0.03, 0.1], 0.001 * np.eye(3))
PACE = np.array([2.0, 3.1, 4.3])


@pytest.fixture(scope="module")
def model() -> sy.Model:
    return sy.Model(sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q"), ("pi/2", 0.3, 0, "q")]))


def samples(model: sy.Model, t: Array, parameters: Array, seed: int) -> sy.Samples:
    """Motion and torques with noise."""
    q, dq, ddq = np.sin(PACE * t), PACE * np.cos(PACE * t), -(PACE**2) * np.sin(PACE * t)
    noise = 0.05 * np.random.default_rng(seed).normal(size=q.shape)
    return sy.Samples(q=q, dq=dq, ddq=ddq, torque=model.inverse_dynamics(q, dq, ddq, parameters) + noise)


def test_it_is_what_the_payload_command_finds(model: sy.Model) -> None:
    """The regression of both stretches at once, by the code that reads two logs."""
    loaded = LINKS + np.concatenate([np.zeros(20), HELD.parameters])
    t = np.arange(10000)[:, None] / 1000
    alone, held = samples(model, t[:6000], LINKS, 1), samples(model, t[6000:], loaded, 2)
    before = sy.Information.from_samples(model, alone)
    estimator = sy.OnlineEstimator(model)
    estimator.update(t[6000:, 0], held.q, held.torque, held.dq, held.ddq)
    found = sy.OnlinePayload(estimator, before=before).estimate()
    assert found is not None
    assert found.since == pytest.approx(4.0)
    after = sy.Information.from_samples(model, held)
    expected = estimate_payload(
        CarriedBody(model, 2, changes="nothing"), after, before, weights=before.joint_weights("joint")
    )
    for quantity in expected.quantities[:4]:
        own, half = found[quantity.name], (quantity.upper - quantity.lower) / 2
        assert own.value == pytest.approx(quantity.value, abs=0.1 * half)
        assert (own.upper - own.lower) / 2 == pytest.approx(half, rel=0.2)
        assert own.standing == "measured"
    for name, true in zip(("mass", "cx", "cy", "cz"), (HELD.mass, *HELD.com), strict=True):
        assert true in found[name]


def test_nothing_is_told_before_anything_changed(model: sy.Model) -> None:
    t = np.arange(7000)[:, None] / 1000
    data = samples(model, t, LINKS, 3)
    estimator = sy.OnlineEstimator(model, detect_changes=True)
    payload = sy.OnlinePayload(estimator)
    estimator.update(t[:, 0], data.q, data.torque, data.dq, data.ddq)
    assert estimator.changes == []
    assert payload.estimate() is None
    with pytest.raises(sy.InputError, match="which does not move"):
        sy.OnlinePayload(estimator, frame="base")


def test_what_makes_no_payload_is_refused_before_anything_is_picked_up(model: sy.Model) -> None:
    other = sy.Model(sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q"), ("pi/2", 0.3, 0, "q")]))
    empty = sy.Information.empty(model)
    together = replace(empty, factors=(sy.regression.Factor(None, np.arange(15), np.eye(16), 20),))
    for given, message in (
        ({"before": sy.Information.empty(other)}, "before: is of another robot or of other terms"),
        ({"before": together}, "before was reduced over all joints together"),
        ({"placement": np.zeros((4, 4))}, "placement must have 0, 0, 0, 1 as its last row"),
        ({"placement": np.eye(3)}, "placement must be a 4 x 4 matrix"),
        ({"changes": "frictions"}, "changes must be one of nothing, friction"),
    ):
        with pytest.raises(sy.InputError, match=message):
            sy.OnlinePayload(sy.OnlineEstimator(model), **given)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def with_friction(model: sy.Model) -> sy.Model:
    return sy.Model(model.robot.with_terms(sy.Viscous(), sy.Coulomb()))


def since(with_friction: sy.Model, friction: float, bodies: list[Array], seed: int) -> OnlinePayloadEstimate:
    """What is told after 4 s in which the links have other parameters, and friction is so many times as large."""
    t = np.arange(10000)[:, None] / 1000
    columns = np.concatenate(with_friction.link_columns)
    alone = np.full(with_friction.parameter_count, 0.6)
    alone[columns] = LINKS
    changed = friction * alone
    changed[columns] = LINKS + np.concatenate(bodies)
    before = sy.Information.from_samples(with_friction, samples(with_friction, t[:6000], alone, 2 * seed))
    after = samples(with_friction, t[6000:], changed, 2 * seed + 1)
    estimator = sy.OnlineEstimator(with_friction)
    estimator.update(t[6000:, 0], after.q, after.torque, after.dq, after.ddq)
    found = sy.OnlinePayload(estimator, before=before).estimate()
    assert found is not None
    return found


NOTHING = np.zeros(10)


@pytest.mark.slow
def test_friction_that_grows_with_the_load_is_no_part_of_it(with_friction: sy.Model) -> None:
    found = [since(with_friction, 1.2, [NOTHING, NOTHING, HELD.parameters], seed) for seed in range(15)]
    true = dict(zip(("mass", "cx", "cy", "cz"), (HELD.mass, *HELD.com), strict=True))
    held = [value in one[name] for one in found for name, value in true.items()]
    assert np.mean(held) > 0.85  # 60 of them, of which 57 are expected; 23 with friction that may not change
    assert all(one["mass"].standing == "measured" for one in found)
    assert all(one.remarks == () for one in found)


def test_friction_alone_is_no_payload(with_friction: sy.Model) -> None:
    found = since(with_friction, 2.0, [NOTHING] * 3, 1)
    assert found["mass"].lower == 0.0
    assert found["mass"].upper < 0.02
    assert np.isnan(found.center_of_mass).all()
    assert {found[name].standing for name in ("cx", "cz", "Ixx", "Ixy")} == {"open"}
    assert found.remarks == ()


def test_what_hangs_elsewhere_is_told_to_be_no_payload(with_friction: sy.Model) -> None:
    heavy = sy.Inertia.from_com(2.0, [0.2, 0.1, 0.0], 0.02 * np.eye(3)).parameters
    (remark,) = since(with_friction, 1.0, [NOTHING, heavy, NOTHING], 1).remarks
    assert "A payload does not explain the torques of" in remark


@pytest.mark.slow
def test_residuals_of_an_unchanged_robot_raise_no_alarm() -> None:
    """Residuals that last for 20 ms, of two joints, for half an hour; 3 s of them shifted by two deviations."""
    from scipy.signal import lfilter

    white = np.random.default_rng(6).normal(size=(1_800_000, 2))
    keep = np.exp(-0.05)
    residuals = lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], white, axis=0)
    detector = ChangeDetector(2, 50)
    used = np.ones((50, 2), dtype=bool)
    clock = np.arange(50) / 1000
    assert not any(detector.add(k / 1000 + clock, residuals[k : k + 50], used) for k in range(0, 1_797_000, 50))
    residuals[-3000:] += 2.0
    noticed = next(
        k for k in range(1_797_000, 1_800_000, 50) if detector.add(k / 1000 + clock, residuals[k : k + 50], used)
    )
    assert noticed - 1_797_000 < 1500
    assert detector.began == pytest.approx(1797.0, abs=0.3)


def test_one_jolt_is_no_change() -> None:
    residuals = np.random.default_rng(7).normal(size=(10000, 1))
    residuals[6010:6040] += 100.0
    detector, used = ChangeDetector(1, 50), np.ones((50, 1), dtype=bool)
    assert not any(detector.add(np.arange(k, k + 50) / 1000, residuals[k : k + 50], used) for k in range(0, 10000, 50))


@pytest.fixture(scope="module")
def run() -> PickUpRun:
    return watch_pick_up(simulated_pick_up(1, when=25.0, duration=28.0))


@pytest.mark.slow
def test_the_arm_of_the_demonstration_notices_what_it_picked_up(run: PickUpRun) -> None:
    (change,) = run.changes
    assert abs(change.t - 25.0) < 0.1
    assert change.noticed - 25.0 < 0.2
    found, truth = run.at(3.0), run.simulated.payload
    assert found is not None
    assert abs(found.mass / truth.mass - 1.0) < 0.05
    assert truth.mass in found["mass"]
    assert np.linalg.norm([found[f"c{a}"].value - c for a, c in zip("xyz", truth.com, strict=True)]) < 0.01
    assert run.at(0.0) is None


@pytest.mark.slow
def test_intervals_shrink_as_rows_arrive(run: PickUpRun) -> None:
    widths = [found["mass"].upper - found["mass"].lower for found in run.told]
    assert widths[-1] < 0.1
    assert widths[-1] < 0.5 * widths[2]
    table = str(run)
    assert "3 s" in table
    assert "Noticed" in table
