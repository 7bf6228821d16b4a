"""What the data decides, on arms whose true motion, noise and friction are known."""

import numpy as np
import pytest
from scipy import signal

import steelyard as sy
from steelyard.recording import Processing, Recording, decide
from steelyard.recording.cutoff.by_spectra import noise_share
from steelyard.recording.cutoff.by_torques import TorqueFit

RATE, COULOMB, TURN = 500.0, np.array([3.0, 1.5]), 0.02


@pytest.fixture(scope="module")
def arm() -> tuple[sy.Model, np.ndarray]:
    robot = sy.Robot.from_dh([(0, 0.4, 0, "q"), (0, 0.3, 0, "q")], gravity=(0, -9.81, 0))
    model = sy.Model(robot.with_terms(sy.Viscous(), sy.Coulomb()))
    link = [0.02, 0.0, 0.0, 0.3, 0.0, 0.3, 0.4, 0.0, 0.0, 2.0]
    return model, np.array([*link, 1.0, COULOMB[0], *link, 0.5, COULOMB[1]])


def motion(seed: int, seconds: float, top: float) -> tuple[np.ndarray, ...]:
    random = np.random.default_rng(seed)
    t = np.arange(round(seconds * RATE)) / RATE
    w = 2 * np.pi * top * np.array([[0.3, 0.7, 1.0], [0.45, 0.6, 0.9]]).T
    size, phase = random.uniform(0.4, 1.0, (2, 3, 2)) * np.array([1.0, 6.28])[:, None, None]
    size = size / w
    angle = w * t[:, None, None] + phase
    return tuple((size * w**n * np.sin(angle + n * np.pi / 2)).sum(axis=1) for n in range(3))


def log(arm, seed: int, noise: float, seconds: float = 10.0, top: float = 0.6, turn: float = TURN) -> Recording:
    """An arm whose friction turns its sign over `turn` rad/s; torques with a noise of 1 %."""
    model, parameters = arm
    q, dq, ddq = motion(seed, seconds, top)
    torque = model.inverse_dynamics(q, dq, ddq, parameters) + COULOMB * (np.tanh(dq / turn) - np.sign(dq))
    random = np.random.default_rng(100 + seed)
    torque += 0.01 * torque.std(axis=0) * random.normal(size=q.shape)
    t = np.arange(len(q)) / RATE
    return Recording(t=t, q=q + noise * random.normal(size=q.shape), torque=torque)


def error(arm, information: sy.Information) -> float:
    """Of the torque of another motion, against the true model."""
    model, parameters = arm
    other = motion(50, 10.0, 0.6)
    true = model.inverse_dynamics(*other, parameters)
    found = model.inverse_dynamics(*other, model.base_parameters().Pb @ sy.least_squares(information).base)
    return float(np.linalg.norm(found - true) / np.linalg.norm(true))


def processed(arm, recording: Recording, **options) -> sy.Information:
    samples = recording.process(Processing.from_dict(options), arm[0])
    return sy.Information.from_samples(arm[0], samples)


@pytest.mark.parametrize("noise", [*(pytest.param(noise, marks=pytest.mark.slow) for noise in (1e-5, 1e-4)), 1e-3])
def test_default_is_as_good_as_the_best_by_hand(arm, noise):
    recording = log(arm, 1, noise)
    by_hand = min(
        error(arm, processed(arm, recording, cutoff=cutoff, trim=0.8, velocity_threshold=0.08))
        for cutoff in (2.0, 4.0, 8.0, 16.0, 32.0)
    )
    found = error(arm, processed(arm, recording))
    assert found < 1.5 * by_hand + 2e-4
    assert found < 2e-3


def test_neither_ends_nor_rows_near_rest_spoil_the_default(arm):
    recording = log(arm, 2, 1e-4)
    good = error(arm, processed(arm, recording))
    assert error(arm, processed(arm, recording, trim=0.0)) > 2.0 * good
    assert error(arm, processed(arm, recording, velocity_threshold="none")) > 2.0 * good


def test_threshold_is_where_friction_turns(arm):
    recording = log(arm, 3, 1e-5, seconds=30.0)
    found = decide(Processing(), [recording], arm[0])
    assert found.thresholds is not None
    assert found.thresholds.sticking.all()
    # Within it 2 % of the friction lack at least, and beyond it at most 12 %.
    assert np.all((found.thresholds.thresholds > TURN) & (found.thresholds.thresholds < 5.0 * TURN))
    assert "joint 'joint1', joint 'joint2' show less friction" in found.remarks[1]
    assert found.processing.velocity_threshold == tuple(found.thresholds.thresholds)
    sharp = decide(Processing(), [log(arm, 3, 1e-5, seconds=30.0, turn=1e-6)], arm[0])
    assert sharp.thresholds is not None
    assert not sharp.thresholds.sticking.any()
    np.testing.assert_allclose(sharp.thresholds.thresholds, 3.0 * sharp.thresholds.noise)
    assert sharp.near_rest == sharp.processing


def test_rows_near_rest_are_those_where_the_sign_of_the_velocity_is_certain(arm):
    recording = log(arm, 3, 1e-5, seconds=30.0)
    found = decide(Processing(), [recording], arm[0])
    usual, near_rest = (recording.process(one, arm[0]) for one in (found.processing, found.near_rest))
    rows = np.round(near_rest.t * RATE).astype(int)
    slow = near_rest.mask & ~usual.mask
    assert np.all(slow.sum(axis=0) > 50)
    true = motion(3, 30.0, 0.6)[1][rows]
    assert np.mean(np.sign(near_rest.dq[slow]) == np.sign(true[slow])) > 0.999
    stated = decide(Processing(velocity_threshold=0.05), [recording], arm[0])
    assert stated.near_rest == stated.processing


def one_at_a_time(arm, seed: int, seconds: float = 30.0, turn: float = 1e-3) -> tuple[Recording, np.ndarray]:
    """Joints that move one after the other, from rest to rest in 1.2 s, and wait; with the true velocities (S, N)."""
    model, parameters = arm
    random = np.random.default_rng(seed)
    t = np.arange(round(seconds * RATE)) / RATE
    q, dq, ddq = np.zeros((3, len(t), 2))
    begin, place, joint = 0.0, np.zeros(2), 0
    while begin < seconds:
        goal = random.uniform(-1.5, 1.5)
        s = np.clip((t - begin) / 1.2, 0.0, 1.0)
        moves = (t >= begin) & (t < begin + 1.2)
        way = goal - place[joint]
        q[t >= begin, joint] = place[joint] + way * np.polyval([6, -15, 10, 0, 0, 0], s[t >= begin])
        dq[moves, joint] = way * np.polyval([30, -60, 30, 0, 0], s[moves]) / 1.2
        ddq[moves, joint] = way * np.polyval([120, -180, 60, 0], s[moves]) / 1.2**2
        place[joint], begin, joint = goal, begin + 1.5, 1 - joint
    torque = model.inverse_dynamics(q, dq, ddq, parameters) + COULOMB * (np.tanh(dq / turn) - np.sign(dq))
    torque += 0.01 * torque.std(axis=0) * random.normal(size=q.shape)
    return Recording(t=t, q=np.round(q, 7), torque=torque), dq


def test_rows_in_which_a_joint_waits_are_left_out(arm):
    """What a filter leaves of a motion that has ended is no velocity, whatever its sign; no noise says so."""
    recording, dq = one_at_a_time(arm, 1)
    found = decide(Processing(), [recording], arm[0])
    assert found.thresholds.resting.all()
    samples = recording.process(found.processing, arm[0])
    rows = np.round(samples.t * RATE).astype(int)
    waits = np.abs(dq[rows]) < 1e-3
    assert not np.any(samples.mask & waits & (np.abs(samples.dq) < 0.02 * samples.dq.std(axis=0)))
    assert np.mean(samples.mask[np.abs(dq[rows]) > 0.1]) > 0.99
    assert "may be at rest" in found.thresholds.reason or found.thresholds.sticking.all()
    # Friction that is found is the true one; with the rows at rest it is off by a third.
    base = sy.least_squares(sy.Information.from_samples(arm[0], samples))
    told = dict(zip(base.base_expressions, base.base, strict=True))
    assert [told["Fcj1"], told["Fcj2"]] == pytest.approx(COULOMB, rel=0.03)


def test_where_nothing_turns_with_the_velocity_rows_at_rest_are_kept(arm):
    model = sy.Model(arm[0].robot.with_terms(sy.Viscous()))
    recording, _ = one_at_a_time((arm[0], arm[1] * ~np.isin(arm[1], COULOMB)), 2, turn=1e9)
    found = decide(Processing(), [recording], model)
    assert not found.thresholds.resting.any()
    # A joint that only turns, and does not wait, comes to no rest.
    assert not decide(Processing(), [log(arm, 3, 1e-5)], arm[0]).thresholds.resting.any()


def test_rows_in_motion_tell_no_torque_of_another_place(arm):
    """A fit of rows with the second joint at one angle says any torque, 1e9 N·m say, where it stands at another."""
    model, parameters = arm
    t = np.arange(0.0, 8.0, 0.01)
    q, dq, ddq = (np.column_stack([np.sin(2 * t + n * np.pi / 2) * 2**n, np.zeros_like(t)]) for n in range(3))
    q[:, 1] = np.where(t < 4.0, 0.3, 1.2)
    torque = model.inverse_dynamics(q, dq, ddq, parameters)
    samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque + 1e-3 * np.random.default_rng(1).normal(size=q.shape))
    fit, rows = TorqueFit(model), np.arange(len(t))
    fit.add(samples, rows[:400], np.ones((400, 2), dtype=bool))
    predicted = fit.predicted(samples, rows, fit.fitted()[0])
    told = np.isfinite(predicted)
    assert told[:400].all()
    assert 0 < np.count_nonzero(told[400:]) < 800
    np.testing.assert_allclose(predicted[told], torque[told], atol=0.01)


def test_noise_of_the_velocity_is_the_true_one(arm):
    recording = log(arm, 4, 1e-3)
    found = decide(Processing(cutoff=8.0), [recording], arm[0])
    samples = recording.process(cutoff=8.0, velocity_threshold=None)
    _, dq, _ = motion(4, 10.0, 0.6)
    rows = np.round(samples.t * RATE).astype(int)
    assert found.thresholds is not None
    np.testing.assert_allclose((samples.dq - dq[rows]).std(axis=0), found.thresholds.noise, rtol=0.25)


def test_a_joint_that_is_always_slow_keeps_its_rows(arm):
    model, parameters = arm
    q, dq, ddq = (part * np.array([1.0, 1e-3]) for part in motion(5, 10.0, 0.6))
    torque = model.inverse_dynamics(q, dq, ddq, parameters)
    random = np.random.default_rng(1)
    recording = Recording(
        t=np.arange(len(q)) / RATE,
        q=q + 1e-3 * random.normal(size=q.shape),
        torque=torque + 0.01 * torque.std(axis=0) * random.normal(size=q.shape),
    )
    samples = recording.process(Processing(), model)
    assert np.all(samples.used > 0.7 * samples.count)


def test_one_cutoff_for_all_logs(arm, tmp_path):
    """A short calm log and a fast one share what all of them show; the order of the logs plays no part."""
    logs = [log(arm, 6, 1e-4, top=0.3), log(arm, 7, 1e-4, top=1.5)]
    both = decide(Processing(), logs, arm[0])
    other = decide(Processing(), logs[::-1], arm[0])
    assert both.processing.cutoff == pytest.approx(other.processing.cutoff, rel=1e-6)
    assert both.cutoff_choice is not None
    # The fast one has motion up to 1.5 Hz, and needs twice that at least.
    assert both.processing.cutoff > 3.0
    assert "2 logs" in both.remarks[0]


def test_rows_too_few_decide_nothing(arm):
    few = Recording(t=np.arange(40) / RATE, q=np.sin(np.arange(80.0)).reshape(40, 2), torque=np.ones((40, 2)))
    assert decide(Processing(cutoff=8.0), [few], arm[0]).processing.velocity_threshold is None
    with pytest.raises(sy.InputError, match="too few to choose a cutoff"):
        decide(Processing(), [few], arm[0])


def test_evidence_can_be_looked_at(arm):
    choice = decide(Processing(), [log(arm, 1, 1e-4)], arm[0]).cutoff_choice
    assert choice is not None
    assert [len(row) for row in choice.table] == 2 * [len(choice.titles)]
    assert [trace["name"] for trace in choice.figure()["data"]] == ["joint 1", "joint 2", "all"]
    # Each joint by itself would choose the candidate with the least error of its own.
    least = [choice.candidates[np.argmin(errors)] for errors in choice.joint_errors.T]
    np.testing.assert_array_equal(choice.joint_cutoffs, least)
    np.testing.assert_allclose(choice.error, np.exp(np.log(choice.joint_errors).mean(axis=1)))
    assert f"{choice.cutoff:.4g} Hz" in choice._repr_html_()


@pytest.mark.slow
def test_noise_that_a_controller_answers_is_not_taken_for_motion(arm):
    """A slow motion with coarse encoders: torques answer their noise, and fit it best where the filter lets it pass."""
    model, parameters = arm
    random = np.random.default_rng(3)
    a, b = 0.25 * random.normal(size=(2, 2, 4))
    series = sy.excitation.FourierTrajectory(a=a, b=b, center=np.zeros(2), frequency=0.05)
    sensors = sy.simulation.Sensors(encoder_resolution=2 * np.pi / 2**16, torque_noise=0.05)
    played = sy.play(model, parameters, series, sensors=sensors, seed=1)
    recording = Recording(t=played.t[::4], q=played.q[::4], torque=played.torque[::4])
    choice = decide(Processing(cutoff="auto"), [recording], model).cutoff_choice
    assert "noise of the positions" in choice.remark
    decision = decide(Processing(cutoff="auto", velocity_threshold="auto"), [recording], model)
    # What is said of a key is found by the key, not by its words.
    assert decision.reasons["cutoff"] == choice.reason
    least = np.exp(np.log(choice.joint_errors).mean(axis=1)).min()  # another error than that of all torques in all rows
    assert f"the mean error of joints in fast motion, {100 * least:.3g} %, is least at" in choice.reason
    assert decision.remarks[0] == f"{choice.reason}; set `cutoff` in [processing] to choose."
    assert decision.reasons.keys() == {"cutoff", "velocity_threshold"}
    assert decision.remarks[1].startswith(decision.reasons["velocity_threshold"])
    base = model.base_parameters()
    inertias = [k for k, name in enumerate(base.names) if name.startswith("Lzz")]

    def wrong(cutoff):
        found = sy.least_squares(processed(arm, recording, cutoff=cutoff)).base
        return np.abs(found[inertias] / base.values(parameters)[inertias] - 1.0)

    assert len(inertias) == 2
    assert wrong("auto").max() < 0.25
    assert wrong(46.0).min() > 0.5


@pytest.mark.parametrize("held", [False, True])
def test_one_coarse_encoder_limits_the_cutoff(held):
    """Two fine encoders and a coarse one: noisy torques hide what its noise does to the answer, intervals do not."""
    robot = sy.Robot.from_dh([(0, 0.4, 0, "q"), (0, 0.3, 0, "q"), (0, 0, "q", 0)], gravity=(0, -9.81, 2.0))
    model = sy.Model(robot.with_terms(sy.Viscous(), sy.RotorInertia()))
    link = np.array([0.02, 0.0, 0.0, 0.3, 0.0, 0.3, 0.4, 0.0, 0.0, 2.0])
    parameters = np.concatenate([[*link, 1.0, 0.2], [*link, 0.5, 0.1], [*0.5 * link, 20.0, 1.0]])
    random = np.random.default_rng(7)
    t = np.arange(30_000) / RATE
    speed = 2 * np.pi * 0.1 * np.arange(1, 6)
    a, b = random.normal(size=(2, 5, 3)) * np.array([0.4, 0.4, 0.0 if held else 0.04])
    phase = np.outer(t, speed)
    q = np.sin(phase) @ a + np.cos(phase) @ b
    dq = (speed * np.cos(phase)) @ a - (speed * np.sin(phase)) @ b
    ddq = -(speed**2 * np.sin(phase)) @ a - (speed**2 * np.cos(phase)) @ b
    torque = model.inverse_dynamics(q, dq, ddq, parameters)
    torque += 0.3 * torque.std(axis=0) * random.normal(size=q.shape)
    noisy = q + np.array([1e-6, 1e-6, 3e-5]) * random.normal(size=q.shape)
    recording = Recording(t=t, q=noisy, torque=torque)
    decision = decide(Processing(cutoff="auto"), [recording], model)
    if held:  # A joint that only trembles has no inertia to show, and must not blur the motion of the others.
        assert decision.processing.cutoff > 40.0
        return
    samples = recording.process(decision.processing, model)
    found = sy.least_squares(sy.Information.from_samples(model, samples), weights="joint")
    wrong = (found.base - model.base_parameters().values(parameters)) / found.standard_error
    assert np.abs(wrong).max() < 4.0
    assert "noise of the positions" in decision.cutoff_choice.remark


def test_share_of_noise_is_the_true_one():
    random = np.random.default_rng(4)
    t = np.arange(20_000) / RATE
    q = np.sin(2 * np.pi * 0.4 * t)[:, None] * [1.0, 0.5]
    noise = 1e-4 * random.normal(size=q.shape)
    cutoffs = [10.0, 20.0, 40.0]
    share = noise_share(q + noise, RATE, cutoffs)
    for cutoff, told in zip(cutoffs, share, strict=True):
        gain = signal.butter(3, cutoff, fs=RATE, output="sos")
        left, moved = (
            np.gradient(np.gradient(signal.sosfiltfilt(gain, x, axis=0), 1 / RATE, axis=0), 1 / RATE, axis=0)[500:-500]
            for x in (noise, q + noise)
        )
        np.testing.assert_allclose(told, (left**2).mean(axis=0) / (moved**2).mean(axis=0), rtol=0.15)
    still = noise_share(np.column_stack([q[:, 0], np.full(len(q), 0.3)]), RATE, cutoffs)
    assert np.isfinite(still[:, 0]).all()
    assert np.isnan(still[:, 1]).all()
