"""Dahl's and LuGre's friction as terms: their state beside SciPy's integration, their passivity, and what logs tell."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import steelyard as sy
from steelyard.dynamics import ByJoint, Dahl, LuGre, Viscous, term_from_dict
from steelyard.dynamics.bristles import bristle_states
from steelyard.identification.mistakes import find_mistakes
from steelyard.recording import Processing, Recording, chunks, process_chunks
from steelyard.recording.diagnosis import estimate_delay

D, RATIO, SPEED = 0.02, 0.5, 0.1
RATES, SIZES = np.array([0.9, 2.1, 3.4]), np.array([0.6, 0.4, 0.2])
PENDULUM = sy.Robot.from_dh([(0, 0.5, 0, "q")], gravity=(0, -9.81, 0), name="pendulum")


def motion(t):
    phase = np.multiply.outer(t, RATES)
    return np.sin(phase) @ SIZES, np.cos(phase) @ (SIZES * RATES), -np.sin(phase) @ (SIZES * RATES**2)


def speed(t):
    """The speed of `motion` at one time, without arrays."""
    return sum(size * rate * math.cos(rate * t) for size, rate in zip(SIZES.tolist(), RATES.tolist(), strict=True))


def integrated(t, ratio=RATIO, displacement=D, speed_of=speed):
    """The state of the bristles by SciPy, from zero."""

    def slope(time, state):
        v, u = speed_of(float(time)), float(state[0])
        return [(v - abs(v) * u / (1.0 + ratio * math.exp(-((v / SPEED) ** 2)))) / displacement]

    found = solve_ivp(slope, (t[0], t[-1]), [0.0], t_eval=t, rtol=1e-9, atol=1e-11, max_step=0.01)
    return found.y[0]


@pytest.mark.parametrize("ratio", [0.0, RATIO])
def test_the_state_along_a_motion_is_that_of_the_differential_equation(ratio):
    t = np.arange(6000) / 1000.0
    q, dq, _ = (one[:, None] for one in motion(t))
    found = bristle_states(q, dq, [D], [ratio], [SPEED])
    expected = integrated(t, ratio)
    assert np.ptp(expected) > 1.99  # it slides to both sides
    np.testing.assert_allclose(found.states[:, 0], expected, atol=1e-3)
    slope = np.gradient(expected, t)
    np.testing.assert_allclose(found.rates[10:, 0], (D * slope)[10:], atol=5e-3)
    other = bristle_states(q, dq, [D], [ratio], [SPEED], first=[0.5]).states
    np.testing.assert_allclose(other[:, 0], found.states[:, 0] + 0.5 * found.weights[:, 0], atol=1e-12)


def work(damping, viscous):
    """What a joint takes in: bristles that are bent slowly, and then a fast motion by a displacement."""
    slow, fast, friction = 1e-3, 500.0, 1.0
    parts, begin = [], 0.0
    for v, distance in ((slow, 5.0 * D), (fast, 0.69 * D)):
        bound = 1.0 + RATIO * np.exp(-((v / SPEED) ** 2))

        def slope(_, y, v=v, bound=bound):
            rate = v - v * y[0] / bound
            return [rate / D, (friction * y[0] + damping * rate + viscous * v) * v]

        found = solve_ivp(slope, (0.0, distance / v), [begin, 0.0], rtol=1e-9, atol=1e-12)
        begin = found.y[0, -1]
        parts.append(found.y[1, -1])
    return sum(parts)


def test_friction_dissipates_exactly_where_the_condition_holds():
    term = LuGre(D, RATIO, SPEED)
    for damping, viscous in ((1.0, 0.5), (1.0, 0.25), (2.0, 1.1), (2.0, 0.4)):
        values = {"Fcj": 1.0, "Fbj": damping, "Fvj": viscous}
        least = min(
            float(sum(values[symbol] * matrix[0, 0] for symbol, matrix in condition.coefficients.items()))
            for condition in term.conditions_at(0)
        )
        assert (least >= 0.0) == (work(damping, viscous) > 0.0), (damping, viscous)


def log_of(t, ratio, friction, damping, viscous, noise=0.0):
    q, dq, ddq = motion(t)
    u = integrated(t, ratio)
    rate = dq - np.abs(dq) * u / (1.0 + ratio * np.exp(-((dq / SPEED) ** 2)))
    torque = 0.8 * ddq + 5.0 * np.cos(q) + friction * u + damping * rate + viscous * dq
    torque = torque + noise * np.random.default_rng(1).normal(size=len(t))
    return tuple(one[:, None] for one in (q, dq, ddq, torque))


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.0, RATIO])
def test_a_log_tells_the_friction(ratio):
    t = np.arange(20000) / 1000.0
    damping = 1.0 if ratio else 0.0
    q, _, _, torque = log_of(t, ratio, 2.0, damping, 0.7, 0.02)
    terms = (LuGre(D, RATIO, SPEED),) if ratio else (Dahl(D), Viscous())
    model = sy.Model(PENDULUM.with_terms(*terms))
    recording = Recording(t=t, q=q, torque=torque)
    samples = recording.process(model=model, cutoff=20.0)
    assert any("before presliding friction is known" in remark for remark in samples.remarks)
    info = sy.Information.from_samples(model, samples)
    found = dict(zip(model.base_parameters().expressions, sy.least_squares(info).base, strict=True))
    for name, value in {"Fcj1": 2.0, "Fvj1": 0.7, **({"Fbj1": 1.0} if ratio else {})}.items():
        assert found[name] == pytest.approx(value, rel=0.05), name


@pytest.mark.slow
def test_parameters_with_which_friction_would_drive_are_refused():
    t = np.arange(6000) / 200.0
    samples = sy.Samples(*log_of(t, RATIO, 2.0, 1.0, 0.2), t=t)
    model = sy.Model(PENDULUM.with_terms(LuGre(D, RATIO, SPEED)))
    info = sy.Information.from_samples(model, samples)
    feasible = sy.FeasibleSet(model)
    assert sy.check(feasible, base=sy.least_squares(info).base).status != "feasible"
    found = dict(zip(model.parameter_names, sy.fit(info, feasible).parameters, strict=True))
    assert found["Fvj1"] >= RATIO * found["Fbj1"] * (1.0 - 1e-6)


@pytest.mark.slow
def test_a_log_in_pieces_and_sections_has_the_states_of_the_whole(tmp_path, monkeypatch):
    monkeypatch.setattr(chunks, "PIECE_ROWS", 2000)
    monkeypatch.setattr(chunks, "SECTION_ROWS", 4000)
    t = np.arange(16000) / 100.0
    clock = np.clip(t, 0.0, 30.0) + np.clip(t - 90.0, 0.0, None)  # at rest for a minute, over several pieces
    q = np.column_stack([motion(clock)[0], 0.7 * motion(1.3 * clock)[0]])
    robot = sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.5, 0, "q")], gravity=(0, -9.81, 0))
    laws = ByJoint([LuGre(D, RATIO, SPEED, joints=[1]), Dahl([1.0, 0.05], joints=[2]), Viscous()])
    model = sy.Model(robot.with_terms(laws))
    t = np.where(np.arange(len(t)) < 12000, t, t + 5.0)  # a gap
    recording = Recording(t=t, q=q, torque=np.ones_like(q) + np.sin(q))
    recording.save(tmp_path / "log.npz")
    for options in ({"cutoff": 5.0}, {"cutoff": 5.0, "torque_cutoff": 8.0, "decimate": 2}):
        processing = Processing.from_dict({**options, "longest_gap": 0.5}, "test")
        whole = recording.process(processing, model)
        parts = list(process_chunks(tmp_path / "log.npz", processing=processing, model=model))
        joined = sy.Samples.joined(parts)
        np.testing.assert_array_equal(joined.mask, whole.mask)
        np.testing.assert_allclose(joined.channels["presliding"], whole.channels["presliding"], atol=1e-8)
        np.testing.assert_allclose(joined.regressor, whole.regressor, atol=1e-6)
    opened = chunks.OpenedLog(chunks.LogStream(str(tmp_path / "log.npz"), None, None), processing, model, None)
    assert opened.sections > 2
    third = [part.channels["presliding"] for part in opened.samples(2, chunks.SeenRows())]
    again = [part.channels["presliding"] for part in opened.samples(2, chunks.SeenRows())]
    assert all((a == b).all() for a, b in zip(third, again, strict=True))


@pytest.mark.slow
def test_samples_begin_anew_behind_a_gap():
    t = np.arange(4000) / 100.0
    q, dq, ddq, torque = log_of(t, 0.0, 2.0, 0.0, 0.7)
    model = sy.Model(PENDULUM.with_terms(Dahl(D), Viscous()))
    gap = np.where(np.arange(len(t)) < 2000, t, t + 1.0)
    samples = sy.Samples(q, dq, ddq, torque, t=gap).with_presliding(model)
    first, second = (np.flatnonzero(~samples.mask[half, 0]) for half in (slice(2000), slice(2000, None)))
    for lost, start in ((first, 0), (second, 2000)):
        assert lost.tolist() == list(range(len(lost)))
        path = np.abs(np.diff(q[start : start + len(lost) + 1, 0])).sum()
        assert path == pytest.approx(D * np.log(100.0), rel=0.15)
    given = sy.Samples(q, dq, ddq, torque, channels={"presliding": np.sign(dq)})
    assert given.with_presliding(model) is given


def test_states_are_asked_for_where_they_are_missing():
    model = sy.Model(PENDULUM.with_terms(Dahl(D)))
    one, numbers = np.zeros((3, 1)), np.zeros(model.parameter_count)
    numbers[-1] = 2.0
    with pytest.raises(sy.InputError, match=r"model\.presliding\(q, dq\)"):
        model.inverse_dynamics(one, one, one, numbers)
    with pytest.raises(sy.InputError, match="break away at 1"):
        model.inverse_dynamics(one, one, one, numbers, channels={"presliding": one + 1.2})
    torque = model.inverse_dynamics(one, one, one, numbers, channels={"presliding": one - 0.4})
    np.testing.assert_allclose(torque, -0.8)
    assert model.drives(numbers).friction.tolist() == [2.0]
    still = model.without_channels.inverse_dynamics(one, one - 0.1, one, numbers)
    np.testing.assert_allclose(still, -2.0)
    filtered = sy.Samples(one, one, one, one, filtered_torque=True)
    with pytest.raises(sy.InputError, match=r"Recording\.process"):
        filtered.with_presliding(model)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"kind": "dahl"}, "displacement"),
        ({"kind": "dahl", "displacement": 0.0}, "must be positive"),
        ({"kind": "dahl", "displacement": 0.1, "sliding": "yes"}, "must be true or false"),
        ({"kind": "lugre", "displacement": 0.1, "ratio": -0.1, "velocity": 0.1}, "must not be negative"),
        ({"kind": "friction_by_channel", "channel": "presliding", "range": [-1.0, 1.0]}, "another name"),
    ],
)
def test_numbers_that_no_bristle_has_are_refused(table, said):
    with pytest.raises(sy.InputError, match=said):
        term_from_dict(table)


def test_each_joint_has_the_condition_of_its_own_ratio():
    robot = sy.Robot.from_dh([(0, 0.5, 0, "q"), (0, 0.5, 0, "q")])
    term = LuGre(D, [0.2, 0.8], SPEED)
    model = sy.Model(robot.with_terms(ByJoint([term, Viscous()])))
    names = [block.name for block in model.conditions() if "Fbj" in block.name and "Fvj" in block.name]
    assert names == ["Fvj - 0.2 Fbj >= 0 at joint1", "Fvj - 0.8 Fbj >= 0 at joint2"]
    assert term_from_dict(term.to_dict()) == term


@cache
def long_log():
    t = np.arange(8000) / 200.0
    q, _, _, torque = log_of(t, RATIO, 2.0, 0.5, 0.7, 0.02)
    return t, q, torque


def late_log(shift):
    t, q, torque = long_log()
    return Recording(t=t.copy(), q=q.copy(), torque=np.interp(t - shift, t, torque[:, 0])[:, None])


def test_a_law_that_another_stands_for_asks_nothing_of_the_states():
    arm = sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q")])
    model = sy.Model(arm.with_terms(ByJoint([LuGre(D, RATIO, SPEED, joints=[1]), Dahl(D)])))
    t = np.arange(400)[:, None] / 200.0
    q, dq = np.sin([1.0, 1.3] * t), [1.0, 1.3] * np.cos([1.0, 1.3] * t)
    states = model.presliding(q, dq)
    assert states[:, 0].max() > 1.01  # LuGre's bristles break away above Coulomb friction, Dahl's at it
    columns = model.regressor(q, dq, 0.0 * q, channels={"presliding": states})
    np.testing.assert_array_equal(columns[:, 0, model.parameter_names.index("Fcj1")], states[:, 0])
    with pytest.raises(sy.InputError, match="term 'dahl' break away at 1"):
        model.regressor(q, dq, 0.0 * q, channels={"presliding": states[:, ::-1]})


@pytest.mark.slow
def test_what_the_data_decides_is_decided_with_the_state():
    model = sy.Model(PENDULUM.with_terms(LuGre(D, RATIO, SPEED)))
    samples = late_log(0.0).process(model=model)
    assert samples.cutoff > 5.0  # of motions up to 0.54 Hz
    assert not any("less friction than faster motion" in remark for remark in samples.remarks)
    found = estimate_delay(late_log(0.02).process(cutoff=15.0), model)
    assert found.delay == pytest.approx(0.02, abs=0.0025)  # half a row
    assert found.standard_deviation < 0.0025


@pytest.mark.slow
def test_friction_that_remembers_is_no_mistake_of_a_log():
    model = sy.Model(PENDULUM.with_terms(LuGre(D, RATIO, SPEED)))
    samples = late_log(0.0).process(model=model, cutoff=15.0)
    assert find_mistakes(model, samples) == ()
    wrong = find_mistakes(model, replace(samples, torque=-samples.torque))
    assert wrong[0].kind == "torque sign"
    assert wrong[0].error_after < 0.01


@pytest.mark.slow
def test_the_state_of_a_log_is_that_of_the_model_it_is_used_with():
    short, long = (sy.Model(PENDULUM.with_terms(Dahl(d), Viscous())) for d in (D, 10.0 * D))
    recording = late_log(0.0)
    of_short, of_long = (recording.process(model=model, cutoff=15.0) for model in (short, long))
    again = of_short.with_presliding(long).channels["presliding"]
    np.testing.assert_allclose(again[-500:], of_long.channels["presliding"][-500:], atol=1e-6)
    assert np.abs(again - of_short.channels["presliding"]).max() > 0.1
    assert of_short.with_presliding(sy.Model(PENDULUM.with_terms(Dahl(D)))) is of_short
    plain = recording.process(cutoff=15.0)
    of_one, of_other = (plain.with_presliding(model) for model in (short, long))
    np.testing.assert_array_equal(of_one.with_presliding(long).channels["presliding"], of_other.channels["presliding"])
    assert of_one.with_presliding(short) is of_one
    assert sy.Samples.joined([of_one, of_other]).channels is None
    assert sy.Samples.joined([of_one, of_one]).with_presliding(short).bristles is of_one.bristles
    filtered = recording.process(model=short, cutoff=15.0, torque_cutoff=15.0)
    with pytest.raises(sy.InputError, match=r"Recording\.process"):
        filtered.with_presliding(long)


@pytest.mark.slow
def test_a_joint_that_moves_too_little_to_tell_its_state_is_said():
    model = sy.Model(PENDULUM.with_terms(Dahl(1000.0)))
    with pytest.raises(sy.InputError, match=r"before presliding friction is known: [0-9]+ of joint 1"):
        late_log(0.0).process(model=model, cutoff=15.0)
