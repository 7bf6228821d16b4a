"""identify says what is wrong with the rows of a log."""

from dataclasses import replace

import numpy as np
import pytest

import steelyard as sy
from steelyard.errors import InputError
from steelyard.recording import Recording, chunks
from steelyard.recording.diagnosis import faulty_rows, find_stiction, remedy_of

ROBOT = """
terms = []
[description]
convention = "standard"
rows = [[0, 0.5, 0, "q"], [0, 0.4, 0, "q"]]
gravity = [0.0, -9.81, 0.0]
[processing]
cutoff = 20.0
"""
T = np.arange(8000) / 1000


def log() -> Recording:
    model = sy.Model(sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")], gravity=(0, -9.81, 0)))
    w = np.array([2.1, 3.3])
    a = np.outer(T, w)
    parameters = np.tile([0.2, 0, 0, 0.2, 0, 0.2, 0.1, 0, 0, 1.0], 2)
    q, dq, ddq = np.sin(a), w * np.cos(a), -(w**2) * np.sin(a)
    torque = model.inverse_dynamics(q, dq, ddq, parameters) + 0.01 * np.random.default_rng(1).normal(size=q.shape)
    return Recording(t=T, q=q, torque=torque, source="arm")


def broken() -> Recording:
    one = log()
    torque, q = one.torque.copy(), one.q.copy()
    torque[:, 0] = np.clip(torque[:, 0], -6.0, 6.0)
    for row in range(100, 7900, 50):
        q[row], torque[row] = q[row - 1], torque[row - 1]
    return replace(one, q=q, torque=torque)


def test_sound_log_has_no_faulty_rows():
    assert faulty_rows(log()) == ()


def test_faults_are_said_unless_they_are_dealt_with():
    found = faulty_rows(broken())
    assert [one.split("`")[1] for one in found] == ["saturation = true", "repeated = true"]
    assert faulty_rows(broken(), ["saturation", "repeated"]) == ()


@pytest.mark.slow
@pytest.mark.parametrize("first_rows", [200_000, 3000])
def test_identify_remarks_on_them(tmp_path, first_rows, monkeypatch):
    monkeypatch.setattr(chunks, "CHOICE_ROWS", first_rows)
    path = broken().save(tmp_path / "log.csv")
    robot = tmp_path / "robot.toml"
    robot.write_text(ROBOT)
    remarks = sy.identify(robot, [path]).remarks
    for option in ("saturation", "repeated"):
        (one,) = [remark for remark in remarks if f"`{option} = true`" in remark]
        assert ("Seen in the first 3000 rows" in one) == (first_rows == 3000)
        assert remedy_of(one) == option
    assert not any("`stiction" in remark for remark in remarks)


def test_rest_at_the_ends_and_of_all_joints_is_no_stiction():
    clock = np.interp(T, [0, 1, 3, 4, 6, 7, 8], [0, 0, 2, 2, 4, 4, 4])
    q = np.column_stack([np.sin(2 * clock), np.sin(3 * clock)])
    resting = Recording(t=T, q=q, torque=np.column_stack([np.sin(9 * T), np.cos(7 * T)]), source="resting")
    assert find_stiction(resting).count.min() > 2500
    assert not resting.diagnose().stiction
    # One joint alone that stands while the other goes on sticks.
    q[:, 0] = np.sin(2 * T)
    assert replace(resting, q=q).diagnose().stiction.count.tolist() == [0, pytest.approx(1000, abs=5)]


@pytest.mark.slow
def test_what_rounding_leaves_of_a_log_without_noise_is_no_body(elbow, simulation):
    """Torques in mN·m: the squares that a body might explain are rounding, and less than zero."""
    path, model, folder = elbow
    exact = Recording.read(simulation.record(model, folder / "exact.npz", 1, noise=0.0))
    found = sy.identify(path, [replace(exact, torque=1e3 * exact.torque).save(folder / "log.npz")])
    assert found.prediction.word == "wrong"
    assert not any("the robot changes" in remark for remark in found.remarks)


def test_no_usable_row_is_refused():
    with pytest.raises(InputError, match=r"8000 rows in 7.999 s, of which \[processing\] leaves none"):
        log().process(cutoff=5.0, delay=100.0)
    samples = log().process(cutoff=5.0)
    none = replace(samples, mask=np.zeros(samples.q.shape, dtype=bool))
    model = sy.Model(sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")]))
    with pytest.raises(InputError, match="no usable row"):
        sy.least_squares(sy.Information.from_samples(model, none))
