"""SDF files against Drake, which reads them with Gazebo's own library."""

from pathlib import Path

import numpy as np
import pytest

import steelyard as sy

drake = pytest.importorskip("pydrake.multibody.parsing", reason="Drake (pip install drake) is not installed")
pytest.importorskip("pinocchio", reason="Pinocchio (pip install pin), of which the trees are made, is not installed")

from pydrake.multibody.plant import MultibodyPlant  # noqa: E402
from random_sdf import RandomTree  # noqa: E402

NESTED = """<sdf version="1.9"><model name="cell">
  <link name="base"><inertial><mass>2</mass></inertial></link>
  <frame name="mount" attached_to="base"><pose degrees="true">0.1 0.2 0.3 30 0 -40</pose></frame>
  <model name="arm" placement_frame="flange">
    <pose relative_to="mount">0 0 0.1 0.2 0 0</pose>
    <link name="lower"><pose rotation_format="quat_xyzw">0.1 0 0 0.5 0.5 0.5 0.5</pose>
      <inertial><pose>0 0.1 0.2 0.1 0 0</pose><mass>3</mass><inertia><ixx>0.1</ixx><iyy>0.15</iyy><izz>0.12</izz>
      <ixy>0.01</ixy><ixz>0</ixz><iyz>0</iyz></inertia></inertial></link>
    <frame name="flange" attached_to="lower"><pose>0 0 -0.2 0 0.3 0</pose></frame>
    <link name="upper"><pose relative_to="elbow"/><inertial><mass>1.5</mass><inertia><ixx>0.02</ixx><iyy>0.02</iyy>
      <izz>0.03</izz></inertia></inertial></link>
    <joint name="elbow" type="revolute"><pose relative_to="lower">0 0 0.4 0 0 0.5</pose>
      <parent>lower</parent><child>upper</child><axis><xyz expressed_in="flange">0 1 0.2</xyz></axis></joint>
  </model>
  <joint name="shoulder" type="revolute"><parent>mount</parent><child>arm::flange</child>
    <axis><xyz expressed_in="__model__">0 0 1</xyz></axis></joint>
</model></sdf>"""


def compare(path: Path, robot: sy.Robot, base: str) -> None:
    plant = MultibodyPlant(0.0)
    drake.Parser(plant).AddModels(str(path))
    plant.WeldFrames(plant.world_frame(), plant.GetBodyByName(base).body_frame())
    plant.mutable_gravity_field().set_gravity_vector(robot.gravity)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    places = [
        plant.GetJointByName(name.split("::")[-1]).velocity_start() for name in robot.joint_names
    ]  # the names differ in these files
    random = np.random.default_rng(1)
    model, parameters = sy.Model(robot), np.nan_to_num(robot.parameters)
    for _ in range(3):
        full = np.zeros((3, plant.num_velocities()))
        q, dq, ddq = random.uniform(-2, 2, (3, robot.dof))
        full[:, places] = q, dq, ddq
        plant.SetPositions(context, full[0])
        plant.SetVelocities(context, full[1])
        forces = drake_forces(plant, context)
        expected = plant.CalcInverseDynamics(context, full[2], forces)[places]
        torque = model.inverse_dynamics(q, dq, ddq, parameters)
        assert np.abs(torque - expected).max() < 1e-9 * max(1.0, np.abs(expected).max())


def drake_forces(plant, context):
    from pydrake.multibody.tree import MultibodyForces

    forces = MultibodyForces(plant)
    plant.CalcForceElementsContribution(context, forces)
    return forces


@pytest.mark.parametrize("version", ["1.4", "1.5", "1.6", "1.7", "1.8", "1.9", "1.10", "1.11"])
def test_random_trees_agree(tmp_path, version):
    for seed in range(4):
        tree = RandomTree(seed, 6)
        path = tmp_path / f"tree{seed}.sdf"
        path.write_text(tree.sdf(version))
        compare(path, sy.Robot.from_sdf(path), "base")


def test_nested_models_agree(tmp_path):
    path = tmp_path / "cell.sdf"
    path.write_text(NESTED)
    robot = sy.Robot.from_sdf(path)
    assert set(robot.joint_names) == {"shoulder", "arm::elbow"}
    compare(path, robot, "base")
    # The same arm in a file of its own, included, and merged.
    start = NESTED.index('<model name="arm"')
    arm = NESTED[start : NESTED.index("</model>") + 8]
    (tmp_path / "arm").mkdir()
    (tmp_path / "arm" / "model.config").write_text('<model><sdf version="1.9">arm.sdf</sdf></model>')
    (tmp_path / "arm" / "arm.sdf").write_text(
        f'<sdf version="1.9">{arm.replace("""<pose relative_to="mount">0 0 0.1 0.2 0 0</pose>""", "")}</sdf>'
    )
    include = '<include><uri>arm/arm.sdf</uri><pose relative_to="mount">0 0 0.1 0.2 0 0</pose></include>'
    path.write_text(NESTED.replace(arm, include))
    included = sy.Robot.from_sdf(path)
    for one, other in zip(robot.joints, included.joints, strict=True):
        assert one.name == other.name
        assert np.allclose(one.before, other.before, atol=1e-15)
    path.write_text(NESTED.replace(arm, include.replace("<include>", '<include merge="true">')).replace("arm::", ""))
    assert set(sy.Robot.from_sdf(path).joint_names) == {"shoulder", "elbow"}
