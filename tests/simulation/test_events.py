"""Events: found where closed forms say, in the right order, once each."""

import numpy as np
import pytest
from scipy.special import ellipk

import steelyard as sy
from steelyard.errors import InputError
from steelyard.simulation import Event, at_time, joint_limits, simulate

METHODS = ("dormand_prince", "dop853", "radau", "lsoda", "runge_kutta_4", "rosenbrock")
QUICK = [pytest.param(m, marks=pytest.mark.slow) if m in ("radau", "rosenbrock") else m for m in METHODS]


@pytest.mark.parametrize("method", QUICK)
def test_a_pendulum_hangs_after_a_quarter_of_its_period(pendulum, method):
    model, delta = pendulum
    quarter = ellipk(np.sin(1.0) ** 2) / np.sqrt(9.81)  # let go at 2 rad
    event = Event(lambda t, q, dq: q[0], "it hangs", direction=-1)
    steps = {"runge_kutta_4": 5e-4, "rosenbrock": 1e-4}
    options = {"step": steps[method]} if method in steps else {"relative_tolerance": 1e-10}
    result = simulate(model, delta, [2.0], [0.0], 5.0, method=method, events=event, **options)
    assert result.status == "event"
    assert abs(result.end_time - quarter) < (1e-6 if method == "rosenbrock" else 2e-8)
    assert abs(result.final_q[0]) < 1e-12
    assert result.message == f"it hangs at {result.end_time:.6g} s"
    assert result.t[-1] <= result.end_time < result.t[-1] + 1e-3
    (found,) = result.events
    assert found.t == result.end_time
    assert abs(found.dq[0] + 2 * np.sin(1.0) * np.sqrt(9.81)) < 1e-5


@pytest.mark.parametrize("method", ["dormand_prince", pytest.param("runge_kutta_4", marks=pytest.mark.slow)])
def test_events_that_do_not_end_the_run_are_all_found(pendulum, method):
    model, delta = pendulum
    sample_time = 4 * ellipk(np.sin(0.5) ** 2) / np.sqrt(9.81)  # let go at 1 rad
    rising = Event(lambda t, q, dq: q[0], "up", direction=1, terminal=False)
    either = Event(lambda t, q, dq: dq[0], "turns", terminal=False)
    result = simulate(model, delta, [1.0], [0.0], 2.9 * sample_time, method=method, events=(rising, either), rate=100)
    assert result.status == "finished"
    up = [e.t for e in result.events if e.name == "up"]
    np.testing.assert_allclose(up, [0.75 * sample_time, 1.75 * sample_time, 2.75 * sample_time], atol=1e-7)
    turns = [e.t for e in result.events if e.name == "turns"]  # not the start, where it is let go
    np.testing.assert_allclose(turns, 0.5 * sample_time * np.arange(1, 6), atol=1e-7)
    assert [e.t for e in result.events] == sorted(e.t for e in result.events)


@pytest.mark.parametrize("method", METHODS)
def test_the_first_of_two_events_in_one_step_ends_the_run(pendulum, method):
    model, delta = pendulum
    events = (at_time(0.50004, "late"), at_time(0.50002, "early"), at_time(0.50003, "later", terminal=False))
    result = simulate(model, delta, [1.0], [0.0], 1.0, method=method, events=events)
    assert result.message.startswith("early")
    assert abs(result.end_time - 0.50002) < 1e-12
    assert result.events[0].name == "early"


def test_a_joint_that_passes_its_limit_is_named(two_links):
    model, delta = two_links
    event = joint_limits(model.robot, lower=[-1.0, -np.inf], upper=[1.0, 0.5])
    result = simulate(model, delta, [0.0, 0.0], [0.0, 0.0], 3.0, events=event)
    assert result.status == "event"
    q = result.final_q
    joint = int(np.argmin(np.minimum(q - [-1.0, -np.inf], [1.0, 0.5] - q)))
    assert f"joint {model.robot.joint_names[joint]!r} passed its" in result.message
    assert abs(np.minimum(q - [-1.0, -np.inf], [1.0, 0.5] - q).min()) < 1e-9


GRIPPER = """<robot name="gripper"><link name="palm"/>
<link name="thumb"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
</link>
<link name="finger"><inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
</link>
<joint name="grip" type="prismatic"><parent link="palm"/><child link="thumb"/><axis xyz="1 0 0"/>
  <limit lower="-9" upper="9" velocity="0" effort="0"/></joint>
<joint name="mirror" type="prismatic"><parent link="palm"/><child link="finger"/><axis xyz="0 1 0"/>
  <mimic joint="grip" multiplier="-2" offset="0.5"/><limit lower="-1.5" upper="2" velocity="0" effort="0"/></joint>
</robot>"""


def test_limits_of_a_joint_that_mimics_end_a_run(tmp_path):
    (tmp_path / "gripper.urdf").write_text(GRIPPER)
    robot = sy.Robot.from_urdf(tmp_path / "gripper.urdf")
    result = simulate(sy.Model(robot), robot.parameters, [0.0], [0.25], 9.0, events=joint_limits(robot))
    assert result.status == "event"
    assert abs(result.end_time - 4.0) < 1e-9  # -2 q + 0.5 = -1.5, at a constant speed
    assert result.message.startswith("joint 'grip' passed its upper limit 1 ")


@pytest.mark.slow
def test_events_of_a_batch_are_those_of_each_run(pendulum):
    model, delta = pendulum
    q0 = np.array([[0.5], [1.0], [2.0], [-1.0]])
    event = Event(lambda t, q, dq: q[..., 0], "it hangs", direction=-1)
    for method in ("dormand_prince", "runge_kutta_4", "dop853"):
        result = simulate(model, delta, q0, np.zeros_like(q0), 0.8, method=method, events=event)
        quarters = ellipk(np.sin(q0[:3, 0] / 2) ** 2) / np.sqrt(9.81)
        np.testing.assert_allclose(result.end_time[:3], quarters, atol=1e-7)
        assert [s.value for s in result.status] == ["event", "event", "event", "finished"]
        assert [len(result.run(k).events) for k in range(4)] == [1, 1, 1, 0]
        assert np.isnan(result.q[0, -1, 0])
        assert np.isfinite(result.q[3]).all()


def test_an_event_in_a_control_loop_is_found_between_its_ticks(pendulum):
    model, delta = pendulum
    for method in ("dormand_prince", "runge_kutta_4"):
        result = simulate(
            model,
            delta,
            [1.0],
            [0.0],
            1.0,
            lambda t, q, dq: np.zeros(1),
            sample_time=0.01,
            method=method,
            events=Event(lambda t, q, dq: q[0]),
        )
        assert abs(result.end_time - ellipk(np.sin(0.5) ** 2) / np.sqrt(9.81)) < 1e-6


def test_wrong_events_are_refused(pendulum):
    model, delta = pendulum
    with pytest.raises(InputError, match=r"direction of event 'x' must be -1, 0 or 1, got 2"):
        Event(lambda t, q, dq: 0.0, "x", direction=2)
    with pytest.raises(InputError, match="events must be Event objects, got function"):
        simulate(model, delta, [0.0], [0.0], 1.0, events=[lambda t, q, dq: 0.0])
    with pytest.raises(InputError, match=r"event 'two' must return a number, got shape \(2,\)"):
        simulate(model, delta, [0.0], [0.0], 1.0, events=Event(lambda t, q, dq: np.zeros(2), "two"))
    with pytest.raises(InputError, match="has no joint limits"):
        joint_limits(sy.Robot.from_dh([(0, 1.0, 0, "q")]))
