"""How much of the package a process loads: what is not asked for costs no time and no memory."""

import subprocess
import sys

import numpy as np
import pytest

import steelyard as sy

DH = '[description]\nrows = [[0, 0.0, 0, "q"], ["pi/2", 0.4, 0, "q"]]\n'
URDF = '[description]\nurdf = "arm.urdf"\n'
MOST = 160
"""Files of the package, packages' own among them. A reader who follows one identification meets these and no others."""

SLOW = {f"scipy.{name}" for name in ("interpolate", "ndimage", "signal", "stats")}

COUNT = """
import sys
import steelyard
result = steelyard.identify("robot.toml", ["log.csv"])
assert result.estimate.certificate is not None
print(*sorted(name for name in sys.modules if name.partition(".")[0] in ("steelyard", "scipy")))
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A log of an arm of two links, and its description in two formats."""
    place = tmp_path_factory.mktemp("loaded")
    robot = sy.Robot.from_dh([(0, 0.0, 0, "q"), ("pi/2", 0.4, 0, "q")], name="arm")
    model = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset()))
    body = sy.Inertia.from_com(2.0, (0.1, 0.02, -0.03), 0.02 * np.eye(3)).parameters
    parameters = np.concatenate([[*body, 0.8, 0.3, 0.1]] * 2)
    t = np.arange(0.0, 4.0, 0.005)
    phase = 2 * np.pi * t[:, None] * np.array([0.25, 0.4])
    rate = 2 * np.pi * np.array([0.25, 0.4])
    q, dq, ddq = np.sin(phase), rate * np.cos(phase), -(rate**2) * np.sin(phase)
    torque = model.inverse_dynamics(q, dq, ddq, parameters)
    torque += np.random.default_rng(1).normal(scale=0.05, size=torque.shape)
    table = np.column_stack([t, q, torque])
    np.savetxt(place / "log.csv", table, delimiter=",", header="t,q1,q2,tau1,tau2", comments="")
    links = "".join(
        f'<link name="{name}"><inertial><origin xyz="0 0 0"/><mass value="1"/>'
        '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>'
        for name in ("base", "upper", "fore")
    )
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>'
        '<limit lower="-3" upper="3" effort="100" velocity="10"/></joint>'
        for name, parent, child, axis in (("one", "base", "upper", "0 0 1"), ("two", "upper", "fore", "0 1 0"))
    )
    (place / "arm.urdf").write_text(f'<robot name="arm">{links}{joints}</robot>')
    return place


@pytest.mark.parametrize(
    "description", [pytest.param(DH, marks=pytest.mark.slow, id="dh"), pytest.param(URDF, id="urdf")]
)
def test_an_identification_loads_few_files(folder, description):
    (folder / "robot.toml").write_text(description)
    done = subprocess.run([sys.executable, "-c", COUNT], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    # What writes loops is loaded where they are compiled, once on a machine, and what tells the size of a mistake where
    # there may be one, as here, where the URDF has half of the masses.
    unusual = {"steelyard.graph.loops", "steelyard.identification.mistake_sizes"}
    loaded = [name for name in done.stdout.split() if name.startswith("steelyard") and name not in unusual]
    assert "steelyard.estimators.fit" in loaded
    assert len(loaded) <= MOST, loaded
    # What an identification of this robot and this log has no use for.
    rooms = {name.split(".")[1] for name in loaded if "." in name}
    assert rooms.isdisjoint({"cli", "control", "excitation", "report", "simulation"})
    # Together they would take longer to import than this identification takes.
    assert SLOW.isdisjoint(done.stdout.split())
