"""Small valid files of every kind that is read, and damaged copies of them: what readers are tried on."""

from __future__ import annotations

import bz2
import copy
import gzip
import hashlib
import json
import lzma
import math
import random
import re
import shutil
import struct
from collections.abc import Callable, Iterable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from log_writers import BAGS, states, write_ros2
from scipy.io import savemat

import steelyard as sy
from steelyard.collision import geometry_from_dict
from steelyard.collision.mesh_files import read_meshes
from steelyard.collision.self_collision import read_srdf
from steelyard.conic import SemidefiniteProgram
from steelyard.dynamics.terms import term_from_dict
from steelyard.errors import InputError
from steelyard.excitation import MotionLimits, QuinticTrajectory, load_trajectory, save_trajectory
from steelyard.excitation.motion_limits import limits_from_file
from steelyard.feasibility import load_certificate, verify_document
from steelyard.feasibility.constraints import constraints_from_dict
from steelyard.feasibility.constraints.center_of_mass import read_points
from steelyard.fleet import FleetManifest
from steelyard.fleet.packed import is_whole, packed, unpacked
from steelyard.identification.saved_result import SavedResult
from steelyard.recording import LogColumns, Processing, process_chunks
from steelyard.regression.least_squares import least_squares
from steelyard.robot import RobotFile

LARGEST = 1e40
"""No number that was read may be larger: squares and their sums must stay finite."""

URDF = """<?xml version="1.0"?>
<robot name="pair">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.1 0 0" rpy="0 0 0.1"/><mass value="2"/>
    <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
  <link name="fore"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>
    <collision><origin xyz="0 0 0.1"/><geometry><box size="0.1 0.1 0.2"/></geometry></collision></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="50" velocity="5"/><dynamics damping="0.1" friction="0.2"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.4 0 0" rpy="0 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="5"/></joint>
</robot>
"""
XACRO = (
    URDF.replace(
        '<robot name="pair">',
        """<robot name="pair" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="length" default="0.4"/><xacro:property name="mass" value="${2 * 0.5}"/>
  <xacro:macro name="body" params="m:=1 *block"><mass value="${m}"/></xacro:macro>""",
    )
    .replace('<mass value="1"/>', '<mass value="${mass}"/>')
    .replace('xyz="0.4 0 0"', 'xyz="$(arg length) 0 ${0.1 * sin(pi)}"')
)
MJCF = """<mujoco model="pair">
  <compiler angle="degree" autolimits="true" eulerseq="xyz"/>
  <option gravity="0 0 -9.8"/>
  <default><joint damping="0.5"/><default class="fore"><joint armature="0.02" range="-90 45"/></default></default>
  <worldbody>
    <body name="upper" pos="0 0 1">
      <inertial pos="0.1 0 0" mass="2" fullinertia="0.2 0.3 0.25 0.01 0.02 0.03"/>
      <joint name="shoulder" axis="0 1 0"/>
      <body name="fore" pos="0.5 0 0" euler="0 90 0">
        <joint name="elbow" class="fore" axis="0 0 1"/>
        <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.05" density="500"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="elbow" gear="50"/></actuator>
</mujoco>
"""
SDF = """<?xml version="1.0"?>
<sdf version="1.9"><model name="pair">
  <link name="base"/>
  <link name="upper"><pose>0 0 1 0 0 0</pose><inertial><pose>0.1 0 0 0 0 0.1</pose><mass>2</mass>
    <inertia><ixx>0.02</ixx><ixy>0</ixy><ixz>0</ixz><iyy>0.02</iyy><iyz>0</iyz><izz>0.02</izz></inertia></inertial></link>
  <link name="fore"><pose relative_to="elbow">0 0 0 0 0 0</pose><inertial><mass>1</mass></inertial>
    <collision name="c"><geometry><box><size>0.1 0.1 0.2</size></box></geometry></collision></link>
  <joint name="fix" type="fixed"><parent>world</parent><child>base</child></joint>
  <joint name="shoulder" type="revolute"><parent>base</parent><child>upper</child>
    <axis><xyz>0 1 0</xyz><limit><lower>-3</lower><upper>3</upper><effort>50</effort></limit>
    <dynamics><damping>0.1</damping><friction>0.2</friction></dynamics></axis></joint>
  <joint name="elbow" type="revolute"><pose relative_to="upper">0.4 0 0 0 0 0</pose><parent>upper</parent>
    <child>fore</child><axis><xyz expressed_in="base">0 1 0</xyz></axis></joint>
</model></sdf>
"""
ROBOT = """name = "pair"
[description]
convention = "standard"
rows = [["pi/2", 0, 0.3, "q"], [0, 0.5, 0, "q+pi/2"]]
gravity = [0, 0, -9.81]
[[terms]]
kind = "viscous"
[[terms]]
kind = "motor_side"
coupling = [[1, 0.5], [0, 1]]
[log]
time = "t"
position = ["q1", "q2"]
torque = "tau{}"
torque_unit = "A"
gain = [10, 10]
position_matrix = [["1/45", 0], [0, 1]]
position_offset = [0, "-pi/2"]
[processing]
cutoff = 10.0
trim = 0.5
decimate = [2]
velocity_threshold = 0.01
[limits]
lower = -3
upper = [3, 3]
velocity = 5
[constraints]
total_mass = { maximum = 10 }
[[constraints.center_of_mass_box]]
link = "link1"
lower = [-1, -1, -1]
upper = [1, 1, 1]
[[constraints.center_of_mass_hull]]
link = "link2"
points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
"""
MANIFEST = """name = "two arms"
robot = "robot.urdf"
false_discovery_rate = 0.1
intervals = "base"
[[robots]]
id = "A-17"
group = "line 3"
date = 2026-03-01
informations = ["information.json"]
[[robots]]
id = "A-18"
date = 2026-03-02
logs = ["log*.csv"]
validate = ["log.npz"]
"""
ROBOTS = """id,group,robot,informations,logs,date
1,a,robot.urdf,information.json;information.json,,2026-01-01
2,a,robot.urdf,,log.csv,2026-01-01T10:00:00
3,b,robot.urdf,information.json,,2026-01-02
"""
LIMITS = """lower = [-1, -1]
upper = 1
velocity = { shoulder = 2, elbow = 3 }
acceleration = 5
torque = [50, 50]
total_power = 100
[collision]
self = false
margin = 0.01
exclude = [["upper", "fore"]]
[[collision.shapes]]
link = "fore"
type = "capsule"
radius = 0.05
length = 0.2
[[obstacles]]
name = "box"
type = "box"
size = [0.1, 0.1, 0.1]
xyz = [1, 1, 1]
[table]
normal = [0, 0, 1]
offset = -1
[[workspace]]
link = "fore"
lower = [-5, -5, -5]
upper = [5, 5, inf]
"""
SRDF = """<robot name="pair"><disable_collisions link1="base" link2="upper" reason="Adjacent"/>
<disable_default_collisions link="fore"/><enable_collisions link1="fore" link2="base"/></robot>
"""
OBJ = """o body
v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""
PROGRAM = """* variable 1: "x"
2
2
3 -2
1 2.5
0 1 1 1 1
1 1 1 2 0.5
1 1 2 2 -1
2 1 3 3 1e-3
2 2 1 1 1
2 2 2 2 -1
"""
PLY = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 4
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
0 0 1
3 0 2 1
3 0 1 3
3 0 3 2
3 1 2 3
"""
DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="meter" meter="1"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="a" count="12">0 0 0 1 0 0 0 1 0 0 0 1</float_array>
<technique_common><accessor source="#a" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/><p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>
"""


MESSAGES = ("ros1.bag", "ros1_bz2.bag", "ros1_lz4.bag", "json.mcap", "protobuf.mcap", "cdr.mcap", "without_chunks.mcap")
COMPRESSED = {"messages.db3": "MESSAGE", "file.db3.zstd": "FILE"}
"""Files of bags of ROS 2 that are compressed, and how."""
LIBRARIES: dict[str, tuple[str, ...]] = {
    "robot.xacro": ("xacro",),
    "log.csv.zst": ("backports.zstd",),
    **dict.fromkeys(("log.h5", "new.mat"), ("h5py",)),
    **dict.fromkeys((*MESSAGES, *COMPRESSED, "bag.db3", "metadata.yaml"), ("rosbags", "mcap", "mcap_protobuf")),
}
"""What files of a kind are read and written with, beyond what is always there."""
MESHES = {"mesh.stl", "mesh.obj", "mesh.ply", "binary.ply", "mesh.dae"}
TAKES_LONG = MESHES | {"log.mat", "robot.xacro", "bag.db3", "metadata.yaml", *COMPRESSED}
"""Kinds whose files are read by a process each, or as slowly."""


def _motion(count: int = 400) -> dict[str, np.ndarray]:
    t = np.arange(count) / 100
    q = np.column_stack([np.sin(3 * t), np.cos(2 * t)])
    torque = np.column_stack([np.cos(3 * t), np.sin(5 * t)])
    return {"t": t, "q": q, "tau": torque}


def _flat(arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    columns = {}
    for name, values in arrays.items():
        columns |= {name: values} if values.ndim == 1 else {f"{name}{k + 1}": values[:, k] for k in range(2)}
    return columns


def _binary_stl() -> bytes:
    corners = np.vstack([np.zeros(3), np.eye(3)]).astype("<f4")
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    return bytes(80) + struct.pack("<I", 4) + b"".join(bytes(12) + corners[list(f)].tobytes() + b"\0\0" for f in faces)


def _binary_ply() -> bytes:
    head, _, _ = PLY.partition("0 0 0\n")
    corners = np.vstack([np.zeros(3), np.eye(3)]).astype("<f4")
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    body = corners.tobytes() + b"".join(struct.pack("<B3i", 3, *f) for f in faces)
    return head.replace("ascii", "binary_little_endian").encode() + body


def write_samples(folder: Path) -> dict[str, Path]:
    """Write a valid file of each kind; return the kinds and the files."""
    import polars

    folder.mkdir(exist_ok=True)
    texts = {"robot.urdf": URDF, "robot.toml": ROBOT, "limits.toml": LIMITS, "robot.srdf": SRDF, "mesh.obj": OBJ}
    texts |= {"robot.xacro": XACRO, "robot.mjcf": MJCF, "robot.sdf": SDF, "program.dat-s": PROGRAM}
    texts |= {"fleet.toml": MANIFEST, "robots.csv": ROBOTS}
    texts |= {"mesh.ply": PLY, "mesh.dae": DAE, "points.csv": "x,y,z\n0,0,0\n1,0,0\n0,1,0\n0,0,1\n"}
    for name, text in texts.items():
        (folder / name).write_text(text)
    (folder / "mesh.stl").write_bytes(_binary_stl())
    (folder / "binary.ply").write_bytes(_binary_ply())
    np.save(folder / "points.npy", np.vstack([np.zeros(3), np.eye(3)]))
    arrays = _motion()
    np.savez(folder / "log.npz", **arrays)
    np.savez_compressed(folder / "small.npz", **_flat(arrays))
    frame = polars.DataFrame(_flat(arrays))
    frame.write_csv(folder / "log.csv")
    frame.write_parquet(folder / "log.parquet")
    trajectory = QuinticTrajectory.point_to_point([[0.0, 0.0], [1.0, 0.5], [0.0, 0.0]], [1.0, 1.0])
    frame.write_ipc(folder / "log.feather")
    _write_other_logs(folder, arrays)
    for suffix in ("json", "csv", "parquet", "yaml"):
        save_trajectory(trajectory, folder / f"trajectory.{suffix}", rate=50.0)
    robot = sy.Robot.from_urdf(folder / "robot.urdf").with_terms(sy.Viscous())
    model = sy.Model(robot)
    rng = np.random.default_rng(1)
    q, dq, ddq = (rng.normal(size=(60, 2)) for _ in range(3))
    parameters = np.nan_to_num(np.asarray(robot.parameters))
    torque = model.inverse_dynamics(q, dq, ddq, parameters) + rng.normal(0, 0.01, (60, 2))
    information = sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque), batch_means=False)
    information.save(folder / "information.json")
    (folder / "reduced.checkpoint").write_bytes(packed({"information": information, "names": ("a", None), "count": 3}))
    estimate = sy.fit(information, sy.FeasibleSet(model))
    estimate.save(folder / "estimate.json")
    verdict = sy.check(sy.FeasibleSet(model), base=-estimate.base)
    verdict.certificate.save(folder / "certificate.json")
    entry = {"path": "robot.urdf", "sha256": "0" * 64}
    options = {"processing": {}, "decided": {}}
    record = {"format": "steelyard-run-1", "robot": [entry], "logs": [[entry]], "options": options}
    (folder / "run.json").write_text(json.dumps(record))
    return {path.name: path for path in sorted(folder.iterdir())}


def is_readable(kind: str) -> bool:
    """Whether the libraries are installed that read and write files of this kind."""
    try:
        return all(find_spec(name) is not None for name in LIBRARIES.get(kind, ()))
    except ModuleNotFoundError:  # the package within which it would be
        return False


def _write_other_logs(folder: Path, arrays: dict[str, np.ndarray]) -> None:
    for suffix, library in (("gz", gzip), ("bz2", bz2), ("xz", lzma)):
        (folder / f"log.csv.{suffix}").write_bytes(library.compress((folder / "log.csv").read_bytes()))
    savemat(folder / "log.mat", _flat(arrays), do_compression=True)
    if is_readable("log.csv.zst"):
        from backports import zstd

        (folder / "log.csv.zst").write_bytes(zstd.compress((folder / "log.csv").read_bytes()))
    if is_readable("log.h5"):
        import h5py

        with h5py.File(folder / "log.h5", "w") as file:
            for name, values in _flat(arrays).items():
                file.create_dataset(name, data=values, compression="gzip")
        # As MATLAB writes its newer files: HDF5 behind a block of its own, arrays the other way round.
        with h5py.File(folder / "new.mat", "w", userblock_size=512) as file:
            for name, values in arrays.items():
                file.create_dataset(name, data=np.atleast_2d(values.T)).attrs["MATLAB_class"] = np.bytes_("double")
        with (folder / "new.mat").open("r+b") as new:
            new.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    messages = {"/joint_states": states(arrays["t"], ["shoulder", "elbow"], arrays["q"], None, arrays["tau"])}
    for name in filter(is_readable, MESSAGES):
        BAGS[name](folder / name, messages)
    if is_readable("bag.db3"):
        bag = write_ros2(folder / "bag", messages)
        (folder / "bag.db3").write_bytes((bag / "bag.db3").read_bytes())
        (folder / "metadata.yaml").write_bytes((bag / "metadata.yaml").read_bytes())
        shutil.rmtree(bag)
    for name in filter(is_readable, COMPRESSED):
        bag = write_ros2(folder / name.partition(".")[0], messages, compression=COMPRESSED[name])
        (folder / name).write_bytes((bag / name).read_bytes())
        (folder / f"{name}.yaml").write_bytes((bag / "metadata.yaml").read_bytes())
        shutil.rmtree(bag)


# What reads a file, and all that comes of it: numbers that must be finite.


def _finite(values: Iterable[Any], unknown: bool = False) -> None:
    for value in values:
        if value is None:
            continue
        array = np.asarray(value, dtype=np.float64)
        bad = np.isinf(array) | (np.abs(array) > LARGEST) if unknown else ~(np.abs(array) <= LARGEST)
        assert not bad.any(), f"accepted {array[bad][:3]}"


def _robot(robot: sy.Robot) -> None:
    _finite([robot.parameters], unknown=True)
    for joint in robot.joints:
        _finite([joint.before, joint.after, joint.multiplier, joint.offset])
        _finite([joint.damping, joint.friction], unknown=True)
        assert not any(map(math.isnan, (joint.lower, joint.upper, joint.velocity_limit, joint.effort_limit)))


def _read_urdf(path: Path) -> None:
    robot = sy.Robot.from_urdf(path)
    _robot(robot)
    for link in robot.links:
        if link.inertia is not None:
            _finite([link.inertia.pseudo_inertia])


def _read_xacro(path: Path) -> None:
    robot = sy.Robot.from_urdf(path, xacro_arguments={"length": "0.3"})
    _robot(robot)


def _read_described(path: Path) -> None:
    robot = RobotFile.load(path).robot
    _robot(robot)
    for link in robot.links:
        if link.inertia is not None:
            _finite([link.inertia.pseudo_inertia])


def _read_robot_file(path: Path) -> None:
    file = RobotFile.load(path)
    _robot(file.robot.with_terms(*(term_from_dict(term) for term in file.terms)))
    LogColumns.from_dict(file.section("log"), "[log]")
    Processing.from_dict(file.section("processing"), "[processing]")
    constraints_from_dict(file.section("constraints"), folder=path.parent)


def _read_limits(path: Path) -> None:
    robot = sy.Robot.from_urdf(path.parent / "robot.urdf")
    limits, sections = limits_from_file(path)
    MotionLimits.from_robot(robot).updated(limits)
    geometry_from_dict(sections, robot, path.parent)


def _read_log(path: Path) -> None:
    recording = sy.Recording.read(path, {}, 2)
    _finite([recording.t, recording.q, recording.torque])
    for samples in process_chunks(path, {}, Processing(cutoff=10.0), rows=100, joints=2):
        _finite([samples.q, samples.dq, samples.ddq, samples.torque])


def _read_bag(path: Path) -> None:
    """Read the file as a part of a bag whose other file is sound."""
    bag = path.parent / "damaged-bag"
    bag.mkdir(exist_ok=True)
    for name in ("bag.db3", "metadata.yaml"):
        source = path if path.name.endswith(name) else path.parent / name
        (bag / name).write_bytes(source.read_bytes())
    _read_log(bag)


def _read_compressed_bag(path: Path) -> None:
    """Read the file as that of a bag whose description is sound."""
    (name,) = (name for name in COMPRESSED if path.name.endswith(name))
    bag = path.parent / f"damaged-{name}-bag"
    bag.mkdir(exist_ok=True)
    (bag / name).write_bytes(path.read_bytes())
    (bag / "metadata.yaml").write_bytes((path.parent / f"{name}.yaml").read_bytes())
    _read_log(bag)


def _read_saved(path: Path) -> None:
    """Read the file as the record beside a sound estimate."""
    place = path.parent / "damaged-result"
    place.mkdir(exist_ok=True)
    (place / "estimate.json").write_bytes((path.parent / "estimate.json").read_bytes())
    (place / "run.json").write_bytes(path.read_bytes())
    _ = repr(SavedResult.load(place).record)


def _read_fleet(path: Path) -> None:
    for entry in FleetManifest.load(path).entries:
        _ = entry.label, [entry.files(key) for key in ("informations", "logs", "validate")]


def _read_packed(path: Path) -> None:
    data = path.read_bytes()
    if is_whole(data):
        unpacked(data)


def _read_forged(path: Path) -> None:
    """Read the file as if its hash were right."""
    mark, _, content = path.read_bytes().partition(b"\n")
    unpacked(b"".join([mark, b"\n", hashlib.sha256(content[32:]).digest(), content[32:]]))


def _read_program(path: Path) -> None:
    program = SemidefiniteProgram.read(path)  # the format has any numbers, and nothing here squares them
    assert np.isfinite(program.cost).all()
    assert np.isfinite(program.value).all()


def _read_estimate(path: Path) -> None:
    estimate = sy.Estimate.load(path)
    _finite([estimate.base, estimate.parameters, estimate.weights])
    _finite([estimate.damping, estimate.friction, estimate.joint_relative_error], unknown=True)
    assert not np.isnan(estimate.standard_error).any()
    assert np.all(estimate.standard_error >= 0.0)
    _ = repr(estimate), estimate._repr_html_(), estimate.confidence_interval()


def _read_information(path: Path) -> None:
    information = sy.Information.load(path)
    for factor in information.factors:
        _finite([factor.triangle])
    estimate = least_squares(information, None)
    _finite([estimate.base])
    _ = information + information, information.condition_number, repr(information)


def _read_trajectory(path: Path) -> None:
    trajectory = load_trajectory(path)
    _finite([trajectory.duration])
    assert 0.0 < trajectory.duration < 1e9
    _finite(trajectory.motion(np.linspace(0.0, trajectory.duration, 20)))


def _read_certificate(path: Path) -> None:
    verify_document(load_certificate(path), str(path))


def _read_mesh(*paths: Path) -> None:
    """Read one mesh, or several at once: then whatever is wrong with any of them is raised as a group."""
    errors: list[Exception] = []
    for found in read_meshes(paths).values():
        try:
            if isinstance(found, InputError):
                raise found
            sy.collision.Mesh(*found)
        except Exception as error:
            if len(paths) == 1:
                raise
            errors.append(error)
    if errors:
        raise ExceptionGroup("of several meshes", errors)


def _read_torque(path: Path) -> None:
    from steelyard.identification.simulated import TorqueTable

    TorqueTable.read(path, 2)


def _read_shapes(path: Path) -> None:
    from steelyard.collision import RobotGeometry

    RobotGeometry.from_urdf(sy.Robot.from_urdf(path))


READERS: dict[str, tuple[Callable[..., None], ...]] = {
    "robot.urdf": (_read_urdf, _read_shapes),
    "robot.xacro": (_read_xacro,),
    "robot.mjcf": (_read_described,),
    "robot.sdf": (_read_described,),
    "robot.toml": (_read_robot_file,),
    "limits.toml": (_read_limits,),
    "robot.srdf": (lambda path: _ignore(read_srdf(path)),),
    "log.npz": (_read_log,),
    "small.npz": (_read_log,),
    "log.csv": (_read_log, _read_torque),
    "log.parquet": (_read_log, _read_torque),
    "log.feather": (_read_log,),
    "log.csv.gz": (_read_log,),
    "log.csv.bz2": (_read_log,),
    "log.csv.xz": (_read_log,),
    "log.csv.zst": (_read_log,),
    "log.mat": (_read_log,),
    "new.mat": (_read_log,),
    "log.h5": (_read_log,),
    **dict.fromkeys(MESSAGES, (_read_log,)),
    "bag.db3": (_read_bag,),
    "metadata.yaml": (_read_bag,),
    **dict.fromkeys(COMPRESSED, (_read_compressed_bag,)),
    "run.json": (_read_saved,),
    "fleet.toml": (_read_fleet,),
    "robots.csv": (_read_fleet,),
    "reduced.checkpoint": (_read_packed, _read_forged),
    "program.dat-s": (_read_program,),
    "estimate.json": (_read_estimate, _read_certificate),
    "information.json": (_read_information,),
    "certificate.json": (_read_certificate,),
    "trajectory.json": (_read_trajectory,),
    "trajectory.csv": (_read_trajectory,),
    "trajectory.parquet": (_read_trajectory,),
    "trajectory.yaml": (_read_trajectory,),
    "points.csv": (lambda path: _finite([read_points(path)]),),
    "points.npy": (lambda path: _finite([read_points(path)]),),
    "mesh.stl": (_read_mesh,),
    "mesh.obj": (_read_mesh,),
    "mesh.ply": (_read_mesh,),
    "binary.ply": (_read_mesh,),
    "mesh.dae": (_read_mesh,),
}


def _ignore(value: object) -> None:
    del value


# Damage

TOKENS = [
    b"1e308", b"-1e308", b"1e999", b"1e-320", b"nan", b"inf", b"-inf", b"0", b"-1", b"2147483648", b"9" * 400,
    b"9" * 5000, b"\0", b"\xff", b"\x1b[31m", b"\xc2\x9b31m", b"[[", b"]", b"{", b"}", b'"', b"'", b",", b"null",
    b"true", b"1_0", b"0x1",
    b"", b" ", b"\n", b"[]", b"{}", b'["box"]', b"-0.0", b"1e15", b"1e-15", b"\xe2\x80\xae", b"../..", b"/dev/zero",
]  # fmt: skip
NUMBER = re.compile(rb"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
VALUES: list[Any] = [
    None, True, [], {}, "", "x", "1", 0, -1, 10**400, 2**70, 1e308, -1e308, 1e-320, math.nan, math.inf, [[]], [None],
    {"a": 1},
    "nan", "1/0", "9" * 2000, "1e999", ["box"], [1.0], [[1.0, 2.0], [3.0]], "\x1b[31m", "a\0b", "\ud800",
]  # fmt: skip


BINARY = (
    ".npz", ".parquet", ".npy", ".stl", ".feather", ".gz", ".bz2", ".xz", ".zst", ".zstd", ".mat", ".h5", ".bag",
    ".mcap", ".db3", ".checkpoint",
)  # fmt: skip


def damaged(content: bytes, kind: str, random_number: random.Random) -> bytes:
    """Return a damaged copy of a file; the same for the same random numbers."""
    if kind.endswith(".json") and random_number.random() < 0.6:
        return _damaged_document(content, random_number)
    damage = bytearray(content)
    for _ in range(1 + min(int(random_number.expovariate(0.8)), 5)):
        _damage(damage, random_number, text=not kind.endswith(BINARY))
    return bytes(damage)


def _damage(data: bytearray, rng: random.Random, text: bool) -> None:
    where = rng.randrange(len(data) + 1)
    what = rng.choice(("flip", "cut", "remove", "copy", "token", "number", "number", "exchange") if text else (
        "flip", "flip", "flip", "byte", "byte", "cut", "remove", "copy", "token", "length"))  # fmt: skip
    if what in ("flip", "byte") and where < len(data):
        data[where] = data[where] ^ (1 << rng.randrange(8)) if what == "flip" else rng.choice((0, 1, 127, 128, 255))
    elif what == "cut":
        del data[where:]
    elif what == "remove":
        del data[where : where + rng.choice((1, 4, 20, 200))]
    elif what == "copy":
        source = rng.randrange(len(data) + 1)
        data[where:where] = data[source : source + rng.choice((1, 8, 60, 400))]
    elif what == "token":
        data[where:where] = rng.choice(TOKENS)
    elif what == "length" and where + 8 <= len(data):
        data[where : where + 4] = rng.choice((0, 1, 2**31 - 1, 2**32 - 1, len(data))).to_bytes(4, "little")
    else:
        numbers = list(NUMBER.finditer(data))
        if numbers:
            one = rng.choice(numbers)
            data[slice(*one.span())] = rng.choice(TOKENS) if what == "number" else rng.choice(numbers)[0]


def _damaged_document(content: bytes, rng: random.Random) -> bytes:
    document = json.loads(content)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        place, key = _random_place(document, rng)
        if place is None:
            continue
        match rng.choice(("value", "value", "value", "delete", "repeat", "copy", "deep")):
            case "value":
                place[key] = copy.deepcopy(rng.choice(VALUES))
            case "delete":
                del place[key]
            case "repeat" if isinstance(place, list):
                place.insert(key, copy.deepcopy(place[key]))
            case "copy":
                other, source = _random_place(document, rng)
                if other is not None:
                    place[key] = copy.deepcopy(other[source])
            case _:
                for _ in range(rng.choice((1, 5, 100))):
                    place[key] = [place[key]]
    return json.dumps(document).encode()


def _random_place(document: Any, rng: random.Random) -> tuple[Any, Any]:
    place, key, node = None, None, document
    while isinstance(node, (dict, list)) and node and (place is None or rng.random() < 0.8):
        place = node
        key = rng.choice(list(node)) if isinstance(node, dict) else rng.randrange(len(node))
        node = place[key]
    return place, key
