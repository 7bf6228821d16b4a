"""Samples as they come, and as a robot should not send them; what comes out is that of the whole log."""

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt
from two_joint_arm import unstated_arm, unstated_parameters

import steelyard as sy
from steelyard.online import OnlineEstimate, online_estimator
from steelyard.online.causal_filter import CausalMotionFilter
from steelyard.online.even_stream import EvenStream
from steelyard.online.running_information import RunningInformation

Array = NDArray[np.float64]
TRUE = unstated_parameters()


@pytest.fixture(scope="module")
def model() -> sy.Model:
    return unstated_arm()


@pytest.fixture(scope="module")
def motion(model: sy.Model) -> tuple[Array, ...]:
    """5 s of a motion: t, q, dq, ddq and the torque with noise."""
    t = np.arange(5000) / 1000
    pace = np.array([3.0, 4.0])
    q, dq, ddq = np.sin(pace * t[:, None]), pace * np.cos(pace * t[:, None]), -(pace**2) * np.sin(pace * t[:, None])
    torque = model.inverse_dynamics(q, dq, ddq, TRUE)
    return t, q, dq, ddq, torque + 0.1 * np.random.default_rng(1).normal(size=q.shape)


def batch_fit(estimator: sy.OnlineEstimator, answer: OnlineEstimate) -> sy.Estimate:
    """The same problem as an answer, solved as that of a log."""
    return sy.fit(
        estimator.information,
        estimator.feasible_set,
        weights=answer.weights,
        prior=answer.prior,
        prior_weight=answer.prior_weight,
    )


def gram(factor: sy.regression.Factor) -> Array:
    return np.asarray(factor.triangle.T @ factor.triangle)


def same(one: sy.Information, other: sy.Information) -> bool:
    """Whether two Informations hold the same sums of products; triangles of full columns alone are unique."""
    levels = [one.factors, *one.batch_means], [other.factors, *other.batch_means]
    pairs = [pair for own, further in zip(*levels, strict=True) for pair in zip(own, further, strict=True)]
    return all(
        a.count == b.count and np.allclose(gram(a), gram(b), rtol=1e-10, atol=1e-10 * np.abs(gram(b)).max())
        for a, b in pairs
    )


def test_rows_that_come_in_tens_are_reduced_as_the_whole_log(model: sy.Model, motion: tuple[Array, ...]) -> None:
    t, q, dq, ddq, torque = motion
    estimator = sy.OnlineEstimator(model, least_speed=0.0)
    for k in range(3333):
        estimator.update(t[k], q[k], torque[k], dq[k], ddq[k])
    estimator.flush()
    samples = sy.Samples(q=q[:3333], dq=dq[:3333], ddq=ddq[:3333], torque=torque[:3333])
    assert same(estimator.information, sy.Information.from_samples(model, samples))


def test_answers_are_those_of_the_batch_fit(model: sy.Model, motion: tuple[Array, ...]) -> None:
    t, q, _, _, torque = motion
    estimator = sy.OnlineEstimator(model)
    for k in range(0, 5000, 250):
        estimator.update(t[k : k + 250], q[k : k + 250], torque[k : k + 250])
        answer = estimator.estimate(accuracy=1e-10)
        assert estimator.feasible_set.contains(answer.parameters)
    batch = batch_fit(estimator, answer)
    assert answer.converged
    assert answer.base == pytest.approx(batch.base, rel=1e-4, abs=1e-5 * np.abs(batch.base).max())
    true = model.base_parameters().values(TRUE)
    assert answer.base == pytest.approx(true, abs=0.05)


def test_the_filter_is_the_zero_phase_one_late_by_its_delay() -> None:
    random = np.random.default_rng(2)
    q = np.cumsum(np.cumsum(random.normal(size=(3000, 2)), axis=0), axis=0) * 1e-5
    found = CausalMotionFilter(1000.0, 10.0, 3, 2)
    out = np.concatenate([found.add(q[k : k + 7]) for k in range(0, 2996, 7)])
    reference = sosfiltfilt(butter(3, 10.0 / 500.0, output="sos"), q, axis=0)
    inside = slice(700, 2000)
    expected = reference[found.delay :][inside]
    assert np.abs(out[inside, 0] - expected).max() < 1e-4 * np.abs(expected).max()
    speed = np.gradient(reference, 1e-3, axis=0)[found.delay :][inside]
    assert np.abs(out[inside, 1] - speed).max() < 1e-3 * np.abs(speed).max()


def test_polynomials_pass_the_filter_with_their_derivatives() -> None:
    t = np.arange(1000)[:, None] / 1000
    out = CausalMotionFilter(1000.0, 10.0, 3, 1).add(2.0 + 3.0 * t - 4.0 * t**2 + t**3)
    late = t[220:780]
    assert np.allclose(out[:, 0], 2.0 + 3.0 * late - 4.0 * late**2 + late**3, atol=1e-12)
    assert np.allclose(out[:, 2], -8.0 + 6.0 * late, atol=1e-7)


def spoilt(t: Array, rows: Array, kind: str) -> tuple[Array, Array]:
    """Times and rows of q and torque of two joints, as a robot should not send them."""
    random = np.random.default_rng(3)
    t, rows = t.copy(), rows.copy()
    if kind == "jitter":
        t += random.uniform(-3e-4, 3e-4, size=t.shape)
        # Positions at the times that are told, as a robot samples them.
        rows[:, :2] = np.sin(np.array([3.0, 4.0]) * t[:, None])
    elif kind == "absolute":
        t += 1.7e9
    elif kind == "missing":
        kept = random.uniform(size=len(t)) > 0.1
        t, rows = t[kept], rows[kept]
    elif kind == "repeated":
        order = np.sort(np.concatenate([np.arange(len(t)), random.integers(0, len(t), size=300)]))
        t, rows = t[order], rows[order]
    elif kind == "nan":
        rows[random.integers(0, len(t), size=50), random.integers(0, 4, size=50)] = np.nan
        t[random.integers(0, len(t), size=20)] = np.nan
    elif kind == "damaged message":
        rows[random.integers(0, len(t), size=50), random.integers(0, 4, size=50)] = 1e308
    elif kind == "gap":
        kept = (t < 2.0) | (t > 2.5)
        t, rows = t[kept], rows[kept]
    elif kind == "reset":
        t[2500:] -= 100.0
    elif kind == "wild":
        rows[random.integers(0, len(t), size=5), random.integers(0, 2, size=5)] += 3.0
    elif kind == "modulo":
        rows[:, :2] = np.mod(rows[:, :2], 2.0 * np.pi)
    return t, rows


TOLD = {
    "even": "",
    "jitter": "interpolated",
    "absolute": "",
    "missing": "interpolated",
    "repeated": "time stamp of the one before",
    "nan": "no finite number",
    "damaged message": "beyond 1e12",
    "gap": "missing for more than 20 ms",
    "reset": "clock went back",
    "wild": "5 samples had a position that is too far from those before and after",
    "modulo": "times a position jumped by a turn",
}


@pytest.mark.parametrize("kind", TOLD)
def test_samples_that_are_not_as_they_should_be(model: sy.Model, motion: tuple[Array, ...], kind: str) -> None:
    t, q, _, _, torque = motion
    times, rows = spoilt(t, np.hstack([q, torque]), kind)
    estimator = sy.OnlineEstimator(model)
    for k in range(0, len(times), 100):
        part = slice(k, k + 100)
        estimator.update(times[part], rows[part, :2], rows[part, 2:])
    answer = estimator.estimate()
    assert estimator.feasible_set.contains(answer.parameters)
    assert answer.base == pytest.approx(model.base_parameters().values(TRUE), abs=0.06)
    assert TOLD[kind] in " ".join(estimator.remarks)
    assert bool(TOLD[kind]) == any(
        "interpolated" in r or "left out;" in r or "times" in r or "finite" in r or "stamp" in r
        for r in estimator.remarks
        if "slower" not in r
    )


@pytest.mark.parametrize("unit", [1e-3, 1e-9])
def test_stamps_since_1970_in_another_unit_are_told(model: sy.Model, motion: tuple[Array, ...], unit: float) -> None:
    t, q, _, _, torque = motion
    estimator = sy.OnlineEstimator(model)
    estimator.update((1.76e9 + t) / unit, q, torque)
    assert estimator.estimate().rows == 0
    assert f"{len(t)} samples had a time" in " ".join(estimator.remarks)
    assert "ms and ns, where s are expected" in " ".join(estimator.remarks)


@pytest.mark.parametrize(("rate", "jitter"), [(40.0, 0.0), (50.0, 0.5)])
def test_slow_samples_are_no_gaps(model: sy.Model, motion: tuple[Array, ...], rate: float, jitter: float) -> None:
    """All of them count where that is the rate that was said; where it was not, the remarks say what came."""
    random = np.random.default_rng(2)
    times = (np.arange(800) + jitter * random.uniform(-0.5, 0.5, 800)) / rate
    pace = np.array([3.0, 4.0])
    q, dq, ddq = (f(pace * times[:, None]) * pace**k for f, k in ((np.sin, 0), (np.cos, 1), (lambda x: -np.sin(x), 2)))
    slow, said = sy.OnlineEstimator(model, rate=rate), sy.OnlineEstimator(model, longest_gap=0.01)
    for estimator in (slow, said):
        estimator.update(times, q, model.inverse_dynamics(q, dq, ddq, TRUE))
    answer = slow.estimate()
    assert answer.rows > 1400
    assert slow.stream_counts["gaps"] == 0
    assert slow.information.relative_error(answer.base) < 0.02
    told = " ".join(said.remarks)
    assert f"Most samples are {np.diff(times).mean():.4g} s after the one before" in told
    assert "Samples come at" not in told


def test_even_samples_pass_unchanged_whatever_their_parts() -> None:
    rows = np.column_stack([1.7e9 + np.arange(1000) / 1000, np.random.default_rng(4).normal(size=(1000, 2))])
    stream = EvenStream(1000.0, 1, 0.02)
    parts = [stretch for k in range(0, 1000, 37) for stretch in stream.add(rows[k : k + 37])]
    assert np.array_equal(np.concatenate([part.values for part in parts]), rows[:, 1:2])
    assert [part.begins for part in parts] == [True] + [False] * (len(parts) - 1)


def test_a_robot_at_rest_tells_no_friction_and_forgets_nothing(model: sy.Model, motion: tuple[Array, ...]) -> None:
    t, q, _, _, torque = motion
    estimator = sy.OnlineEstimator(model, forget=1.0)
    estimator.update(t, q, torque)
    before = estimator.information
    still = np.tile(q[-1], (3000, 1))
    estimator.update(5.0 + t[:3000] + 1.0, still, np.zeros_like(still))
    assert same(estimator.information, before)
    assert "slower than 0.001" in " ".join(estimator.remarks)


def test_what_is_forgotten_counts_less_by_the_time_constant(model: sy.Model, motion: tuple[Array, ...]) -> None:
    t, q, dq, ddq, torque = motion
    estimator = sy.OnlineEstimator(model, forget=0.5, least_speed=0.0)
    for part in parts(5000, (10,)):
        estimator.update(t[part], q[part], torque[part], dq[part], ddq[part])
    weights = np.exp(-(5000 - np.arange(5000)) / 500.0)
    rows = np.column_stack([model.base_columns.by_joint(model.base_columns.entries(q, dq, ddq))[1], torque[:, 1]])
    expected = (rows * weights[:, None]).T @ rows
    assert np.allclose(gram(estimator.information.factors[1]), expected, rtol=0.0, atol=0.02 * np.abs(expected).max())


def test_a_window_holds_the_newest_samples_alone(model: sy.Model, motion: tuple[Array, ...]) -> None:
    t, q, dq, ddq, torque = motion
    estimator = sy.OnlineEstimator(model, window=0.8, least_speed=0.0)
    for k in range(0, 5000, 50):
        part = slice(k, k + 50)
        estimator.update(t[part], q[part], torque[part], dq[part], ddq[part])
    newest = slice(5000 - 800, 5000)
    samples = sy.Samples(q=q[newest], dq=dq[newest], ddq=ddq[newest], torque=torque[newest])
    expected = sy.Information.from_samples(model, samples, batch_means=False)
    found = estimator.information
    assert found.count == expected.count
    for a, b in zip(found.factors, expected.factors, strict=True):
        assert np.allclose(gram(a), gram(b), rtol=1e-10, atol=1e-10 * np.abs(gram(b)).max())


@pytest.mark.parametrize("together", [1, 3000])
@pytest.mark.parametrize("options", [{"forget": 0.5}, {"window": 0.8}, {"forget": 0.5, "window": 0.8}])
def test_samples_count_alike_one_by_one_and_together(
    model: sy.Model, motion: tuple[Array, ...], options: dict[str, float], together: int
) -> None:
    # The least squares of NumPy, with a weight for each row; every third torque of the first joint is missing.
    t, q, dq, ddq, torque = (array[:3000] for array in motion)
    torque = np.where(np.arange(3000)[:, None] % 3 > [0, -1], torque, np.nan)
    estimator = sy.OnlineEstimator(model, least_speed=0.0, weights=None, **options)
    for k in range(0, 3000, together):
        rows = slice(k, k + together) if together > 1 else k
        estimator.update(t[rows], q[rows], torque[rows], dq[rows], ddq[rows])
    shown = np.isfinite(torque)
    after = np.cumsum(shown[::-1], axis=0)[::-1] - shown
    keep = np.exp(-1.0 / (0.5 * 1000.0)) if "forget" in options else 1.0
    weights = np.sqrt(keep**after) * shown
    if "window" in options:
        weights[:-800] = 0.0  # eight parts of 100 samples each
    regressor = np.asarray(model.kernel("regressor", base=True)(q, dq, ddq)).reshape(3000, 2, -1)
    W = (weights[:, :, None] * regressor).reshape(6000, -1)
    expected = np.linalg.lstsq(W, (weights * np.nan_to_num(torque)).ravel(), rcond=None)[0]
    information = estimator.information
    np.testing.assert_allclose(sy.least_squares(information, weights=None).base, expected, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose([f.count for f in information.factors], np.sum(weights**2, axis=0), atol=0.51)


def test_a_search_that_is_stopped_gives_a_possible_answer(model: sy.Model, motion: tuple[Array, ...]) -> None:
    t, q, _, _, torque = motion
    estimator = sy.OnlineEstimator(model)
    estimator.update(t, q, torque)
    answer = estimator.estimate(seconds=1e-9)
    assert not answer.converged
    assert "stopped" in answer.remark
    assert estimator.feasible_set.contains(answer.parameters)
    assert estimator.estimate().converged


LIGHT = """<robot name="light"><link name="base"/>
<link name="l1"><inertial><mass value="1.36"/><inertia ixx="0.0014" iyy="0.0014" izz="0.0009"
  ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><axis xyz="1 0 0"/>
<limit lower="-3" upper="3" effort="100" velocity="10"/></joint>
<link name="l2"><inertial><mass value="0.495"/><inertia ixx="0.011" iyy="0.0079" izz="0.0083"
  ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><axis xyz="0 1 0"/>
<origin xyz="0.17 0.7 0.37" rpy="1.5707963 0 0"/>
<limit lower="-3" upper="3" effort="100" velocity="10"/></joint></robot>"""
"""A description that has a tenth of the masses that the robot has, and centres of mass elsewhere."""


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [pytest.param(np.inf, marks=pytest.mark.slow), 1e-3])
def test_a_robot_unlike_its_description_has_answers_at_all_times(seconds: float, tmp_path: Path) -> None:
    """The search alone ends in corners, singular to rounding; where there is time, every answer is the best."""
    (tmp_path / "light.urdf").write_text(LIGHT)
    model = sy.Model(sy.Robot.from_urdf(tmp_path / "light.urdf"))
    heavy = [0.5, -0.01, 0.17, 0.55, -0.09, 0.31, -1.23, 0.28, 1.24, 11.5]
    truth = np.array([*heavy, 0.0096, 0.0044, 0.0044, 0.0187, -0.0011, 0.0193, 0.25, -0.13, -0.09, 5.4])
    t = np.arange(2000) / 1000
    q, dq, ddq = np.zeros((3, len(t), 2))
    for pace, size in ((np.array([5.2, 1.8]), np.array([0.8, 0.35])), (np.array([4.4, 4.1]), np.array([0.4, 0.5]))):
        angle = pace * t[:, None] + 5.4
        q, dq = q + size * np.sin(angle), dq + size * pace * np.cos(angle)
        ddq = ddq - size * pace**2 * np.sin(angle)
    torque = model.inverse_dynamics(q, dq, ddq, truth)
    torque = torque + 1e-3 * torque.std(axis=0) * np.random.default_rng(0).normal(size=torque.shape)
    estimator = sy.OnlineEstimator(model, forget=2.0)
    answers = []
    rows = 200 if seconds == np.inf else 100
    for start in range(0, len(t), rows):
        estimator.update(t[start : start + rows], q[start : start + rows], torque[start : start + rows])
        answers.append(estimator.estimate(seconds=seconds))
        assert estimator.feasible_set.contains(answers[-1].parameters)
    if seconds == np.inf:
        assert all(one.converged for one in answers if one.rows)
        assert estimator.information.relative_error(answers[-1].base) < 0.2


@pytest.mark.parametrize("most", [0.5, 1.0])
@pytest.mark.parametrize("consistency", ["full", "inertia"])
def test_a_bound_on_the_mass_of_a_light_robot_leaves_room(
    model: sy.Model, motion: tuple[Array, ...], consistency: Literal["full", "inertia"], most: float
) -> None:
    """The masses that are assumed then lie on the bound, and the search begins elsewhere."""
    t, q, dq, ddq, _ = motion
    true = TRUE.copy()
    true[:10] *= 0.1 * most
    true[12:22] *= 0.2 * most
    torque = model.inverse_dynamics(q, dq, ddq, true)
    bounded = sy.FeasibleSet(model, consistency=consistency, constraints=[sy.TotalMass(maximum=most)])
    assert bounded.contains(true)
    estimator = sy.OnlineEstimator(model, bounded)
    estimator.update(t, q, torque + 0.01 * np.random.default_rng(1).normal(size=q.shape))
    answer = estimator.estimate(accuracy=1e-9)
    batch = batch_fit(estimator, answer)
    assert answer.base == pytest.approx(batch.base, abs=1e-5 * np.abs(batch.base).max())
    assert answer.base == pytest.approx(model.base_parameters().values(true), abs=0.05)


def test_answers_are_proved(model: sy.Model, motion: tuple[Array, ...]) -> None:
    t, q, _, _, torque = motion
    estimator = sy.OnlineEstimator(model)
    estimator.update(t, q, torque)
    estimate = estimator.proved()
    assert sy.check(sy.FeasibleSet(model), parameters=estimate.parameters).feasible
    assert estimate.certificate


def test_intervals_hold_the_truth(model: sy.Model, motion: tuple[Array, ...]) -> None:
    t, q, dq, ddq, torque = motion
    base = model.base_parameters().values(TRUE)
    estimator = sy.OnlineEstimator(model)
    random = np.random.default_rng(5)
    torque = model.inverse_dynamics(q, dq, ddq, TRUE)
    held = []
    for _ in range(10):
        estimator.restart()
        estimator.update(t, q, torque + 0.1 * random.normal(size=q.shape), dq, ddq)
        low, high = estimator.intervals().T
        held.append((low < base) & (base < high))
        both = estimator.intervals(np.eye(12)[:2].sum(axis=0))
        assert low[:2].sum() < both[0, 0] < both[0, 1] < high[:2].sum()
    # 114 of 120 are expected; fewer than 100 or more than 119 with a probability below 1 %.
    assert 100 <= np.sum(held) <= 119


@pytest.mark.slow
@pytest.mark.parametrize("options", [{"forget": 1.0}, {"forget": 1.0, "window": 2.5}])
def test_intervals_are_no_wider_than_what_is_forgotten_asks_for(
    model: sy.Model, motion: tuple[Array, ...], options: dict[str, float]
) -> None:
    """The variance of a weighted mean takes the squares of the weights: half of what the weights themselves make it."""
    t, q, dq, ddq, _ = motion
    base, random = model.base_parameters().values(TRUE), np.random.default_rng(6)
    torque = model.inverse_dynamics(q, dq, ddq, TRUE)
    estimator, away = sy.OnlineEstimator(model, **options), []
    for _ in range(25):
        estimator.restart()
        estimator.update(t, q, torque + 0.1 * random.normal(size=q.shape), dq, ddq)
        low, high = estimator.intervals().T
        away.append((0.5 * (low + high) - base) / (high - low) * 2.0 * 1.96)
    # Of standard deviations that are right the mean square is 1, less what few batches and Student's quantile ask for.
    assert 0.7 < np.mean(np.square(away)) < 1.3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rate": 0.0}, "rate must be a positive number"),
        ({"cutoff": 600.0}, "half the rate"),
        ({"forget": -1.0}, "forget must be a positive number"),
        ({"forget": np.inf}, "or absent where nothing is forgotten, got inf"),
        ({"window": np.nan}, "window must be a number of s of at least 8 samples"),
        ({"window": 0.007}, "window must be a number of s of at least 8 samples"),
        ({"cutoff": 1e-6}, "would hold 2198806717 samples back"),
        ({"rate": 1e9}, "219880678 samples back at 1e.09 Hz, 0.2199 s, more than 100000 samples; give a cutoff"),
        ({"order": 0}, "order must be a whole number of at least 1, got 0"),
        ({"order": "3"}, "order must be a whole number of at least 1"),
        ({"prior_weight": "much"}, 'positive number or "auto"'),
        ({"weights": [1.0]}, "2 positive numbers"),
        ({"weights": "joints"}, "must be None, 'joint' or one number"),
        ({"least_speed": -1.0}, "at least 0"),
        ({"rate": 40.0, "longest_gap": 0.02}, "longer than the 0.025 s between two samples"),
    ],
)
def test_options_that_make_no_sense(model: sy.Model, options: dict[str, object], message: str) -> None:
    with pytest.raises(sy.InputError, match=message):
        sy.OnlineEstimator(model, **options).update(0.0, [0.0, 0.0], [0.0, 0.0])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("samples", "message"),
    [
        ([(0.0, [0.0], [0.0, 0.0])], "q has the shape"),
        ([(0.0, [0.0, 0.0], [0.0, 0.0], None, [0.0, 0.0])], "ddq was given without dq"),
        ([(0.0, [0.0, 0.0], [0.0, 0.0]), (0.1, [0.0, 0.0], [0.0, 0.0], [0.0, 0.0])], "give the same of every sample"),
        ([([0.0, 0.1], [[0.0, 0.0]], [[0.0, 0.0]])], "one row for each of 2 times"),
        ([([[0.0], [0.1]], np.zeros((2, 2)), np.zeros((2, 2)))], r"t has the shape \(2, 1\)"),
        ([(0.0, ["a", "b"], [0.0, 0.0])], "q must be real numbers"),
        ([(0.0, np.zeros(2) + 1j, [0.0, 0.0])], "q must be real numbers, got an array of complex128"),
        ([(0.0, np.zeros(2), np.ma.array([0.0, 1.0], mask=[0, 1]))], "torque must be .* masked numbers"),
    ],
)
def test_samples_that_do_not_fit(model: sy.Model, samples: list[tuple[object, ...]], message: str) -> None:
    estimator = sy.OnlineEstimator(model)
    *first, last = samples
    for sample in first:
        estimator.update(*sample)  # type: ignore[arg-type]
    with pytest.raises(sy.InputError, match=message):
        estimator.update(*last)  # type: ignore[arg-type]


@pytest.mark.parametrize("accuracy", [0.0, -1.0, np.nan, None])
def test_no_answer_is_called_the_best_by_an_accuracy_that_is_none(model: sy.Model, accuracy: object) -> None:
    with pytest.raises(sy.InputError, match="accuracy must be a positive number"):
        sy.OnlineEstimator(model).estimate(accuracy=accuracy)  # type: ignore[arg-type]
    with pytest.raises(sy.InputError, match="seconds must be a number of at least 0"):
        sy.OnlineEstimator(model).estimate(seconds=np.nan)


@pytest.mark.parametrize("combinations", [np.zeros((2, 2, 12)), np.full(12, np.nan), "x", np.zeros(11)])
def test_combinations_that_are_none(model: sy.Model, combinations: object) -> None:
    with pytest.raises(sy.InputError, match="combinations must be"):
        sy.OnlineEstimator(model).intervals(combinations)  # type: ignore[arg-type]


@pytest.mark.parametrize("together", [1, 7, 3000])
def test_what_is_missing_changes_nothing_of_the_rows_beside_it(
    model: sy.Model, motion: tuple[Array, ...], together: int
) -> None:
    """By a clock of which rounding leaves 1e-7 s: of 20 rows and 30 torques that are missing, so many are told."""
    t, q, dq, _, torque = (array[:3000] for array in motion)
    lost = np.arange(505, 2505, 100)
    silent = np.arange(1000, 1300, 10)
    torque = torque.copy()
    torque[silent, 0] = np.nan
    kept = np.setdiff1d(np.arange(3000), lost)
    estimator = sy.OnlineEstimator(model)
    times = 1.7e9 + t[kept]
    for k in range(0, len(kept), together):
        rows = kept[k : k + together] if together > 1 else kept[k]
        estimator.update(times[k : k + together] if together > 1 else times[k], q[rows], torque[rows])
    estimator.flush()
    assert estimator.stream_counts["interpolated"] == len(lost)
    assert estimator.stream_counts["torques missing"] == len(silent)
    rest = np.sum(np.abs(dq[220:-220]) < 1e-3, axis=0)
    assert [f.count for f in estimator.factors()] == [3000 - 440 - len(silent) - rest[0], 3000 - 440 - rest[1]]


def test_why_nothing_counts_yet_is_told(model: sy.Model, motion: tuple[Array, ...]) -> None:
    t, q, _, _, torque = motion
    estimator = sy.OnlineEstimator(model)
    estimator.update((1.7e9 + t).astype(np.float32), q, torque)
    assert "since the filter gives the first one after 0.44 s without a gap" in estimator.estimate().remark
    assert "in single precision times since 1970 are 128 s apart" in " ".join(estimator.remarks)
    assert np.spacing(np.float32(1.7e9)) == 128.0


def test_torques_at_a_limit_are_told_and_left_out(model: sy.Model, motion: tuple[Array, ...]) -> None:
    """With a tenth of them clipped, least squares would be off by up to 10 standard errors."""
    t, q, dq, ddq, torque = motion
    limit = 0.9 * np.abs(torque[:, 0]).max()
    clipped = torque.copy()
    clipped[:, 0] = np.clip(torque[:, 0], -limit, limit)
    at = np.abs(clipped[:, 0]) >= limit
    left_out = np.where(np.abs(clipped) < limit, clipped, np.nan)
    still = np.tile(q[:1], (3000, 1))
    held = np.tile(torque.max(axis=0), (3000, 1))  # the same torque at rest is no limit
    for given, rest, told in (
        (torque, False, False),
        (torque, True, False),
        (clipped, False, True),
        (left_out, False, False),
    ):
        estimator = sy.OnlineEstimator(model)
        if rest:
            estimator.update(t[:3000] - 3.0, still, held, 0.0 * still, 0.0 * still)
        estimator.update(t, q, given, dq, ddq)
        said = [remark for remark in estimator.remarks if "at its limit" in remark]
        assert len(said) == told
        assert all(remark.startswith("The torque of joint1 stands at") for remark in said)
        if told:
            lost = len(t) - estimator.factors()[0].count
            assert at.sum() <= lost < 3 * at.sum()
            assert f"{lost - np.sum(np.abs(dq[:, 0]) < 1e-3)} rows" in said[0]
            assert estimator.estimate().base == pytest.approx(model.base_parameters().values(TRUE), abs=0.05)


def test_a_dead_sensor_is_told(model: sy.Model, motion: tuple[Array, ...]) -> None:
    """That of joint 1 of a real arm reads 0 throughout; brakes make the torque 0, too, while an encoder flickers."""
    t, q, _, _, torque = motion
    flicker = 1e-4 * np.random.default_rng(1).integers(0, 2, size=q.shape)
    for positions, told in ((q, True), (q[0] + flicker, False)):
        estimator = sy.OnlineEstimator(model)
        estimator.update(t, positions, np.column_stack([np.zeros(len(t)), torque[:, 1]]))
        assert ("The torque of joint1 never changes" in str(estimator.remarks)) == told


@pytest.mark.parametrize("kind", ["", "degrees", "columns of torques", "noise"])
def test_what_no_parameters_explain_is_told(model: sy.Model, motion: tuple[Array, ...], kind: str) -> None:
    """With the part that the least squares of NumPy leave of the weighted torques."""
    t, q, dq, ddq, torque = motion
    if kind == "degrees":
        q, dq, ddq = (np.degrees(one) for one in (q, dq, ddq))
    elif kind == "columns of torques":
        torque = torque[:, ::-1]
    elif kind == "noise":
        torque = torque + 2.0 * np.random.default_rng(2).normal(size=torque.shape) * torque.std(axis=0)
    estimator = sy.OnlineEstimator(model, least_speed=0.0)
    estimator.update(t, q, torque, dq, ddq)
    weights = estimator.estimate().weights
    regressor = np.asarray(model.kernel("regressor", base=True)(q, dq, ddq)).reshape(len(t), 2, -1)
    W, omega = (weights[:, None] * regressor).reshape(2 * len(t), -1), (weights * torque).ravel()
    left = omega - W @ np.linalg.lstsq(W, omega, rcond=None)[0]
    part = float(np.linalg.norm(left) / np.linalg.norm(omega))
    told = " ".join(estimator.remarks)
    assert (f"Least squares leave {part:.2g} of the torques" in told) == bool(kind)
    assert (part > 0.5) == bool(kind)


def test_a_first_sample_that_is_refused_does_not_say_what_the_next_ones_hold(model: sy.Model) -> None:
    estimator = sy.OnlineEstimator(model)
    with pytest.raises(sy.InputError, match="dq has the shape"):
        estimator.update(0.0, [0.0, 0.0], [0.0, 0.0], [0.0])
    estimator.update(0.0, [0.0, 0.0], [0.0, 0.0])
    estimator.flush()
    assert estimator.stream_counts["received"] == 1


def parts(rows: int, sizes: tuple[int, ...]) -> Iterator[slice]:
    start, k = 0, 0
    while start < rows:
        size = sizes[k % len(sizes)]
        yield slice(start, min(rows, start + size))
        start, k = start + size, k + 1


def test_after_a_restart_nothing_of_the_samples_before_counts(model: sy.Model, motion: tuple[Array, ...]) -> None:
    """Not even what the filter held back of them, nor what was said of them."""
    t, q, _, _, torque = motion
    again, new = sy.OnlineEstimator(model), sy.OnlineEstimator(model)
    again.update(t[:2000], q[:2000], 3.0 * torque[:2000])
    again.update(t[1000:2000], q[1000:2000], torque[1000:2000])
    again.estimate()
    again.restart()
    assert again.remarks == ()
    for estimator in (again, new):
        estimator.update(t[2000:], q[2000:], torque[2000:])
    assert same(again.information, new.information)
    assert np.allclose(again.intervals(), new.intervals(), rtol=1e-9)


def heavier_from_13_s(
    model: sy.Model, seconds: int, pace: tuple[float, float], mass: float, place: tuple[float, float, float]
) -> tuple[Array, Array, Array]:
    """Times, positions and noisy torques of a robot whose second link carries a mass after 13 s."""
    t, speeds = np.arange(1000 * seconds) / 1000, np.array(pace)
    phase = speeds * t[:, None]
    q, dq, ddq = np.sin(phase), speeds * np.cos(phase), -(speeds**2) * np.sin(phase)
    heavier = TRUE.copy()
    heavier[12:22] += sy.Inertia.from_com(mass, place, 0.01 * np.eye(3)).parameters
    torque = model.inverse_dynamics(q, dq, ddq, TRUE)
    torque[13000:] = model.inverse_dynamics(q[13000:], dq[13000:], ddq[13000:], heavier)
    return t, q, torque + 0.1 * np.random.default_rng(1).normal(size=q.shape)


@pytest.mark.slow
def test_an_answer_that_what_is_assumed_keeps_from_the_data_is_told() -> None:
    """Two slides of 20 and 10 kg whose kinematics have no length, so that their links are taken for light ones."""
    rows = [
        (0, 0, "q", 0),
        ("pi/2", 0, "q", "pi/2"),
        ("pi/2", 0, 0.2, "q"),
        ("pi/2", 0.1, 0, "q"),
        ("-pi/2", 0, 0, "q"),
    ]
    gantry = sy.Model(sy.Robot.from_dh(rows, name="gantry"))
    links = [
        sy.Inertia.from_com(20.0 / k, [0.03, 0.02, -0.05], 0.5 / k * np.diag([0.1, 0.12, 0.09])).parameters
        for k in range(1, 6)
    ]
    t, pace = np.arange(8000)[:, None] / 1000, np.array([1.3, 2.1, 3.7, 2.9, 4.3])
    motion = 0.3 * np.sin(pace * t), 0.3 * pace * np.cos(pace * t), -0.3 * pace**2 * np.sin(pace * t)
    for scale, heavy in ((1.0, True), (0.02, False)):
        torque = gantry.inverse_dynamics(*motion, scale * np.concatenate(links))
        torque += 0.01 * torque.std(axis=0) * np.random.default_rng(1).normal(size=torque.shape)
        estimator = sy.OnlineEstimator(gantry)
        estimator.update(t[:, 0], motion[0], torque)
        answer = estimator.estimate()
        assert ("of the torques and least squares 0.0" in " ".join(estimator.remarks)) == heavy
        off = gantry.inverse_dynamics(*motion, answer.parameters) - torque
        assert (np.linalg.norm(off) > 0.2 * np.linalg.norm(torque)) == heavy


@pytest.mark.slow
def test_a_robot_that_picks_and_places_all_day_fills_no_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock that counts from 1970, whose times six digits do not tell apart."""
    monkeypatch.setattr(online_estimator, "MOST_CHANGES", 4)
    pendulum = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q")], gravity=(0, -9.81, 0)))
    alone = sy.Inertia.from_com(2.0, [-0.5, 0, 0], 0.1 * np.eye(3)).parameters
    weight = sy.Inertia.from_com(1.0, [0, 0, 0], 0.01 * np.eye(3)).parameters
    t = np.arange(70000)[:, None] / 1000
    held = (t // 8.0) % 2.0 == 1.0  # from 8 to 16 s, from 24 to 32 s and so on
    motion = np.sin(2 * t), 2 * np.cos(2 * t), -4 * np.sin(2 * t)
    torque = np.where(
        held, pendulum.inverse_dynamics(*motion, alone + weight), pendulum.inverse_dynamics(*motion, alone)
    )
    estimator = sy.OnlineEstimator(pendulum, detect_changes=True)
    noise = 0.1 * np.random.default_rng(1).normal(size=t.shape)
    estimator.update(1.7e9 + t[:, 0], motion[0], torque + noise)
    assert estimator.change_count == 8
    found = [change.t - 1.7e9 for change in estimator.changes]
    assert found == pytest.approx([8.0, 48.0, 56.0, 64.0], abs=0.6)
    told = [remark for remark in estimator.remarks if "changed" in remark]
    assert told[0].startswith("The robot changed 8 times, the first time at 1700000007.9")
    assert told[1].startswith("At 170000006")
    assert len(told) == 2


@pytest.mark.slow
@pytest.mark.parametrize("forget", [None, 5.0])
def test_a_motion_that_shows_more_is_no_change(model: sy.Model, forget: float | None) -> None:
    """20 s of slow motion tell little of inertias; the fast motion after it is that of the same robot."""
    t = np.arange(7000) / 200
    share = np.clip((t - 20.0) / 2.0, 0.0, 1.0)
    share = (share**3 * (10.0 - 15.0 * share + 6.0 * share**2))[:, None]
    slow, fast = 0.4 * np.sin(np.array([0.3, 0.5]) * t[:, None]), 0.4 * np.sin(np.array([4.0, 5.3]) * t[:, None])
    q = slow + share * (fast - slow)
    dq = np.gradient(q, 1 / 200, axis=0)
    torque = model.inverse_dynamics(q, dq, np.gradient(dq, 1 / 200, axis=0), TRUE)
    noise = 0.05 * np.random.default_rng(1).normal(size=q.shape)
    estimator = sy.OnlineEstimator(model, rate=200, detect_changes=True, forget=forget)
    estimator.update(t, q, torque + noise)
    assert estimator.changes == []
    assert estimator.information.relative_error(estimator.estimate().base) < 0.05


@pytest.mark.slow
def test_what_is_usual_is_learned_in_motion() -> None:
    """Nothing but noise is left at rest; then the arm moves, with friction that its model lacks, and never changes."""
    model = sy.Model(sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q")]))
    body = sy.Inertia.from_com(3.0, [-0.2, 0.0, 0.05], 0.02 * np.eye(3)).parameters
    t = np.arange(30 * 250)[:, None] / 250
    begins = np.clip(t - 15.0, 0.0, 1.0)
    share, pace = begins**2 * (3.0 - 2.0 * begins), np.array([3.0, 4.0])
    phase = pace * np.cumsum(share, axis=0) / 250
    q, dq = np.sin(phase), pace * share * np.cos(phase)
    torque = model.inverse_dynamics(q, dq, np.gradient(dq, 1 / 250, axis=0), np.tile(body, 2))
    torque += np.tanh(dq / 0.05) + 0.02 * np.random.default_rng(1).normal(size=q.shape)
    estimator = sy.OnlineEstimator(model, rate=250, detect_changes=True)
    estimator.update(t[:, 0], q, torque)
    assert estimator.changes == []


@pytest.mark.parametrize("detect", [False, True])
def test_an_arm_at_rest_whose_joints_feel_no_gravity_is_waited_for(detect: bool) -> None:
    """All rows of its regressor are zero, and all that is measured is noise."""
    model = sy.Model(sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")], gravity=(0, 0, -9.81)))
    t, random = np.arange(12000)[:, None] / 1000, np.random.default_rng(1)
    links = np.tile(sy.Inertia.from_com(3.0, [-0.2, 0.0, 0.0], 0.02 * np.eye(3)).parameters, 2)
    begins = np.clip(t - 6.0, 0.0, 1.0)
    share, pace = begins**2 * (3.0 - 2.0 * begins), np.array([3.0, 4.0])
    phase = pace * np.cumsum(share, axis=0) / 1000
    dq = pace * share * np.cos(phase)
    motion = np.sin(phase), dq, np.gradient(dq, 1e-3, axis=0)
    torque = model.inverse_dynamics(*motion, links) + 0.02 * random.normal(size=dq.shape)
    estimator = sy.OnlineEstimator(model, detect_changes=detect)
    estimator.update(t[:5000, 0], motion[0][:5000], torque[:5000], *(one[:5000] for one in motion[1:]))
    assert np.isinf(estimator.intervals()).all()
    assert "does not describe this motion" not in " ".join(estimator.remarks)
    estimator.update(t[5000:, 0], motion[0][5000:], torque[5000:], *(one[5000:] for one in motion[1:]))
    assert estimator.information.relative_error(estimator.estimate().base) < 0.1
    assert estimator.estimate().base == pytest.approx(model.base_parameters().values(links), abs=0.02)
    assert estimator.changes == []


@pytest.mark.slow
@pytest.mark.parametrize("jump", [-1e9, -100.0, 100.0])
def test_a_change_is_noticed_whatever_the_clock_does(model: sy.Model, jump: float) -> None:
    """The clock of a robot jumps while it is learned, as where it is set only then: the change comes 9 s later."""
    t, q, torque = heavier_from_13_s(model, 15, (3.0, 4.0), 1.5, (0.0, 0.0, 0.0))
    told = np.where(t < 4.0, t, t + jump)
    estimator = sy.OnlineEstimator(model, detect_changes=True)
    estimator.update(told, q, torque)
    assert [change.t - jump for change in estimator.changes] == [pytest.approx(13.0, abs=0.3)]


@pytest.mark.slow
def test_a_gap_teaches_nothing_of_a_robot_that_is_learned_anew(model: sy.Model) -> None:
    """A second after a change nothing comes for ten seconds: the estimate of one second is not taken for one of six."""
    t, q, torque = heavier_from_13_s(model, 30, (1.1, 0.7), 3.0, (0.1, 0.2, 0.0))
    kept = (t < 14.0) | (t >= 24.0)
    estimator = sy.OnlineEstimator(model, detect_changes=True)
    estimator.update(t[kept], q[kept], torque[kept])
    assert [round(change.t) for change in estimator.changes] == [13]


def test_merged_parts_are_the_whole(model: sy.Model, motion: tuple[Array, ...]) -> None:
    _, q, dq, ddq, torque = motion
    columns = model.base_columns
    whole, first, second = (RunningInformation(model) for _ in range(3))
    for part in parts(4096, (10, 333, 1)):
        entries = columns.by_joint(columns.entries(q[part], dq[part], ddq[part]))
        rows = [np.column_stack([own, torque[part, k]]) for k, own in enumerate(entries)]
        used = np.ones(torque[part].shape, dtype=bool)
        whole.add(rows, used)
        for start, half in ((0, first), (2048, second)):
            own = slice(max(part.start, start) - part.start, max(min(part.stop, start + 2048), part.start) - part.start)
            if own.stop > own.start:
                half.add([r[own] for r in rows], used[own])
    first.merge(second.ended())
    assert same(first.information(), whole.information())


@pytest.mark.parametrize("noise", [1e-4, 1e-3])
def test_a_joint_that_stands_still_shows_no_friction_by_the_noise_of_its_encoder(model: sy.Model, noise: float) -> None:
    """Velocities of noise have a sign, which friction at rest does not follow; few rows outweigh no other joint."""
    body = sy.Inertia.from_com(3.0, [-0.2, 0.0, 0.0], 0.02 * np.eye(3)).parameters
    true = np.concatenate([body, [0.5, 0.4], body, [0.3, 0.5]])
    t, random = np.arange(10000) / 500, np.random.default_rng(5)
    pace = np.array([1.1, 1.9, 2.7])
    motion = [f(pace * t[:, None]) @ (0.5 * pace**k) for f, k in ((np.sin, 0), (np.cos, 1), (lambda x: -np.sin(x), 2))]
    q, dq, ddq = (
        np.column_stack([one, still * np.ones(len(t))]) for one, still in zip(motion, (0.4, 0, 0), strict=True)
    )
    torque = model.inverse_dynamics(q, dq, ddq, true)
    torque[:, 1] += 0.2  # friction at rest: any, up to that of sliding
    torque += 0.01 * random.normal(size=torque.shape)
    estimator = sy.OnlineEstimator(model, rate=500)
    estimator.update(t, q + noise * random.normal(size=q.shape), torque)
    answer = estimator.estimate()
    intervals = estimator.intervals()
    names = list(model.base_parameters().expressions)
    low, high = intervals[names.index("Fcj2")]
    assert low < 0.5 < high
    assert estimator.factors()[1].count < 0.02 * len(t)
    low, high = intervals[names.index("Fcj1")]
    assert 0.3 < low < high < 0.5
    away = model.inverse_dynamics(q, dq, ddq, answer.parameters)[:, 0] - model.inverse_dynamics(q, dq, ddq, true)[:, 0]
    assert np.std(away) < 0.03 * np.std(torque[:, 0])
