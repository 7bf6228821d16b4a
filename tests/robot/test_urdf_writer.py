"""Writing estimates into a copy of a URDF."""

import difflib
import os

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from steelyard.errors import InputError
from steelyard.robot import Inertia, Robot, write_urdf
from steelyard.robot.description_changes import remark_on_held

SOURCE = """<?xml version='1.0' encoding="utf-8"?>
<!-- kept: Größe > 1 -->
<robot   name='bench' >
  <material name="grey"><color rgba="0.7 0.7 0.7 1"/></material>
  <link name="base">
    <inertial><mass value="9"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
  </link>
  <link name="stand">
    <inertial>
      <mass value="8"/>
      <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>
    </inertial>
  </link>
  <link name="upper">
    <visual><geometry><mesh filename="package://a/b&amp;c.stl"/></geometry></visual>
    <inertial>
      <!-- weighed on the kitchen scale -->
      <mass  value = '2.0' />
      <origin rpy="0 0.3 0" xyz="0.1 0 0" />
      <inertia ixx="0.1" ixy="0" ixz="0"
               iyy="0.2" iyz="0" izz="0.25" />
    </inertial>
  </link>
  <link name="bolt">
    <inertial>
      <origin xyz="0 0 0"/>
      <mass value="0.5"/>
      <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/>
    </inertial>
    <visual/>
  </link>
  <link name="lower" />
  <link name="hand">
    <inertial><mass value="0.4"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>
  </link>
  <joint name="mount" type="fixed"><parent link="base"/><child link="stand"/></joint>
  <joint name="shoulder" type="revolute">
    <parent link="base"/>
    <child link="upper"/>
    <axis xyz="0 0 1"/>
    <dynamics   friction='0.1' />
  </joint>
  <joint name="screw" type="fixed"><origin xyz="1 0 0"/><parent link="upper"/><child link="bolt"/></joint>
  <joint name="elbow" type="revolute">
    <origin xyz="0 2 0" rpy="1.5707963267948966 0 0"/>
    <parent link="bolt"/>
    <child link="lower"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="wrist" type="revolute">
    <origin xyz="0 0 0.3"/><parent link="lower"/><child link="hand"/><dynamics damping="0.5"/>
  </joint>
  <transmission name="t"><joint name="elbow"/></transmission>
</robot>
<!-- the end -->
"""
LOWER = """<inertial><origin xyz="0 0 1"/><mass value="1"/>
    <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>"""
BODY = Inertia.from_com(3.0, (0.2, -0.1, 0.05), [[0.3, 0.01, 0.02], [0.01, 0.4, 0.03], [0.02, 0.03, 0.5]])


@pytest.fixture
def source(tmp_path):
    path = tmp_path / "bench.urdf"
    path.write_bytes(SOURCE.encode())
    return path


def estimate(robot: Robot) -> np.ndarray:
    """The same body for every link, scaled to tell the links apart."""
    return np.concatenate([BODY.parameters * (index + 1) for index in range(len(robot.links))])


def changed_lines(before: str, after: str) -> tuple[list[str], list[str]]:
    difference = list(difflib.unified_diff(before.splitlines(), after.splitlines(), n=0, lineterm=""))[2:]
    return (
        [line[1:].strip() for line in difference if line[0] == "-"],
        [line[1:].strip() for line in difference if line[0] == "+"],
    )


def test_only_inertials_and_friction_change(source, tmp_path):
    robot = Robot.from_urdf(source, locked=["wrist"])
    target = tmp_path / "out.urdf"
    write_urdf(robot, estimate(robot), [0.25, 0.5], [np.nan, 0.75], source, target)
    removed, added = changed_lines(SOURCE, target.read_text(encoding="utf-8"))
    assert removed == [
        "<mass  value = '2.0' />",
        '<origin rpy="0 0.3 0" xyz="0.1 0 0" />',
        '<inertia ixx="0.1" ixy="0" ixz="0"',
        'iyy="0.2" iyz="0" izz="0.25" />',
        "<inertial>",
        '<origin xyz="0 0 0"/>',
        '<mass value="0.5"/>',
        '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/>',
        "</inertial>",
        '<link name="lower" />',
        "<dynamics   friction='0.1' />",
    ]
    about_com = BODY.about_com
    assert added[0] == "<mass  value = '3.0' />"
    assert added[1].startswith('<origin rpy="0 0 0" xyz="0.2')
    assert added[2].startswith('<inertia ixx="0.')
    assert float(added[2].split('"')[1]) == pytest.approx(about_com[0, 0], rel=1e-14)
    assert added[4:6] == ['<link name="lower">', "<inertial>"]
    assert added[9:11] == ["</inertial>", "</link>"]
    assert added[11] == "<dynamics   friction='0.1' damping=\"0.25\" />"
    assert added[12:] == ['<dynamics damping="0.5" friction="0.75"/>']
    assert source.read_bytes() == SOURCE.encode()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bench.urdf", "out.urdf"]


def test_what_is_not_changed_stays_byte_for_byte(source, tmp_path):
    """Also where the file has turned frames, parts that are fixed to others, and numbers in other words."""
    source.write_text(
        SOURCE.replace("value = '2.0'", 'value="2.00e0"').replace('name="lower" />', f'name="lower">{LOWER}</link>')
    )
    robot = Robot.from_urdf(source, locked=["wrist"])
    damping = [joint.damping for joint in robot.joints]
    friction = [joint.friction for joint in robot.joints]
    same, other = tmp_path / "same.urdf", tmp_path / "other.urdf"
    write_urdf(robot, robot.parameters, damping, friction, source, same)
    assert same.read_bytes() == source.read_bytes()
    changed = np.array(robot.parameters)
    changed[19] *= 1.0 + 1e-9
    write_urdf(robot, changed, damping, friction, source, other)
    removed, added = changed_lines(source.read_text(), other.read_text())
    assert len(removed) == len(added) == 2
    assert float(added[0].split('"')[7]) == pytest.approx(1.0 + 1.4e-9, rel=1e-14)  # the wrist with its 0.4 kg is apart


def test_line_ends_and_the_byte_order_mark_stay(source, tmp_path):
    source.write_bytes(b"\xef\xbb\xbf" + SOURCE.replace("\n", "\r\n").encode())
    robot = Robot.from_urdf(source)
    target = tmp_path / "out.urdf"
    write_urdf(robot, estimate(robot), np.zeros(3), np.zeros(3), source, target)
    data = target.read_bytes()
    assert data.startswith(b"\xef\xbb\xbf<?xml version='1.0'")
    assert data.count(b"\n") == data.count(b"\r\n")
    assert np.allclose(Robot.from_urdf(target).parameters, estimate(robot), rtol=1e-12)


def test_latin_letters_stay(source, tmp_path):
    source.write_bytes(SOURCE.replace('"utf-8"', '"iso-8859-1"').encode("iso-8859-1"))
    robot = Robot.from_urdf(source)
    target = tmp_path / "out.urdf"
    write_urdf(robot, estimate(robot), np.zeros(3), np.zeros(3), source, target)
    assert "Größe > 1" in target.read_bytes().decode("iso-8859-1")
    assert np.allclose(Robot.from_urdf(target).parameters, estimate(robot), rtol=1e-12)


def test_a_file_without_lines(source, tmp_path):
    flat = SOURCE.replace('ixz="0"\n', 'ixz="0" ')
    source.write_text("".join(line.strip() + " " for line in flat.splitlines()))
    robot = Robot.from_urdf(source)
    target = tmp_path / "out.urdf"
    write_urdf(robot, estimate(robot), np.full(3, 0.5), np.full(3, 0.25), source, target)
    again = Robot.from_urdf(target)
    assert np.allclose(again.parameters, estimate(robot), rtol=1e-12)
    assert [(joint.damping, joint.friction) for joint in again.joints] == [(0.5, 0.25)] * 3
    assert b"\n" not in target.read_bytes()


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), scale=st.sampled_from([1e-4, 1.0, 1e3]))
def test_reading_again_gives_the_same_parameters(source, tmp_path, seed, scale):
    robot = Robot.from_urdf(source)
    generator = np.random.default_rng(seed)
    values = []
    for _ in robot.links:
        # Point masses make a body that exists.
        masses, positions = scale * generator.uniform(0.1, 1.0, 9), generator.uniform(-1.0, 1.0, (9, 3))
        total = Inertia.zero()
        for mass, position in zip(masses, positions, strict=True):
            total = total + Inertia.from_com(mass, position, np.zeros((3, 3)))
        values.append(total.parameters)
    target = tmp_path / "again.urdf"
    write_urdf(robot, np.concatenate(values), np.zeros(3), np.zeros(3), source, target)
    again = Robot.from_urdf(target)
    for link, expected in zip(again.links, values, strict=True):
        assert np.abs(link.inertia.parameters - expected).max() <= 1e-12 * np.abs(expected).max()


def test_locked_links_keep_their_inertia_and_the_total_is_the_estimate(source, tmp_path):
    position = 0.7
    robot = Robot.from_urdf(source, locked={"wrist": position})
    target = tmp_path / "out.urdf"
    write_urdf(robot, estimate(robot), [0.1, 0.2], [0.3, 0.4], source, target)
    assert np.allclose(Robot.from_urdf(target, locked={"wrist": position}).parameters, estimate(robot), rtol=1e-12)
    free = Robot.from_urdf(target)
    assert np.allclose(free.links[2].inertia.parameters, Robot.from_urdf(source).links[2].inertia.parameters)
    assert free.links[1].inertia.mass == pytest.approx(6.0 - 0.4)
    assert (free.joints[2].damping, free.joints[1].damping) == (0.5, 0.2)


def test_links_fixed_to_the_base_do_not_change(source, tmp_path):
    robot = Robot.from_urdf(source)
    target = tmp_path / "out.urdf"
    write_urdf(robot, estimate(robot), np.zeros(3), np.zeros(3), source, target)
    kept = Robot.from_urdf(target).base_attachments[0]
    assert kept.name == "stand"
    assert kept.inertia.mass == 8.0


def test_the_friction_of_a_coordinate_is_written_once(source, tmp_path):
    text = SOURCE.replace(
        '<dynamics damping="0.5"/>', '<dynamics damping="0.5"/><mimic joint="elbow" multiplier="-1"/>'
    )
    source.write_text(text, encoding="utf-8")
    robot = Robot.from_urdf(source)
    target = tmp_path / "out.urdf"
    write_urdf(robot, estimate(robot), [0.1, 0.2], [0.3, 0.4], source, target)
    _, elbow, wrist = Robot.from_urdf(target).joints
    assert (elbow.damping, elbow.friction) == (0.2, 0.4)
    assert wrist.damping == 0.0
    assert np.isnan(wrist.friction)


def test_nan_leaves_friction_as_it_was(source, tmp_path):
    robot = Robot.from_urdf(source)
    target = tmp_path / "out.urdf"
    write_urdf(robot, estimate(robot), np.full(3, np.nan), np.full(3, np.nan), source, target)
    for before, after in zip(robot.joints, Robot.from_urdf(target).joints, strict=True):
        assert np.array_equal([before.damping, before.friction], [after.damping, after.friction], equal_nan=True)
    assert "<dynamics   friction='0.1' />" in target.read_text(encoding="utf-8")


def test_a_massless_estimate_is_refused_and_nothing_is_written(source, tmp_path):
    robot = Robot.from_urdf(source)
    values = estimate(robot)
    values[19] = -0.25
    with pytest.raises(InputError, match=r'link "lower": its mass is -0\.25 kg'):
        write_urdf(robot, values, np.zeros(3), np.zeros(3), source, tmp_path / "out.urdf")
    assert [path.name for path in tmp_path.iterdir()] == ["bench.urdf"]


@pytest.mark.parametrize(
    "lower", [BODY.parameters * 0.1, Inertia.from_com(0.5, (0, 0, 0), np.eye(3) * 1e-3).parameters]
)
def test_a_locked_link_heavier_than_the_estimate_keeps_a_part(source, tmp_path, lower):
    """The hand weighs more than what was identified of it and the link that carries it, or is wider."""
    robot, target = Robot.from_urdf(source, locked={"wrist": 0.7}), tmp_path / "out.urdf"
    values = np.concatenate([BODY.parameters, lower])
    write_urdf(robot, values, np.zeros(2), np.zeros(2), source, target)
    assert np.allclose(Robot.from_urdf(target, locked={"wrist": 0.7}).parameters, values, rtol=1e-12, atol=1e-15)
    before, hand = (Robot.from_urdf(path).links[2].inertia.parameters for path in (source, target))
    share = hand[9] / before[9]
    assert 0.0 < share < 1.0
    assert np.allclose(hand, share * before, rtol=1e-12)
    for link in Robot.from_urdf(target).links:
        assert np.linalg.eigvalsh(link.own_inertia.pseudo_inertia)[0] > 0.0
    assert f"(hand with {share:.2g} of it, for lower)" in remark_on_held(robot, values)
    assert remark_on_held(robot, estimate(robot)) == ""


def test_what_is_no_body_shares_nothing_with_a_locked_link(source, tmp_path):
    robot = Robot.from_urdf(source, locked=["wrist"])
    rod = Inertia.from_com(0.5, (0, 0, 0), np.diag([1e-3, 1e-3, 0.0])).parameters
    with pytest.raises(InputError, match=r'link "lower": without hand, .* a pseudo-inertia with the eigenvalue -'):
        write_urdf(
            robot, np.concatenate([BODY.parameters, rod]), np.zeros(2), np.zeros(2), source, tmp_path / "out.urdf"
        )
    assert remark_on_held(robot, np.concatenate([BODY.parameters, rod])) == ""


@pytest.mark.parametrize(
    ("change", "phrase"),
    [
        ({"parameters": np.zeros(29)}, r"parameters must have shape \(30,\), got \(29,\)"),
        ({"damping": np.zeros(2)}, r"damping must have shape \(3,\), got \(2,\)"),
        ({"friction": [0.0, -1.0, 0.0]}, r'joint "elbow": its friction is -1, but it must be finite and at least 0'),
        ({"parameters": np.full(30, np.nan)}, 'link "upper": its parameters must be finite'),
        ({"target": "no/folder/out.urdf"}, "the folder .*no/folder does not exist"),
        ({"target": "."}, "this is a folder"),
        ({"source": "other.urdf"}, 'it has no link "upper" of robot "bench"'),
        ({"source": "none.urdf"}, r"none\.urdf: cannot be read"),
        ({"target": "bench.urdf"}, "which is never changed"),
        ({"target": "alias.urdf"}, "which is never changed"),
        ({"source": "copy.urdf", "target": "bench.urdf"}, "which is never changed"),
    ],
)
def test_what_cannot_be_written_is_refused(source, tmp_path, change, phrase):
    robot = Robot.from_urdf(source)
    (tmp_path / "other.urdf").write_text('<robot name="other"><link name="base"/></robot>')
    (tmp_path / "copy.urdf").write_bytes(source.read_bytes())
    os.link(source, tmp_path / "alias.urdf")
    arguments = {
        "parameters": estimate(robot),
        "damping": np.zeros(3),
        "friction": np.zeros(3),
        "source": "bench.urdf",
        "target": "out.urdf",
    } | change
    arguments |= {key: tmp_path / arguments[key] for key in ("source", "target")}
    with pytest.raises(InputError, match=phrase):
        write_urdf(robot, **arguments)
    assert source.read_bytes() == SOURCE.encode()
    assert not (tmp_path / "out.urdf").exists()


def test_utf16_is_refused(source, tmp_path):
    source.write_bytes(SOURCE.replace('"utf-8"', '"utf-16"').encode("utf-16"))
    robot = Robot.from_urdf(source)
    with pytest.raises(InputError, match="UTF-16 and UTF-32 files cannot be edited in place"):
        write_urdf(robot, estimate(robot), np.zeros(3), np.zeros(3), source, tmp_path / "out.urdf")


EXTENDED = """<robot name="r"><link name="a"/>
  <link name="b"><inertial><origin xyz="0 0 0.1" rpy="0.1 0 0"/><mass value="1e0"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <link name="c"><inertial><mass value="0.5"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <joint name="j &amp; k" type="revolute"><parent link="a"/><child link="b"/><dynamics damping="0.50"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="f" type="fixed"><parent link="b"/><child link="c"/></joint>
  <gazebo reference="j &amp; k"><damping> 0.5 </damping><mu1>0.2</mu1>
    <axis><dynamics><friction/></dynamics></axis></gazebo>
  <gazebo reference="b"><damping>7</damping><mu1>0.2</mu1></gazebo>
  <ros2_control name="x"><joint name="j &amp; k"><param name="friction">1</param><param name="max">2</param></joint>
  </ros2_control>
</robot>
"""


def test_without_changes_a_copy_is_the_same_byte_for_byte(tmp_path):
    source, target = tmp_path / "r.urdf", tmp_path / "same.urdf"
    for text in (EXTENDED, EXTENDED.replace("\n", "\r\n")):
        source.write_bytes(text.encode())
        robot = Robot.from_urdf(source)
        write_urdf(robot, robot.parameters, [np.nan], [np.nan], source, target)
        assert target.read_bytes() == source.read_bytes()


def test_what_the_format_has_no_place_for_stands_in_an_extension(tmp_path):
    source, target = tmp_path / "r.urdf", tmp_path / "weighed.urdf"
    source.write_text(EXTENDED)
    robot = Robot.from_urdf(source)
    changed = [[0.75], [0.25]]
    write_urdf(robot, robot.parameters, *changed, source, target, rotor_inertia=[0.125], offset=[-2.0])
    text = target.read_text()
    assert '<dynamics damping="0.75" friction="0.25"/>' in text
    assert "<damping> 0.75 </damping><mu1>0.2</mu1>" in text
    assert "<friction>0.25</friction>" in text
    assert '<gazebo reference="b"><damping>7</damping>' in text  # of the link's speed through the air
    assert '<param name="friction">0.25</param><param name="max">2</param>' in text
    assert '<steelyard:joint name="j &amp; k" rotor_inertia="0.125" offset="-2.0"/>' in text
    again = Robot.from_urdf(target)
    assert again.joints[0].rotor_inertia == 0.125
    third = tmp_path / "third.urdf"
    write_urdf(again, again.parameters, *changed, target, third, rotor_inertia=[0.5], offset=[np.nan])
    assert third.read_text().count("<steelyard:") == 2
    with pytest.raises(InputError, match="its rotor inertia is -1"):
        write_urdf(robot, robot.parameters, *changed, source, target, rotor_inertia=[-1.0])


CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.mark.parametrize("compiler", ['strippath="false"', 'meshdir="../me&amp;shes ü"'])
def test_mujoco_finds_meshes_from_another_folder(tmp_path, compiler):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    folder, meshes = tmp_path / "arm", tmp_path / "me&shes ü"
    folder.mkdir()
    meshes.mkdir()
    (meshes / "hand.obj").write_text(CORNERS)
    shape = '<visual><geometry><mesh filename="../me&amp;shes ü/hand.obj"/></geometry></visual>'
    missing = '<texture filename=""/><texture filename="missing.png"/>'
    text = EXTENDED.replace('<link name="b">', f'<link name="b">{shape}').replace("<gazebo", f"{missing}<gazebo", 1)
    text = text.replace(
        '<robot name="r">', f'<robot name="r"><mujoco><compiler {compiler} discardvisual="false"/></mujoco>'
    )
    source, target = folder / "r.urdf", tmp_path / "weighed.urdf"
    source.write_text(text, encoding="utf-8")
    assert mujoco.MjModel.from_xml_path(str(source)).nmesh == 1
    robot = Robot.from_urdf(source)
    write_urdf(robot, robot.parameters, [0.75], [0.25], source, target)
    assert mujoco.MjModel.from_xml_path(str(target)).nmesh == 1
    assert missing in target.read_text()
    beside = folder / "weighed.urdf"
    write_urdf(robot, robot.parameters, [0.75], [0.25], source, beside)
    assert shape in beside.read_text(encoding="utf-8")


def test_other_programs_pass_over_the_extension(tmp_path):
    pinocchio = pytest.importorskip("pinocchio", reason="Pinocchio is not installed")
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    source, target = tmp_path / "r.urdf", tmp_path / "weighed.urdf"
    source.write_text(EXTENDED)
    robot = Robot.from_urdf(source)
    parameters = robot.parameters * 1.25
    write_urdf(robot, parameters, [0.75], [0.25], source, target, rotor_inertia=[0.125], offset=[-2.0])
    model = pinocchio.buildModelFromUrdf(str(target))
    assert model.inertias[1].mass == pytest.approx(parameters[9], rel=1e-12)
    assert mujoco.MjModel.from_xml_path(str(target)).nv == 1
