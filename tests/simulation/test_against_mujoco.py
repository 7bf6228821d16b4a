"""Free fall beside MuJoCo, which reads the same URDF by itself."""

import sysconfig
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import steelyard as sy
from steelyard.simulation import simulate

mujoco = pytest.importorskip("mujoco", reason="MuJoCo (the oracle) is not installed")

ROBOTS = Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"
CASES = {
    "ur_description/urdf/ur5_robot.urdf": (),
    "panda_description/urdf/panda.urdf": ("panda_finger_joint1", "panda_finger_joint2"),
    "double_pendulum_description/urdf/double_pendulum_continuous.urdf": (),
}


def bare(path, locked):
    """Return the URDF without shapes, friction and limits, and with the locked joints fixed."""
    root = ElementTree.parse(path).getroot()
    for link in root.iter("link"):
        for shape in [e for e in link if e.tag in ("visual", "collision")]:
            link.remove(shape)
    for joint in root.iter("joint"):
        for child in [e for e in joint if e.tag in ("dynamics", "limit", "mimic", "safety_controller")]:
            joint.remove(child)
        if joint.get("name") in locked:
            joint.set("type", "fixed")
        elif joint.get("type") == "revolute":
            joint.set("type", "continuous")
    for other in [e for e in root if e.tag not in ("link", "joint")]:
        root.remove(other)
    compiler = ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler")
    compiler.set("balanceinertia", "false")
    compiler.set("fusestatic", "true")
    return ElementTree.tostring(root, encoding="unicode")


@pytest.fixture(scope="module", params=CASES, ids=lambda name: Path(name).stem)
def case(request, tmp_path_factory):
    path, locked = ROBOTS / request.param, CASES[request.param]
    if not path.is_file():
        pytest.skip("the robots of example-robot-data are not installed")
    text = bare(path, locked)
    file = tmp_path_factory.mktemp("urdf") / "bare.urdf"
    file.write_text(text)
    robot = sy.Robot.from_urdf(file)
    world = mujoco.MjModel.from_xml_string(text)
    world.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    world.dof_armature[:] = world.dof_damping[:] = world.dof_frictionloss[:] = 0.0
    order = [mujoco.mj_name2id(world, mujoco.mjtObj.mjOBJ_JOINT, name) for name in robot.joint_names]
    assert sorted(order) == list(range(world.nv))
    return sy.Model(robot), world, order


def fall_in_mujoco(world, order, q0, t):
    """Integrate MuJoCo's own accelerations with tight tolerances."""
    data = mujoco.MjData(world)
    n = len(order)

    def slope(_, y):
        data.qpos[order], data.qvel[order] = y[:n], y[n:]
        mujoco.mj_forward(world, data)
        return np.concatenate([y[n:], data.qacc[order]])

    start = np.concatenate([q0, np.zeros(n)])
    return solve_ivp(slope, (0.0, t[-1]), start, method="DOP853", t_eval=t, rtol=1e-12, atol=1e-12).y[:n].T


@pytest.mark.slow
@pytest.mark.parametrize("method", ["dormand_prince", "dop853"])
def test_two_seconds_of_free_fall(case, method):
    model, world, order = case
    delta = np.nan_to_num(model.robot.parameters)
    q0 = -0.2 * np.arange(model.dof)  # a start from which the Panda's fall is not chaotic
    result = simulate(
        model,
        delta,
        q0,
        np.zeros(model.dof),
        2.0,
        method=method,
        relative_tolerance=1e-12,
        absolute_tolerance=1e-12,
        rate=50.0,
    )
    theirs = fall_in_mujoco(world, order, q0, result.t)
    assert np.ptp(result.q, axis=0).max() > 1.0
    assert np.abs(result.q - theirs).max() < 1e-6
    assert np.ptp(result.energy) < 1e-8 * np.ptp(result.potential_energy)
