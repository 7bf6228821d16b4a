"""Several topics of a bag that belong together: what one lacks another has, at stamps that may differ."""

from pathlib import Path

import numpy as np
import pytest
from log_writers import START, State, states, write_mcap_json, write_ros1, write_ros2

from steelyard.errors import InputError
from steelyard.recording import LogColumns, Recording

pytest.importorskip("rosbags", reason="bags are read with rosbags")
pytest.importorskip("mcap", reason="MCAP files are read with mcap")

T = np.arange(200) / 250
JOINTS = ("shoulder", "elbow")
Q = np.column_stack([0.5 + 2.0 * T, 1.0 - 3.0 * T])
"""Straight lines, which interpolation leaves as they are."""
TORQUE = np.column_stack([4.0 * T, 7.0 - 5.0 * T])


def motion(t: np.ndarray = T, joints: tuple[str, ...] = JOINTS) -> list[State]:
    q = np.column_stack([0.5 + 2.0 * t, 1.0 - 3.0 * t])
    return states(t, joints, q, None, np.empty((len(t), 0)))


def efforts(t: np.ndarray = T, joints: tuple[str, ...] = JOINTS) -> list[State]:
    torque = np.column_stack([4.0 * t, 7.0 - 5.0 * t])
    return [one._replace(position=[], effort=row) for one, row in zip(motion(t, joints), torque, strict=True)]


def whole(joints: tuple[str, ...], t: np.ndarray = T) -> list[State]:
    return [a._replace(effort=b.effort) for a, b in zip(motion(t, joints), efforts(t, joints), strict=True)]


def expect(found: Recording, rows: slice) -> None:
    np.testing.assert_allclose(found.t, T[rows] - T[rows][0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.q, Q[rows], rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.torque, TORQUE[rows], rtol=0, atol=1e-8)


def guesses(found: Recording) -> str:
    assert found.layout is not None
    return " ".join(found.layout.guesses)


@pytest.mark.parametrize("name", ["ros1.bag", "ros2", "json.mcap"])
def test_topics_of_equal_stamps_are_joined_by_themselves(name: str, tmp_path: Path) -> None:
    """The broadcasters of ros2_control stamp all their messages with the time of one update; orders may differ."""
    turned = [one._replace(names=JOINTS[::-1], effort=one.effort[::-1]) for one in efforts()]
    write = {"ros1.bag": write_ros1, "ros2": write_ros2, "json.mcap": write_mcap_json}[name]
    path = write(tmp_path / name, {"/effort_states": turned, "/joint_states": motion()})
    found = Recording.read(path, joints=JOINTS)
    np.testing.assert_array_equal(found.q, Q)
    np.testing.assert_array_equal(found.torque, TORQUE)
    assert "effort[shoulder] … effort[elbow] come from the topic /effort_states; the stamps are the same." in guesses(
        found
    )


def test_torques_are_interpolated_to_the_stamps_of_the_positions(tmp_path: Path) -> None:
    late = T[10:-10] + 0.0013
    path = write_mcap_json(tmp_path / "run.mcap", {"/joint_states": motion(), "/effort": efforts(late)})
    found = Recording.read(path, joints=JOINTS)
    expect(found, slice(11, -10))  # from the first effort to the last
    assert "interpolated to the stamps of the topic /joint_states" in guesses(found)


def test_stamps_of_the_recording_serve_where_one_topic_has_none(tmp_path: Path) -> None:
    without = [one._replace(stamp=0, recorded=one.stamp) for one in efforts()]
    known = [one._replace(recorded=one.stamp) for one in motion()]
    path = write_mcap_json(tmp_path / "run.mcap", {"/joint_states": known, "/effort": without})
    expect(Recording.read(path, joints=JOINTS), slice(None))


def test_slow_topics_and_gaps_are_told(tmp_path: Path) -> None:
    path = write_mcap_json(tmp_path / "slow.mcap", {"/joint_states": motion(), "/effort": efforts(T[::5])})
    assert "has messages every 20 ms where positions come every 4 ms" in guesses(Recording.read(path, joints=JOINTS))
    gap = np.r_[T[:80], T[100:]]
    path = write_mcap_json(tmp_path / "gap.mcap", {"/joint_states": motion(), "/effort": efforts(gap)})
    with pytest.raises(InputError, match=r"no finite number .* and 1 other column in 20 of 200 rows"):
        Recording.read(path, joints=JOINTS)
    np.testing.assert_allclose(Recording.read(path, {"missing": "fill"}, JOINTS).q, Q, atol=1e-12)


def test_two_arms_are_one_robot_or_each_their_own(tmp_path: Path) -> None:
    left, right = ("left_1", "left_2"), ("right_1", "right_2")
    path = write_mcap_json(tmp_path / "arms.mcap", {"/left": whole(left), "/right": whole(right, T + 0.0005)})
    one = Recording.read(path, joints=right)
    np.testing.assert_allclose(one.q, np.column_stack([0.5 + 2 * (T + 5e-4), 1.0 - 3 * (T + 5e-4)]), atol=1e-12)
    assert one.layout is not None
    assert one.layout.guesses == ()  # the other arm is not asked for
    both = Recording.read(path, joints=left + right)
    np.testing.assert_allclose(both.q, np.tile(Q[1:], 2), atol=1e-9)
    np.testing.assert_allclose(both.torque, np.tile(TORQUE[1:], 2), atol=1e-9)


def test_topics_that_say_the_same_are_a_question(tmp_path: Path) -> None:
    double = [one._replace(position=np.asarray(one.position) + 1.0) for one in motion()]
    topics = {"/joint_states": motion(), "/raw": double, "/effort": efforts()}
    path = write_mcap_json(tmp_path / "run.mcap", topics)
    with pytest.raises(InputError, match=r"belong together, such as `topic = \[.*\]`, each holds what those before"):
        Recording.read(path, joints=JOINTS)
    expect(Recording.read(path, {"topic": ["/joint_states", "/effort"]}, JOINTS), slice(None))
    other = Recording.read(path, {"topic": ["/raw", "/effort"]}, JOINTS)
    np.testing.assert_allclose(other.q, Q + 1.0)
    with pytest.raises(InputError, match="the topic /raw holds nothing of its joints"):
        Recording.read(path, {"topic": ["/joint_states", "/raw", "/effort"]}, JOINTS)
    with pytest.raises(InputError, match="has no topic '/efort'"):
        Recording.read(path, {"topic": ["/joint_states", "/efort"]}, JOINTS)


def test_what_cannot_be_joined_is_one_sentence(tmp_path: Path) -> None:
    topics = {"/joint_states": motion(), "/effort": efforts(T + 100.0)}
    path = write_mcap_json(tmp_path / "apart.mcap", topics)
    with pytest.raises(InputError, match="were not recorded at the same time: the topic /joint_states, the topic"):
        Recording.read(path, joints=JOINTS)
    back = [
        one._replace(recorded=START + k * 4_000_000) for k, one in enumerate(efforts(np.r_[T[:100] + 3.0, T[100:]]))
    ]
    path = write_mcap_json(tmp_path / "back.mcap", {"/joint_states": motion(), "/effort": back})
    with pytest.raises(InputError, match="The stamps of the topic /effort go back in time"):
        Recording.read(path, joints=JOINTS)


@pytest.mark.parametrize("value", [[], ["a", "a"], ["a", ""], 3, {"a": 1}])
def test_no_other_list_is_taken_for_topics(value: object) -> None:
    with pytest.raises(InputError, match="it must be the name of a topic in quotes, or a list of several"):
        LogColumns.from_dict({"topic": value})


def test_a_list_of_one_topic_is_that_topic() -> None:
    assert LogColumns.from_dict({"topic": ["/a"]}) == LogColumns(topic="/a")
    assert LogColumns.from_dict({"topic": ["/a", "/b"]}).to_dict() == {"topic": ["/a", "/b"]}
