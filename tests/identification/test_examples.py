"""The examples: what is written can be run as it says; tests/test_pictures.py looks at what comes out."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.identification import examples
from steelyard.identification.examples import EXAMPLES, RECORDINGS, deviating, list_examples, write_example
from steelyard.robot import Inertia

pin = pytest.importorskip("pinocchio")


@pytest.fixture
def robots():
    """The robots of example-robot-data, or a skip."""
    try:
        EXAMPLES["panda"].robot()
    except sy.InputError as error:
        pytest.skip(str(error))


@pytest.fixture
def short(robots, monkeypatch):
    """Experiments of four seconds."""
    monkeypatch.setattr(examples, "SECONDS", 4.0)


@pytest.mark.slow
def test_folder_is_complete_and_honest(short, tmp_path):
    folder = write_example("ur5", tmp_path / "made")
    names = {path.name for path in folder.iterdir()}
    assert names == {"robot.urdf", "robot.toml", "train.csv", "validate.csv", "truth.json", "README.md"}
    truth = sy.Estimate.load(folder / "truth.json")
    model = sy.Model.load(folder / "robot.toml")
    recording = sy.Recording.read(folder / "train.csv", joints=model.dof)
    samples = recording.process(cutoff=8.0, model=model)
    # The torques of the truth, by Pinocchio, are those of the log but for noise, friction near standstill and filters.
    robot = pin.buildModelFromUrdf(str(folder / "robot.urdf"))
    assert [robot.names[k] for k in range(1, robot.njoints)] == list(model.robot.joint_names)
    values = dict(zip(truth.parameter_names, truth.parameters, strict=True))
    for link in range(model.dof):
        body = Inertia.from_parameters(truth.parameters[model.link_columns[link]])
        robot.inertias[link + 1] = pin.Inertia(body.mass, body.com, body.about_com)
    drives = np.array([[values[f"{kind}{k + 1}"] for kind in ("Fvj", "Fcj", "Foj", "Ia")] for k in range(model.dof)]).T
    data, torque = robot.createData(), []
    for q, dq, ddq in zip(samples.q, samples.dq, samples.ddq, strict=True):
        rigid = pin.rnea(robot, data, q, dq, ddq)
        torque.append(rigid + drives[0] * dq + drives[1] * np.sign(dq) + drives[2] + drives[3] * ddq)
    missed = np.linalg.norm(samples.torque - torque) / np.linalg.norm(samples.torque)
    assert 0.01 < missed < 0.08


@pytest.mark.slow
def test_the_same_bytes_again(short, tmp_path):
    one, two = (write_example("z1", tmp_path / name) for name in "ab")
    assert all((two / path.name).read_bytes() == path.read_bytes() for path in one.iterdir())


def test_deviating_bodies_remain_possible():
    random = np.random.default_rng(5)
    body = Inertia.from_com(2.0, [0.1, -0.2, 0.3], np.diag([0.01, 0.02, 0.025]))
    found = [deviating(body, 0.3, random) for _ in range(200)]
    assert all(np.linalg.eigvalsh(one.pseudo_inertia).min() > 0.0 for one in found)
    assert np.std([np.log(one.mass / body.mass) for one in found]) == pytest.approx(0.3, rel=0.15)


def test_unknown_names_and_the_missing_package(tmp_path, monkeypatch):
    with pytest.raises(sy.InputError, match=r"no example 'pandas'.*panda"):
        write_example("pandas", tmp_path / "x")
    monkeypatch.setattr("sys.path", [])
    with pytest.raises(sy.MissingExtraError, match=r"example-robot-data>="):
        write_example("panda", tmp_path / "x")
    assert not (tmp_path / "x").exists()


def test_list_names_all_and_where_real_recordings_are():
    text = list_examples()
    assert all(name in text for name in EXAMPLES)
    assert all(recording.commit in text and recording.repository in text for recording in RECORDINGS)
