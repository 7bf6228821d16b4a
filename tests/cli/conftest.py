"""Runs the command line in this process, on a small robot and its log."""

import shutil

import numpy as np
import pytest

import steelyard as sy

URDF = """\
<?xml version="1.0"?>
<!-- a comment that must survive -->
<robot name="pair">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.1 0 0"/><mass value="2"/>
    <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
  <link name="fore"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="50" velocity="5"/><dynamics damping="0.1" friction="0.2"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.4 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="5"/></joint>
</robot>
"""

ROBOT_FILE = """\
[description]
urdf = "pair.urdf"

[[terms]]
kind = "viscous"

[[terms]]
kind = "coulomb"

[processing]
cutoff = 10.0
"""


@pytest.fixture(scope="session")
def prepared(tmp_path_factory):
    """Return a folder with ``pair.urdf``, ``robot.toml`` and ``log.csv``, which is copied for each test."""
    folder = tmp_path_factory.mktemp("pair")
    (folder / "pair.urdf").write_text(URDF)
    (folder / "robot.toml").write_text(ROBOT_FILE)
    model = sy.Model.load(folder / "robot.toml")
    random = np.random.default_rng(3)
    trajectory = sy.excitation.FourierTrajectory(
        a=random.normal(size=(2, 4)) * 0.6, b=random.normal(size=(2, 4)) * 0.6, center=np.zeros(2), frequency=0.2
    )
    t, q, dq, ddq = trajectory.sample(200.0, 2.0)
    parameters = np.nan_to_num(np.asarray(model.robot.parameters))
    torque = model.inverse_dynamics(q, dq, ddq, parameters) + random.normal(size=q.shape) * 0.05
    sy.Recording(t=t, q=q, torque=torque, source="simulation").save(folder / "log.csv")
    return folder


@pytest.fixture
def place(prepared, tmp_path):
    """Return a folder with ``pair.urdf``, ``robot.toml`` and ``log.csv``."""
    for file in prepared.iterdir():
        shutil.copy(file, tmp_path)
    return tmp_path
