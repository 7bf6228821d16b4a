"""Active observer, stiffness estimation, and force control on an elastic wall."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

import steelyard as sy
from steelyard.control import (
    ActiveObserver,
    AdaptiveForceControl,
    ForceControlOptions,
    MeasuredVelocity,
    StiffnessEstimator,
    Tool,
)
from steelyard.control.adaptive_force import force_loop
from steelyard.identification.wam import true_parameters
from steelyard.simulation import ElasticContact, Measurement, Sensors, Status, simulate

Q = np.array([0.0, 0.6, 0.0, 1.8, 0.0, 0.5, 0.0])
COUNTS = 4096.0 * np.array([42.0, 28.25, 28.25, 18.0, 10.27, 10.27, 14.93])


def test_the_sampled_plant_is_the_exact_one(random):
    """Against the matrix exponential, and the poles where they were wanted."""
    from scipy.linalg import expm

    for bandwidth, gain, sample_time in random.uniform([5.0, 1.0, 1e-4], [50.0, 100.0, 5e-3], (10, 3)):
        loop = force_loop(bandwidth, gain, sample_time)
        whole = expm(sample_time * np.array([[0.0, 1.0, 0.0], [0.0, -gain, 1.0], [0.0, 0.0, 0.0]]))
        np.testing.assert_allclose(loop.transition, whole[:2, :2], rtol=1e-10, atol=1e-14)
        np.testing.assert_allclose(loop.control, whole[:2, 2], rtol=1e-7)
        closed = loop.transition - np.outer(loop.control, loop.gains)
        pole = np.exp(-bandwidth * sample_time)
        np.testing.assert_allclose([np.trace(closed), np.linalg.det(closed)], [2 * pole, pole**2], rtol=1e-9)


@pytest.mark.parametrize("order", [pytest.param(1, marks=pytest.mark.slow), 2, pytest.param(3, marks=pytest.mark.slow)])
def test_the_gain_becomes_that_of_the_riccati_equation(order):
    loop = force_loop(20.0, 40.0, 0.001)
    scale, noise, driven = 3000.0, 0.05, 0.3
    observer = ActiveObserver(
        loop.transition, loop.control, [1.0, 0.0], measurement_noise=noise, disturbance_noise=driven, order=order
    )
    observer.start(np.array(0.0))
    for _ in range(4000):
        observer.update(np.array(0.0), np.array(0.0), scale)
    before = observer.state.copy(), observer.disturbance.copy()
    observer.update(np.array(1.0), np.array(0.0), scale)
    n = 2 + order
    F = np.zeros((n, n))
    F[:2, :2], F[:2, 2] = loop.transition, scale * loop.control
    F[2:, 2:] = np.eye(order) + np.eye(order, k=1)
    H, Q_ = np.eye(n)[:1], np.zeros((n, n))
    Q_[-1, -1] = driven**2
    covariance = solve_discrete_are(F.T, H.T, Q_, [[noise**2]])
    gain = (covariance @ H.T / (H @ covariance @ H.T + noise**2))[:, 0]
    assert before[0] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose([*observer.state, observer.disturbance], gain[:3], rtol=1e-5)


@pytest.mark.slow
def test_the_order_is_that_of_disturbances_that_are_followed():
    """A ramp leaves an error at order 1, and none at order 2."""
    loop = force_loop(20.0, 40.0, 0.001)
    errors = []
    for order in (1, 2):
        observer = ActiveObserver(
            loop.transition, loop.control, [1.0, 0.0], measurement_noise=0.05, disturbance_noise=0.05, order=order
        )
        observer.start(np.array(0.0))
        x = np.zeros(2)
        for k in range(4000):
            _, disturbance = observer.update(np.array(x[0]), np.array(0.0), 1000.0)
            pushed = 0.01 * k
            x = loop.transition @ x + 1000.0 * loop.control * pushed
        errors.append(abs(float(disturbance) - pushed))
    assert errors[0] > 0.1
    assert errors[1] < 0.02


def test_prediction_with_feedback_is_that_of_the_closed_loop(random):
    """The plant follows ``F - s G L`` whatever acts on it, once the disturbance is known."""
    loop = force_loop(15.0, 30.0, 0.001)
    observer = ActiveObserver(loop.transition, loop.control, [1.0, 0.0], measurement_noise=0.01, disturbance_noise=1.0)
    scale, push = 2000.0, 1.7
    observer.start(np.array(0.0))
    x, u, past = np.zeros(2), np.array(0.0), []
    for _ in range(3000):
        state, disturbance = observer.update(np.array(x[0]), u, scale)
        u = np.asarray(loop.gains @ (np.array([5.0, 0.0]) - state) / scale - disturbance)
        x = loop.transition @ x + scale * loop.control * (u + push)
        past.append(x[0])
    assert past[-1] == pytest.approx(5.0, rel=1e-6)
    assert float(disturbance) == pytest.approx(push, rel=1e-6)


def test_runs_are_estimated_apart():
    loop = force_loop(20.0, 40.0, 0.001)
    scales = np.array([500.0, 5000.0])
    pushes = np.array([1.0, -3.0])
    observer = ActiveObserver(loop.transition, loop.control, [1.0, 0.0], measurement_noise=0.05, disturbance_noise=0.3)
    observer.start(np.zeros(2))
    x = np.zeros((2, 2))
    for _ in range(3000):
        _, disturbance = observer.update(x[:, 0], np.zeros(2), scales)
        x = x @ loop.transition.T + (scales * pushes)[:, None] * loop.control
    np.testing.assert_allclose(disturbance, pushes, rtol=0.01)


@pytest.mark.parametrize(
    "stiffness", [pytest.param(100.0, marks=pytest.mark.slow), 3000.0, pytest.param(80000.0, marks=pytest.mark.slow)]
)
def test_stiffness_under_noise(stiffness, random):
    """Noise of an encoder (10 µm) and of a force sensor (0.05 N), moved to and fro."""
    estimator = StiffnessEstimator(initial=1000.0, smallest_displacement=1e-4)
    estimator.start(())
    amplitude = np.clip(4.0 / stiffness, 5e-4, 0.02)
    for k in range(8000):
        place = 2.0 * amplitude + amplitude * np.sin(0.004 * k)
        force = stiffness * place + 0.05 * random.normal()
        estimator.update(0.001 * k, np.array(place + 1e-5 * random.normal()), np.array(force), np.array(True))
    assert float(estimator.stiffness) == pytest.approx(stiffness, rel=0.05)


def test_nothing_is_learnt_at_rest_and_nothing_forgotten(random):
    estimator = StiffnessEstimator(initial=700.0)
    estimator.start(())
    for k in range(3000):
        noise = random.normal(size=2)
        estimator.update(0.001 * k, np.array(0.01 + 1e-5 * noise[0]), np.array(7.0 + 0.05 * noise[1]), np.array(True))
    assert float(estimator.stiffness) == 700.0


def test_what_is_not_a_spring_does_not_count():
    estimator = StiffnessEstimator(initial=700.0)
    estimator.start(())
    for k in range(500):  # the force falls as the tool goes in
        estimator.update(0.001 * k, np.array(1e-4 * k), np.array(100.0 - 0.1 * k), np.array(True))
    for k in range(500):  # out of contact
        estimator.update(1.0 + 0.001 * k, np.array(1e-4 * k), np.array(0.2 * k), np.array(False))
    assert float(estimator.stiffness) == 700.0


def wall(model, stiffness):
    pose = model.pose(Q, "link7")
    return ElasticContact("link7", surface=(0.0, 0.0, pose[2, 3] - 0.003), normal=(0, 0, 1), stiffness=stiffness)


def controller_of(model, parameters, force, compensate_drives=False, **tuning):
    pose = model.pose(Q, "link7")
    return AdaptiveForceControl(
        model,
        parameters,
        Tool("link7"),
        force,
        normal=(0, 0, -1),
        reference=pose,
        kp=400.0,
        kd=40.0,
        compensate_drives=compensate_drives,
        options=ForceControlOptions(**tuning),
    )


def tenfold(t):
    return np.where((np.asarray(t) >= 1.3) & (np.asarray(t) < 2.6), 10_000.0, 1000.0)


class Watched:
    """A controller, and what it estimated at each call."""

    def __init__(self, controller):
        self.controller, self.sample_time = controller, controller.sample_time

    def start(self, measurement):
        self.controller.start(measurement)
        self.stiffness = []

    def torque(self, measurement):
        torque = self.controller.torque(measurement)
        self.stiffness.append(np.array(self.controller.stiffness))
        return torque


def pressed(t):
    return 10.0 + 3.0 * np.sin(np.pi * t)


@pytest.mark.slow
def test_the_stiffness_is_found_across_a_tenfold_change(wam):
    sensors = Sensors(encoder_resolution=2 * np.pi / COUNTS, force_noise=0.03)
    estimator = StiffnessEstimator(smallest_displacement=1e-4, smallest_force=1.0)
    watched = Watched(controller_of(wam, true_parameters(), pressed, compensate_drives=True, stiffness=estimator))
    result = simulate(
        wam, true_parameters(), Q, 0 * Q, 3.9, watched, environment=wall(wam, tenfold), sensors=sensors, seed=3
    )
    assert result.status is Status.FINISHED
    found = np.array(watched.stiffness)
    t = 0.001 * np.arange(len(found))
    for start, end, value in ((0.8, 1.3, 1000.0), (1.6, 2.6, 10_000.0), (2.9, 3.9, 1000.0)):
        inside = (t >= start) & (t < end)
        assert np.abs(found[inside] / value - 1.0).max() < 0.05
        settled = (result.t >= start) & (result.t < end)
        error = result.force[settled, 2] - pressed(result.t[settled])
        assert np.sqrt(np.mean(error**2)) < 1.0


@pytest.mark.slow
def test_a_steady_force_is_reached_despite_a_wrong_model(wam):
    """The observer takes away what friction and a wrong mass do."""
    wrong = true_parameters()
    wrong[[k for k, name in enumerate(wam.parameter_names) if name[0] in "Llm"]] *= 1.05
    controller = controller_of(wam, wrong, 8.0)
    result = simulate(wam, true_parameters(), Q, 0 * Q, 1.6, controller, environment=wall(wam, 4000.0))
    assert np.abs(result.force[-500:, 2] - 8.0).max() < 0.2


@pytest.mark.slow
@pytest.mark.parametrize("stiffness", [100.0, 3000.0, *(pytest.param(k, marks=pytest.mark.slow) for k in (1e4, 5e4))])
def test_a_noisy_sensor_on_pinocchios_plant(redundant, random, bent, stiffness):
    """With half a newton of noise, of which it is told, it finds the stiffness and presses as it is to."""
    model, parameters, plant, link = redundant
    q, _ = bent(model, random)
    pose = plant.pose(q)
    height, dq, sample_time = pose[2, 3] - 0.002, 0.0 * q, 0.002
    controller = AdaptiveForceControl(
        model,
        parameters,
        Tool(link),
        10.0,
        normal=(0, 0, -1),
        reference=pose,
        kp=400.0,
        kd=40.0,
        options=ForceControlOptions(force_noise=0.5),
        sample_time=sample_time,
        velocity=MeasuredVelocity(),
    )
    noise = np.array([0.5, 0.5, 0.5, 0.005, 0.005, 0.005])
    pressed, found = [], []
    for k in range(1500):
        push = np.array([0.0, 0.0, stiffness * max(height - plant.pose(q)[2, 3], 0.0), 0.0, 0.0, 0.0])
        seen = Measurement(t=k * sample_time, q=q, dq=dq, force=push + noise * random.standard_normal(6))
        if k == 0:
            controller.start(seen)
        torque = controller.torque(seen)
        pressed.append(push[2])
        found.append(float(controller.stiffness))
        for _ in range(2):
            push[2] = stiffness * max(height - plant.pose(q)[2, 3], 0.0)
            dq = dq + 0.5 * sample_time * plant.acceleration(q, dq, torque, push)
            q = q + 0.5 * sample_time * dq
    last = slice(1000, None)
    assert np.abs(np.array(found[last]) / stiffness - 1.0).max() < 0.15
    assert np.mean(pressed[last]) == pytest.approx(10.0, abs=0.3)


@pytest.mark.slow
def test_smoothing_keeps_the_stiffness(random):
    """Noise as large as the increments: without smoothing the spring looks many times as stiff."""
    found = []
    for smoothing in (0.0, 0.05):
        estimator = StiffnessEstimator(initial=1000.0, smoothing=smoothing)
        estimator.start(())
        for k in range(6000):
            place = 0.05 + 0.04 * np.sin(0.004 * k)
            force = 100.0 * place + 0.5 * random.normal()
            estimator.update(0.001 * k, np.array(place), np.array(force), np.array(True))
        found.append(float(estimator.stiffness))
    assert found[0] > 150.0
    assert found[1] == pytest.approx(100.0, rel=0.1)


def test_force_control_needs_a_sensor(wam):
    with pytest.raises(sy.InputError, match="force sensor"):
        controller_of(wam, true_parameters(), 8.0).start(Measurement(t=0.0, q=Q))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"force": np.nan}, "force must be finite"),
        ({"normal": (0, 0, 0)}, "other than zero"),
        ({"bandwidth": -1.0}, "bandwidth"),
        ({"order": 0}, "order must be a whole number of at least 1, got 0"),
        ({"force_noise": 0.0}, "measurement_noise"),
    ],
)
def test_bad_input_is_refused(wam, arguments, message):
    tuning = {"force": 1.0, "normal": (0, 0, -1)} | arguments
    task = {"normal": tuning.pop("normal"), "reference": np.eye(4), "kp": 1.0, "kd": 1.0}
    with pytest.raises(sy.InputError, match=message):
        AdaptiveForceControl(
            wam,
            true_parameters(),
            Tool("link7"),
            tuning.pop("force"),
            **task,
            options=ForceControlOptions(**tuning),
        )


def test_a_stiffness_beyond_its_bounds_is_refused():
    with pytest.raises(sy.InputError, match="between lower and upper"):
        StiffnessEstimator(initial=1.0)
    with pytest.raises(sy.InputError, match="matrices of shapes"):
        ActiveObserver(np.eye(2), [1.0], [1.0, 0.0], measurement_noise=1.0, disturbance_noise=1.0)
