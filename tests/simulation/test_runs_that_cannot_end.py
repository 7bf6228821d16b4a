"""Runs that diverge end with a status and the time, whichever method follows them; parameters of no robot are told."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.errors import InputError
from steelyard.simulation import Event, Sensors, joint_limits, simulate
from steelyard.simulation.compiled import motion_functions
from steelyard.simulation.plant import Plant
from steelyard.simulation.simulate import first_impossible

ADAPTIVE = ("dormand_prince", "dop853", "radau", "bdf", "lsoda")
METHODS = (*ADAPTIVE, "runge_kutta_4", "rosenbrock")
QUICK = tuple(pytest.param(m, marks=pytest.mark.slow) if m in ADAPTIVE[1:] else m for m in METHODS)


def growth(t, q, dq):
    return 8.0 * q


@pytest.mark.parametrize("method", [*QUICK[:5], *(pytest.param(m, marks=pytest.mark.slow) for m in METHODS[5:])])
def test_a_joint_that_is_driven_away_ends_at_an_absurd_speed(method):
    # 2 kg on a slide: q = q0 cosh(2 t), so that the speed 2 q0 sinh(2 t) is 5e3 m/s at asinh(2500 / q0) / 2.
    model = sy.Model(sy.Robot.from_dh([(0, 0, "q", 0)], name="slide", gravity=(0, 0, 0)))
    delta = np.zeros(model.parameter_count)
    delta[model.parameter_names.index("m1")] = 2.0
    q0 = np.array([[0.1], [1.0], [1e-9]])
    batch = simulate(model, delta, q0, [0.0], 7.0, growth, method=method, rate=100.0)
    assert [s.value for s in batch.status] == ["diverged", "diverged", "finished"]
    instants = np.arcsinh(2500.0 / q0[:2, 0]) / 2.0
    assert ((instants - 1e-3 < batch.end_time[:2]) & (batch.end_time[:2] < instants + 0.3)).all()
    assert np.isfinite(batch.final_dq).all()
    alone = simulate(model, delta, [1.0], [0.0], 7.0, growth, method=method, rate=100.0)
    for result in (batch.run(1), alone):
        name = model.robot.joint_names[0]
        assert result.message.startswith(f"joint {name!r} reached ")
        assert f" m/s, which no robot does, at {result.end_time:.6g} s" in result.message
    never = Event(lambda t, q, dq: q[0] + 1.0, "behind")
    watched = simulate(model, delta, [1.0], [0.0], 7.0, growth, method=method, rate=100.0, events=never)
    assert (watched.message, watched.end_time) == (alone.message, alone.end_time)
    fast = simulate(model, delta, [0.0], [2e4], 0.01, growth, method=method)
    assert fast.status == "finished"  # who starts as fast as that means it


@pytest.mark.parametrize("method", [*(pytest.param(m, marks=pytest.mark.slow) for m in ADAPTIVE), *METHODS[-2:]])
def test_an_arm_with_positive_feedback_ends(two_links, method):
    model, delta = two_links
    delta = delta.copy()
    starts = ([0.1, 0.1], np.full((2, 2), 0.1)) if method in ("dormand_prince", "lsoda") else ([0.1, 0.1],)
    for q0 in starts:
        result = simulate(model, delta, q0, [0.0, 0.0], 20.0, lambda t, q, dq: 50.0 * q + 5.0 * dq, method=method)
        assert set(np.atleast_1d(result.status)) == {"diverged"}
        assert (np.asarray(result.end_time) < 20.0).all()


@pytest.mark.slow
@pytest.mark.parametrize("method", QUICK[:5])
@pytest.mark.parametrize("q0", [[1e-6], pytest.param([[1e-6], [2e-6]], marks=pytest.mark.slow)], ids=["one", "two"])
def test_time_that_stands_still_ends_a_run(pendulum, method, q0):
    model, delta = pendulum
    # It vibrates at 1e8 rad/s, with a speed of a hundred rad/s.
    result = simulate(model, delta, q0, [0.0], 1000.0, lambda t, q, dq: -2e16 * q, method=method, rate=1.0)
    assert set(np.atleast_1d(result.status)) == {"diverged"}
    assert "time stands still" in str(result.message)
    assert (np.asarray(result.end_time) < 2e-3).all()


@pytest.mark.parametrize("method", METHODS)
def test_a_torque_that_is_not_a_number_is_named(two_links, method):
    model, delta = two_links
    names = model.robot.joint_names

    def torque(t, q, dq):
        return np.array([0.0, np.nan if t > 0.0504 else 0.0])

    result = simulate(model, delta, [0.1, 0.2], [0.0, 0.0], 0.2, torque, method=method)
    assert result.status == "diverged"
    assert f"torque returned NaN for joint {names[1]!r} at 0.0" in result.message
    held = simulate(model, delta, [0.1, 0.2], [0.0, 0.0], 0.2, torque, method=method, sample_time=0.01)
    assert held.status == "diverged"
    assert held.end_time == pytest.approx(0.06, abs=1e-9)
    assert f"torque returned NaN for joint {names[1]!r} at 0.06 s" in held.message

    class Broken:
        sample_time = 0.01

        def start(self, measurement):
            pass

        def torque(self, measurement):
            return torque(measurement.t, None, None)

    assert (
        "torque returned NaN for joint"
        in simulate(model, delta, [0.1, 0.2], [0.0, 0.0], 0.2, Broken(), method=method).message
    )


@pytest.mark.slow
@pytest.mark.parametrize("method", ["automatic", "rosenbrock"])
def test_parameters_of_no_robot_are_told_even_where_the_run_finishes(wam, method):
    from steelyard.identification.wam import true_parameters

    q0 = np.random.default_rng(0).uniform(-1, 1, (16, 7))[2:5]
    delta = true_parameters()
    wrong = delta.copy()
    wrong[wam.parameter_names.index("Lzz7")] = -0.01
    result = simulate(wam, wrong, q0[1], np.zeros(7), 0.05, method=method)
    assert result.status == "finished"
    assert "inertia matrix is not positive definite at 0 s (eigenvalue -0.0122)" in result.message
    assert "steelyard.check" in result.message
    batch = simulate(wam, np.stack([delta, wrong, delta]), q0, np.zeros(7), 0.05, method=method)
    assert [bool(m) for m in batch.message] == [False, True, False]


@pytest.mark.parametrize("runs", [1, 300])
def test_the_first_impossible_sample_is_found(two_links, runs):
    model, delta = two_links
    delta = delta.copy()
    delta[model.parameter_names.index("Lzz1")] -= 1.2  # positive definite where the arm is bent, only
    functions = motion_functions(model, base=False, smooth=True, each=False)
    plant = Plant(functions, delta, 1e-3, runs)
    bent = np.linspace(1.5, 0.0, 1234)
    q = np.column_stack([np.sin(bent), bent])
    least = np.array([np.linalg.eigvalsh(model.total_inertia_matrix(x, delta))[0] for x in q])
    first = int(np.flatnonzero(least <= 0.0)[0])
    assert 100 < first < 1200
    found = first_impossible(plant, 0, q)
    assert found is not None
    assert found[0] == first
    assert found[1] == pytest.approx(least[first], rel=1e-6, abs=1e-12)
    assert first_impossible(plant, 0, q[:first]) is None


def test_seeds_and_events_that_cannot_be_used(pendulum):
    model, delta = pendulum
    for seed in (-1, 1.5, True, "a"):
        with pytest.raises(InputError, match="seed must be a whole number of at least 0"):
            simulate(model, delta, [0.0], [0.0], 0.1, sensors=Sensors(torque_noise=1.0), seed=seed)
    with pytest.raises(
        InputError, match=r"event 'odd' must return numbers, but returned NaN at 0 s, where q is \[0.5\]"
    ):
        simulate(model, delta, [0.5], [0.0], 0.1, events=Event(lambda t, q, dq: np.nan, "odd"))
    with pytest.raises(InputError, match=r"event 'late' must return numbers, but returned NaN at 0\.0[56]"):
        simulate(
            model,
            delta,
            [0.5],
            [0.0],
            0.2,
            method="runge_kutta_4",
            events=Event(lambda t, q, dq: np.nan if t > 0.05 else 1.0, "late"),
        )
    with pytest.raises(InputError, match="with from_start needs a direction"):
        Event(lambda t, q, dq: 0.0, "x", from_start=True)


@pytest.mark.parametrize("method", ["dormand_prince", "dop853", "runge_kutta_4"])
def test_runs_that_start_beyond_a_limit_or_leave_it_from_the_start(pendulum, method):
    model, delta = pendulum
    limits = joint_limits(model.robot, lower=[-0.2], upper=[1.0])
    q0 = np.array([[1.5], [0.5], [1.0], [-0.2]])
    dq0 = np.array([[0.0], [0.0], [3.0], [4.0]])
    result = simulate(model, delta, q0, dq0, 2.0, method=method, events=limits)
    assert [s.value for s in result.status] == ["event"] * 4
    assert result.message[0].endswith("passed its upper limit 1 at 0 s, where it starts")
    assert result.end_time[0] == 0.0
    assert result.q[0, 0, 0] == 1.5
    assert np.isnan(result.q[0, 1:]).all()
    assert result.end_time[1] > 0.1
    assert result.end_time[2] == pytest.approx(0.0, abs=1e-6)  # leaves at once
    assert result.final_q[3, 0] == pytest.approx(1.0, abs=1e-9)  # goes inside, and leaves at the other end
    alone = simulate(model, delta, [1.5], [0.0], 2.0, method=method, events=limits)
    assert len(alone.t) == 1
    assert alone.status == "event"
    noted = simulate(
        model,
        delta,
        [1.5],
        [0.0],
        0.1,
        method=method,
        events=joint_limits(model.robot, lower=[-0.2], upper=[1.0], terminal=False),
    )
    assert noted.status == "finished"
    assert [e.t for e in noted.events] == [0.0]
