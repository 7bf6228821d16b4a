"""From an MJCF and a log that MuJoCo simulated to an MJCF with the identified values."""

import numpy as np
import pytest

from steelyard.cli import main

mujoco = pytest.importorskip("mujoco", reason="MuJoCo (extra `mjcf`) is not installed")

ARM = """<mujoco model="arm"><compiler angle="radian"/><option timestep="0.001"><flag contact="disable"/></option>
  <default><joint damping="{damping}" armature="{armature}"/></default>
  <worldbody>
    <body name="upper" pos="0 0 1"><inertial pos="0.02 0 -0.15" mass="{upper}" diaginertia="0.05 0.06 0.02"/>
      <joint name="shoulder" axis="0 1 0"/>
      <body name="fore" pos="0 0 -0.4"><joint name="elbow" axis="0 1 0"/>
        <geom type="box" size="0.03 0.04 0.15" mass="{fore}"/>
      </body>
    </body>
  </worldbody></mujoco>
"""
CAD = {"damping": 0.1, "armature": 0.05, "upper": 3.0, "fore": 1.5}
TRUE = {"damping": 0.6, "armature": 0.2, "upper": 3.6, "fore": 1.2}


def recorded(path, seed):
    """A PD controller follows sines; the log holds positions, velocities and torques."""
    world = mujoco.MjModel.from_xml_string(ARM.format(**TRUE))
    data = mujoco.MjData(world)
    random = np.random.default_rng(seed)
    size, phase = random.uniform(0.2, 0.5, (2, 3)), random.uniform(0, 6, (2, 3))
    rate = 2 * np.pi * np.array([0.2, 0.5, 0.9])
    rows = []
    for _ in range(8000):
        angle = rate * data.time + phase
        wanted, speed = (size * np.sin(angle)).sum(1), (size * rate * np.cos(angle)).sum(1)
        data.qfrc_applied[:] = 400 * (wanted - data.qpos) + 40 * (speed - data.qvel)
        rows.append([data.time, *data.qpos, *data.qvel, *data.qfrc_applied])
        mujoco.mj_step(world, data)
    names = [f"{kind}_{joint}" for kind in ("position", "velocity", "torque") for joint in ("shoulder", "elbow")]
    np.savetxt(path, rows[500:], delimiter=",", header=",".join(["time", *names]), comments="")


def run(monkeypatch, command):
    monkeypatch.setattr("sys.argv", command.split())
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0


def torques(world):
    """Those of MuJoCo at random states, without friction."""
    world.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, random, rows = mujoco.MjData(world), np.random.default_rng(3), []
    for _ in range(50):
        data.qpos[:], data.qvel[:], data.qacc[:] = random.normal(size=(3, 2))
        mujoco.mj_inverse(world, data)
        rows.append(data.qfrc_inverse.copy())
    return np.array(rows)


@pytest.mark.slow
def test_an_mjcf_and_its_logs_lead_to_an_mjcf(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.xml").write_text(ARM.format(**CAD))
    recorded("one.csv", 1)
    recorded("two.csv", 2)
    run(monkeypatch, "steelyard identify arm.xml one.csv --validate two.csv --output out")
    assert "predicts well" in capsys.readouterr().out
    found = mujoco.MjModel.from_xml_path("out/robot.xml")
    described, true = (mujoco.MjModel.from_xml_string(ARM.format(**values)) for values in (CAD, TRUE))
    assert np.allclose(found.dof_damping, 0.6, rtol=0.05)
    right, size = torques(true), np.linalg.norm(torques(true))
    assert np.linalg.norm(torques(described) - right) > 0.1 * size
    assert np.linalg.norm(torques(found) - right) < 0.02 * size
    run(monkeypatch, "steelyard inspect out/robot.xml")
    told = capsys.readouterr().out
    assert "rotor inertia" in told
    assert "Inertias that the file gives (<inertial>): upper, fore." in told
