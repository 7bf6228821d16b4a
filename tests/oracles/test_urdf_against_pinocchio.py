"""The URDF reader against Pinocchio, on the robots of the package example-robot-data."""

import sysconfig
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.robot import Robot

pinocchio = pytest.importorskip("pinocchio", reason="Pinocchio (pip install pin) is not installed")

ROBOTS = Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"
FAST = (
    "asr_twodof_description/urdf/TwoDofs.urdf",
    "baxter_description/urdf/baxter.urdf",
    "bolt_description/robots/bolt.urdf",
    "double_pendulum_description/urdf/double_pendulum_continuous.urdf",
    "hyq_description/robots/hyq_no_sensors.urdf",
    "kinova_description/robots/kinova.urdf",
    "panda_description/urdf/panda.urdf",
    "pr2_description/urdf/pr2.urdf",
    "simple_humanoid_description/urdf/simple_humanoid.urdf",
    "talos_data/robots/talos_left_arm.urdf",
    "tiago_description/robots/tiago_no_hand.urdf",
    "ur_description/urdf/ur5_robot.urdf",
    "xarm_description/urdf/xarm7.urdf",
)
# What cannot be weighed, and the words that say why.
REFUSED = {
    "alex_description/urdf/alex_psyonic_hands.urdf": "mimics the unknown joint",
    "hector_description/robots/quadrotor_base.urdf": "no joint moves",
    "iris_description/robots/iris_simple.urdf": "no joint moves",
    "ur_description/urdf/ur3.urdf": "no <link>",
}

# Pinocchio cannot read these with mimic joints, because it meets some before the joint that drives them; there they are
# read as free joints and given the values that the file's <mimic> elements ask for.
MIMICS_BEFORE_DRIVER = (
    "romeo_description/urdf/romeo.urdf",
    "talos_data/robots/talos_full_v2.urdf",
    "talos_data/robots/talos_full_v2_box.urdf",
)


def found(names=None) -> list[str]:
    if not ROBOTS.is_dir():
        return []
    return sorted(
        name
        for name in (path.relative_to(ROBOTS).as_posix() for path in ROBOTS.rglob("*.urdf"))
        if name not in REFUSED and (names is None or name in names)
    )


def random_coordinates(robot: Robot, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-2.0, 2.0, robot.dof)


def link_placements(robot: Robot, q: np.ndarray) -> dict[str, np.ndarray]:
    """Placement of each link of the source in the root link, from nothing but the parts of the joints."""
    placements = {robot.base_link: np.eye(4)}
    moving: list[np.ndarray] = []
    for joint, link in zip(robot.joints, robot.links, strict=True):
        value = joint.multiplier * q[joint.coordinate] + joint.offset
        motion = np.eye(4)
        if joint.kind == "prismatic":
            motion[2, 3] = value
        else:
            motion[:2, :2] = [[np.cos(value), -np.sin(value)], [np.sin(value), np.cos(value)]]
        parent = np.eye(4) if joint.parent == -1 else moving[joint.parent]
        moving.append(parent @ joint.before @ motion @ joint.after)
        placements[link.name] = moving[-1]
        for attachment in link.attachments:
            placements[attachment.name] = moving[-1] @ attachment.placement
    for attachment in robot.base_attachments:
        placements[attachment.name] = attachment.placement
    return placements


def mimics(path: Path) -> dict[str, tuple[str, float, float]]:
    """Name of each mimic joint -> the joint that it mimics, multiplier, offset."""
    found = {}
    for joint in ElementTree.parse(path).getroot().iterfind("joint"):
        tag = joint.find("mimic")
        if tag is not None:
            found[joint.get("name")] = (
                tag.get("joint"),
                float(tag.get("multiplier", "1")),
                float(tag.get("offset", "0")),
            )
    return found


def configuration(model, robot: Robot, q: np.ndarray, followers: dict[str, tuple[str, float, float]]) -> np.ndarray:
    """The same configuration in the coordinates of Pinocchio."""
    result = pinocchio.neutral(model)
    values = dict(zip(robot.joint_names, q, strict=True))
    values |= {name: factor * values[driver] + offset for name, (driver, factor, offset) in followers.items()}
    for name, value in values.items():
        joint = model.joints[model.getJointId(name)]
        result[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
    return result


def compare(robot: Robot, model, followers=None, absent=()) -> None:
    data = model.createData()
    assert sorted(robot.joint_names) == sorted(
        model.names[index]
        for index in range(1, model.njoints)
        if not model.joints[index].shortname().startswith("JointModelMimic")
        and model.names[index] not in (followers or {})
    )
    for seed in range(3):
        q = random_coordinates(robot, seed)
        pinocchio.framesForwardKinematics(model, data, configuration(model, robot, q, followers or {}))
        for name, placement in link_placements(robot, q).items():
            if name in absent:
                continue
            assert model.existFrame(name, pinocchio.FrameType.BODY), name
            frame = model.getFrameId(name, pinocchio.FrameType.BODY)
            assert np.allclose(data.oMf[frame].homogeneous, placement, rtol=0, atol=1e-9), name
    for joint, link in zip(robot.joints, robot.links, strict=True):
        # Pinocchio keeps a body's inertia in the frame of its joint, which in a URDF is the frame of the child link.
        expected = model.inertias[model.getJointId(joint.name)]
        com = expected.lever
        assert link.inertia.mass == pytest.approx(expected.mass, rel=1e-12, abs=1e-15)
        assert np.allclose(link.inertia.first_moment, expected.mass * com, rtol=1e-9, atol=1e-12)
        cross = np.array([[0, -com[2], com[1]], [com[2], 0, -com[0]], [-com[1], com[0], 0]])
        about_origin = expected.inertia - expected.mass * cross @ cross
        assert np.allclose(link.inertia.about_origin, about_origin, rtol=1e-9, atol=1e-12 + 1e-9 * expected.mass)


def check(name: str) -> None:
    path = ROBOTS / name
    robot = Robot.from_urdf(path)
    if name in MIMICS_BEFORE_DRIVER:
        compare(robot, pinocchio.buildModelFromUrdf(str(path), mimic=False), followers=mimics(path))
    else:
        compare(robot, pinocchio.buildModelFromUrdf(str(path), mimic=True))


@pytest.mark.parametrize("name", found(FAST))
def test_kinematics_and_inertia_agree(name):
    check(name)


@pytest.mark.slow
@pytest.mark.parametrize("name", found())
def test_kinematics_and_inertia_agree_on_the_whole_collection(name):
    check(name)


@pytest.mark.parametrize(("name", "reason"), REFUSED.items())
def test_the_rest_is_refused_with_a_reason(name, reason):
    if not ROBOTS.is_dir():
        pytest.skip("example-robot-data is not installed")
    with pytest.raises(InputError, match=reason):
        Robot.from_urdf(ROBOTS / name)


@pytest.mark.parametrize(
    ("name", "locked"),
    [
        ("kinova_description/robots/kinova.urdf", {"j2s6s200_joint_2": 0.7, "j2s6s200_joint_6": -1.1}),
        ("tiago_description/robots/tiago_no_hand.urdf", {"torso_lift_joint": 0.2, "head_1_joint": 0.4}),
        ("bolt_description/robots/bolt.urdf", {"FL_HAA": 0.3}),
    ],
)
def test_locked_joints_agree_with_a_reduced_model(name, locked):
    path = ROBOTS / name
    if not path.exists():
        pytest.skip("example-robot-data is not installed")
    whole = pinocchio.buildModelFromUrdf(str(path))
    at = pinocchio.neutral(whole)
    for joint_name, value in locked.items():
        joint = whole.joints[whole.getJointId(joint_name)]
        at[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
    reduced = pinocchio.buildReducedModel(whole, [whole.getJointId(joint_name) for joint_name in locked], at)
    compare(Robot.from_urdf(path, locked=locked), reduced)


def test_a_floating_base_locked_is_a_fixed_base(tmp_path):
    path = ROBOTS / "bolt_description/robots/bolt.urdf"
    if not path.exists():
        pytest.skip("example-robot-data is not installed")
    text = path.read_text()
    ending = (
        '<link name="ground"/>'
        '<joint name="free" type="floating"><parent link="ground"/><child link="base_link"/></joint>'
    )
    floating = tmp_path / "floating.urdf"
    floating.write_text(text.replace("</robot>", ending + "</robot>"))
    with pytest.raises(InputError, match=r'"free" is of type "floating".*lock it'):
        Robot.from_urdf(floating)
    robot = Robot.from_urdf(floating, locked=["free"])
    assert robot.base_link == "ground"
    compare(robot, pinocchio.buildModelFromUrdf(str(path)), absent=("ground",))
