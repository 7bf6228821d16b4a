"""Writing SDF in place: what is read again, what stays byte for byte, and what is refused."""

from xml.etree import ElementTree
from xml.sax.saxutils import escape

import numpy as np
import pytest

from steelyard.dynamics import Model
from steelyard.errors import InputError
from steelyard.robot import Drives, Inertia, Robot
from steelyard.robot.description import SDF
from steelyard.robot.sdf_writer import write_sdf

ARM = """<?xml version="1.0"?>
<!-- an arm -->
<sdf version='1.9'>
  <world name="w"><light name="sun"/>
  <model name="arm">
    <link name="base"/>
    <link name="upper"><!-- kept -->
      <inertial>
        <mass> 3.0 </mass>
        <pose rotation_format="quat_xyzw">0.1 0 0 0.5 0.5 0.5 0.5</pose>
        <inertia><ixx>0.2</ixx><iyy>0.3</iyy></inertia>
      </inertial>
      <visual name="v"><geometry><box><size>1 1 1</size></box></geometry></visual>
    </link>
    <link name="camera"><pose>0.3 0.1 0 0 0.4 0</pose><inertial><mass>0.4</mass>
      <inertia><ixx>0.001</ixx><iyy>0.001</iyy><izz>0.001</izz></inertia></inertial></link>
    <joint name="shoulder" type="revolute"><parent>base</parent><child>upper</child>
      <axis><xyz>0 1 0</xyz><dynamics><friction>0.1</friction></dynamics></axis></joint>
    <joint name="glue" type="fixed"><parent>upper</parent><child>camera</child></joint>
    <model name="tool">
      <link name="tip"/>
      <joint name="slide" type="prismatic"><parent>tip</parent><child>end</child><axis/></joint>
      <link name="end"><inertial/></link>
    </model>
    <joint name="wrist" type="revolute"><parent>camera</parent><child>tool::tip</child><axis><xyz>1 0 0</xyz></axis>
    </joint>
    <plugin name="p" filename="x"><link name="upper"/><weird a="1"/></plugin>
  </model>
  </world>
</sdf>
"""


def arm(tmp_path, text=ARM):
    path = tmp_path / "arm.sdf"
    path.write_bytes(text.encode())
    return path, Robot.from_sdf(path)


def body(random):
    spread = random.uniform(0.02, 0.1, 3)
    return Inertia.from_com(
        random.uniform(1, 5), random.normal(size=3) * 0.1, np.diag(spread.sum() - spread)
    ).parameters


def test_without_changes_it_is_the_same_byte_for_byte(tmp_path):
    for text in (ARM, ARM.replace("\n", "\r\n")):
        path, robot = arm(tmp_path, text)
        unknown = Drives.unknown(3)
        known = unknown.with_known(friction=[0.1, np.nan, np.nan])
        for drives in (unknown, known):
            write_sdf(robot, robot.parameters, drives, path, tmp_path / "same.sdf")
            assert (tmp_path / "same.sdf").read_bytes() == path.read_bytes()


@pytest.mark.parametrize("seed", range(4))
def test_what_is_written_is_read_again(tmp_path, seed):
    path, robot = arm(tmp_path)
    assert robot.joint_names == ("shoulder", "wrist", "tool::slide")
    random = np.random.default_rng(seed)
    parameters = np.concatenate([body(random) for _ in robot.links])
    drives = Drives(*random.uniform(0.1, 1, (4, 3)))
    target = tmp_path / "weighed.sdf"
    write_sdf(robot, parameters, drives, path, target)
    weighed = Robot.from_sdf(target)
    assert np.allclose(weighed.parameters, parameters, rtol=1e-11, atol=1e-13)
    assert [joint.damping for joint in weighed.joints] == drives.damping.tolist()
    assert [joint.friction for joint in weighed.joints] == drives.friction.tolist()
    text = target.read_text()
    for kept in ("<!-- an arm -->", "<!-- kept -->", "<size>1 1 1</size>", '<weird a="1"/>', '<light name="sun"/>'):
        assert kept in text
    assert (
        f'<steelyard:joint name="wrist" rotor_inertia="{drives.rotor_inertia[1]!r}"'.replace("np.float64(", "")[:45]
        in text
    )
    # Every link of the copy is a possible body.
    for link in weighed.links:
        for one in (link.own_inertia, *(part.inertia for part in link.attachments)):
            assert np.linalg.eigvalsh(one.pseudo_inertia)[0] > 0
    again = tmp_path / "again.sdf"
    write_sdf(weighed, weighed.parameters, drives, target, again)
    assert again.read_text().count("<steelyard:drives") == 1
    q, dq, ddq = random.uniform(-1, 1, (3, 5, 3))
    ours = Model(robot).inverse_dynamics(q, dq, ddq, parameters)
    assert np.allclose(Model(weighed).inverse_dynamics(q, dq, ddq, weighed.parameters), ours, rtol=0, atol=1e-9)


def test_locked_links_heavier_than_the_estimate_keep_a_part(tmp_path):
    path, _ = arm(tmp_path)
    locked, target = {"wrist": 0.2}, tmp_path / "weighed.sdf"
    robot = Robot.from_sdf(path, locked=locked)
    parameters = np.concatenate([body(np.random.default_rng(seed)) for seed in range(len(robot.links))])
    parameters[:10] *= 0.1
    write_sdf(robot, parameters, Drives.unknown(robot.dof), path, target)
    weighed = Robot.from_sdf(target, locked=locked)
    assert np.allclose(weighed.parameters, parameters, rtol=1e-11, atol=1e-13)
    tip = {one.name: one.inertia.mass for one in weighed.links[0].attachments}["tool::tip"]
    assert 0.0 < tip < 1.0


def test_what_is_refused(tmp_path):
    path, robot = arm(tmp_path)
    drives = Drives.unknown(3)
    with pytest.raises(InputError, match="which is never changed"):
        write_sdf(robot, robot.parameters, drives, path, path)
    light = robot.parameters.copy()
    light[9] = -1.0
    with pytest.raises(InputError, match='link "upper": its mass is -1 kg'):
        write_sdf(robot, light, drives, path, tmp_path / "x.sdf")
    with pytest.raises(InputError, match='joint "wrist": its rotor inertia is -1'):
        write_sdf(robot, robot.parameters, drives.with_known(rotor_inertia=[0, -1, 0]), path, tmp_path / "x.sdf")
    other = tmp_path / "other.sdf"
    other.write_text(ARM.replace('"camera"', '"eye"'))
    with pytest.raises(InputError, match='does not hold "camera" of robot "arm"'):
        write_sdf(robot, robot.parameters, drives, other, tmp_path / "x.sdf")
    assert not (tmp_path / "x.sdf").exists()


def test_meshes_are_found_from_another_folder(tmp_path):
    (tmp_path / "arm" / "meshes").mkdir(parents=True)
    mesh = tmp_path / "arm" / "meshes" / "ü&.stl"
    mesh.touch()
    names = ("meshes/ü&.stl", "model://arm/ü.stl", "missing.stl")
    uris = "".join(f"<mesh><uri> {escape(name)} </uri></mesh>" for name in names)
    path, robot = arm(tmp_path / "arm", ARM.replace("<box><size>1 1 1</size></box>", uris))
    drives = Drives.unknown(3).with_known(friction=[0.3, np.nan, np.nan])
    for target, expected in ((tmp_path / "x.sdf", mesh.as_posix()), (tmp_path / "arm" / "x.sdf", names[0])):
        write_sdf(robot, robot.parameters, drives, path, target)
        found = [one.text.strip() for one in ElementTree.parse(target).iter("uri")]
        assert found == [expected, *names[1:]]


def test_links_of_other_files_are_not_written(tmp_path):
    path, robot = arm(tmp_path)
    assert SDF.refusal(robot) == ""
    start = ARM.index('<model name="tool">')
    tool = ARM[start : ARM.index("</model>") + 8]
    (tmp_path / "tool.sdf").write_text(f'<sdf version="1.9">{tool}</sdf>')
    path.write_text(ARM.replace(tool, "<include><uri>tool.sdf</uri></include>"))
    robot = Robot.from_sdf(path)
    assert "includes tool::end from another file" in SDF.refusal(robot)
    with pytest.raises(InputError, match="identify the robot from the file of the model"):
        write_sdf(robot, robot.parameters, Drives.unknown(3), path, tmp_path / "x.sdf")
