"""Descriptions of robots in packages, read and compared with what reads them independently."""

from __future__ import annotations

import re
import tempfile
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from described_trees import FORMATS, checked
from interpreted import interpreted

import steelyard as sy
from steelyard.robot import Drives, Robot
from steelyard.robot.description import MJCF, description_format

STATES = 20


@dataclass
class Outcome:
    """What became of a file: the reason why it was refused, or its error, and the joints that had to be locked.

    `written_error` is the error after other parameters were written, and `unwritten` why that was refused.
    """

    path: Path
    reason: str = ""
    robot: Robot | None = None
    error: float = np.nan
    locked: tuple[str, ...] = ()
    unchecked: str = ""
    written_error: float = np.nan
    unwritten: str = ""


def lockable(message: str) -> str | None:
    """Return the joint that a refusal advises to lock because it has several degrees of freedom."""
    found = re.search(r'is of type "(?:floating|planar|spherical)".*lock it: locked=\["(.*)"\]', message)
    return found[1] if found else None


def read(path: Path, reader: Callable[..., Robot]) -> tuple[Robot, tuple[str, ...]]:
    """Read a robot; joints that are not of one degree of freedom are locked one after the other."""
    locked: list[str] = []
    while True:
        try:
            return reader(path, locked=locked), tuple(locked)
        except sy.InputError as error:
            joint = lockable(str(error))
            if joint is None or joint in locked:
                raise
            locked.append(joint)


def random_states(robot: Robot, seed: int = 1) -> tuple[np.ndarray, ...]:
    """Return positions, velocities and accelerations (STATES, N)."""
    generator = np.random.default_rng(seed)
    return tuple(generator.uniform(-1.0, 1.0, (STATES, robot.dof)) for _ in range(3))


def mujoco_model(path: Path):
    """Compile an MJCF with MuJoCo, without the meshes of bodies whose inertia is written, which take long."""
    import mujoco

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of settings that are out of date
        try:
            return compiled_without_meshes(mujoco, mujoco.MjSpec.from_file(str(path)), path)
        except (TypeError, AttributeError):  # older versions cannot take geoms out
            return mujoco.MjModel.from_xml_path(str(path))


def compiled_without_meshes(mujoco, spec, path: Path):
    """Compile what MuJoCo has parsed, without the meshes that an inertia does not need."""
    if spec.compiler.inertiafromgeom != mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE:
        for body in spec.bodies:
            if body.explicitinertial or body.name == "world":
                for geom in [one for one in body.geoms if one.type == mujoco.mjtGeom.mjGEOM_MESH]:
                    spec.delete(geom)
    used = {geom.meshname for geom in spec.geoms}
    for mesh in [one for one in spec.meshes if (one.name or Path(one.file).stem) not in used]:
        spec.delete(mesh)
    try:
        return spec.compile()
    except ValueError:  # something else needs the geoms
        return mujoco.MjModel.from_xml_path(str(path))


def difference_from_mujoco(
    path: Path, robot: Robot, parameters: np.ndarray | None = None, model: sy.Model | None = None
) -> float:
    """Return the largest difference of inverse dynamics, relative to the largest torque.

    The parameters are those of the robot with rotors, by default what its description says. The model is that of the
    robot with rotors, where it has been made.

    MuJoCo reads the file itself; friction, springs, fluids and constraints are left out on both sides, and what follows
    another joint moves with it.
    """
    import mujoco

    world = mujoco_model(path)
    world.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    for name in ("dof_damping", "dof_dampingpoly", "jnt_stiffness", "jnt_stiffnesspoly", "body_gravcomp",
                 "tendon_stiffness", "tendon_damping", "tendon_armature"):  # fmt: skip
        if hasattr(world, name):
            getattr(world, name)[:] = 0.0
    world.opt.density = world.opt.viscosity = 0.0
    data = mujoco.MjData(world)
    # In both, joints stand in the order of the document; those of MuJoCo may have no name.
    kinds = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    theirs = [k for k in range(world.njnt) if int(world.jnt_type[k]) in kinds]
    by_name = {mujoco.mj_id2name(world, mujoco.mjtObj.mjOBJ_JOINT, k): k for k in theirs}
    order = [by_name.get(joint.name, theirs[index]) for index, joint in enumerate(robot.joints)]
    assert len(set(order)) == len(order)
    coupling = np.zeros((world.nv, robot.dof))
    offsets = np.array(world.qpos0)
    for joint, k in zip(robot.joints, order, strict=True):
        coupling[world.jnt_dofadr[k], joint.coordinate] = joint.multiplier
        offsets[world.jnt_qposadr[k]] = joint.offset
    held = [k for k in theirs if k not in order]
    offsets[world.jnt_qposadr[held]] = 0.0
    model = model or sy.Model(robot.with_terms(sy.RotorInertia()))
    states = random_states(robot)
    if parameters is None:
        parameters = np.nan_to_num(model.robot.parameters)
    values = dict(zip(("q", "dq", "ddq"), states, strict=True), parameters=parameters)
    ours = interpreted(model, "inverse_dynamics", **values)
    torques = []
    for q, dq, ddq in zip(*states, strict=True):
        data.qpos[:] = offsets
        for joint, k in zip(robot.joints, order, strict=True):
            data.qpos[world.jnt_qposadr[k]] += joint.multiplier * q[joint.coordinate]
        data.qvel[:], data.qacc[:] = coupling @ dq, coupling @ ddq
        mujoco.mj_inverse(world, data)
        torques.append(coupling.T @ data.qfrc_inverse)
    return float(np.abs(ours - torques).max() / max(np.abs(torques).max(), 1e-9))


def checked_mjcf(path: Path) -> Outcome:
    """Read an MJCF and compare it with MuJoCo."""
    robot, locked = read(path, lambda file, locked: MJCF.read(file, None, locked, None))
    model = sy.Model(robot.with_terms(sy.RotorInertia()))
    try:
        found = Outcome(path, robot=robot, error=difference_from_mujoco(path, robot, model=model), locked=locked)
    except ValueError as error:
        return Outcome(path, robot=robot, locked=locked, unchecked=" ".join(str(error).split()))
    try:
        found.written_error = difference_when_written(robot, path, model=model)
    except sy.InputError as error:
        found.unwritten = str(error).replace(str(path), path.name)
    return found


def difference_when_written(
    robot: Robot, source: Path, target: Path | None = None, seed: int = 1, model: sy.Model | None = None
) -> float:
    """Write random bodies and drives into a copy of an MJCF, and return the difference of MuJoCo's torques.

    By default the copy is in another folder, where a copy without changes must be the same, byte for byte.
    """
    from steelyard.robot.mjcf_writer import write_mjcf

    held = np.zeros(len(robot.parameter_names))
    for link, start in zip(robot.links, robot.link_starts, strict=True):
        for one in link.attachments:
            if one.locked and one.inertia is not None:
                held[start : start + 10] += one.inertia.moved(one.placement).parameters
    parameters, known = random_bodies(robot, seed) + held, random_drives(robot, seed)
    if target is not None:
        write_mjcf(robot, parameters, known, source, target)
        return difference_from_mujoco(target, robot, with_rotors(robot, parameters, known.rotor_inertia), model)
    with tempfile.TemporaryDirectory() as folder:
        same = Path(folder) / "same.xml"
        own = Drives.unknown(robot.dof).with_known(
            **{name: [getattr(joint, name) for joint in robot.felt_joints] for name in DRIVES}
        )
        write_mjcf(robot, robot.parameters, own, source, same)
        assert same.read_bytes() == source.read_bytes()
        return difference_when_written(robot, source, Path(folder) / "other.xml", seed, model)


def random_bodies(robot: Robot, seed: int = 1) -> np.ndarray:
    """Return parameters (n,) of links that are possible and differ."""
    random = np.random.default_rng(seed)
    parameters = []
    for _ in robot.links:
        points, masses = random.normal(size=(6, 3)) * 0.2, random.uniform(0.1, 1.0, 6)
        parts = [sy.Inertia.from_com(mass, point, np.zeros((3, 3))) for mass, point in zip(masses, points, strict=True)]
        parameters.append(sum(parts[1:], parts[0]).parameters)
    return np.concatenate(parameters)


DRIVES = ("damping", "friction", "rotor_inertia")


def random_drives(robot: Robot, seed: int = 1) -> Drives:
    """Return damping, friction and rotor inertia, without offsets."""
    random = np.random.default_rng(seed)
    return Drives.unknown(robot.dof).with_known(**{name: random.uniform(0.1, 1.0, robot.dof) for name in DRIVES})


def with_rotors(robot: Robot, parameters: np.ndarray, rotors: np.ndarray) -> np.ndarray:
    """Return the parameters of the robot with rotors (N,)."""
    model = sy.Model(robot.with_terms(sy.RotorInertia()))
    values = dict(zip(robot.parameter_names, parameters, strict=True))
    numbers = {f"Ia{index + 1}": value for index, value in zip(robot.driving_joints, rotors, strict=True)}
    return np.array([(values | numbers)[name] for name in model.parameter_names])


def checked_tree(path: Path) -> Outcome:
    """Read a URDF, a xacro or an SDF and compare it with Pinocchio, as it is and written with other bodies."""
    kind = FORMATS[path.suffix.lower()[1:]]
    robot, locked = read(path, lambda file, locked: kind.read(file, None, locked, None))
    return checked(kind, path, robot, locked, Outcome(path, robot=robot))


CHECKS: dict[str, Callable[[Path], Outcome]] = {"mjcf": checked_mjcf} | dict.fromkeys(FORMATS, checked_tree)


def kind_of(path: Path) -> str | None:
    """Return the format of a file, None where it is none."""
    if path.suffix.lower()[1:] in FORMATS:
        return path.suffix.lower()[1:]
    if path.suffix.lower() not in (".xml", ".mjcf"):
        return None
    found = description_format(path)
    return "mjcf" if found is MJCF else None


def outcomes(folder: Path) -> Iterator[tuple[str, Outcome]]:
    """Check all the descriptions in a folder; yield their formats and what became of them."""
    for path in sorted(folder.rglob("*")):
        kind = kind_of(path) if path.is_file() else None
        if kind is None:
            continue
        try:
            yield kind, CHECKS[kind](path)
        except sy.InputError as error:
            yield kind, Outcome(path, reason=str(error).replace(str(path), path.name))
