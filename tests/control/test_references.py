"""References, velocity estimators and rotations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BPoly
from scipy.spatial.transform import Rotation, Slerp

import steelyard as sy
from steelyard.control import (
    ConstantPose,
    ConstantReference,
    FilteredDifference,
    NumericalDifference,
    PoseFunction,
    PoseTrajectory,
    Tool,
    TrajectoryReference,
    rotation_matrix,
    rotation_vector,
)
from steelyard.errors import InputError
from steelyard.identification.wam import TRAJECTORIES
from steelyard.simulation import Measurement

B = TRAJECTORIES["B"]


@given(
    st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3),
    st.sampled_from([1e-12, 1e-8, 1e-4, 0.1, 1.0, 2.0, 2.69, 2.7, 3.0, 3.14, 3.1415926, np.pi - 1e-9]),
)
def test_rotation_vectors_are_those_of_scipy(direction, angle):
    axis = np.array(direction)
    length = np.linalg.norm(axis)
    if length < 1e-3:
        return
    vector = angle * axis / length
    turn = Rotation.from_rotvec(vector).as_matrix()
    np.testing.assert_allclose(rotation_matrix(vector), turn, atol=2e-15)
    np.testing.assert_allclose(rotation_vector(turn), Rotation.from_matrix(turn).as_rotvec(), rtol=1e-7, atol=1e-15)


def test_rotations_at_rest_and_at_half_a_turn():
    assert not rotation_vector(np.eye(3)).any()
    np.testing.assert_array_equal(rotation_matrix(np.zeros(3)), np.eye(3))
    for axis in np.vstack((np.eye(3), [[0.6, 0.8, 0.0], [0.0, -0.6, 0.8], [0.36, 0.48, 0.8]])):
        turn = 2.0 * np.outer(axis, axis) - np.eye(3)
        found = rotation_vector(turn)
        np.testing.assert_allclose(np.abs(found @ axis), np.pi, rtol=1e-14)
        np.testing.assert_allclose(np.linalg.norm(found), np.pi, rtol=1e-14)


def test_many_rotations_at_once(random):
    turns = Rotation.random(200, random_state=3)
    found = rotation_vector(turns.as_matrix().reshape(20, 10, 3, 3))
    np.testing.assert_allclose(found.reshape(-1, 3), turns.as_rotvec(), atol=1e-12)
    np.testing.assert_allclose(rotation_matrix(found), turns.as_matrix().reshape(20, 10, 3, 3), atol=1e-12)


def test_a_trajectory_is_the_same_on_and_off_its_samples():
    reference = TrajectoryReference(B, start=4.0, sample_time=0.001)
    for t in (4.0, 4.001, 6.0475, 6.04751, 4.0 + 12.499, 4.0 + 12.5):
        expected = B.motion([t - 4.0])
        for found, wanted in zip(reference.at(t), expected, strict=True):
            np.testing.assert_allclose(found, wanted[0], atol=1e-12)
    for t, end in ((0.0, 0.0), (3.999, 0.0), (17.0, 12.5)):
        q, dq, ddq = reference.at(t)
        np.testing.assert_allclose(q, B.motion([end])[0][0])
        assert not dq.any()
        assert not ddq.any()


def test_a_periodic_trajectory_goes_on():
    reference = TrajectoryReference(B, repeat=True)
    np.testing.assert_allclose(reference.at(31.3)[1], B.motion([6.3])[1][0], atol=1e-9)


def test_a_constant_holds_one_or_many():
    assert ConstantReference(np.ones((4, 7))).at(2.0)[0].shape == (4, 7)
    with pytest.raises(sy.InputError, match="finite joint positions"):
        ConstantReference([np.inf])


def test_a_trajectory_needs_motion_and_duration():
    class Endless:
        def motion(self, t):
            return t

    with pytest.raises(sy.InputError, match="motion"):
        TrajectoryReference(Endless())


def test_poses_follow_the_quintic_and_the_shortest_turn(random):
    turns = Rotation.random(3, random_state=5)
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = turns.as_matrix(), random.normal(size=(3, 3))
    times = np.array([0.5, 1.5, 4.0])
    reference = PoseTrajectory(times, poses)
    for t in np.linspace(0.0, 5.0, 41):
        target = reference.target(t)
        inside = float(np.clip(t, 0.5, 4.0))
        k = min(int(np.searchsorted(times, inside, side="right")) - 1, 1)
        share = BPoly.from_derivatives(times[k : k + 2], [[0, 0, 0], [1, 0, 0]])
        between = Slerp([0.0, 1.0], turns[k : k + 2])(float(np.clip(share(inside), 0.0, 1.0)))
        np.testing.assert_allclose(target.pose[:3, :3], between.as_matrix(), atol=1e-12)
        way = poses[k + 1, :3, 3] - poses[k, :3, 3]
        np.testing.assert_allclose(target.pose[:3, 3], poses[k, :3, 3] + share(inside) * way, atol=1e-12)
        h = 1e-5
        if min(abs(times - t)) > 2 * h:
            after, before = reference.target(t + h), reference.target(t - h)
            spin = Rotation.from_matrix(after.pose[:3, :3] @ before.pose[:3, :3].T).as_rotvec() / (2 * h)
            np.testing.assert_allclose(target.twist[:3], (after.pose - before.pose)[:3, 3] / (2 * h), atol=1e-7)
            np.testing.assert_allclose(target.twist[3:], spin, atol=1e-7)
            np.testing.assert_allclose(target.acceleration, (after.twist - before.twist) / (2 * h), atol=1e-6)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PoseTrajectory([0.0], [np.eye(4)]), "at least two times"),
        (lambda: PoseTrajectory([0.0, 0.0], [np.eye(4)] * 2), "must increase"),
        (lambda: PoseTrajectory([0.0, 1.0], [np.eye(4)] * 3), "as many poses"),
        (lambda: ConstantPose(-np.eye(4)), "rotation matrix, a position"),
        (lambda: PoseFunction(lambda t: np.eye(4)).target(1.0), "three arrays; at 1 s"),
        (lambda: NumericalDifference(0), "steps must be a whole number of at least 1, got 0"),
        (lambda: NumericalDifference(order=3), "1 or 2"),
        (lambda: FilteredDifference(0.0), "cutoff"),
    ],
)
def test_bad_input_is_refused(make, message):
    with pytest.raises(sy.InputError, match=message):
        make()


def speeds(estimator, function, count=400, sample_time=0.001):
    estimator.start(Measurement(t=0.0, q=np.array([function(0.0)])))
    times = sample_time * np.arange(count)
    return times, np.array([float(estimator.velocity(Measurement(t=t, q=np.array([function(t)])))[0]) for t in times])


def test_differences_lag_as_they_say():
    """Of x = t³: the first order shows the velocity half its span earlier, the second order that of now."""
    t, one = speeds(NumericalDifference(), lambda t: t**3)
    np.testing.assert_allclose(one[5:], 3 * (t[5:] - 0.0005) ** 2, atol=1e-6)
    t, four = speeds(NumericalDifference(steps=4), lambda t: t**3)
    np.testing.assert_allclose(four[5:], 3 * (t[5:] - 0.002) ** 2, atol=1e-5)
    t, second = speeds(NumericalDifference(order=2), lambda t: 5 * t**2)
    np.testing.assert_allclose(second[3:], 10 * t[3:], atol=1e-9)
    t, second = speeds(NumericalDifference(steps=3, order=2), lambda t: 5 * t**2)
    np.testing.assert_allclose(second[7:], 10 * t[7:], atol=1e-9)


def test_the_filter_passes_what_is_below_its_cutoff():
    """Amplitudes against the first-order low pass, 1 / sqrt(1 + (f/fc)²)."""
    for frequency in (2.0, 20.0, 60.0):
        w = 2 * np.pi * frequency
        t, found = speeds(FilteredDifference(20.0), lambda t, w=w: np.sin(w * t) / w, 4000, 0.0002)
        phases = np.column_stack((np.sin(w * t), np.cos(w * t)))[2000:]
        amplitude = np.linalg.norm(np.linalg.lstsq(phases, found[2000:], rcond=None)[0])
        assert amplitude == pytest.approx(1 / np.hypot(1, frequency / 20.0), rel=0.02)


def test_no_time_no_change():
    estimator = NumericalDifference()
    seen = Measurement(t=0.0, q=np.ones(2))
    estimator.start(seen)
    np.testing.assert_array_equal(estimator.velocity(seen), 0.0)
    estimator.velocity(Measurement(t=0.1, q=np.full(2, 2.0)))
    np.testing.assert_allclose(estimator.velocity(Measurement(t=0.1, q=np.full(2, 2.0))), 10.0)


@pytest.mark.parametrize("placement", ["tip", [[1.0], [2.0, 3.0]], np.eye(4) * 1j, np.eye(3)])
def test_a_tool_is_placed_by_a_pose_or_a_position(placement):
    with pytest.raises(InputError, match=r"on 'link2' must be a pose \(4, 4\) or a position \(3,\), got [^ ]"):
        Tool("link2", placement)
