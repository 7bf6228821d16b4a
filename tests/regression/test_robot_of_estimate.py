"""An estimate belongs to the geometry that it was identified with: its inertias stand in the frames of that."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import steelyard as sy
from steelyard.identification.saved import matching_estimate

LINK = """<link name="{0}"><inertial><origin xyz="0.1 0.02 0.03"/><mass value="2"/>
  <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.04"/></inertial></link>"""
URDF = f"""<robot name="pair"><link name="world"/>{LINK.format("upper")}{LINK.format("fore")}
  <joint name="shoulder" type="revolute"><parent link="world"/><child link="upper"/><origin xyz="0 0 0.3"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="5"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.4 0 0" rpy="0 0 0"/>
    <axis xyz="1 0 0"/><limit lower="-3" upper="3" effort="50" velocity="5"/></joint></robot>"""
BODY = '<inertial pos="0.1 0.02 0.03" mass="2" diaginertia="0.02 0.03 0.04"/>'
MJCF = f"""<mujoco model="pair"><compiler angle="radian"/><worldbody><body name="upper" pos="0 0 0.3">{BODY}
  <joint name="shoulder" axis="0 1 0"/><body name="fore" pos="0.4 0 0">{BODY}<joint name="elbow" axis="1 0 0"/></body>
  </body></worldbody></mujoco>"""


def identified(path: Path) -> sy.Estimate:
    """The estimate of least squares among possible robots, of torques of the description itself."""
    model = sy.Model(read(path))
    motion = np.random.default_rng(0).uniform(-2.0, 2.0, (3, 60, 2))
    torque = model.inverse_dynamics(*motion, np.nan_to_num(model.robot.parameters))
    samples = sy.Samples(*motion, torque)
    return sy.fit(sy.Information.from_samples(model, samples), sy.FeasibleSet(model))


def read(path: Path) -> sy.Robot:
    return sy.Robot.from_urdf(path) if path.suffix == ".urdf" else sy.Robot.from_mjcf(path)


def write(estimate: sy.Estimate, source: Path, target: Path) -> None:
    (estimate.write_urdf if source.suffix == ".urdf" else estimate.write_description)(source, target)


@pytest.mark.parametrize(
    ("suffix", "text", "before", "after", "joint"),
    [
        ("urdf", URDF, 'xyz="1 0 0"', 'xyz="-1 0 0"', "elbow"),  # its base parameters have the same names
        ("urdf", URDF, 'xyz="0 1 0"', 'xyz="0 0 1"', "shoulder"),
        ("urdf", URDF, 'xyz="0.4 0 0"', 'xyz="0.45 0 0"', "elbow"),
        ("urdf", URDF, 'rpy="0 0 0"', 'rpy="1.57 0 0"', "elbow"),
        ("urdf", URDF, '"elbow" type="revolute"', '"elbow" type="prismatic"', "elbow"),
        ("urdf", URDF, 'xyz="0 0 0.3"', 'xyz="0 1 0.3" rpy="0 0 1"', ""),  # the robot stands elsewhere
        ("urdf", URDF, 'xyz="0.4 0 0"', 'xyz="0.400001 0 0"', ""),
        ("xml", MJCF, 'axis="1 0 0"', 'axis="-1 0 0"', "elbow"),
        ("xml", MJCF, 'pos="0.4 0 0"', 'pos="0.45 0 0"', "elbow"),
        ("xml", MJCF, 'pos="0 0 0.3"', 'pos="0 0 0.5"', ""),
    ],
)
def test_a_description_of_another_geometry_is_refused(
    suffix: str, text: str, before: str, after: str, joint: str, tmp_path: Path
) -> None:
    own, other, target = (tmp_path / f"{name}.{suffix}" for name in ("own", "other", "target"))
    own.write_text(text)
    assert before in text
    other.write_text(text.replace(before, after))
    identified(own).save(tmp_path / "estimate.json")
    estimate = sy.Estimate.load(tmp_path / "estimate.json")
    write(estimate, own, target)
    if not joint:
        write(estimate, other, target)
        np.testing.assert_allclose(read(target).parameters, np.asarray(estimate), rtol=1e-9, atol=1e-9)
        return
    target.unlink()
    with pytest.raises(sy.InputError, match=f"origin, axis or motion of the joint '{joint}' is another"):
        write(estimate, other, target)
    assert not target.exists()


def test_what_reads_robot_and_estimate_refuses_it_too(tmp_path: Path) -> None:
    own, other = tmp_path / "own.urdf", tmp_path / "other.urdf"
    own.write_text(URDF)
    other.write_text(URDF.replace('xyz="1 0 0"', 'xyz="-1 0 0"'))
    estimate = identified(own)
    estimate.save(tmp_path / "estimate.json")
    matching_estimate(sy.Model(read(own)), tmp_path / "estimate.json")
    with pytest.raises(sy.InputError, match="of the joint 'elbow' is another"):
        matching_estimate(sy.Model(read(other)), tmp_path / "estimate.json")
    # Estimates that were saved before do not tell where joints are; what is damaged is refused.
    write(replace(estimate, description={}), other, tmp_path / "target.urdf")
    several: tuple[Any, ...] = (3, [1, 2], [{}, {}], [{"name": "shoulder"}], "pair")
    for damaged in several:
        with pytest.raises(sy.InputError, match="damaged"):
            write(replace(estimate, description={"joints": damaged}), own, tmp_path / "target.urdf")
