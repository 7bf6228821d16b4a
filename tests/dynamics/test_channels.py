"""Terms that need channels of a log, and the load of gravity: by formulas, and through samples and logs."""

import copy
import pickle

import numpy as np
import pytest

import steelyard as sy
from steelyard.dynamics import ChannelFriction, LoadFriction, term_from_dict
from steelyard.recording import Recording, process_chunks

WARM = ChannelFriction("temperature", range=[15.0, 60.0], reference=25.0)
LINK = sy.Inertia.from_com(mass=2.0, com=(0.2, 0.05, 0.0), about_com=np.eye(3) * 0.02)


def arm(*terms):
    links = {"link1": LINK, "link2": LINK}
    return sy.Model(sy.Robot.from_dh([("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q")], inertias=links).with_terms(*terms))


def values(model, **symbols):
    numbers = dict(zip(model.parameter_names, np.nan_to_num(model.robot.parameters), strict=True))
    return np.array(list((numbers | symbols).values()))


FRICTION = {"Fcj1": 2.0, "Fcsj1": -0.02, "Fvj1": 0.8, "Fvsj1": -0.01, "Fcj2": 1.0, "Fcsj2": 0.01, "Fvj2": 0.3}


def test_friction_is_that_of_the_temperature(random):
    model, bare = arm(WARM), arm()
    q, dq, ddq = random.normal(size=(3, 20, 2))
    warm = random.uniform(20.0, 50.0, (20, 2))
    parameters = values(model, **FRICTION)
    beyond = warm - 25.0
    friction = ([2.0, 1.0] + [-0.02, 0.01] * beyond) * np.sign(dq) + ([0.8, 0.3] + [-0.01, 0.0] * beyond) * dq
    expected = bare.inverse_dynamics(q, dq, ddq, values(bare)) + friction
    given = {"temperature": warm}
    np.testing.assert_allclose(model.inverse_dynamics(q, dq, ddq, parameters, channels=given), expected, atol=1e-12)
    np.testing.assert_allclose(model.drive_torque(dq, ddq, parameters, channels=given), friction, atol=1e-12)
    np.testing.assert_allclose(model.regressor(q, dq, ddq, channels=given) @ parameters, expected, atol=1e-12)
    one = model.inverse_dynamics(q[3], dq[3], ddq[3], parameters, channels={"temperature": warm[3]})
    np.testing.assert_allclose(one, expected[3], atol=1e-12)


@pytest.mark.slow
def test_a_copy_of_a_model_with_channels(random):
    model = arm(WARM)
    q, dq, ddq = random.normal(size=(3, 20, 2))
    given, parameters = {"temperature": random.uniform(20.0, 50.0, (20, 2))}, values(model, **FRICTION)
    expected = model.inverse_dynamics(q, dq, ddq, parameters, channels=given)
    for twin in (copy.deepcopy(model), pickle.loads(pickle.dumps(model))):
        found = twin.inverse_dynamics(q, dq, ddq, parameters, channels=given)
        assert found.tobytes() == expected.tobytes()
        with pytest.raises(sy.InputError, match="needs the channel 'temperature'"):
            twin.inverse_dynamics(q, dq, ddq, parameters)


def test_a_held_channel_and_forward_dynamics(random):
    model = arm(WARM)
    q, dq, ddq = random.normal(size=(3, 20, 2))
    parameters, given = values(model, **FRICTION), {"temperature": random.uniform(20.0, 50.0, (20, 2))}
    torque = model.inverse_dynamics(q, dq, ddq, parameters, channels=given)
    back = model.forward_dynamics(q, dq, torque, parameters, channels=given)
    np.testing.assert_allclose(back, ddq, atol=1e-9)
    shared = model.inverse_dynamics(q, dq, ddq, parameters, channels={"temperature": np.full(20, 40.0)})
    held = sy.Model(model.robot.with_terms(WARM.with_shape(held=40.0)))
    np.testing.assert_allclose(held.inverse_dynamics(q, dq, ddq, parameters), shared, atol=1e-12)


def test_samples_carry_channels(random):
    model = arm(WARM)
    q, dq, ddq = random.normal(size=(3, 90, 2))
    warm = random.uniform(20.0, 50.0, 90)
    parameters = values(model, **FRICTION)
    torque = model.inverse_dynamics(q, dq, ddq, parameters, channels={"temperature": warm})
    samples = sy.Samples(q=q, dq=dq, ddq=ddq, torque=torque, channels={"temperature": warm})
    parts = [samples.rows(0, 40), samples.rows(40, 90)]
    truth = model.base_parameters().values(parameters)
    for one in (samples, sy.Samples.joined(parts)):
        found = sy.least_squares(sy.Information.from_samples(model, one)).base
        np.testing.assert_allclose(found, truth, atol=1e-8)
    apart = [sy.Information.from_samples(model, part) for part in parts]
    np.testing.assert_allclose(sy.least_squares(apart[0] + apart[1]).base, truth, atol=1e-8)


@pytest.mark.slow
def test_a_log_is_read_and_processed_with_its_channels():
    """The temperature in the samples is that of the log at their times, whole and by chunks."""
    t = np.arange(0.0, 6.0, 0.005)
    log = {
        "t": t,
        "q1": np.sin(2 * t), "q2": np.cos(3 * t), "tau1": np.cos(t), "tau2": np.sin(t),
        "temp1": 20.0 + 2.0 * t, "temp2": 50.0 - 3.0 * t,
    }  # fmt: skip
    model = arm(WARM)
    columns = {"channels": {"temperature": "temp{}"}}
    options = sy.Processing(cutoff=8.0, decimate=(4,), trim=0.5, velocity_threshold=None)
    whole = Recording.read(log, columns, joints=2).process(options, model)
    assert whole.channels is not None
    expected = np.column_stack([20.0 + 2.0 * whole.t, 50.0 - 3.0 * whole.t])
    np.testing.assert_allclose(whole.channels["temperature"], expected, atol=1e-9)
    assert whole.regressor_model is model
    parts = list(process_chunks(log, columns, options, rows=500, joints=2, model=model))
    joined = sy.Samples.joined(parts)
    np.testing.assert_allclose(joined.channels["temperature"], expected, atol=1e-9)
    np.testing.assert_allclose(joined.regressor, whole.regressor, rtol=1e-6, atol=1e-8)
    torn = {name: np.delete(values, [400, 401]) for name, values in log.items()}
    uneven = Recording.read(torn, columns, joints=2).process(options, model)
    at = np.column_stack([20.0 + 2.0 * uneven.t, 50.0 - 3.0 * uneven.t])
    np.testing.assert_allclose(uneven.channels["temperature"], at, atol=1e-9)


def test_what_is_wrong_with_channels_is_said(random):
    model = arm(WARM)
    q, dq, ddq = random.normal(size=(3, 5, 2))
    for channels, phrase in (
        (None, "needs the channel 'temperature', which was not given: name its column in [log]"),
        ({"heat": np.zeros(5)}, "needs the channel 'temperature'"),
        ({"temperature": np.zeros(7)}, r"has shape (7,); expected (5,), or (5, 2)"),
        ({"temperature": np.full(5, 70.0)}, "from 70 to 70, beyond the range 15 to 60"),
        ({"temperature": np.full(5, np.nan)}, "is not finite in some rows"),
    ):
        with pytest.raises(sy.InputError) as caught:
            model.regressor(q, dq, ddq, channels=channels)
        assert phrase in str(caught.value)
    with pytest.raises(sy.InputError, match="needs the channel 'temperature'"):
        sy.Information.from_samples(model, sy.Samples(q=q, dq=dq, ddq=ddq, torque=q))
    with pytest.raises(sy.InputError, match=r"channel 'temperature' of Samples has shape \(4,\)"):
        sy.Samples(q=q, dq=dq, ddq=ddq, torque=q, channels={"temperature": np.zeros(4)})
    log = {"t": np.arange(9) / 100.0, **{name: np.arange(9) * 1.0 for name in ("q1", "q2", "tau1", "tau2")}}
    hot = {**log, "warm": np.full(9, 70.0)}
    recording = Recording.read(hot, {"channels": {"temperature": "warm"}}, joints=2)
    with pytest.raises(sy.InputError, match=f"^{recording.source}: The channel 'temperature' goes from 70 to 70"):
        recording.process(sy.Processing(cutoff=None, velocity_threshold=None), model)
    with pytest.raises(sy.InputError, match="no column 'warm'"):
        Recording.read(log, {"channels": {"temperature": "warm"}}, joints=2)


@pytest.mark.parametrize("power", [1.0, 2.0])
def test_the_load_is_the_torque_of_gravity(power, random):
    model, bare = arm(LoadFriction(power=power)), arm()
    q, dq, ddq = random.normal(size=(3, 20, 2))
    load = np.abs(bare.gravity(q, values(bare))) ** power
    friction = np.sign(dq) * ([1.0, 0.5] + [0.0, 0.1] * load) + dq * ([0.3, 0.2] + [0.0, 0.05] * load)
    named = {"Fcj1": 1.0, "Flj1": 0.2, "Fvj1": 0.3, "Fcj2": 0.5, "Flj2": 0.1, "Fvj2": 0.2, "Fvlj2": 0.05}
    parameters = values(model, **named)
    expected = bare.inverse_dynamics(q, dq, ddq, values(bare)) + friction
    np.testing.assert_allclose(model.inverse_dynamics(q, dq, ddq, parameters), expected, atol=1e-11)
    np.testing.assert_allclose(model.regressor(q, dq, ddq) @ parameters, expected, atol=1e-11)
    assert "Flj1" not in model.base_parameters().names
    assert "Flj2" in model.base_parameters().names


def test_conditions_hold_over_the_range():
    """Feasible if and only if friction is nonnegative at both ends of the range; loads from 0 to the largest."""
    for term, symbols, ends in (
        (WARM, ("Fcj", "Fcsj"), (-10.0, 35.0)),
        (LoadFriction(largest=30.0), ("Fcj", "Flj"), (0.0, 30.0)),
    ):
        for slope in (-0.3, -0.02, 0.0, 0.02, 0.3):
            friction = min(1.0 + slope * end for end in ends)
            least = min(
                sum({symbols[0]: 1.0, symbols[1]: slope}.get(s, 0.0) * m[0, 0] for s, m in one.coefficients.items())
                for one in term.conditions()
            )
            assert (least >= 0.0) == (friction >= 0.0)
    assert [one.name for one in LoadFriction().conditions()][:2] == ["Fcj >= 0", "Flj >= 0"]


def test_channel_terms_are_kept_and_refused():
    for term in (WARM, WARM.with_shape(held=30.0), LoadFriction(power=2.0, largest=20.0)):
        assert term_from_dict(term.to_dict()) == term
    bare = sy.Robot.from_dh([(0, 0.4, 0, "q")])
    with pytest.raises(sy.InputError, match="the inertia of link1 is not known"):
        bare.with_terms(LoadFriction())
    for section, phrase in (
        ({"kind": "friction_by_channel", "channel": "a b", "range": [0, 1]}, "a name of letters, digits and _"),
        ({"kind": "friction_by_channel", "channel": "heat", "range": [1, 0]}, "the least and the greatest"),
        ({"kind": "friction_by_load", "power": 3}, "must be 1 or 2"),
    ):
        with pytest.raises(sy.InputError) as caught:
            term_from_dict(section)
        assert phrase in str(caught.value)


def test_a_signal_is_held_within_its_range():
    with pytest.raises(sy.InputError, match="held of the channel 'temperature' is 70, beyond the range 15 to 60"):
        WARM.with_shape(held=70.0)
    with pytest.raises(sy.InputError, match="reference of the channel 'temperature' is 0, beyond the range 15 to 60"):
        ChannelFriction("temperature", range=[15, 60])
    with pytest.raises(sy.InputError, match="needs the channel 'temperature', which was not given"):
        WARM.columns(0, [0.0], [1.0], [0.0], np)
    with pytest.raises(sy.InputError, match=r"The held of .* must be one number, got \[20, 30\]"):
        WARM.with_shape(held=[20, 30])


def test_loads_by_moments_are_those_of_links_with_these_moments():
    moments = [0.0, 0.0, 0.0, 0.0, 1.5, 0.2, 0.0, 3.0]
    rows = [("pi/2", 0, 0.3, "q"), (0, 0.4, 0, "q")]
    robot = sy.Robot.from_dh(rows)  # without inertias
    model, bare = sy.Model(robot.with_terms(LoadFriction(moments=moments))), sy.Model(robot)
    values = dict.fromkeys(bare.parameter_names, 0.0) | {"lx2": 1.5, "ly2": 0.2, "m2": 3.0}
    q, dq = np.random.default_rng(0).uniform(-2.0, 2.0, (2, 50, 2))
    load = np.abs(bare.gravity(q, [values[name] for name in bare.parameter_names]))
    delta = [{"Flj2": 0.1}.get(name, 0.0) for name in model.parameter_names]
    expected = 0.1 * load * np.sign(dq) * [0.0, 1.0]
    np.testing.assert_allclose(model.inverse_dynamics(q, dq, 0.0 * q, delta), expected, atol=1e-12)
    with pytest.raises(sy.InputError, match="four numbers for each of the 2 links"):
        robot.with_terms(LoadFriction(moments=[1.0]))
