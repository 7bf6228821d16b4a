"""Laws that differ from joint to joint: their torques against formulas, their conditions, their form in robot.toml."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.dynamics import (
    ByJoint,
    ChannelFriction,
    Cogging,
    Coulomb,
    PiecewiseFriction,
    Spring,
    Stribeck,
    Viscous,
    term_from_dict,
)

ROWS = [("pi/2", 0, 0.3, "q"), (0, 0.5, 0, "q"), (0, 0.4, 0, "q")]
LAWS = [
    Stribeck(velocity=[0.1, 0.2, 0.3], joints=[1]),
    PiecewiseFriction([0.5, 2.0], joints=[2]),
    Spring(joints=[3]),
    Cogging([6], joints=[1]),
    Cogging([9], joints=[3]),
    Coulomb(),
    Viscous(),
]


def test_torques_are_those_of_each_joint():
    model = sy.Model(sy.Robot.from_dh(ROWS, name="arm").with_terms(ByJoint(LAWS)))
    delta = np.zeros(model.parameter_count)
    names = list(model.parameter_names)
    # What would act elsewhere is given, too, and must have no effect there.
    values = {"Fcj": 2.0, "Fsj": 1.0, "Fn1j": 3.0, "Fn2j": 4.0, "Ksj": 0.7, "Ts1j": 0.2, "Tc1j": 0.1, "Fvj": 0.5}
    for symbol, value in values.items():
        for joint in (1, 2, 3):
            delta[names.index(f"{symbol}{joint}")] = value
    random = np.random.default_rng(1)
    q, dq = random.uniform(-1.5, 1.5, (2, 50, 3))
    found = model.inverse_dynamics(q, dq, 0.0 * q, delta)
    v, s, a = dq.T, np.sign(dq.T), np.abs(dq.T)
    ripple = [0.2 * np.sin(n * one) + 0.1 * np.cos(n * one) for n, one in ((6, q[:, 0]), (9, q[:, 2]))]
    first = s[0] * (2.0 + np.exp(-((v[0] / 0.1) ** 2))) + 0.5 * v[0] + ripple[0]
    second = 2.0 * s[1] + s[1] * np.interp(a[1], [0.0, 0.5, 2.0], [0.0, 3.0, 4.0])  # which stands for viscous friction
    third = 2.0 * s[2] + 0.5 * v[2] + 0.7 * q[:, 2] + ripple[1]
    np.testing.assert_allclose(found, np.column_stack([first, second, third]), atol=1e-12)


def test_a_law_has_its_channel_where_it_acts():
    heated = ChannelFriction(channel="heat", range=[0.0, 60.0], reference=20.0, joints=[2])
    model = sy.Model(sy.Robot.from_dh(ROWS).with_terms(ByJoint([heated, Coulomb(), Viscous()])))
    values = {"Fc": 2.0, "Fv": 0.5, "Fcs": 0.1, "Fvs": 0.01}
    delta = np.zeros(len(model.parameter_names))
    for place, name in enumerate(model.parameter_names):
        delta[place] = values.get(name.split("j")[0], 0.0)
    q, dq, heat = np.random.default_rng(1).uniform(1.0, 1.5, (3, 20, 3)) * [[[1.0]], [[-1.0]], [[30.0]]]
    heat[:, 0] = 90.0  # beyond the range, at a joint where the law does not act
    found = model.inverse_dynamics(q, dq, 0.0 * q, delta, channels={"heat": heat})
    beyond = np.where([False, True, False], heat - 20.0, 0.0)
    np.testing.assert_allclose(found, (2.0 + 0.1 * beyond) * np.sign(dq) + (0.5 + 0.01 * beyond) * dq, atol=1e-12)
    plain = model.without_channels.inverse_dynamics(q, dq, 0.0 * q, delta)
    np.testing.assert_allclose(plain, 2.0 * np.sign(dq) + 0.5 * dq, atol=1e-12)
    with pytest.raises(sy.InputError, match="beyond the range"):
        model.inverse_dynamics(q, dq, 0.0 * q, delta, channels={"heat": heat + 60.0})
    with pytest.raises(sy.InputError, match="needs the channel 'heat', which was not given"):
        ByJoint([heated]).columns(1, q[0], dq[0], q[0], np)


def test_of_laws_that_all_need_channels_none_is_left_without_them():
    class ByWear(Viscous):
        kind = "by_wear"
        channels = ("wear",)

    worn = ByJoint([ByWear()])
    assert worn.without_channels() is None
    assert ByJoint([*worn.laws, Coulomb()]).without_channels() == ByJoint([Coulomb()])


def test_it_comes_back_from_its_table():
    term = ByJoint(LAWS)
    again = term_from_dict(term.to_dict())
    assert again == term
    assert hash(again) == hash(term)
    assert [condition.name for condition in term.conditions()].count("Fcj >= 0") == 1


def test_laws_are_tables():
    with pytest.raises(sy.InputError, match=r"must be a term or its table, got 3"):
        ByJoint([Coulomb(), 3])


def test_two_laws_with_one_parameter_at_a_joint_are_refused():
    with pytest.raises(sy.InputError, match="'Ts1j' at joint 'joint1'"):
        sy.Robot.from_dh(ROWS).with_terms(ByJoint([Cogging([6]), Cogging([9], joints=[1])]))
    with pytest.raises(sy.InputError, match="must be a list of terms"):
        ByJoint([])
