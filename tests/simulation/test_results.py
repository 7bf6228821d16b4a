"""What a result knows, saves and refuses; runs that cannot go on; bad input."""

import json

import numpy as np
import polars
import pytest

import steelyard as sy
from steelyard.errors import InputError
from steelyard.simulation import ElasticContact, SimulationResult, Status, simulate


@pytest.fixture(scope="module")
def swing(two_links):
    model, delta = two_links
    return simulate(model, delta, [0.3, -0.4], [0.0, 1.0], 0.5, rate=200.0)


def test_a_result_prints_itself(swing, two_links):
    assert repr(swing) == "SimulationResult(101 samples x 2 joints, dormand_prince: finished at 0.5 s)"
    assert "finished at 0.5 s" in swing._repr_html_()
    model, delta = two_links
    batch = simulate(model, delta, np.zeros((3, 2)), np.zeros(2), 0.1)
    assert "3 runs" in repr(batch)
    assert "3 finished" in batch._repr_html_()
    json.dumps(swing.options)


def test_files_hold_the_result(swing, two_links, tmp_path):
    for suffix in (".csv", ".parquet"):
        path = swing.save(tmp_path / f"swing{suffix}")
        frame = polars.read_csv(path) if suffix == ".csv" else polars.read_parquet(path)
        np.testing.assert_array_equal(frame["q2"].to_numpy(), swing.q[:, 1])
        np.testing.assert_array_equal(frame["kinetic_energy"].to_numpy(), swing.kinetic_energy)
        recording = sy.Recording.read(path)
        np.testing.assert_array_equal(recording.q, swing.q)
        np.testing.assert_array_equal(recording.torque, swing.torque)
    np.testing.assert_array_equal(sy.Recording.read(swing.save(tmp_path / "swing.npz")).q, swing.q)
    model, delta = two_links
    batch = simulate(model, delta, np.array([[0.0, 0.0], [0.1, 0.2]]), np.zeros(2), 0.1)
    frame = polars.read_csv(batch.save(tmp_path / "batch.csv"))
    assert frame["run"].to_list() == [0] * 101 + [1] * 101
    with np.load(batch.save(tmp_path / "batch.npz")) as file:
        np.testing.assert_array_equal(file["q"], batch.q)
        assert file["status"].tolist() == ["finished", "finished"]
    with pytest.raises(InputError, match=r"saved as .csv, .parquet, .npz, got '.xlsx'"):
        swing.save(tmp_path / "swing.xlsx")
    assert sorted(p.suffix for p in tmp_path.iterdir()) == [".csv", ".csv", ".npz", ".npz", ".parquet"]


def test_a_recording_is_that_of_the_robot(swing, two_links):
    model, delta = two_links
    recording = swing.recording()
    assert recording.joint_names == tuple(model.robot.joint_names)
    torque = model.inverse_dynamics(swing.q, swing.dq, swing.ddq, delta)
    np.testing.assert_allclose(torque, recording.torque, atol=1e-9)
    batch = simulate(model, delta, np.zeros((2, 2)), np.zeros(2), 0.1)
    assert batch.recording(run=1).count == 101
    with pytest.raises(InputError, match="name one, as in recording"):
        batch.recording()
    with pytest.raises(InputError, match="runs 0 to 1, got 2"):
        batch.run(2)


@pytest.mark.slow
def test_runs_that_blow_up_end_alone(two_links):
    """Torques that grow with the square of the speed, in one run of three."""
    model, delta = two_links
    gain = np.array([[0.0], [50.0], [0.0]])
    q0 = np.array([[0.1, 0.2], [0.1, 0.2], [0.3, 0.4]])

    def torque(t, q, dq):
        return gain * dq * np.abs(dq)

    for method in ("dormand_prince", "runge_kutta_4", "rosenbrock"):
        result = simulate(model, delta, q0, np.ones(2), 0.5, torque, method=method)
        assert [s.value for s in result.status] == ["finished", "diverged", "finished"], method
        assert 0.0 < result.end_time[1] < 0.5
        assert np.isfinite(result.q[[0, 2]]).all()
        assert np.isfinite(result.final_q).all()
        assert isinstance(result, SimulationResult)
    alone = simulate(model, delta, q0[2], np.ones(2), 0.5, method="dormand_prince")
    np.testing.assert_allclose(
        simulate(model, delta, q0, np.ones(2), 0.5, torque, method="dormand_prince").q[2], alone.q, atol=1e-6
    )


@pytest.mark.parametrize("method", ["dormand_prince", "dop853", "radau", "lsoda", "runge_kutta_4", "rosenbrock"])
def test_torques_that_are_no_numbers_end_the_run(pendulum, method):
    model, delta = pendulum

    def torque(t, q, dq):
        return np.full(1, np.nan if t > 0.5 else 0.0)

    result = simulate(model, delta, [1.0], [0.0], 1.0, torque, method=method)
    assert result.status is Status.DIVERGED
    assert 0.5 - (0.05 if method == "lsoda" else 1e-3) < result.end_time < 0.502  # LSODA gives up a step early
    assert np.isfinite(result.q).all()


def test_a_massless_robot_diverges_at_once(pendulum):
    model, _ = pendulum
    for method in ("dormand_prince", "radau", "runge_kutta_4"):
        result = simulate(model, np.zeros(10), [1.0], [0.0], 1.0, lambda t, q, dq: np.ones(1), method=method)
        assert result.status == "diverged"
        assert result.end_time < 1e-2
        assert "not physically possible" in result.message


@pytest.mark.parametrize(
    "method",
    ["dormand_prince", *(pytest.param(m, marks=pytest.mark.slow) for m in ("dop853", "rosenbrock")), "runge_kutta_4"],
)
def test_contact_is_a_spring(method):
    """A mass that lands on a wall at 1 m/s: half a sample time of w = sqrt(k / m), depth v / w."""
    model = sy.Model(sy.Robot.from_dh([(0, 0, "q", 0)], name="slide", gravity=(0, 0, 0)))
    delta = np.zeros(10)
    delta[9] = 2.0
    link = model.robot.link_names[-1]
    wall = ElasticContact(link, surface=(0, 0, 0.5), normal=(0, 0, -1), stiffness=800.0)
    result = simulate(model, delta, [0.0], [1.0], 0.7, environment=wall, method=method)
    assert abs(result.q.max() - (0.5 + 1 / 20)) < 1e-5
    assert abs(result.final_dq[0] + 1.0) < 1e-4
    assert abs(result.force[:, 2].min() + 800.0 / 20) < 0.01
    assert not result.force[:, [0, 1, 3, 4, 5]].any()


def test_a_wall_may_grow_hard_with_time():
    model = sy.Model(sy.Robot.from_dh([(0, 0, "q", 0)], name="slide", gravity=(0, 0, 0)))
    delta = np.zeros(10)
    delta[9] = 2.0
    link = model.robot.link_names[-1]
    soft = ElasticContact(link, (0, 0, 0.5), (0, 0, -1), stiffness=lambda t: np.where(np.asarray(t) < 0.4, 0.0, 800.0))
    batch = simulate(model, delta, [[0.0], [0.2]], [1.0], 0.7, environment=soft, method="dormand_prince")
    assert abs(batch.q[0].max() - 0.55) < 1e-5
    assert batch.q[1].max() > 0.6  # it was 0.1 m deep when the wall grew hard


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"q0": [0.0, 0.0]}, r"has 1 joints: q0 must have shape \(1,\), or \(R, 1\) for R runs, got \(2,\)"),
        ({"q0": [np.nan]}, r"q0 must be finite, got \[nan\]"),
        ({"q0": "zero"}, "q0 must be an array of numbers, got 'zero'"),
        ({"parameters": np.zeros(3)}, r"has 10 parameters: parameters must have shape \(10,\)"),
        ({"parameters": np.r_[np.zeros(9), np.nan]}, "The parameters m1 of pendulum are not finite numbers"),
        ({"duration": -1.0}, "duration must be a positive number, in s, got -1.0"),
        ({"duration": np.inf}, "duration must be finite"),
        ({"duration": 1e9}, "1e.09 s at 1000 Hz are too many samples for the memory"),
        ({"method": "euler"}, "method must be one of automatic, dormand_prince, .* got 'euler'"),
        ({"sign_width": -1.0}, "sign_width must be at least 0"),
        ({"step": 1e-3}, "step is for the fixed-step methods"),
        ({"rate": 0.0}, "rate must be a positive number, in Hz, got 0.0"),
        ({"sample_time": 0.01}, "sample_time is for a torque"),
        ({"sensors": 3}, "sensors must be a Sensors object, got int"),
        ({"environment": 3}, "environment must have link, point and wrench"),
        ({"relative_tolerance": 0.0}, "relative_tolerance must be a positive number"),
        ({"q0": np.zeros((2, 1)), "dq0": np.zeros((3, 1))}, r"must agree on the number of runs, got q0 \(2, 1\)"),
        ({"q0": np.zeros((0, 1))}, "A batch needs one run at least"),
    ],
)
def test_bad_input_is_one_sentence(pendulum, change, words):
    model, delta = pendulum
    arguments = {"parameters": delta, "q0": [0.0], "dq0": [0.0], "duration": 1.0, "method": "dormand_prince"} | change
    with pytest.raises(InputError, match=words):
        simulate(model, **arguments)


def test_walls_are_checked():
    with pytest.raises(InputError, match="normal of an elastic contact must point somewhere"):
        ElasticContact("a", (0, 0, 0), (0, 0, 0), 1.0)
    with pytest.raises(InputError, match="stiffness of an elastic contact must be at least 0"):
        ElasticContact("a", (0, 0, 0), (0, 0, 1), -1.0)
    with pytest.raises(InputError, match="stiffness of an elastic contact must be at least 0 N/m, got 'hard'"):
        ElasticContact("a", (0, 0, 0), (0, 0, 1), "hard")
    with pytest.raises(InputError, match="surface of an elastic contact must be three finite numbers, got 'floor'"):
        ElasticContact("a", "floor", (0, 0, 1), 1.0)
