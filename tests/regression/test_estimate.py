"""Estimates: saving, loading, and what is refused."""

import json

import numpy as np
import pytest
from any_text import CHARACTERS
from hypothesis import given
from hypothesis import strategies as st

import steelyard as sy


def make_estimate():
    return sy.Estimate(
        method="joint-weighted least squares",
        base_names=("a", "b"),
        base_expressions=("a + c", "b"),
        base=np.array([1.5, 0.0]),
        standard_error=np.array([0.3, np.inf]),
        joint_names=("one",),
        relative_error=0.05,
        row_count=10,
        condition_number=float("inf"),
        joint_relative_error=np.array([0.05]),
        remarks=("something",),
        description={"tip": "hand"},
    )


@pytest.fixture
def estimate():
    return make_estimate()


FIELDS = sorted(make_estimate().to_dict())


def test_round_trip(estimate, tmp_path):
    estimate.save(tmp_path / "estimate.json")
    loaded = sy.Estimate.load(tmp_path / "estimate.json")
    assert loaded.to_dict() == estimate.to_dict()
    assert loaded.standard_error.tolist() == [0.3, np.inf]
    assert loaded.condition_number == np.inf
    assert loaded.relative_standard_error.tolist() == pytest.approx([0.2, np.inf])
    assert loaded.description == {"tip": "hand"}
    assert json.loads((tmp_path / "estimate.json").read_text())["format"] == "steelyard-estimate-3"


@pytest.mark.parametrize(
    ("change", "phrase"),
    [
        ({"format": "other"}, "format is 'other'"),
        ({"base": None}, "'base' must be a list of numbers"),
        ({"joint_names": "one"}, "'joint_names' must be a list of strings"),
        ({"row_count": "ten"}, "'row_count' must be a number"),
        ({"description": []}, "'description' must be an object"),
        ({"damping": [1.0, 2.0]}, "'damping' has 2 values, expected 1"),
        ({"base": ["x", 1.0]}, "'base' must be a list of numbers"),
        ({"base": [1.0]}, "'base' has 1 values, expected 2"),
        ({"method": "delete"}, "lacks 'method'"),
    ],
)
def test_broken_files_are_refused(estimate, tmp_path, change, phrase):
    document = estimate.to_dict()
    for key, value in change.items():
        document[key] = value
        if value == "delete":
            del document[key]
    path = tmp_path / "estimate.json"
    path.write_text(json.dumps(document))
    with pytest.raises(sy.InputError) as caught:
        sy.Estimate.load(path)
    assert phrase in str(caught.value)


VALUES = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(CHARACTERS)
    | st.lists(st.floats() | st.text(CHARACTERS))
    | st.just({})
)


@given(st.sampled_from(FIELDS), VALUES)
def test_any_value_in_any_field_is_taken_or_refused(name, value):
    """Whatever JSON a field holds, the answer is an estimate or one sentence."""
    document = make_estimate().to_dict() | {name: value}
    loaded, message = None, "file.json: "
    try:
        loaded = sy.Estimate.from_dict(document, "file.json")
    except sy.InputError as error:
        message = str(error)
    assert message.startswith("file.json: ")
    assert loaded is None or sy.Estimate.from_dict(loaded.to_dict()).to_dict() == loaded.to_dict()


@pytest.mark.parametrize(("text", "phrase"), [("[]", "holds no estimate, but a list"), ("{", "is not JSON")])
def test_other_json_is_refused(tmp_path, text, phrase):
    path = tmp_path / "estimate.json"
    path.write_text(text)
    with pytest.raises(sy.InputError) as caught:
        sy.Estimate.load(path)
    assert phrase in str(caught.value)


def test_base_parameters_alone_make_no_urdf(estimate, tmp_path):
    with pytest.raises(sy.InputError, match=r"use steelyard\.fit"):
        estimate.write_urdf(tmp_path / "a.urdf", tmp_path / "b.urdf")


def test_it_shows_itself(estimate):
    assert "2 base parameters, relative error 5.00%" in repr(estimate)
    assert "a + c" in estimate._repr_html_()


def test_covariance_is_kept(tmp_path):
    """Against the inverse of the normal equations; what the data says nothing of has none."""
    rows = np.random.default_rng(1).normal(size=(50, 3)) @ [[1.0, 0.9, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.0]]
    info = sy.Information.from_factor(np.linalg.qr(rows)[1], [4.0, 3.0, 0.0], 2.0, 50, ["a", "b", "c"])
    sy.least_squares(info, None).save(tmp_path / "estimate.json")
    estimate = sy.Estimate.load(tmp_path / "estimate.json")
    expected = np.zeros((3, 3))
    expected[:2, :2] = np.linalg.inv(rows[:, :2].T @ rows[:, :2])
    found = estimate.covariance
    np.testing.assert_allclose(found / found[0, 0], expected / expected[0, 0], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(np.sqrt(np.diag(found))[:2], estimate.standard_error[:2], rtol=1e-12)
