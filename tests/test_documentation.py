"""Every block of code in the README and the documentation runs as it stands, in a folder that holds what it names."""

import json
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import steelyard as sy
from steelyard import collision as geometry
from steelyard.cli import main
from steelyard.excitation import FourierTrajectory, MotionLimits, limits_from_file
from steelyard.recording import LogColumns, Processing

ROOT = Path(__file__).resolve().parent.parent
FENCE = re.compile(r"^```(?P<language>[a-z]*)[^\n]*\n(?P<text>.*?)^```", re.MULTILINE | re.DOTALL)
PAGES = [
    "README.md",
    "CONTRIBUTING.md",
    "thesis/README.md",
    *sorted(str(p.relative_to(ROOT)) for p in (ROOT / "docs").rglob("*.md")),
]

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
LINKS = ("base", "shoulder", "upper", "forearm", "first_wrist", "second_wrist", "third_wrist")
AXES = ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1", "0 1 0")
PLACES = ("0 0 0.1", "0 0.1 0", "0 0 0.4", "0 0 0.4", "0 0.1 0", "0 0 0.1")
MASSES = (3.0, 8.0, 2.41, 1.2, 1.2, 0.3)

ROBOT_FILE = """\
[description]
urdf = "my_robot.urdf"
tip = "tool0"

[[terms]]
kind = "viscous"

[[terms]]
kind = "coulomb"
"""

PLACEHOLDERS = {
    "ROBOT": "robot.toml",
    "ESTIMATE": "estimate.json",
    "LOG": "run1.csv",
    "run.csv": "run1.csv",
    "UNLOADED": "unloaded.csv",
    "LOADED": "loaded.csv",
    "A": "result/estimate.json",
    "B": "estimate.json",
    "C": "result",
    "FILE": "limits.toml",
    "DIR": "out",
    "MANIFEST": "fleet.toml",
}

SLOW = {
    ("README.md", "console"): "the whole chain of commands",
    ("README.md", "python"): "an identification",
    ("docs/index.md", "console"): "the demo, and an identification",
    ("docs/how-to/extend.md", "toml"): "everything that the page registers",
    ("docs/how-to/validate-and-compare.md", "console"): "intervals of two results",
    ("docs/how-to/payload.md", "console"): "payloads, and the gains of drives",
    ("docs/how-to/experiment-in-software.md", "python"): "a design of a motion",
    ("docs/reference/command-line.md", "console"): "every command",
    ("docs/how-to/simulate.md", "python"): "many simulations",
    ("docs/how-to/use-the-library.md", "python"): "an identification, step by step",
    ("docs/how-to/first-robot-file.md", "console"): "an examination of a log",
    ("docs/how-to/priors-and-robust-fits.md", "python"): "several fits",
    ("docs/how-to/extend.md", "python"): "a package of each kind",
    ("docs/how-to/process-a-log.md", "python"): "a log of a minute and its spectra",
    ("docs/explanation/what-infeasibility-tells.md", "python"): "intervals of all the parameters",
    ("docs/how-to/control.md", "python"): "controllers in a loop",
    ("docs/how-to/simulate.md", "console"): "many simulations",
    ("docs/how-to/excite.md", "python"): "designs of motions",
    ("docs/how-to/excite.md", "console"): "a design with the default number of starts",
    ("docs/how-to/collision-free-motion.md", "python"): "designs of motions",
    ("docs/reference/identification.md", "python"): "the demonstration, and a design of a motion",
    ("docs/reference/report.md", "python"): "an identification",
    ("docs/how-to/bags.md", "console"): "a bag, and two identifications",
    ("docs/how-to/no-inertias.md", "console"): "an identification",
    ("docs/how-to/mujoco.md", "console"): "an identification of an MJCF",
    ("docs/how-to/mujoco.md", "python"): "an identification of an MJCF",
    ("docs/how-to/ros2-control.md", "console"): "a design with the default number of starts",
    ("docs/how-to/from-figaroh.md", "console"): "an identification",
    ("docs/how-to/poor-fit.md", "console"): "an identification",
    ("docs/how-to/fleet.md", "console"): "estimates of several robots",
    ("docs/how-to/on-the-fly.md", "console"): "a motion on the fly",
    ("docs/how-to/currents.md", "console"): "an identification, and the gains of drives",
    ("docs/how-to/many-logs.md", "console"): "an identification of four logs",
    ("docs/how-to/online.md", "python"): "an answer a hundred times a second",
    ("docs/explanation/estimators.md", "python"): "a robot in a loop, and samples of a posterior",
    ("docs/how-to/many-logs.md", "python"): "identifications of several logs",
    ("docs/thesis/closed-form.md", "python"): "conditions by a program of computer algebra",
    ("docs/how-to/payload.md", "python"): "payloads, and the gains of drives",
    ("docs/how-to/on-the-fly.md", "python"): "a motion on the fly",
    ("docs/how-to/validate-and-compare.md", "python"): "two results, and what they predict",
    ("docs/how-to/find-mistakes.md", "python"): "a search for mistakes",
    ("thesis/README.md", "python"): "earlier methods",
    ("docs/reference/collision.md", "python"): "distances of meshes",
    ("docs/how-to/online.md", "console"): "answers during a motion",
}

ELSEWHERE = {
    "steelyard reproduce": "thesis/tests/reproduction runs the sections",
    "python3 -m venv": "the tests run in an environment that was made so",
    ".venv/bin/pip": "the tests run in an environment that was made so",
    ".venv/bin/pre-commit": "it changes the hooks of the work tree",
    "steelyard init arm.urdf": "tests/cli/test_init_and_doctor.py runs it on a bare URDF",
    "steelyard doctor run.csv": "it ends with 1 where something is wrong with the log, as here",
    "steelyard view": "tests/report/test_view.py serves it to a browser; it runs until it is stopped",
    "steelyard example": "tests/test_pictures.py makes and runs every example",
    "steelyard identify ur5/": "tests/test_pictures.py makes and runs every example",
    "steelyard excite robot.toml --limits limits.toml --on-the-fly": "tests/cli/test_excite_on_the_fly.py runs it",
    "steelyard deflections": "tests/identification/test_elastic_joints.py runs it",
    "pip install": "the tests run in an environment that was made so",
}


SHORTER = {"excite": ("--starts", "1"), "simulate": ("--duration", "1")}
"""What is added to commands that do not say it: how long they search and simulate is not what is tried here."""


def blocks(page: str, *languages: str) -> list[str]:
    text = (ROOT / page).read_text(encoding="utf-8")
    return [found["text"] for found in FENCE.finditer(text) if found["language"] in languages]


def pages_with(language: str) -> list[Any]:
    found = [page for page in PAGES if blocks(page, language)]
    return [pytest.param(p, marks=pytest.mark.slow) if (p, language) in SLOW else p for p in found]


def description() -> str:
    """A URDF with six joints, a tool and a finger that may be locked."""
    rows = ['<robot name="arm"><link name="base"/>']
    for name, mass in zip(LINKS[1:], MASSES, strict=True):
        moment = 0.02 * mass
        rows.append(
            f'<link name="{name}"><inertial><origin xyz="0.01 0.02 0.1"/><mass value="{mass}"/>'
            f'<inertia ixx="{moment}" iyy="{moment}" izz="{moment / 2}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )
    for k, (name, axis, place) in enumerate(zip(JOINTS, AXES, PLACES, strict=True)):
        rows.append(
            f'<joint name="{name}_joint" type="revolute"><parent link="{LINKS[k]}"/><child link="{LINKS[k + 1]}"/>'
            f'<origin xyz="{place}"/><axis xyz="{axis}"/><limit lower="-3" upper="3" velocity="3" effort="150"/>'
            '<dynamics damping="1.0" friction="0.5"/></joint>'
        )
    rows.append(
        '<link name="tool0"/><link name="finger"><inertial><mass value="0.1"/>'
        '<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="flange" type="fixed"><parent link="third_wrist"/><child link="tool0"/></joint>'
        '<joint name="finger_joint" type="prismatic"><parent link="tool0"/><child link="finger"/><axis xyz="0 0 1"/>'
        '<limit lower="0" upper="0.05" velocity="1" effort="10"/></joint></robot>'
    )
    return "\n".join(rows)


def recording(model: sy.Model, parameters: np.ndarray, seed: int, duration: float = 6.0) -> sy.Recording:
    random = np.random.default_rng(seed)
    count = model.dof
    waves = random.normal(size=(2, count, 4)) * 0.3
    trajectory = FourierTrajectory(a=waves[0], b=waves[1], center=np.zeros(count), frequency=1.0 / duration)
    t, q, dq, ddq = trajectory.sample(200.0, duration)
    torque = model.inverse_dynamics(q, dq, ddq, parameters) + random.normal(size=q.shape) * 0.05
    return sy.Recording(t=t, q=q, torque=torque, source="simulation", joint_names=model.robot.joint_names)


LEG = """\
<robot name="leg"><link name="hip"/>
  <link name="thigh"><inertial><origin xyz="0 0 -0.1"/><mass value="1.1"/>
    <inertia ixx="6e-3" iyy="6e-3" izz="9e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="calf"><inertial><origin xyz="0 0 -0.1"/><mass value="0.3"/>
    <inertia ixx="2e-3" iyy="2e-3" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="lift" type="continuous"><parent link="hip"/><child link="thigh"/><axis xyz="0 1 0"/></joint>
  <joint name="knee" type="continuous"><parent link="thigh"/><child link="calf"/>
    <origin xyz="0 0 -0.2"/><axis xyz="0 1 0"/></joint>
</robot>
"""


def drives_in(folder: Path) -> None:
    """Write a leg with position-controlled joints, and logs of what they were told and where they stood."""
    (folder / "leg.urdf").write_text(LEG, encoding="utf-8")
    text = '[description]\nurdf = "leg.urdf"\n\n[drive]\ncommand = "q_des{}"\nkp = 20.0\nkd = 1.5\n'
    (folder / "leg.toml").write_text(text, encoding="utf-8")
    model = sy.Model(sy.Robot.from_urdf(folder / "leg.urdf"))
    t = np.arange(500) / 200.0
    for seed, name in ((1, "sweeps"), (2, "more")):
        phase = np.random.default_rng(seed).uniform(0.0, 1.0, 2) + t[:, None] * 2.0
        angle = phase + np.sin(2.0 * phase)
        rate, rise = 2.0 + 4.0 * np.cos(2.0 * phase), -16.0 * np.sin(2.0 * phase)
        q, dq = 0.5 * np.sin(angle), 0.5 * np.cos(angle) * rate
        ddq = 0.5 * (np.cos(angle) * rise - np.sin(angle) * rate**2)
        torque = model.inverse_dynamics(q, dq, ddq, model.robot.parameters) + 0.02 * ddq + 1.7 * dq + 0.1 * np.sign(dq)
        command = q + torque / 20.0
        columns = {"t": t, "q1": q[:, 0], "q2": q[:, 1], "q_des1": command[:, 0], "q_des2": command[:, 1]}
        rows = [",".join(f"{x:.8g}" for x in row) for row in zip(*columns.values(), strict=True)]
        (folder / f"{name}.csv").write_text("\n".join([",".join(columns), *rows]), encoding="utf-8")


@pytest.fixture(scope="session")
def workshop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files that the pages speak of; copied for each page."""
    folder = tmp_path_factory.mktemp("workshop")
    for name in ("my_robot.urdf", "tx40.urdf"):
        (folder / name).write_text(description(), encoding="utf-8")
    (folder / "robot.toml").write_text(ROBOT_FILE, encoding="utf-8")
    (folder / "limits.toml").write_text("velocity = 1.5\nacceleration = 4.0\n", encoding="utf-8")
    model = sy.Model.load(folder / "robot.toml")
    parameters = np.nan_to_num(np.asarray(model.robot.parameters))
    for k in range(3):
        recording(model, parameters, k).save(folder / f"run{k + 1}.csv")
    for name in ("run.csv", "long.csv"):
        recording(model, parameters, 4).save(folder / name)
    held = parameters.copy()
    held[model.link_columns[-1]] += sy.Inertia.from_com(2.0, [0.0, 0.01, 0.08], 0.004 * np.eye(3)).parameters
    for name, carried in (("unloaded.csv", parameters), ("loaded.csv", held)):
        recording(model, carried, 5).save(folder / name)
    rows = "".join(f'\n[[robots]]\nid = "{k}"\nlogs = ["run{k}.csv"]\n' for k in (1, 2, 3))
    (folder / "fleet.toml").write_text(f'robot = "robot.toml"\n{rows}', encoding="utf-8")
    rows = "".join(f"{k},robot.toml,run{k}.csv\n" for k in (1, 2, 3))
    (folder / "robots.csv").write_text(f"id,robot,logs\n{rows}", encoding="utf-8")
    for day in (1, 2):
        (folder / "logs" / f"day{day}").mkdir(parents=True)
        recording(model, parameters, day).save(folder / "logs" / f"day{day}" / "run.parquet")
    currents = '[log]\ntorque_unit = "A"\ngain = "find"\n'
    (folder / "currents.toml").write_text(f"{ROBOT_FILE}{currents}", encoding="utf-8")
    drives_in(folder)
    (folder / "result").mkdir()
    samples = sy.Recording.read(folder / "run1.csv", joints=6).process(cutoff=10.0)
    estimate = sy.fit(sy.Information.from_samples(model, samples), sy.FeasibleSet(model))
    for target in (folder / "estimate.json", folder / "result" / "estimate.json"):
        estimate.save(target)
    (folder / "meshes").mkdir()
    corners = [f"v {x} {y} {z}" for x in (-50, 50) for y in (-50, 50) for z in (-400, 400)]
    faces = ["f 1 2 4 3", "f 5 7 8 6", "f 1 5 6 2", "f 3 4 8 7", "f 1 3 7 5", "f 2 6 8 4"]
    (folder / "meshes" / "forearm.obj").write_text("\n".join(corners + faces), encoding="utf-8")
    return folder


@pytest.fixture
def place(workshop: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the workshop, where the test stands."""
    shutil.copytree(workshop, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


# What pages take for granted: names that the reader has at this point, or files of another robot.


def _names(model: sy.Model, info: sy.Information, estimate: sy.Estimate, parameters: Any) -> dict[str, Any]:
    return {
        "sy": sy,
        "model": model,
        "info": info,
        "information": info,
        "feasible_set": sy.FeasibleSet(model),
        "estimate": estimate,
        "delta": parameters,
        "beta": estimate.base,
        "base": estimate.base,
    }


def _identified(place: Path) -> dict[str, Any]:
    """The names of somebody who has identified a robot."""
    model = sy.Model.load(place / "robot.toml")
    info = sy.Information.from_samples(model, sy.Recording.read(place / "run1.csv", joints=6).process(cutoff=10.0))
    estimate = sy.fit(info, sy.FeasibleSet(model))
    return _names(model, info, estimate, estimate.parameters)


def _small(place: Path) -> dict[str, Any]:
    """The same, of a pendulum of two links: intervals of all parameters and the old methods take long for six."""
    rows = [(0, 0.5, 0, "q"), (0, 0.4, 0, "q")]
    model = sy.Model(sy.Robot.from_dh(rows, gravity=(0, -9.81, 0)).with_terms(sy.Viscous()))
    random = np.random.default_rng(5)
    q, dq, ddq = random.normal(size=(3, 300, 2))
    truth = np.array([0.1, 0, 0, 0.1, 0, 0.1, -0.2, 0, 0, 2.0, 0.1] * 2)
    torque = model.inverse_dynamics(q, dq, ddq, truth) + random.normal(size=q.shape) * 0.1
    info = sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    return _names(model, info, sy.least_squares(info), sy.fit(info, sy.FeasibleSet(model)).parameters)


def _mass_four(place: Path) -> dict[str, Any]:
    names = _small(place)
    rows = [(0, 0.5, 0, "q"), (0, 0.4, 0, "q"), (0, 0.3, 0, "q"), (0, 0.2, 0, "q")]
    model = sy.Model(sy.Robot.from_dh(rows, gravity=(0, -9.81, 0)))
    truth = np.array([0.1, 0, 0, 0.1, 0, 0.1, -0.2, 0, 0, 2.0] * 4)
    random = np.random.default_rng(5)
    q, dq, ddq = random.normal(size=(3, 300, 4))
    torque = model.inverse_dynamics(q, dq, ddq, truth) + random.normal(size=q.shape) * 0.1
    info = sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    feasible_set = sy.FeasibleSet(model)
    return names | {"model": model, "info": info, "feasible_set": feasible_set, "estimate": sy.fit(info, feasible_set)}


def _seven_joints(place: Path) -> dict[str, Any]:
    rows = [("pi/2", 0.0, 0.3, "q")] * 7
    model = sy.Model(sy.Robot.from_dh(rows))
    trajectory = FourierTrajectory(a=np.full((7, 1), 0.3), b=np.zeros((7, 1)), center=np.zeros(7), frequency=1 / 12.5)
    t, q, _, _ = trajectory.sample(100.0, 55.0)
    random = np.random.default_rng(3)
    torque = np.sin(q) * 10 + random.normal(size=q.shape) * 0.1
    q = q + random.normal(size=q.shape) * 1e-5
    sy.Recording(t=t, q=q, torque=torque, source="simulation").save(place / "run.csv")
    return {"model": model}


def _solvers(place: Path) -> dict[str, Any]:
    names = _small(place)
    program = names["feasible_set"].inequality.with_margin(1e-3).program(names["model"].parameter_names[9])
    program.write(place / "arch0.dat-s")
    return names | {"x": np.zeros(22), "s": np.zeros(3), "z": np.zeros(3), "objective": 0.0, "count": 1, "seconds": 0.1}


ARM = """\
<mujoco model="arm">
  <default><joint damping="0.8" frictionloss="0.4" armature="0.02"/></default>
  <worldbody>
    <body name="upper" pos="0 0 0.6">
      <joint name="lift" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.04" mass="2.5"/>
      <body name="fore" pos="0.4 0 0">
        <joint name="elbow" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="1.2"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def _mujoco(place: Path) -> dict[str, Any]:
    """An MJCF, logs of a simulation of it as arrays, and what `identify` makes of them."""
    pytest.importorskip("mujoco", reason="MuJoCo (extra `mjcf`) is not installed")
    (place / "arm.xml").write_text(ARM, encoding="utf-8")
    model = sy.Model.load("arm.xml")
    for seed, name in ((1, "train"), (2, "test")):
        log = recording(model, np.nan_to_num(np.asarray(model.robot.parameters)), seed)
        np.savez(place / f"{name}.npz", t=log.t, q=log.q, tau=log.torque)
    sy.identify("arm.xml", "train.npz", validate="test.npz").save("result", force=True)
    return {}


def _bag(place: Path) -> dict[str, Any]:
    """A bag with the joint states of a log."""
    mcap = pytest.importorskip("mcap.writer", reason="mcap (extra `bags`) is not installed")
    pytest.importorskip("rosbags", reason="rosbags (extra `bags`) is not installed")
    log = sy.Recording.read("run1.csv", joints=6)
    names = [f"{joint}_joint" for joint in JOINTS]
    with (place / "recording.mcap").open("wb") as file:
        writer = mcap.Writer(file)
        writer.start()
        schema = writer.register_schema("sensor_msgs/JointState", "jsonschema", b'{"type": "object"}')
        channel = writer.register_channel("/joint_states", "json", schema)
        for stamp, q, torque in zip(log.t, log.q, log.torque, strict=True):
            time = 1_700_000_000 * 10**9 + round(float(stamp) * 1e9)
            header = {"stamp": {"sec": time // 10**9, "nanosec": time % 10**9}}
            message = {"header": header, "name": names, "position": q.tolist(), "effort": torque.tolist()}
            writer.add_message(channel, time, json.dumps(message).encode(), time)
        writer.finish()
    return {}


PREPARATION: dict[str, Callable[[Path], dict[str, Any]]] = {
    "docs/explanation/feasibility.md": _identified,
    "docs/explanation/what-infeasibility-tells.md": _mass_four,
    "docs/how-to/process-a-log.md": _seven_joints,
    "docs/reference/constraints.md": _identified,
    "docs/reference/lmi.md": _small,
    "docs/thesis/methods.md": _small,
    "docs/reference/feasibility.md": _small,
    "docs/reference/regression.md": _small,
    "docs/reference/solvers.md": _solvers,
    "docs/how-to/mujoco.md": _mujoco,
    "docs/how-to/bags.md": _bag,
}


@pytest.mark.parametrize("page", pages_with("python"))
def test_python_runs(page: str, place: Path, no_extensions: None) -> None:
    if page.endswith(("symbolic-models.md", "closed-form.md")):
        pytest.importorskip("sympy", reason="symbolic models need SymPy")
    if "thesis/" in page:
        pytest.importorskip("steelyard_thesis", reason="the package in thesis/ is not installed")
    names: dict[str, Any] = PREPARATION.get(page, lambda place: {})(place)
    for snippet in blocks(page, "python"):
        exec(compile(snippet, page, "exec"), names)


def commands(page: str) -> list[str]:
    """The commands of a page, without those that are run elsewhere."""
    lines = "".join(blocks(page, "console")).splitlines()
    assert all(line.startswith("$ ") for line in lines), "a line of console is a command; what it prints goes into text"
    given = [line.removeprefix("$ ").replace(".venv/bin/steelyard", "steelyard") for line in lines]
    return [line for line in given if not any(line.startswith(start) for start in ELSEWHERE)]


@pytest.mark.parametrize("page", pages_with("console"))
def test_commands_run(
    page: str, place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if page in ("docs/how-to/mujoco.md", "docs/how-to/bags.md"):
        PREPARATION[page](place)
    for line in commands(page):
        words = [PLACEHOLDERS.get(word, word) for word in shlex.split(re.sub(r"\[|\]|\.\.\.", "", line))]
        assert words[0] == "steelyard", f"{page}: {line}"
        option, *value = SHORTER.get(words[1], ("",))
        words += [option, *value] if option not in ("", *words) else []
        monkeypatch.setattr(sys, "argv", words)
        code: Any = 0
        try:
            main()
        except SystemExit as stop:
            code = stop.code or 0
        # The doctor ends with 1 where it finds something.
        assert code == 0 or (words[1], code) == ("doctor", 1), f"{page}: {line}: {capsys.readouterr().err}"


@pytest.mark.parametrize("page", pages_with("toml"))
def test_settings_are_read(page: str, place: Path, no_extensions: None) -> None:
    """Each block of TOML is a limits file, or a robot file or a part of one, and every section is understood."""
    if page.endswith("extend.md"):  # its settings name what its Python registers
        test_python_runs(page, place, None)
    for text in blocks(page, "toml"):
        document = tomllib.loads(text)
        if "project" in document:
            continue  # of a package that adds a command, which tests/cli installs
        if "robots" in document:
            (place / "given.toml").write_text(text, encoding="utf-8")
            assert len(sy.fleet.FleetManifest.load(place / "given.toml").entries) == 2
            continue
        if "velocity" in document or "acceleration" in document:
            (place / "given.toml").write_text(text, encoding="utf-8")
            robot = sy.Robot.from_urdf("my_robot.urdf", tip="tool0")
            limits, sections = limits_from_file(place / "given.toml")
            limits = MotionLimits.of(robot.joint_names).updated(limits)
            assert np.all(limits.velocity < 3.0)
            if sections:
                pytest.importorskip("coal", reason="coal (extra `collision`) is not installed")
            kept = geometry.geometry_from_dict(sections, robot, place, where=page) if sections else ()
            assert len(kept) >= len(sections.keys() - {"collision", "obstacles"})
            continue
        if "description" not in document:
            text = ROBOT_FILE.split("[[terms]]")[0] + text
        (place / "given.toml").write_text(text.replace("forearm.stl", "forearm.obj"), encoding="utf-8")
        file = sy.RobotFile.load(place / "given.toml")
        model = sy.Model.from_file(file)
        assert model.dof in (2, 3, 6, 7)
        LogColumns.from_dict(file.section("log"), page)
        Processing.from_dict(file.section("processing"), page)
        from steelyard.feasibility.constraints import constraints_from_dict
        from steelyard.identification.payload import payload_mounting

        payload_mounting(file, model)
        sy.FeasibleSet(model, "full", list(constraints_from_dict(file.section("constraints"), folder=place)))


@pytest.mark.slow
def test_the_loop_in_cpp_compiles_and_links(place: Path) -> None:
    """The loop of the page, with what it takes for granted: gains, what is wanted, and the generated function."""
    compiler = shutil.which("g++")
    if compiler is None:
        pytest.skip("there is no C++ compiler")
    (snippet,) = blocks("docs/how-to/cpp-controller.md", "cpp")
    sy.Model.load("robot.toml").generate(
        "cpp", ["inverse_dynamics"], directory=place / "code", parameters=sy.Estimate.load("estimate.json")
    )
    include, _, rest = snippet.partition("\n")
    given = "using Six = std::array<double, 6>;\nstruct Reference { Six q, dq, ddq; };\nconst Six kp{}, kd{};\n"
    run = "int main() { Six torque; update(Six{}, Six{}, Reference{}, torque); return torque[1] == 0.0; }\n"
    (place / "code" / "loop.cpp").write_text(f"{include}\n{given}{rest}{run}", encoding="utf-8")
    sources = ["loop.cpp", "arm.cpp"]
    command = [compiler, "-std=c++17", "-Wall", "-Wextra", "-Werror", *sources, "-o", "loop"]
    subprocess.run(command, cwd=place / "code", check=True)
    assert subprocess.run([place / "code" / "loop"], check=False).returncode == 0


def test_every_language_of_a_block_is_known() -> None:
    """A block without a language is shown and not run: texts that are printed, and file formats."""
    known = {"python", "console", "toml", "sh", "text", "json", "xml", "c", "cpp", ""}
    found = {f["language"] for page in PAGES for f in FENCE.finditer((ROOT / page).read_text(encoding="utf-8"))}
    assert found <= known
    shown = [
        b
        for page in PAGES
        for b in blocks(page, "", "text")
        if re.search(r"^\s*(\$ )?steelyard \w|^import ", b, re.MULTILINE)
    ]
    assert shown == [], "commands and Python are to be marked as such, so that they run here"
