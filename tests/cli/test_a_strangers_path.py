"""From a URDF and a log, as robots and programs export it, to a plausible description and a report, in two commands."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from log_exports import JOINTS, STYLES, Motion
from log_writers import BAGS, states
from scipy.io import savemat

import steelyard as sy

pytestmark = pytest.mark.slow
MASSES, AXES = (4.0, 2.5, 0.8), ("0 0 1", "0 1 0", "1 0 0")
HEAVIER = 1.3
"""What the last link weighs over what its CAD says."""


def link(name: str, mass: float) -> str:
    inertia = f'<inertia ixx="{0.01 * mass}" ixy="0" ixz="0" iyy="{0.02 * mass}" iyz="0" izz="{0.02 * mass}"/>'
    return (
        f'<link name="{name}"><inertial><origin xyz="0.12 0.01 0.02"/><mass value="{mass}"/>{inertia}</inertial></link>'
    )


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Motion, sy.Model, np.ndarray]:
    """Return a bare URDF, a simulated motion of the true arm, and its model with its true parameters."""
    path = tmp_path_factory.mktemp("arm") / "arm.urdf"
    names = ("upper", "fore", "hand")
    parents = ("base", *names)
    joints = "".join(
        f'<joint name="{joint}" type="revolute"><parent link="{parents[k]}"/><child link="{names[k]}"/>'
        f'<axis xyz="{AXES[k]}"/><origin xyz="{0.3 if k else 0} 0 0.1"/>'
        '<limit lower="-6.2" upper="6.2" effort="200" velocity="10"/></joint>'
        for k, joint in enumerate(JOINTS)
    )
    links = "".join(map(link, names, MASSES))
    path.write_text(f'<robot name="arm"><link name="base"/>{links}{joints}</robot>')
    model = sy.Model(sy.Robot.from_urdf(path).with_terms(sy.Viscous(), sy.Coulomb()))
    truth = np.nan_to_num(np.asarray(model.robot.parameters))
    truth[model.link_columns[2]] *= HEAVIER
    truth[[model.parameter_names.index(f"{symbol}{k}") for symbol in ("Fvj", "Fcj") for k in (1, 2, 3)]] = 0.4
    random = np.random.default_rng(3)
    t = np.arange(1500) / 75
    rates = 2 * np.pi * np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.7])
    sizes, phases = random.normal(size=(3, 6)) / 2, random.uniform(0, 2 * np.pi, size=(3, 6))
    angle = rates * t[:, None, None] + phases
    q, dq = (sizes * np.sin(angle)).sum(2), (sizes * rates * np.cos(angle)).sum(2)
    ddq = -(sizes * rates**2 * np.sin(angle)).sum(2)
    torque = model.inverse_dynamics(q, dq, ddq, truth)
    torque += 0.02 * torque.std(axis=0) * random.normal(size=q.shape)
    return path, Motion(t, q + 1e-5 * random.normal(size=q.shape), dq, torque), model, truth


def assert_plausible(folder: Path, arm: tuple[Path, Motion, sy.Model, np.ndarray]) -> None:
    """Compare the written description with the true arm: it can exist, weighs as much, and needs the same torques."""
    urdf, _, model, truth = arm
    robot = sy.Robot.from_urdf(folder / "robot.urdf")
    for one in robot.links:
        mass, moment, about_origin = one.inertia.mass, one.inertia.first_moment, one.inertia.about_origin
        second = 0.5 * np.trace(about_origin) * np.eye(3) - about_origin
        pseudo = np.block([[second, moment[:, None]], [moment[None], np.array([[mass]])]])
        assert np.linalg.eigvalsh(pseudo)[0] >= -1e-9
    columns = [one[9] for one in model.link_columns]
    assert sum(one.inertia.mass for one in robot.links) == pytest.approx(truth[columns].sum(), rel=0.3)
    estimate = sy.Estimate.load(folder / "estimate.json")
    terms = [sy.Viscous(), sy.Coulomb(), sy.Offset()]
    terms += [sy.RotorInertia()] * any(name.startswith("Ia") for name in estimate.parameter_names)
    # On a motion that nobody has seen.
    random = np.random.default_rng(8)
    q, dq, ddq = (random.uniform(-size, size, size=(200, 3)) for size in (2.0, 1.5, 3.0))
    found = sy.Model(sy.Robot.from_urdf(urdf).with_terms(*terms)).inverse_dynamics(q, dq, ddq, estimate)
    true = model.inverse_dynamics(q, dq, ddq, truth)
    assert np.linalg.norm(found - true) < 0.03 * np.linalg.norm(true)
    assert "predicts well" in (folder / "report.html").read_text(encoding="utf-8")


def follow(run: Callable, arm: tuple, log: Path, place: Path, named: bool = False) -> None:
    """Go both ways of a stranger: `identify` alone, and `init` before it, with the command that it names."""
    code, out, err = run("identify", arm[0], log, "--output", place / "one", "--verbose")
    assert code == 0, err
    told = re.findall(rf"^ +\S.*? ({'|'.join(JOINTS)}) +(position|torque) ", out, re.MULTILINE)
    assert told == [(joint, quantity) for quantity in ("position", "torque") for joint in JOINTS]
    assert_plausible(place / "one", arm)
    code, out, err = run("init", arm[0], log, "--output", place / "robot.toml")
    assert code == 0, err
    command = re.search(r"Go on with: steelyard (.*) --output result", out)
    assert command is not None
    assert command[1] == f"identify {place / 'robot.toml'} {log}"
    if named:  # the columns that the file names are those that were found without it, and so is the answer
        file = sy.RobotFile.load(place / "robot.toml")
        by_name = sy.Recording.read(log, file.section("log"), JOINTS)
        found = sy.Recording.read(log, joints=JOINTS)
        for quantity in ("t", "q", "torque", "velocity"):
            np.testing.assert_array_equal(getattr(by_name, quantity), getattr(found, quantity))
        return
    code, _, err = run(*command[1].split(), "--output", place / "two")
    assert code == 0, err
    assert_plausible(place / "two", arm)


@pytest.mark.parametrize("style", STYLES)
def test_styles_of_columns(style, arm, run, tmp_path):
    export = STYLES[style](arm[1])
    (tmp_path / "log.csv").write_text(export.text(), encoding="utf-8")
    # Of dates, whose stamps are rounded to milliseconds, `init` says the rate too.
    follow(run, arm, tmp_path / "log.csv", tmp_path, named=style != "dates")


def arrays(log: Motion) -> dict[str, np.ndarray]:
    return {"t": log.t, "q": log.q, "dq": log.dq, "tau": log.torque}


def columns(log: Motion) -> dict[str, np.ndarray]:
    found = {name: values for name, values in arrays(log).items() if values.ndim == 1}
    return found | {f"{name}{k + 1}": arrays(log)[name][:, k] for name in ("q", "dq", "tau") for k in range(3)}


def hdf5(path: Path, log: Motion) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name, values in arrays(log).items():
            file[f"run/{name}"] = values


def bag(name: str) -> Callable[[Path, Motion], object]:
    def write(path: Path, log: Motion) -> object:
        pytest.importorskip("rosbags")
        order = np.argsort(JOINTS)  # as joint state broadcasters do
        names = [JOINTS[k] for k in order]
        return BAGS[name](
            path, {"/joint_states": states(log.t, names, log.q[:, order], log.dq[:, order], log.torque[:, order])}
        )

    return write


FORMATS: dict[str, Callable[[Path, Motion], object]] = {
    "log.parquet": lambda path, log: pl.DataFrame(columns(log)).write_parquet(path),
    "log.arrow": lambda path, log: pl.DataFrame(columns(log)).write_ipc(path),
    "log.npz": lambda path, log: np.savez(path, **arrays(log)),
    "log.mat": lambda path, log: savemat(path, {"run": arrays(log)}),
    "log.h5": hdf5,
    **{name: bag(name) for name in ("ros1.bag", "ros2_sqlite", "ros2_mcap", "json.mcap", "protobuf.mcap", "cdr.mcap")},
}


@pytest.mark.parametrize("name", FORMATS)
def test_formats(name, arm, run, tmp_path):
    FORMATS[name](tmp_path / name, arm[1])
    follow(run, arm, tmp_path / name, tmp_path)
