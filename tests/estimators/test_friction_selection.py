"""Laws of friction that are chosen on pendulums with torques in closed form."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

import steelyard as sy
from steelyard.estimators.friction_candidates import CANDIDATES, lugre_is_passive
from steelyard.estimators.friction_selection import FrictionData, _fall, select_friction

FEW = tuple(one for one in CANDIDATES if one.kind in ("viscous_by_direction", "stribeck", "friction_polynomial"))

ARM = """<robot name="arm"><link name="base"/>
<link name="l1"><inertial><origin xyz="-0.052 -0.041 -0.244"/><mass value="2.05"/>
  <inertia ixx="0.0486" iyy="0.0447" izz="0.0613" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><origin xyz="0.05 0 0.1"/><axis xyz="0 0 1"/>
  <limit lower="-3" upper="3" velocity="5" effort="300"/></joint>
<link name="l2"><inertial><origin xyz="0.028 -0.055 0.098"/><mass value="1.22"/>
  <inertia ixx="0.0324" iyy="0.0272" izz="0.0229" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.05 0 0.3"/><axis xyz="0 1 0"/>
  <limit lower="-3" upper="3" velocity="5" effort="300"/></joint></robot>
"""


def pendulum(friction, seed, noise=0.02, rows=3000):
    """The model of a pendulum, and samples of a random motion with noise that lasts, and with speeds that are noisy."""
    robot = sy.Robot.from_dh([(0, 0.5, 0, "q")], gravity=(0, -9.81, 0))
    model = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset()))
    random, t = np.random.default_rng(seed), np.arange(rows) / 100.0
    phase = np.outer(t, [0.9, 2.1, 3.4])
    size, shift = random.uniform(0.4, 0.8, 3), random.uniform(0.0, 6.0, 3)
    q = np.sin(phase + shift) @ size
    dq = np.cos(phase + shift) @ (size * [0.9, 2.1, 3.4])
    ddq = -np.sin(phase + shift) @ (size * [0.9, 2.1, 3.4] ** np.array(2))
    torque = 0.8 * ddq + 5.0 * np.cos(q) + 0.6 * dq + 1.2 * np.sign(dq) + friction(dq)
    torque += noise * (lfilter([0.3], [1.0, -0.95], random.normal(size=rows)) + random.normal(size=rows))
    measured = dq + 1e-3 * random.normal(size=rows)
    mask = np.abs(measured) > 0.01
    columns = [one[:, None] for one in (q, measured, ddq, torque)]
    return model, sy.Samples(*columns, mask=mask[:, None], t=t)


def test_a_planted_law_is_found_with_its_numbers():
    model, samples = pendulum(lambda dq: 0.9 * np.sign(dq) * np.exp(-((dq / 0.3) ** 2)), seed=1)
    found = select_friction(model, samples, candidates=FEW)
    assert found.kinds == ("stribeck",)
    (law,) = found.chosen
    assert law.shape["velocity"] == pytest.approx(0.3, rel=0.05)
    assert law.shape["exponent"] == 2.0
    assert law.coefficients[0] == pytest.approx(0.9, rel=0.05)
    assert found.errors[0] < 0.5 * found.plain_errors[0]
    first = found.trials[0]
    assert (first.kind, first.verdict, first.joints) == ("stribeck", "chosen", ("joint1",))
    assert found.to_dict()["chosen"][0]["shape"]["velocity"] == law.shape["velocity"]
    assert "chosen" in str(found)


@pytest.mark.parametrize("seed", [1, 2])
def test_nothing_is_added_where_there_is_nothing(seed):
    model, samples = pendulum(lambda dq: 0.0 * dq, seed)
    found = select_friction(model, samples, candidates=FEW)
    assert found.chosen == ()
    assert {one.verdict for one in found.trials} == {"refused"}


def test_a_law_with_a_state_that_is_refused_changes_nothing():
    model, samples = pendulum(lambda dq: 0.9 * np.sign(dq) * np.exp(-((dq / 0.3) ** 2)), seed=1)
    dahl = next(one for one in CANDIDATES if one.kind == "dahl")
    alone, beside = (select_friction(model, samples, candidates=laws) for laws in (FEW, (*FEW, dahl)))
    assert beside.kinds == ("stribeck",)
    assert beside.chosen[0].shape == alone.chosen[0].shape
    assert beside.chosen[0].coefficients == alone.chosen[0].coefficients
    assert (beside.errors, beside.plain_errors) == (alone.errors, alone.plain_errors)


@pytest.mark.parametrize("ratio", [0.25, 1.0, 1.05])
def test_what_a_law_gains_is_negative_where_the_error_rises(ratio):
    """The rise at one joint of a knee counted as a gain of 1e9, before which LuGre's friction had to stand back."""
    before = np.array([1.0, 2.0, 0.5, 4.0])
    trial = SimpleNamespace(before=before, losses=ratio * before, gain=1.0 - np.sqrt(ratio))
    assert _fall(trial).sum() == pytest.approx(-np.log(ratio), abs=1e-12)


def test_a_short_log_tells_nothing_and_says_so():
    model, samples = pendulum(lambda dq: 0.9 * np.sign(dq) * np.exp(-((dq / 0.3) ** 2)), seed=1, rows=60)
    found = select_friction(model, samples, candidates=FEW)
    assert found.chosen == ()
    assert "too short" in found.remarks[0]


def test_friction_that_would_drive_the_joint_is_refused():
    # Near rest it pushes: no friction does, so that nothing that explains it so is added.
    model, samples = pendulum(lambda dq: -1.8 * np.sign(dq) * np.exp(-((dq / 0.4) ** 2)), seed=2)
    found = select_friction(model, samples, candidates=[one for one in FEW if one.kind == "stribeck"])
    assert found.chosen == ()


def test_the_condition_of_passivity_is_where_energy_begins_to_be_made():
    """At the worst deflection and speed the power beyond the stored energy is that of the condition, in closed form."""
    damping, ratio, coulomb, speed = 1.0, 0.5, 1e-3, 1e-2
    v = np.linspace(0.05, 0.5, 50)  # where friction is Coulomb's, and bristles may still be bent by all of Fc (1 + r)
    worst = v * coulomb * (1 + ratio) ** 2 + damping * v * (v - v * (1 + ratio))
    for viscous in (0.45, 0.55):
        dissipated = worst + viscous * v**2
        assert bool(np.all(dissipated >= 0.0)) == lugre_is_passive(damping, viscous, ratio)
    assert speed < v.min()


def bristles(displacement, ratio, velocity, first):
    """A pendulum with LuGre friction that began long before the first row, which slows down and reverses slowly."""
    t = np.arange(4500) / 100.0
    rate = np.cos(0.2 * t) ** 2 + 0.05
    phase = np.cumsum(rate) / 100.0
    q = 0.8 * np.sin(phase) + 0.4 * np.sin(2.3 * phase)
    dq, ddq = np.gradient(q, t), np.gradient(np.gradient(q, t), t)
    v = np.interp(np.arange(len(t) * 10) / 10.0, np.arange(len(t)), dq)
    states, u = np.zeros(len(t)), 0.0
    for k, now in enumerate(v.tolist()):
        slope = (now - abs(now) * u / (1.0 + ratio * np.exp(-((now / velocity) ** 2)))) / displacement
        u += 1e-3 * slope
        if k % 10 == 0:
            states[k // 10] = u
    torque = 0.8 * ddq + 5.0 * np.cos(q) + 0.6 * dq + 1.2 * states
    torque += 0.01 * np.random.default_rng(2).normal(size=len(t))
    robot = sy.Robot.from_dh([(0, 0.5, 0, "q")], gravity=(0, -9.81, 0))
    model = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset()))
    columns = [one[first:, None] for one in (q, dq, ddq, torque)]
    return model, sy.Samples(*columns, t=t[first:])


def test_what_a_bristle_remembers_of_before_the_log_does_not_count():
    """A log that begins where a joint is slow."""
    shape = (0.05, 0.8, 0.08)
    found = select_friction(*bristles(*shape, first=740), candidates=CANDIDATES[-2:])
    (law,) = found.chosen
    assert law.kind == "lugre"
    assert list(law.shape.values()) == pytest.approx(shape, rel=0.05)
    assert law.coefficients[0] == pytest.approx(1.2, rel=0.05)


def test_rows_near_rest_tell_the_numbers_of_friction_that_remembers_the_motion():
    """Without them most of what breaks away above Coulomb friction is not seen."""
    shape = (0.05, 0.8, 0.08)
    model, whole = bristles(*shape, first=740)
    fast = replace(whole, mask=np.abs(whole.dq) > 0.12)
    laws = CANDIDATES[-1:]
    (masked,) = select_friction(model, fast, candidates=laws).chosen
    (law,) = select_friction(model, FrictionData.of(model, fast, near_rest=whole), candidates=laws).chosen
    assert list(law.shape.values()) == pytest.approx(shape, rel=0.05)
    assert all(2.0 * law.shape_errors[name] < error for name, error in masked.shape_errors.items())


def test_a_knee_near_the_full_speed_is_found():
    model, samples = pendulum(lambda dq: -0.5 * np.sign(dq) * np.maximum(np.abs(dq) - 2.3, 0.0), seed=3)
    assert 0.6 * np.quantile(np.abs(samples.dq), 0.99) < 2.3
    laws = [one for one in CANDIDATES if one.kind in ("friction_polynomial", "friction_piecewise", "stribeck")]
    found = select_friction(model, samples, candidates=laws)
    (law,) = found.chosen
    assert law.kind == "friction_piecewise"
    assert law.shape["speed"] == pytest.approx(2.3, rel=0.05)
    assert law.coefficients[0] == pytest.approx(-0.5, rel=0.1)


def test_a_velocity_at_the_end_of_those_that_are_tried_is_no_law():
    model, samples = pendulum(lambda dq: 1.5 * np.sign(dq) * np.exp(-((dq / 0.03) ** 2)), seed=1, noise=0.005)
    found = select_friction(model, samples, candidates=[one for one in FEW if one.kind == "stribeck"])
    assert found.chosen == ()


@pytest.mark.parametrize("seed", [1, 9, 15, 19, 20])
def test_of_laws_that_are_nearly_alike_the_likelier_is_taken(seed):
    """A knee has a held-out error as small as that of this polynomial, or smaller, in noise that lasts."""
    model, samples = pendulum(lambda dq: -0.25 * dq * np.abs(dq) + 0.04 * dq**3, seed, noise=0.1)
    laws = [one for one in CANDIDATES if one.kind in ("friction_polynomial", "friction_piecewise")]
    found = select_friction(model, samples, candidates=laws)
    assert found.kinds == ("friction_polynomial",)
    assert found.trials[1].verdict == "another is better"


def test_a_joint_without_a_row_tells_nothing_and_says_so():
    model, samples = pendulum(lambda dq: 0.9 * np.sign(dq) * np.exp(-((dq / 0.3) ** 2)), seed=1)
    none = replace(samples, mask=np.zeros_like(samples.mask))
    found = select_friction(model, none, candidates=FEW)
    assert found.chosen == ()
    assert "joint1" in found.remarks[0]


@pytest.mark.slow
def test_nothing_is_added_to_what_rounding_leaves(tmp_path):
    """Torques without any noise: what is left of them comes from the filter, and from the ridge of the search."""
    (tmp_path / "arm.urdf").write_text(ARM)
    model = sy.Model(sy.Robot.from_urdf(tmp_path / "arm.urdf").with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset()))
    random, t = np.random.default_rng(4), np.arange(4000) / 200.0
    rates, shifts = random.uniform(0.3, 5.0, (5, 2)), random.uniform(0.0, 6.28, (5, 2))
    sizes = random.uniform(0.2, 0.7, (5, 2)) / (1.0 + 0.3 * rates)
    phase = t[:, None, None] * rates + shifts
    q, dq, ddq = (
        np.sum(sizes * part, axis=1) for part in (np.sin(phase), rates * np.cos(phase), -(rates**2) * np.sin(phase))
    )
    truth = model.robot.parameters.copy()
    for name, value in {"Fvj1": 0.93, "Fcj1": 1.54, "Foj1": 0.0, "Fvj2": 0.56, "Fcj2": 1.01, "Foj2": 0.0}.items():
        truth[model.parameter_names.index(name)] = value
    torque = model.inverse_dynamics(q, dq, ddq, truth)
    recording = sy.Recording(t=t, q=q, torque=torque, joint_names=model.robot.joint_names)
    assert select_friction(model, recording.process(model=model)).kinds == ()
    still = sy.Samples(q=q, dq=dq, ddq=ddq, torque=model.inverse_dynamics(q, dq, ddq, 0.0 * truth))
    assert select_friction(model, still).kinds == ()
