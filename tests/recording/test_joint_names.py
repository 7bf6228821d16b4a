"""Columns named by joints: whatever the joints are called, none is given to another joint."""

import random
from collections.abc import Sequence

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from steelyard.errors import InputError
from steelyard.recording import find_columns

FORMS = {
    "name_word": ("{name}_{word}", "position", "velocity", "effort"),
    "word_name": ("{word}_{name}", "pos", "vel", "tau"),
    "name.word": ("{name}.{word}", "q", "dq", "torque"),
    "name/word": ("{name}/{word}", "position", "velocity", "effort"),
    "word[name]": ("{word}[{name}]", "position", "velocity", "effort"),
    "topic/name/word": ("/joint_states/{name}/{word}", "position", "velocity", "effort"),
    "topic/word[name]": ("/arm.left/joint_states/{word}[{name}]", "position", "velocity", "effort"),
    "name word": ("{name} {word}", "Actual position", "Actual velocity", "Actual torque"),
    "unit": ("{name} {word}", "position [deg]", "velocity [deg/s]", "torque [mNm]"),
}
NASTY = {
    "tens": ["joint_1", "joint_10", "joint_2", "joint_20", "joint_12", "joint_21"],
    "prefixes": ["a", "a_b", "a_b_c", "ab", "abc"],
    "words": ["position", "velocity", "effort", "tau", "q"],
    "words behind": ["arm", "arm_position", "arm_q", "arm_joint"],
    "numbers": ["3", "1", "2", "10"],
    "numbers from 0": ["2", "0", "1"],
    "other scripts": ["关节1", "关节10", "épaule", "ÉPAULE gauche", "straße", "köpf"],
    "capitals": ["A", "a", "Arm", "ARM"],
    "separators": ["a-b", "a_b", "a b"],
    "slashes": ["panda/joint1", "joint1", "panda/joint10"],
    "units": ["m", "rad", "deg", "s"],
    "brackets": ["j[0]", "j[1]", "j[10]"],
    "regular expressions": ["a.b", "a+b", "(a)", "a|b", "^a$", "\\d"],
    "KUKA": ["A1", "A2", "A10"],
}


def header(joints: Sequence[str], form: str, order: random.Random) -> tuple[list[str], list[list[str]]]:
    """Return all names, shuffled, and the positions, velocities and torques in the order of the joints."""
    pattern, *words = FORMS[form]
    groups = [[pattern.format(name=joint, word=word) for joint in joints] for word in words]
    names = ["time", *(name for group in groups for name in group)]
    order.shuffle(names)
    return names, groups


def understood(names: Sequence[str], joints: Sequence[str]) -> list[list[str]]:
    layout = find_columns(names, joints=joints)
    assert layout.time == "time"
    assert layout.velocity is not None
    return [list(layout.position), list(layout.velocity), list(layout.torque)]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("joints", NASTY.values(), ids=NASTY)
def test_joints_with_names_that_invite_mistakes(joints: list[str], form: str) -> None:
    shuffle = random.Random(7)
    joints = shuffle.sample(joints, len(joints))
    names, groups = header(joints, form, shuffle)
    assert understood(names, joints) == groups


def test_names_that_are_words_of_each_other_are_a_question() -> None:
    names, _ = header(["position", "velocity", "effort"], "name_word", random.Random(1))
    message = r'several groups .* for position: .*position = "position_{name}".* or .*position = "{name}_position"'
    with pytest.raises(InputError, match=message):
        understood(names, ["position", "velocity", "effort"])


PIECES = st.sampled_from(
    ["a", "B", "joint", "_", "-", " ", "/", ".", "1", "10", "0", "q", "pos", "tau", "é", "关", "["]
)
NAMES = (
    st.lists(PIECES, min_size=1, max_size=5)
    .map("".join)
    .map(str.strip)
    .filter(lambda name: any(map(str.isalnum, name)))
)


@given(st.lists(NAMES, min_size=1, max_size=6, unique=True), st.sampled_from(sorted(FORMS)), st.integers(0, 1000))
@example(["a", "a_"], "name_word", 0)
def test_no_column_is_given_to_another_joint(joints: list[str], form: str, seed: int) -> None:
    names, groups = header(joints, form, random.Random(seed))
    if len(set(names)) < len(names):
        return
    try:
        found = understood(names, joints)
    except InputError:  # a question is no mistake
        return
    assert found == groups


@given(st.lists(st.sampled_from("abcdefgh"), min_size=2, max_size=8, unique=True), st.sampled_from(sorted(FORMS)))
def test_plain_names_raise_no_question(joints: list[str], form: str) -> None:
    joints = [f"joint_{joint}" for joint in joints]
    names, groups = header(joints, form, random.Random(len(joints)))
    assert understood(names, joints) == groups


def test_the_word_joint_behind_all_names_may_be_left_out() -> None:
    joints = ["shoulder_pan_joint", "shoulder_lift_joint", "wrist_1_joint", "wrist_2_joint"]
    short = [joint.removesuffix("_joint") for joint in joints]
    names = ["t", *(f"{name}_torque" for name in reversed(short)), *(f"{name}_deg" for name in short)]
    layout = find_columns(names, joints=joints)
    assert list(layout.position) == [f"{name}_deg" for name in short]
    assert list(layout.torque) == [f"{name}_torque" for name in short]
    # One joint without the word: then it is a part of the names.
    with pytest.raises(InputError, match="no columns that look like positions"):
        find_columns(["t", "pan_deg", "tilt_deg", "pan_torque", "tilt_torque"], joints=["pan_joint", "tilt"])
