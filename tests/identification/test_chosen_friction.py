"""`identify(..., friction="auto")` on pendulums in closed form: what is added, what the result says, and its rerun."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import steelyard as sy
from steelyard.dynamics import ByJoint, Cogging, Coulomb, PiecewiseFriction, Stribeck, Viscous
from steelyard.estimators.friction_selection import ChosenFriction, FrictionSelection, FrictionTrial
from steelyard.identification import model_of_estimate, next_steps
from steelyard.identification.chosen_friction import FrictionChoice, terms_with
from steelyard.robot import RobotFile


def samples_of(extra):
    random, t = np.random.default_rng(3), np.arange(3000) / 100.0
    phase, sizes = np.outer(t, [0.9, 2.1, 3.4]), np.array([0.6, 0.5, 0.5])
    rates = np.array([0.9, 2.1, 3.4])
    q, dq, ddq = np.sin(phase) @ sizes, np.cos(phase) @ (sizes * rates), -np.sin(phase) @ (sizes * rates**2)
    torque = 0.8 * ddq + 5.0 * np.cos(q) + 0.6 * dq + 1.2 * np.sign(dq) + extra(dq)
    torque += 0.05 * random.normal(size=len(t))
    q, dq, ddq, torque = (one[:, None] for one in (q, dq, ddq, torque))
    return sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque, t=t)


@pytest.mark.slow
def test_the_answer_has_the_law_and_can_be_run_again(tmp_path):
    robot = sy.Robot.from_dh([(0, 0.5, 0, "q")], gravity=(0, -9.81, 0), name="pendulum")
    samples = samples_of(lambda dq: 0.9 * np.sign(dq) * np.exp(-((dq / 0.3) ** 2)))
    plain, result = sy.identify(robot, samples), sy.identify(robot, samples, friction="auto")
    assert result.friction.selection.kinds == ("stribeck",)
    assert result.prediction.relative_error < 0.6 * plain.prediction.relative_error
    values = dict(zip(result.parameter_names, result.estimate.parameters, strict=True))
    assert [values[name] for name in ("Fcj1", "Fsj1", "Fvj1")] == pytest.approx([1.2, 0.9, 0.6], rel=0.05)
    assert result.to_dict()["friction"]["chosen"][0]["kind"] == "stribeck"
    assert "How the friction was chosen" in result.report()
    result.estimate.save(tmp_path / "estimate.json")
    assert json.loads((tmp_path / "estimate.json").read_text())["description"]["terms"][0]["kind"] == "by_joint"
    model = model_of_estimate(tmp_path / "estimate.json", RobotFile.of(robot))
    assert model.parameter_names == result.parameter_names
    stated = tmp_path / "robot.toml"
    rows = '[description]\nrows = [[0, 0.5, 0, "q"]]\ngravity = [0.0, -9.81, 0.0]\n\n'
    stated.write_text(rows + result.friction.toml)
    again = sy.identify(stated, samples)
    np.testing.assert_allclose(again.base, result.base, rtol=1e-6)


PENDULUM = sy.Robot.from_dh([(0, 0.5, 0, "q")], gravity=(0, -9.81, 0), name="pendulum")


@pytest.mark.slow
def test_friction_that_grows_with_gravity_has_loads_by_the_logs():
    samples = samples_of(lambda dq: 0.0 * dq)
    q, dq = samples.q, samples.dq
    result = sy.identify(
        PENDULUM, replace(samples, torque=samples.torque + 0.5 * np.abs(np.cos(q)) * np.sign(dq)), friction="auto"
    )
    assert result.friction.selection.kinds == ("friction_by_load",)
    values = dict(zip(result.parameter_names, result.estimate.parameters, strict=True))
    assert values["Flj1"] == pytest.approx(0.1, rel=0.1)  # of 5 N m
    assert values["Fcj1"] == pytest.approx(1.2, rel=0.05)
    assert model_of_estimate(result.estimate, RobotFile.of(PENDULUM)).parameter_names == result.parameter_names
    assert "moments = [" in result.friction.toml


@pytest.mark.slow
def test_friction_that_falls_with_a_logged_temperature_is_found():
    samples = samples_of(lambda dq: 0.0 * dq)
    temperature = 30.0 + 8.0 * np.sin(0.35 * samples.t)[:, None]
    torque = samples.torque + (temperature - 30.0) * (-0.02 * samples.dq - 0.03 * np.sign(samples.dq))
    heated = replace(samples, torque=torque, channels={"temperature": temperature})
    result = sy.identify(PENDULUM, heated, friction="auto")
    assert result.friction.selection.kinds == ("friction_by_channel temperature",)
    values = dict(zip(result.parameter_names, result.estimate.parameters, strict=True))
    assert values["Fcsj1"] == pytest.approx(-0.03, rel=0.1)
    assert values["Fvsj1"] == pytest.approx(-0.02, rel=0.1)
    assert 'channel = "temperature"' in result.friction.toml
    cold = sy.identify(PENDULUM, replace(samples, channels={"temperature": temperature}), friction="auto")
    assert cold.friction.selection.chosen == ()


@pytest.mark.slow
def test_presliding_is_added(tmp_path):
    samples, fine = samples_of(lambda dq: 0.0 * dq), 20
    dq = np.interp(np.arange((samples.count - 1) * fine + 1) / fine, np.arange(samples.count), samples.dq[:, 0])
    states = np.zeros(samples.count)
    u = 0.0
    for k, rate in enumerate(dq.tolist()):
        u += 0.01 / fine * (rate - abs(rate) * u) / 0.08
        if k % fine == 0:
            states[k // fine] = u
    torque = samples.torque + 1.2 * (states - np.sign(samples.dq[:, 0]))[:, None]
    samples = replace(samples, torque=torque)
    plain, result = sy.identify(PENDULUM, samples), sy.identify(PENDULUM, samples, friction="auto")
    (law,) = result.friction.selection.chosen
    assert law.kind == "dahl"
    assert law.shape["displacement"] == pytest.approx(0.08, rel=0.05)
    values = dict(zip(result.parameter_names, result.estimate.parameters, strict=True))
    assert [values[name] for name in ("Fcj1", "Fvj1")] == pytest.approx([1.2, 0.6], rel=0.05)
    assert result.prediction.relative_error < 0.6 * plain.prediction.relative_error
    assert result.friction.presliding == ()
    assert "the model now has it: Dahl's at joint1" in " ".join(result.friction.sentences)
    assert "Laws that were added" in result.report()
    assert 'kind = "dahl"' in result.friction.toml
    result.estimate.save(tmp_path / "estimate.json")
    model = model_of_estimate(tmp_path / "estimate.json", RobotFile.of(PENDULUM))
    assert model.remembers
    (tmp_path / "robot.toml").write_text(
        '[description]\nrows = [[0, 0.5, 0, "q"]]\ngravity = [0.0, -9.81, 0.0]\n\n' + result.friction.toml
    )
    again = sy.identify(tmp_path / "robot.toml", samples)
    np.testing.assert_allclose(again.base, result.base, rtol=1e-6)


@pytest.mark.slow
def test_nothing_is_added_to_a_sound_model():
    robot = sy.Robot.from_dh([(0, 0.5, 0, "q")], gravity=(0, -9.81, 0), name="pendulum")
    result = sy.identify(robot, samples_of(lambda dq: 0.0 * dq), friction="auto")
    assert result.friction.selection.chosen == ()
    assert [term.kind for term in result.model.robot.terms][:2] == ["viscous", "coulomb"]
    assert "None of the laws of friction that were tried" in result.report()


@pytest.mark.slow
def test_laws_whose_parameters_a_stated_term_has_are_left_alone():
    robot = sy.Robot.from_dh([(0, 0.5, 0, "q")], gravity=(0, -9.81, 0), name="pendulum")
    model = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb(), Cogging([6])))
    result = sy.identify(model, samples_of(lambda dq: 0.9 * np.sign(dq) * np.exp(-((dq / 0.3) ** 2))), friction="auto")
    assert result.friction.selection.kinds == ("stribeck",)
    assert "have their parameters: a ripple with position." in result.report()


def test_laws_are_put_before_those_that_a_stated_term_has_at_other_joints():
    robot = sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.4, 0, "q")])
    motion = SimpleNamespace(model=SimpleNamespace(dof=2), motion=SimpleNamespace(dq=np.array([[1.0, 2.0]])))
    knee = ChosenFriction(1, "friction_piecewise", {"speed": 0.5}, (0.1,), 0.0, 0.5)
    stated = (ByJoint([Stribeck(0.1, joints=[1]), Coulomb(), Viscous()]), sy.Offset())
    found = terms_with(stated, [knee], motion)
    laws = [PiecewiseFriction([0.5, 2.0], joints=[2]), Stribeck(0.1, joints=[1]), Coulomb(), Viscous()]
    assert found == (ByJoint(laws), sy.Offset())
    assert "Fvj2" in sy.Model(robot.with_terms(*found)).parameter_names


def test_numbers_that_the_logs_leave_open_are_told_with_the_remedy():
    known = ChosenFriction(
        0, "stribeck", {"velocity": 0.1, "exponent": 2.0}, (0.5,), 0.0, 0.3, (1.0, 1.0), {"velocity": 0.004}, (0.02,)
    )
    ripple = replace(known, kind="cogging", shape={"harmonic": 6.0}, coefficients=(0.5, 0.001))
    ripple = replace(ripple, shape_errors={"harmonic": 0.01}, coefficient_errors=(0.02, 0.02))
    selection = FrictionSelection(("joint1",), (known, ripple), (), np.array([0.7]), np.array([1.0]))
    choice = FrictionChoice(selection, (), 0.1, 0.2)
    assert not any("open" in one for one in choice.sentences)
    heads, rows = selection.chosen_table()
    assert dict(zip(heads, rows[0], strict=True))["shape"] == "velocity 0.1 ± 0.0078, exponent 2"
    assert dict(zip(heads, rows[0], strict=True))["coefficients"] == "0.5 ± 0.039"
    bare = replace(known, coefficient_errors=(0.04,))
    (told,) = [one for one in replace(choice, selection=selection.with_laws([bare])).sentences if "open" in one]
    assert "stribeck at joint1 (8%)" in told
    assert "steelyard excite --criterion friction" in told
    assert selection.with_laws([bare]).to_dict()["chosen"][0]["coefficient_errors"] == [0.04]


def test_laws_that_are_not_added_are_told_as_taken_back():
    law = ChosenFriction(0, "stribeck", {"velocity": 0.1}, (0.5,), 1e-9, 0.3)
    trial = FrictionTrial(0, "stribeck", "Stribeck's", ("joint1",), 1e-9, 0.3, "chosen")
    selection = FrictionSelection(("joint1",), (law,), (trial,), np.array([0.7]), np.array([1.0])).with_laws(())
    told = selection.to_dict()
    assert told["chosen"] == []
    assert [one["verdict"] for one in told["trials"]] == ["taken back"]
    assert told["joints"][0]["held_out_error"] == 1.0


def test_other_words_are_refused():
    with pytest.raises(sy.InputError, match='friction must be "auto" or None'):
        sy.identify(sy.Robot.from_dh([(0, 0.5, 0, "q")]), samples_of(lambda dq: dq), friction="stribeck")


@pytest.mark.slow
def test_a_pattern_is_a_reason_to_let_the_logs_choose():
    robot = sy.Robot.from_dh([(0, 0.5, 0, "q")], gravity=(0, -9.81, 0), name="pendulum")
    terms = [sy.Viscous(), sy.Coulomb(), sy.Offset(), sy.RotorInertia()]
    samples = samples_of(lambda dq: 6.0 * np.sign(dq) * np.exp(-((dq / 0.5) ** 2)))
    model = sy.Model(robot.with_terms(*terms))
    found = sy.identify(model, samples)
    assert any("--friction auto" in step.code for step in next_steps(found))
    chosen = next_steps(sy.identify(model, samples, friction="auto"))
    assert not any("--friction auto" in step.code or "lacks" in step.reason for step in chosen)
