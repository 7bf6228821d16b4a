"""Joints that stand still: what they show is nothing, and what the others show stays as good as it was."""

import json

import numpy as np
import pytest

import steelyard as sy
from steelyard.recording import Recording, chunks
from steelyard.recording.diagnosis.rest import HeldJoints

ROWS = [
    ["pi/2", 0, 0.3, "q"],
    [0, 0.4, 0, "q"],
    ["pi/2", 0.1, 0, "q"],
    ["-pi/2", 0, 0.35, "q"],
    ["pi/2", 0, 0, "q"],
    [0, 0, 0.1, "q"],
]
SLIDING = [[0, 0, "q", 0], ["pi/2", 0.2, 0, "q"], [0, 0.4, 0, "q"]]
RATE, DURATION = 250.0, 8.0
PROCESSING = {"cutoff": 10.0, "trim": 0.5}


def robot_file(folder, rows=ROWS, **processing):
    settings = "".join(f"{key} = {json.dumps(value)}\n" for key, value in (PROCESSING | processing).items())
    terms = "".join(f'[[terms]]\nkind = "{kind}"\n' for kind in ("viscous", "coulomb", "rotor_inertia"))
    path = folder / "robot.toml"
    path.write_text(f"[description]\nrows = {json.dumps(rows)}\n{terms}[processing]\n{settings}")
    return path


def true_parameters(model):
    random = np.random.default_rng(5)
    values = []
    for _ in model.link_columns:
        spread = random.uniform(0.01, 0.05, 3)
        com = random.normal(scale=0.05, size=3)
        inertia = sy.Inertia.from_com(mass=random.uniform(1, 5), com=com, about_com=np.diag(sum(spread) - spread))
        values.extend([*inertia.parameters, *random.uniform(0.1, 0.5, 3)])
    return np.array(values)


def motion(model, seed, held=()):
    """Sums of four sines, 0.7 where a joint is held; exact derivatives."""
    random = np.random.default_rng(seed)
    t = np.arange(round(DURATION * RATE))[:, None] / RATE
    q, dq, ddq = np.zeros((3, len(t), model.dof))
    for k in range(1, 5):
        w = 2 * np.pi * 0.25 * k
        a, b = random.normal(size=(2, model.dof)) * 0.3
        a[list(held)] = b[list(held)] = 0.0
        q += a * np.sin(w * t) + b * np.cos(w * t)
        dq += w * (a * np.cos(w * t) - b * np.sin(w * t))
        ddq -= w * w * (a * np.sin(w * t) + b * np.cos(w * t))
    q[:, list(held)] = 0.7
    return t[:, 0], q, dq, ddq


def recorded(model, path, seed=1, held=(), position_noise=0.0, step=0.0, drift=0.0):
    t, q, dq, ddq = motion(model, seed, held)
    random = np.random.default_rng(seed + 100)
    torque = model.inverse_dynamics(q, dq, ddq, true_parameters(model)) + 0.05 * random.normal(size=q.shape)
    q[:, list(held)] += position_noise * random.normal(size=(len(t), len(held))) + drift * t[:, None]
    if step:
        q[:, list(held)] = step * np.round(q[:, list(held)] / step)
    Recording(t=t, q=q, torque=torque, source="simulation").save(path)
    return path


def error_on(model, parameters, held=(), seed=77):
    """Relative error of predicted torques on another motion, against the true parameters."""
    _, *other = motion(model, seed, held)
    true = model.inverse_dynamics(*other, true_parameters(model))
    return np.linalg.norm(model.inverse_dynamics(*other, parameters) - true) / np.linalg.norm(true)


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind",
    [
        {},
        *(pytest.param({"position_noise": noise}, marks=pytest.mark.slow) for noise in (1e-6, 1e-4)),
        {"step": 1e-4, "position_noise": 3e-5},
        pytest.param({"drift": 1e-6}, marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_a_joint_at_rest_spoils_nothing(tmp_path, kind):
    path = robot_file(tmp_path)
    model = sy.Model.load(path)
    result = sy.identify(path, [recorded(model, tmp_path / "log.npz", held=(0,), **kind)])
    assert any("Joint 'joint1' does not move (it stays at 0.7" in remark for remark in result.remarks)
    assert error_on(model, result.estimate.parameters, held=(0,)) < 0.003
    # While joint 1 moves, which it never did, so that lengths of links and one density say how heavy it is.
    assert error_on(model, result.estimate.parameters) < 0.1
    assert result.total_mass < 1.5 * sum(true_parameters(model)[c[9]] for c in model.link_columns)
    values = dict(zip(model.parameter_names, result.estimate.parameters, strict=True))
    assert max(values["Fvj1"], values["Fcj1"], values["Ia1"]) < 1e-3  # zero, but for the margin
    loose = set(result.information.unidentifiable)
    assert {"Fvj1", "Fcj1"} < loose
    # It is rank, not rounding, that says how much is not determined.
    _, q, dq, ddq = motion(model, 1, held=(0,))
    W = model.regressor(q, dq, ddq).reshape(-1, model.parameter_count)[:, model.base_parameters().independent]
    missing = W.shape[1] - np.linalg.matrix_rank(W / np.maximum(np.linalg.norm(W, axis=0), 1e-300), tol=1e-8)
    assert np.sum(np.linalg.svd(result.information.reduced(None).R, compute_uv=False) < 1e-9) == missing
    assert result.information.condition_number == np.inf


@pytest.mark.slow
@pytest.mark.parametrize("excluded", [*(pytest.param([one], marks=pytest.mark.slow) for one in (1, 3)), [5, 6]])
def test_parameters_of_excluded_joints_are_zero(tmp_path, excluded):
    path = robot_file(tmp_path, exclude_joints=excluded)
    model = sy.Model.load(path)
    result = sy.identify(path, [recorded(model, tmp_path / "log.npz")])
    values = dict(zip(model.parameter_names, result.estimate.parameters, strict=True))
    for joint in excluded:
        assert max(values[f"Fvj{joint}"], values[f"Fcj{joint}"]) < 1e-3
    others = [k for k in range(6) if k + 1 not in excluded]
    _, *other = motion(model, 77)
    true = model.inverse_dynamics(*other, true_parameters(model))[:, others]
    found = model.inverse_dynamics(*other, result.estimate.parameters)[:, others]
    assert np.linalg.norm(found - true) < 0.003 * np.linalg.norm(true)


@pytest.mark.parametrize("prefer", ["lightest", None])
def test_terms_that_nothing_shows_are_zero_however_the_fit_ends(prefer):
    """Data that no possible robot has: the optimum lies on the boundary, and solvers end anywhere in the rest."""
    model = sy.Model(sy.Robot.from_dh(ROWS[:3]).with_terms(sy.Viscous(), sy.Coulomb(), sy.Offset()))
    q, dq, ddq, torque = np.random.default_rng(3).normal(size=(4, 400, 3))
    mask = np.ones(q.shape, dtype=bool)
    mask[:, 0] = False
    information = sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque, mask=mask))
    estimate = sy.fit(information, sy.FeasibleSet(model), prefer=prefer)
    values = dict(zip(model.parameter_names, estimate.parameters, strict=True))
    assert max(abs(values[name]) for name in ("Fvj1", "Fcj1", "Foj1")) < 1e-3


@pytest.mark.slow
def test_a_joint_that_moves_in_one_log_of_two_is_known(tmp_path):
    path = robot_file(tmp_path)
    model = sy.Model.load(path)
    logs = [recorded(model, tmp_path / "held.npz", held=(0,)), recorded(model, tmp_path / "moving.npz", seed=4)]
    result = sy.identify(path, logs)
    assert not result.information.unidentifiable
    assert error_on(model, result.estimate.parameters) < 0.005


@pytest.mark.slow
def test_one_moving_joint_and_prismatic_ones(tmp_path):
    path = robot_file(tmp_path, SLIDING)
    model = sy.Model.load(path)
    for held in ((0,), (1, 2), (0, 1)):
        result = sy.identify(path, [recorded(model, tmp_path / "log.npz", held=held, position_noise=1e-5)])
        assert error_on(model, result.estimate.parameters, held=held) < 0.01
        assert result.total_mass < 30.0


def test_a_log_without_motion_is_refused(tmp_path):
    path = robot_file(tmp_path)
    model = sy.Model.load(path)
    with pytest.raises(sy.InputError, match=r"log.npz: no joint moves by more than the noise"):
        sy.identify(path, [recorded(model, tmp_path / "log.npz", held=range(6), position_noise=1e-5)])


def test_samples_with_rounding_for_velocities(tmp_path):
    """Samples that were made elsewhere: what rounding left of a joint at rest has a sign, which is no information."""
    model = sy.Model.load(robot_file(tmp_path))
    _, q, dq, ddq = motion(model, 1, held=(0,))
    random = np.random.default_rng(2)
    torque = model.inverse_dynamics(q, dq, ddq, true_parameters(model)) + 0.05 * random.normal(size=q.shape)
    clean = sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    dq[:, 0], ddq[:, 0] = 1e-13 * random.normal(size=len(q)), 1e-10 * random.normal(size=len(q))
    spoiled = sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque))
    assert spoiled.unidentifiable == clean.unidentifiable
    np.testing.assert_allclose(sy.least_squares(spoiled).base, sy.least_squares(clean).base, rtol=1e-9, atol=1e-12)


@pytest.mark.slow
def test_held_in_the_first_rows_alone(tmp_path, monkeypatch):
    """What is chosen by the first rows does not hold where the joint moves later."""
    path = robot_file(tmp_path)
    model = sy.Model.load(path)
    _, q, dq, ddq = motion(model, 1)
    late = np.clip((np.arange(len(q)) - 900) / RATE, 0.0, None)
    q[:, 0], dq[:, 0], ddq[:, 0] = 0.7 + 0.1 * late**2, 0.2 * late, 0.2 * (late > 0)
    torque = model.inverse_dynamics(q, dq, ddq, true_parameters(model))
    log = tmp_path / "late.npz"
    Recording(t=np.arange(len(q)) / RATE, q=q, torque=torque, source="late").save(log)
    monkeypatch.setattr(chunks, "CHOICE_ROWS", 800)
    result = sy.identify(path, [log], chunk_rows=1000)
    assert not any("does not move" in remark for remark in result.remarks)
    assert "Fvj1" not in result.information.unidentifiable


@pytest.mark.parametrize(
    ("q", "held"),
    [
        (lambda t, noise: np.sin(2 * np.pi * 40 * t), False),  # near half the sample rate: looks like noise
        (lambda t, noise: 3e-3 * np.sin(t), False),
        (lambda t, noise: 1e-3 * np.round(0.7e3 + 0.6 * np.sin(t)), True),  # between two counts
        (lambda t, noise: np.where(t < 9.99, 0.5, 0.5 + 1e-4), True),  # a single count
        (lambda t, noise: 0.5 + 3e-4 * noise, True),
        (lambda t, noise: 0.5 + 1.5e-3 * np.sin(0.7 * t) + 2e-5 * noise, True),  # gives way under load
        (lambda t, noise: 0.5 + 1.5e-3 * np.sin(30.0 * t) + 2e-5 * noise, False),  # moves, if not far
        (lambda t, noise: 0.5 + 3e-4 * noise + 0.01 * t, False),
    ],
)
def test_what_counts_as_held(q, held):
    t = np.arange(1000) / 100
    both = np.column_stack([q(t, np.random.default_rng(1).normal(size=t.size)), np.sin(t)])
    assert HeldJoints.of(Recording(t=t, q=both, torque=np.ones((1000, 2)))).mask.tolist() == [held, False]
