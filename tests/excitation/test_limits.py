"""Limits: of a description, of numbers, of files, of other motions."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.excitation import FourierTrajectory, MotionLimits, limits_from_file

URDF = """<robot name="hand"><link name="palm"/><link name="a"/><link name="b"/><link name="c"/>
<joint name="finger" type="revolute"><parent link="palm"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="2" velocity="3" effort="4"/></joint>
<joint name="follower" type="revolute"><parent link="palm"/><child link="b"/><axis xyz="0 0 1"/>
<mimic joint="finger" multiplier="-2" offset="0.5"/><limit lower="-1.5" upper="2" velocity="4" effort="9"/></joint>
<joint name="wheel" type="continuous"><parent link="palm"/><child link="c"/><axis xyz="0 0 1"/>
<limit velocity="5" effort="6"/></joint></robot>"""


@pytest.fixture
def hand(tmp_path):
    (tmp_path / "hand.urdf").write_text(URDF)
    return sy.Robot.from_urdf(tmp_path / "hand.urdf")


def test_joints_that_mimic_narrow_those_that_drive(hand):
    limits = MotionLimits.from_robot(hand)
    assert limits.joint_names == ("finger", "wheel")
    # -1.5 <= 0.5 - 2 q <= 2 means -0.75 <= q <= 1; 2 |dq| <= 4
    np.testing.assert_allclose(limits.lower, [-0.75, -np.inf])
    np.testing.assert_allclose(limits.upper, [1.0, np.inf])
    np.testing.assert_allclose(limits.velocity, [2.0, 5.0])
    np.testing.assert_allclose(limits.torque, [4.0, 6.0])
    assert np.isinf(limits.acceleration).all()


def test_limits_wider_than_those_of_the_description_are_told(hand):
    """Two times a speed of the finger is that of its follower, which the description limits to 4 rad/s."""
    own = MotionLimits.from_robot(hand)
    assert own.widening(hand) == ()
    assert own.updated({"velocity": 2, "acceleration": 9, "upper": {"wheel": 3}}).widening(hand) == ()
    (remark,) = own.updated({"velocity": 2.5, "lower": -1, "torque": float("inf")}).widening(hand)
    assert "lower of finger (-1, there -0.75)" in remark
    assert "velocity of finger (2.5, there 2)" in remark
    assert "torque of wheel (inf, there 6)" in remark
    assert "velocity of wheel" not in remark


def test_limits_replace_those_within_which_no_joint_can_move(tmp_path):
    """Exporters write zeros where nothing is known."""
    zeros = '<limit lower="0" upper="0" velocity="0" effort="0"/>'
    path = tmp_path / "hand.urdf"
    path.write_text(URDF.replace('<limit lower="-1" upper="2" velocity="3" effort="4"/>', zeros))
    robot = sy.Robot.from_urdf(path)
    with pytest.raises(sy.InputError, match=r"^The lower limit of finger is 0 and the upper one 0: .* widen them by"):
        MotionLimits.for_robot(robot, {"velocity": 1.0}, "limits.toml")
    limits = MotionLimits.for_robot(robot, {"lower": {"finger": -0.5}, "upper": {"finger": 0.5}}, "limits.toml")
    assert (limits.lower[0], limits.upper[0], limits.lower[1]) == (-0.5, 0.5, -np.inf)
    assert not limits.widening(sy.Robot.from_urdf(path))[1:]


def test_what_is_not_named_stays(hand):
    limits = MotionLimits.from_robot(hand).updated({"velocity": {"wheel": 1}, "effort": [2, 3], "total_power": 7})
    assert limits.velocity.tolist() == [2.0, 1.0]
    assert limits.torque.tolist() == [2.0, 3.0]
    assert limits.total_power == 7.0
    assert limits.to_dict()["upper"] == {"finger": 1.0}
    assert "velocity" in repr(limits)
    assert "wheel" in limits._repr_html_()


def test_margin_is_left_free_on_both_sides():
    limits = MotionLimits.of(["a"], lower=-1.0, upper=3.0, velocity=2.0, torque=10.0).reduced(0.1)
    assert (limits.lower[0], limits.upper[0], limits.velocity[0], limits.torque[0]) == pytest.approx(
        (-0.8, 2.8, 1.8, 9.0)
    )
    assert np.isinf(limits.acceleration[0])


def test_envelope_holds_the_motions(random):
    motions = [
        FourierTrajectory(random.normal(size=(2, 3)), random.normal(size=(2, 3)), random.normal(size=2), 0.3)
        for _ in range(2)
    ]
    limits = MotionLimits.envelope(motions, ["a", "b"], 500.0)
    samples = [motion.sample(500.0) for motion in motions]
    np.testing.assert_array_equal(limits.upper, np.vstack([s[1] for s in samples]).max(axis=0))
    np.testing.assert_array_equal(limits.acceleration, np.abs(np.vstack([s[3] for s in samples])).max(axis=0))


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"speed": 1}, "limits: 'speed' is no limit; there are lower, upper"),
        ({"velocity": [1, 2, 3]}, "velocity has 3 values, but there are 2 joints: a, b"),
        ({"velocity": {"c": 1}}, "velocity names a joint 'c'; the joints are a, b"),
        ({"velocity": "fast"}, "velocity must be a number, got 'fast'"),
        ({"velocity": [1, True]}, "velocity of b must be a number, got True"),
        ({"velocity": float("nan")}, "must be a number, got nan"),
        ({"velocity": 0}, "velocity limit of a is 0, but it must be positive"),
        ({"lower": 1, "upper": 1}, "cannot move"),
        ({"torque": 1, "effort": 1}, "torque and effort are the same"),
        ({"total_power": -1}, "total_power must be positive"),
    ],
)
def test_bad_limits_are_refused_in_one_sentence(limits, message):
    with pytest.raises(sy.InputError, match=message) as caught:
        MotionLimits.of(["a", "b"], **limits)
    assert "\n" not in str(caught.value)


def test_files_hold_limits_and_obstacles(tmp_path):
    path = tmp_path / "limits.toml"
    path.write_text("velocity = [1, 2]\n[limits]\ntorque = {a = 3}\n[table]\noffset = 0.1\n[[obstacles]]\nname = 'x'\n")
    limits, sections = limits_from_file(path)
    assert limits == {"velocity": [1, 2], "torque": {"a": 3}}
    assert sections == {"table": {"offset": 0.1}, "obstacles": [{"name": "x"}]}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "cannot be read"),
        ("velocity = ", "not valid TOML"),
        ("limits = 3", "must be a table"),
        ("speed = 3", "'speed' is no limit"),
        ("[limits]\nspeed = 3", "'speed' is no limit"),
        ("velocity = 1\n[limits]\nvelocity = 2", "stands both"),
    ],
)
def test_bad_files_are_refused_in_one_sentence(tmp_path, text, message):
    path = tmp_path / "limits.toml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(sy.InputError, match=message) as caught:
        limits_from_file(path)
    assert str(caught.value).startswith(str(path))
