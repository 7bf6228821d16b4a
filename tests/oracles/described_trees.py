"""URDF, xacro and SDF in packages, read, written and compared with Pinocchio."""

from __future__ import annotations

import tempfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from interpreted import interpreted

import steelyard as sy
from steelyard.robot import Robot
from steelyard.robot.description import SDF, URDF
from steelyard.robot.joint import Drives
from steelyard.robot.urdf_document import urdf_content

STATES = 20


def tree_torques(model, robot: Robot, seed: int = 1, ours: sy.Model | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return torques (STATES, N) of Pinocchio's model at random motions of the robot, and those of ours.

    Joints that the robot does not have are held at 0; those that mimic others move with them.
    """
    import pinocchio

    random = np.random.default_rng(seed)
    motions = random.uniform(-1.0, 1.0, (3, STATES, robot.dof))
    data = model.createData()
    model.gravity.linear = np.array(robot.gravity)
    coupling, offsets = np.zeros((len(robot.joints), robot.dof)), np.zeros(len(robot.joints))
    for row, joint in enumerate(robot.joints):
        coupling[row, joint.coordinate], offsets[row] = joint.multiplier, joint.offset
    places = [model.joints[model.getJointId(joint.name)] for joint in robot.joints]
    speeds = [one.idx_v for one in places]
    torques = []
    for q, dq, ddq in zip(*motions, strict=True):
        full = pinocchio.neutral(model)
        for value, one in zip(coupling @ q + offsets, places, strict=True):
            full[one.idx_q : one.idx_q + one.nq] = value if one.nq == 1 else (np.cos(value), np.sin(value))
        v, a = np.zeros((2, model.nv))
        v[speeds], a[speeds] = coupling @ dq, coupling @ ddq
        torques.append(coupling.T @ pinocchio.rnea(model, data, full, v, a)[speeds])
    values = dict(zip(("q", "dq", "ddq"), motions, strict=True), parameters=np.nan_to_num(robot.parameters))
    found = interpreted(ours or sy.Model(robot), "inverse_dynamics", **values)
    return np.array(torques), found


def difference(model, robot: Robot, ours: sy.Model | None = None) -> float:
    """Return the largest difference of torques, relative to the largest torque.

    Our model is that of the robot, or of one that differs in its parameters alone.
    """
    theirs, found = tree_torques(model, robot, ours=ours)
    return float(np.abs(found - theirs).max() / max(np.abs(theirs).max(), 1e-9))


def pinocchio_of_urdf(content: bytes):
    """Pinocchio's model of a URDF."""
    import pinocchio

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.urdf"
        path.write_bytes(content)
        return pinocchio.buildModelFromUrdf(str(path))


def pinocchio_of_sdf(path: Path):
    """A model of Pinocchio of an SDF of version 1.4 to 1.6: poses in the frame of the model, no nested models."""
    import pinocchio

    root = ElementTree.parse(path).getroot()
    element = max(root.iter("model"), key=lambda one: len(one.findall("joint")))

    def place(parent):
        words = [float(word) for word in parent.findtext("pose", "0 0 0 0 0 0").split()]
        return pinocchio.SE3(pinocchio.rpy.rpyToMatrix(*words[3:]), np.array(words[:3]))

    links = {one.get("name"): place(one) for one in element.findall("link")}
    links.setdefault("world", pinocchio.SE3.Identity())
    waiting = {one.get("name"): one for one in element.findall("joint")}
    ends = {name: (one.findtext("parent").strip(), one.findtext("child").strip()) for name, one in waiting.items()}
    root_name = next(name for name in ("world", *links) if name not in {child for _, child in ends.values()}
                     and name in {parent for parent, _ in ends.values()})  # fmt: skip
    # In the frame of the root link, as ours.
    base = links[root_name]
    carriers = {root_name: (0, base)}
    model = pinocchio.Model()

    def inertia(name):
        one = next((link for link in element.findall("link") if link.get("name") == name), None)
        if one is None or one.find("inertial") is None:
            return pinocchio.Inertia(1.0, np.zeros(3), np.eye(3))
        held = one.find("inertial")
        xx, xy, xz, yy, yz, zz = (float(held.findtext(f"inertia/i{key}", "1" if key[0] == key[1] else "0"))
                                  for key in ("xx", "xy", "xz", "yy", "yz", "zz"))  # fmt: skip
        frame = place(held)
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        tensor = frame.rotation @ tensor @ frame.rotation.T
        mass = float(held.findtext("mass", "1"))
        return pinocchio.Inertia(mass, frame.translation, tensor)

    while waiting:
        name = next(name for name in waiting if ends[name][0] in carriers)
        joint = waiting.pop(name)
        parent, child = ends[name]
        index, frame = carriers[parent]
        here = links[child] * place(joint)
        kind = joint.get("type")
        if kind != "fixed":
            axis = np.array([float(word) for word in joint.findtext("axis/xyz").split()])
            flag = joint.findtext("axis/use_parent_model_frame", "0").strip() in ("1", "true")
            if flag or root.get("version") == "1.4":
                axis = here.rotation.T @ axis
            axis = axis / np.linalg.norm(axis)
            made = (
                pinocchio.JointModelPrismaticUnaligned if kind == "prismatic" else pinocchio.JointModelRevoluteUnaligned
            )
            index, frame = model.addJoint(index, made(axis), frame.inverse() * here, name), here
        carriers[child] = index, frame
        model.appendBodyToJoint(index, inertia(child), frame.inverse() * links[child])
    return model


def random_bodies(robot: Robot, seed: int = 1) -> np.ndarray:
    """Return parameters (n,) of links that are possible and differ; what hangs on locked joints is on top."""
    random = np.random.default_rng(seed)
    parameters = []
    for link in robot.links:
        points, masses = random.normal(size=(6, 3)) * 0.2, random.uniform(0.1, 1.0, 6)
        parts = [sy.Inertia.from_com(mass, point, np.zeros((3, 3))) for mass, point in zip(masses, points, strict=True)]
        parts += [
            one.inertia.moved(one.placement) for one in link.attachments if one.locked and one.inertia is not None
        ]
        parameters.append(sum(parts[1:], parts[0]).parameters)
    return np.concatenate(parameters)


def written_differences(
    kind, robot: Robot, source: Path, content: bytes, locked: tuple[str, ...], oracle, ours: sy.Model
) -> float:
    """Write a copy without changes, which must be the same, and one with random bodies; return its error."""
    random = np.random.default_rng(1)
    drives = Drives(*random.uniform(0.1, 1.0, (4, robot.dof)))
    with tempfile.TemporaryDirectory() as folder:
        suffix = ".urdf" if kind is URDF else source.suffix
        same, other = Path(folder) / f"same{suffix}", Path(folder) / f"other{suffix}"
        if np.isfinite(robot.parameters).all() and robot.parameters[9::10].min() > 0.0:
            kind.write(robot, robot.parameters, Drives.unknown(robot.dof), source, same)
            assert same.read_bytes() == content, f"{source}: a copy without changes differs"
        parameters = random_bodies(robot)
        kind.write(robot, parameters, drives, source, other)
        again = kind.read(other, None, locked, robot.gravity)
        scale = np.abs(parameters).max()
        assert np.abs(again.parameters - parameters).max() < 1e-9 * scale, f"{source}: other parameters are read again"
        return difference(oracle(other), again, ours)


def checked(kind, path: Path, robot: Robot, locked: tuple[str, ...], outcome):
    """Fill in the errors of an outcome."""
    if kind is URDF:
        content = urdf_content(path)

        def oracle(file):
            return pinocchio_of_urdf(file.read_bytes())

        model = pinocchio_of_urdf(content)
    else:
        content, oracle, model = path.read_bytes(), pinocchio_of_sdf, pinocchio_of_sdf(path)
    ours = sy.Model(robot)
    outcome.error = difference(model, robot, ours)
    try:
        outcome.written_error = written_differences(kind, robot, path, content, locked, oracle, ours)
    except sy.InputError as error:
        outcome.unwritten = str(error).replace(str(path), path.name)
    return outcome


FORMATS = {"urdf": URDF, "xacro": URDF, "sdf": SDF}
