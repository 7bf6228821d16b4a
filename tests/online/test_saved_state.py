"""An estimator that is switched off in the evening and goes on in the morning, as if nothing had happened."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from two_joint_arm import unstated_arm, unstated_parameters

import steelyard as sy
from steelyard.estimators.physical_prior import physical_prior

Array = NDArray[np.float64]
TRUE, LOADED = unstated_parameters(), unstated_parameters(1.0)


@pytest.fixture(scope="module")
def model() -> sy.Model:
    return unstated_arm()


def log(model: sy.Model, seconds: float, loaded_from: float = np.inf, seed: int = 1) -> tuple[Array, ...]:
    """Times, positions, torques with noise, velocities and accelerations, at 500 Hz."""
    t, pace = np.arange(round(500 * seconds)) / 500, np.array([3.0, 4.0])
    motion = [f(pace * t[:, None]) * pace**k for f, k in ((np.sin, 0), (np.cos, 1), (lambda x: -np.sin(x), 2))]
    alone, loaded = (model.inverse_dynamics(*motion, parameters) for parameters in (TRUE, LOADED))
    torque = np.where(t[:, None] >= loaded_from, loaded, alone)
    return t, motion[0], torque + 0.1 * np.random.default_rng(seed).normal(size=torque.shape), motion[1], motion[2]


def spoilt(whole: tuple[Array, ...], random: np.random.Generator) -> tuple[Array, ...]:
    """The same log as a robot should not send it: by an absolute clock, with gaps, jumps, turns and no numbers."""
    t, q, torque, dq, ddq = (array.copy() for array in whole)
    count = len(t)
    q[random.integers(0, count, 10), random.integers(0, 2, 10)] = np.nan
    torque[random.integers(0, count, 20), random.integers(0, 2, 20)] = np.inf
    q[random.integers(0, count)] += 3.0
    q[random.integers(0, count) :, 0] += 2.0 * np.pi
    t[random.integers(0, count) :] += 0.3
    kept = random.uniform(size=count) > 0.01
    return tuple(array[kept] for array in (1.7e9 + t, q, torque, dq, ddq))


OPTIONS: tuple[dict[str, Any], ...] = (
    {},
    {"detect_changes": True},
    {"forget": 2},
    {"forget": 2.0, "window": 3.0, "detect_changes": True},
    {"window": 1.3, "weights": [1.0, 2.0], "prior_weight": 3.0, "torque_delay": [0.003, -0.0047]},
)


@pytest.mark.slow
@pytest.mark.parametrize("derivatives", [0, 1, 2])
@pytest.mark.parametrize(
    "options", [pytest.param(one, marks=[pytest.mark.slow] * ("detect_changes" in one)) for one in OPTIONS]
)
@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 8))])
def test_who_stops_and_goes_on_ends_as_who_never_stopped(
    model: sy.Model, tmp_path: Path, options: dict[str, Any], derivatives: int, seed: int
) -> None:
    """At any sample, in the middle of a batch or of the filter too: files of the two are the same to the last byte."""
    random = np.random.default_rng(seed)
    whole = spoilt(log(model, 14.0, loaded_from=10.0, seed=seed), random)
    never, stopped = (sy.OnlineEstimator(model, rate=500, **options) for _ in range(2))
    start, path = 0, tmp_path / "arm.npz"
    while start < len(whole[0]):
        size = int(random.choice([1, 1, 3, 10, 57, 500, 1500]))
        rows = slice(start, start + size) if size > 1 else start
        for estimator in (never, stopped):
            estimator.update(*(array[rows] for array in whole[: 3 + derivatives]))
        if random.uniform() < 0.1:
            assert np.array_equal(never.estimate().parameters, stopped.estimate().parameters)
        if start == 0 or random.uniform() < 0.3:
            stopped.save(path)
            stopped = sy.OnlineEstimator.load(path, model)
        start += size
    stopped.save(path)
    never.save(tmp_path / "never.npz")
    assert path.read_bytes() == (tmp_path / "never.npz").read_bytes()
    assert np.array_equal(never.estimate().parameters, stopped.estimate().parameters)
    assert np.array_equal(never.intervals(), stopped.intervals())
    assert never.remarks == stopped.remarks
    assert (stopped.change_count > 0) == bool(options.get("detect_changes"))
    told, again = (sy.OnlinePayload(estimator).estimate() for estimator in (never, stopped))
    assert repr(told) == repr(again)
    assert (told is None) == (stopped.change_count == 0)


@pytest.mark.slow
@pytest.mark.parametrize("clock", [43200.0, 0.0])
def test_what_was_learned_before_a_night_and_after_it_adds(model: sy.Model, tmp_path: Path, clock: float) -> None:
    """Each day has what an estimator of its own has; nothing is filtered or interpolated over the night."""
    evening, morning = log(model, 8.0, seed=1), log(model, 8.0, seed=2)
    estimator = sy.OnlineEstimator(model, rate=500, detect_changes=True)
    estimator.update(*evening[:3])
    estimator.save(tmp_path / "arm.npz")
    estimator = sy.OnlineEstimator.load(tmp_path / "arm.npz", model)
    estimator.update(morning[0] + clock, *morning[1:3])
    days = [sy.OnlineEstimator(model, rate=500) for _ in range(2)]
    for day, samples in zip(days, (evening, morning), strict=True):
        day.update(*samples[:3])
    for both, first, second in zip(estimator.factors(), *(day.factors() for day in days), strict=True):
        # Of noise the second day knows what the first one had, by which rows count as at rest.
        assert abs(both.count - first.count - second.count) <= 2
        grams = [one.triangle.T @ one.triangle for one in (both, first, second)]
        assert np.allclose(grams[0], grams[1] + grams[2], rtol=1e-3, atol=1e-4 * grams[0].max())
    assert estimator.changes == []
    assert estimator.stream_counts["gaps"] + estimator.stream_counts["clock resets"] == 1
    assert estimator.stream_counts["interpolated"] == 0
    low, high = estimator.intervals().T
    for day in days:
        lower, upper = day.intervals().T
        assert np.median((high - low) / (upper - lower)) == pytest.approx(np.sqrt(0.5), rel=0.25)


@pytest.mark.slow
def test_a_tool_that_is_changed_overnight_is_noticed_and_weighed(tmp_path: Path) -> None:
    rows = [("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q"), ("pi/2", 0.3, 0, "q")]
    model = sy.Model(sy.Robot.from_dh(rows, name="arm"))
    links = np.tile(sy.Inertia.from_com(2.0, [-0.1, 0, 0], 0.02 * np.eye(3)).parameters, 3)
    held = sy.Inertia.from_com(0.5, [0.02, 0.03, 0.1], 0.001 * np.eye(3)).parameters
    t, pace = np.arange(9000) / 1000, np.array([2.0, 3.1, 4.3])
    motion = [f(pace * t[:, None]) * pace**k for f, k in ((np.sin, 0), (np.cos, 1), (lambda x: -np.sin(x), 2))]
    noise = 0.05 * np.random.default_rng(1).normal(size=(2, 9000, 3))
    estimator = sy.OnlineEstimator(model, detect_changes=True)
    estimator.update(t, motion[0], model.inverse_dynamics(*motion, links) + noise[0])
    assert estimator.changes == []
    estimator.save(tmp_path / "arm.npz")
    estimator = sy.OnlineEstimator.load(tmp_path / "arm.npz", model)
    payload = sy.OnlinePayload(estimator)
    changed = links + np.concatenate([np.zeros(20), held])
    estimator.update(50000.0 + t, motion[0], model.inverse_dynamics(*motion, changed) + noise[1])
    assert [round(change.t) for change in estimator.changes] == [50000]
    found = payload.estimate()
    assert found is not None
    assert 0.5 in found["mass"]
    assert found.mass == pytest.approx(0.5, abs=0.02)


@pytest.mark.slow
def test_a_feasible_set_and_a_prior_are_given_again(model: sy.Model, tmp_path: Path) -> None:
    path = tmp_path / "arm.npz"
    light = sy.FeasibleSet(model, consistency="inertia", constraints=[sy.TotalMass(maximum=5.0)])
    prior = physical_prior(model).scaled(0.3)
    evening = sy.OnlineEstimator(model, light, rate=500, prior=prior)
    whole = log(model, 6.0)
    evening.update(*(array[:1500] for array in whole[:3]))
    evening.estimate()
    evening.save(path)
    for given, name in (({}, "feasible_set"), ({"feasible_set": light}, "prior")):
        with pytest.raises(sy.InputError, match=f"is of an estimator with a {name} of its own; give the same to load"):
            sy.OnlineEstimator.load(path, model, **given)
    morning = sy.OnlineEstimator.load(path, model, light, prior=prior)
    for estimator in (evening, morning):
        estimator.update(*(array[1500:] for array in whole[:3]))
    assert np.array_equal(evening.estimate().parameters, morning.estimate().parameters)
    lighter = sy.FeasibleSet(model, consistency="inertia", constraints=[sy.TotalMass(maximum=1.0)])
    other = sy.OnlineEstimator.load(path, model, lighter, prior=prior)  # in which the last answer does not lie
    other.update(*(array[1500:] for array in whole[:3]))
    answer = other.estimate()
    assert lighter.contains(answer.parameters)
    assert [f.count for f in other.factors()] == [f.count for f in evening.factors()]


@pytest.fixture(scope="module")
def saved(model: sy.Model, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path: Path = tmp_path_factory.mktemp("saved") / "arm.npz"
    estimator = sy.OnlineEstimator(model, rate=500, detect_changes=True)
    estimator.update(*log(model, 3.0)[:3])
    estimator.save(path)
    return path


def test_files_of_other_robots_are_refused(saved: Path) -> None:
    message = f"{saved.name}: is of another robot than arm, or of other terms; give the model of the estimator"
    for other in (
        unstated_arm(0.6),
        unstated_arm(gravity=(0.0, 0.0, -1.62)),
        sy.Model(unstated_arm().robot.with_terms(sy.Offset())),
    ):
        with pytest.raises(sy.InputError, match=message):
            sy.OnlineEstimator.load(saved, other)


def test_damaged_files_are_refused_with_a_sentence(model: sy.Model, saved: Path, tmp_path: Path) -> None:
    whole, path = saved.read_bytes(), tmp_path / "damaged.npz"
    random = np.random.default_rng(1)
    damaged = [whole[:cut] for cut in (0, 100, len(whole) // 2, len(whole) - 10)]
    for place in random.integers(1000, len(whole) - 1000, 20):
        damaged.append(whole[:place] + bytes([whole[place] ^ 1 << int(random.integers(8))]) + whole[place + 1 :])
    for content in (*damaged, b"{}", b"\x80\x04K\x01."):
        path.write_bytes(content)
        with pytest.raises(sy.InputError, match=r"cannot be read as the state of an OnlineEstimator: .*; give a file"):
            sy.OnlineEstimator.load(path, model)
    with pytest.raises(sy.InputError, match="No such file"):
        sy.OnlineEstimator.load(tmp_path / "missing.npz", model)


def changed(saved: Path, path: Path, change: Any) -> Path:
    """Write a saved state of which the description was changed."""
    with np.load(saved) as archive:
        document, numbers = json.loads(archive["description"].tobytes()), archive["numbers"]
    change(document)
    np.savez(path, description=np.frombuffer(json.dumps(document).encode(), np.uint8), numbers=numbers)
    return path


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda one: one.update(format="steelyard-online-estimator-9"), "a newer Steelyard wrote it: upgrade this one"),
        (lambda one: one.update(format="other"), "format is 'other'.*; let the estimator learn anew"),
        (lambda one: one["state"].pop("measured"), "'measured'; give a file"),
        (lambda one: one["state"]["t"].update(shape=[1, 1]), "t must be of the type float"),
        (lambda one: one["state"]["stream"]["newest"]["shape"].reverse(), "newest must be an array of the shape"),
        (lambda one: one["state"].update(taken="many"), "taken must be of the type int"),
        (lambda one: one["state"]["counted"]["current"]["triangles"].pop(), "numbers and tells of"),
    ],
)
def test_states_that_are_none_are_refused(
    model: sy.Model, saved: Path, tmp_path: Path, change: Any, message: str
) -> None:
    with pytest.raises(sy.InputError, match=message):
        sy.OnlineEstimator.load(changed(saved, tmp_path / "changed.npz", change), model)


def test_nothing_in_the_file_is_pickled(saved: Path) -> None:
    with np.load(saved, allow_pickle=False) as archive:
        assert {name: array.dtype.kind for name, array in archive.items()} == {"description": "u", "numbers": "f"}


def test_a_file_that_cannot_be_written_leaves_the_estimator_and_the_old_file(
    model: sy.Model, saved: Path, tmp_path: Path
) -> None:
    estimator = sy.OnlineEstimator.load(saved, model)
    with pytest.raises(sy.InputError, match="cannot be written"):
        estimator.save(tmp_path / "nowhere" / "arm.npz")
    estimator.save(tmp_path / "arm.npz")
    assert (tmp_path / "arm.npz").read_bytes() == saved.read_bytes()
    assert [one.name for one in tmp_path.iterdir()] == ["arm.npz"]
