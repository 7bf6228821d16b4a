"""Gains that sampled time does not allow are refused, and those that are allowed hold a plant of Pinocchio."""

import math
from pathlib import Path

import numpy as np
import pytest

import steelyard as sy
from steelyard.control import (
    AdaptiveForceControl,
    ComputedTorque,
    FeedforwardTracking,
    FilteredDifference,
    GravityCompensation,
    ImpedanceControl,
    MeasuredVelocity,
    NullSpaceControl,
    NumericalDifference,
    PositionTracking,
    TaskSpaceControl,
    Tool,
)
from steelyard.control.sampled_loop import Feedback, SampledLoop
from steelyard.identification.wam import COUPLING, DH_ROWS, true_parameters
from steelyard.simulation import Measurement

GUIDE = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "control.md"
Q = np.array([0.0, 0.6, 0.0, 1.8, 0.0, 0.5, 0.0])


@pytest.fixture(scope="module")
def wam_plant(wam, plant_class):
    """The WAM in Pinocchio, with the rotors and the friction of its motors written out anew."""
    pin = pytest.importorskip("pinocchio")
    values = dict(zip(wam.parameter_names, true_parameters(), strict=True))
    model, before, joint = pin.Model(), pin.SE3.Identity(), 0
    for k, (alpha, a, d, _) in enumerate(DH_ROWS, start=1):
        joint = model.addJoint(joint, pin.JointModelRZ(), before, f"joint{k}")
        angle = {"-pi/2": -math.pi / 2, "pi/2": math.pi / 2, 0: 0.0}[alpha]
        before = pin.SE3(pin.utils.rotate("x", angle), np.array([a, 0.0, d]))
        mass = values[f"m{k}"]
        com = np.array([values[f"l{x}{k}"] for x in "xyz"]) / mass
        rows = [[values[f"L{''.join(sorted(x + y))}{k}"] for y in "xyz"] for x in "xyz"]
        about_com = np.array(rows) + mass * pin.skew(com) @ pin.skew(com)
        model.appendBodyToJoint(joint, pin.Inertia(mass, com, about_com), before)
    model.addFrame(pin.Frame("link7", joint, 0, before, pin.FrameType.OP_FRAME))
    coupling = np.array(COUPLING)

    def each(symbol):
        return np.array([values[f"{symbol}{k}"] for k in range(1, 8)])

    class Wam(plant_class):
        def __init__(self):
            self.pin, self.model, self.data, self.count = pin, model, model.createData(), 7
            self.frame = model.getFrameId("link7")

        def inertia_matrix(self, q):
            return super().inertia_matrix(q) + coupling @ np.diag(each("Iam")) @ coupling.T

        def acceleration(self, q, dq, torque, wrench=None):
            motors = coupling.T @ dq
            friction = each("Fvj") * dq + each("Fcj") * np.tanh(dq / 0.01) + each("Foj")
            friction = friction + coupling @ (each("Fvm") * motors + each("Fcm") * np.tanh(motors / 0.01) + each("Fom"))
            return np.linalg.solve(
                self.inertia_matrix(q),
                torque
                - friction
                - pin.nonLinearEffects(model, self.data, q, dq)
                + (0.0 if wrench is None else self.jacobian(q).T @ wrench),
            )

    return Wam()


def test_the_wam_of_pinocchio_is_the_wam(wam, wam_plant, random):
    for q in random.uniform(-2.0, 2.0, (5, 7)):
        np.testing.assert_allclose(
            wam_plant.inertia_matrix(q),
            wam.kernel("total_inertia_matrix").sample(q, true_parameters()).reshape(7, 7),
            atol=1e-12,
        )


def impedance_of_the_guide(wam):
    """The tool, the resting pose and the gains that the page gives."""
    text = GUIDE.read_text(encoding="utf-8")
    start = text.index("soft = ImpedanceControl(")
    found = {}
    names = {"ImpedanceControl": lambda *_, **gains: found.update(gains)}
    tool = Tool("link7", [0.0, 0.0, 0.05])
    rest = wam.pose(Q, "link7") @ tool.placement
    names |= {"model": wam, "parameters": true_parameters(), "tool": tool, "first": rest}
    exec(text[start : text.index("print(soft.functions", start)], names)
    return tool, rest, found


@pytest.mark.slow
@pytest.mark.parametrize("compensate_drives", [False, True])
def test_the_impedance_of_the_guide_holds_in_a_loop(wam, wam_plant, compensate_drives):
    """Half a newton metre about z, then 8 N: neither moves the arm by more than the springs give."""
    tool, rest, gains = impedance_of_the_guide(wam)
    assert set(gains) == {"stiffness", "damping"}
    controller = ImpedanceControl(wam, true_parameters(), tool, rest, compensate_drives=compensate_drives, **gains)
    assert controller.gain_margin(Q) > 2.0

    def push(t):
        return np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.5]) if t < 0.25 else np.array([0.0, 0.0, 8.0, 0.0, 0.0, 0.0])

    _, places, speeds = wam_plant.run(controller, Q, 0 * Q, 0.5, wrench=push, velocity=False)
    assert np.abs(speeds).max() < 3.0
    assert np.abs(places - Q).max() < 0.3
    moved = wam.pose(places, "link7") @ tool.placement
    assert np.linalg.norm(moved[:, :3, 3] - rest[:3, 3], axis=1).max() < 0.03


def unchecked(monkeypatch, make):
    """A controller whose gains are not checked."""
    from steelyard.control import ControlBlock

    with monkeypatch.context() as patch:
        patch.setattr(ControlBlock, "_check_gains", lambda *_, **__: None)
        return make()


def test_damping_above_the_inertia_of_the_wrist_is_refused(wam, wam_plant, monkeypatch):
    """The page had a rotational damping of 1 N·m·s/rad; the arm was thrown about."""
    tool, rest, gains = impedance_of_the_guide(wam)
    gains["damping"] = [50, 50, 80, 1, 1, 1]

    def make():
        return ImpedanceControl(wam, true_parameters(), tool, rest, **gains)

    with pytest.raises(sy.InputError, match=r"unstable with these gains on wam.*errors grow by a factor of"):
        make()
    controller = unchecked(monkeypatch, make)
    assert controller.gain_margin(Q) < 1.0
    monkeypatch.setattr(controller, "_check_gains", lambda *_, **__: None)

    def push(t):
        return np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.5])

    with np.errstate(all="ignore"):
        _, _, speeds = wam_plant.run(controller, Q, 0 * Q, 0.2, wrench=push, velocity=False)
    assert not np.abs(speeds).max() < 50.0


ESTIMATORS = {
    "exact": MeasuredVelocity(),
    "difference": NumericalDifference(),
    "parabola": NumericalDifference(order=2),
    "three steps": NumericalDifference(steps=3),
    "filtered": FilteredDifference(20.0),
}


@pytest.mark.parametrize(
    "name", [n if n in ("exact", "filtered") else pytest.param(n, marks=pytest.mark.slow) for n in ESTIMATORS]
)
def test_the_margin_is_where_pinocchio_begins_to_swing(six, random, bent, name, monkeypatch):
    """A tenth below the margin an error dies away, a tenth above it grows."""
    model, parameters, plant, _ = six
    q, _ = bent(model, random)
    inertia = np.linalg.eigvalsh(plant.inertia_matrix(q))[0]

    def make(factor):
        gains = {"kp": factor * 100.0 * inertia, "kd": factor * 20.0 * inertia}
        return FeedforwardTracking(model, parameters, q, velocity=ESTIMATORS[name], sample_time=0.002, **gains)

    margin = make(0.1).gain_margin(q) * 0.1
    still = make(0.9 * margin)
    _, _, speeds = plant.run(still, q + 1e-5, 0 * q, 0.6)
    assert np.abs(speeds[-50:]).max() < np.abs(speeds[:50]).max()
    with pytest.raises(sy.InputError, match="FeedforwardTracking is unstable"):
        make(1.1 * margin)
    swinging = unchecked(monkeypatch, lambda: make(1.1 * margin))
    monkeypatch.setattr(swinging, "_check_gains", lambda *_, **__: None)
    _, _, speeds = plant.run(swinging, q + 1e-5, 0 * q, 0.15 if name == "exact" else 0.6)
    assert np.abs(speeds[-50:]).max() > 2.0 * np.abs(speeds[:50]).max()


def test_every_controller_refuses_what_sampling_does_not_allow(six):
    model, parameters, plant, link = six
    pose, hold, tool = plant.pose(np.array([0.2, -0.7, 0.9, 0.3, 0.9, 0.1])), np.full(6, 0.5), Tool(link)
    stiff, wild = {"kp": 1.0, "kd": 1.0}, {"kp": 1e4, "kd": 2500.0}
    makers = {
        GravityCompensation: (lambda damping: GravityCompensation(model, parameters, damping=damping), 0.1, 1000.0),
        FeedforwardTracking: (lambda g: FeedforwardTracking(model, parameters, hold, **g), stiff, wild),
        ComputedTorque: (lambda g: ComputedTorque(model, parameters, hold, **g), stiff, wild),
        PositionTracking: (lambda g: PositionTracking(model, parameters, hold, **g), stiff, wild),
        TaskSpaceControl: (lambda g: TaskSpaceControl(model, parameters, tool, pose, **g), stiff, wild),
        ImpedanceControl: (
            lambda d: ImpedanceControl(model, parameters, tool, pose, stiffness=10.0, damping=d, inertia=1.0),
            20.0,
            2500.0,
        ),
        AdaptiveForceControl: (
            lambda g: AdaptiveForceControl(model, parameters, tool, 5.0, normal=(0, 0, -1), reference=pose, **g),
            stiff,
            wild,
        ),
        NullSpaceControl: (
            lambda d: TaskSpaceControl(
                model, parameters, tool, pose, **stiff, axes=("x", "y"), null_space=NullSpaceControl(damping=d)
            ),
            10.0,
            5000.0,
        ),
    }
    for make, allowed, forbidden in makers.values():
        make(allowed)
        with pytest.raises(sy.InputError, match=r"is unstable with these gains on ur5: near rest at q = \["):
            make(forbidden)


def test_an_integral_above_damping_times_stiffness_is_refused(six):
    """Routh: ``ki < kp kd`` for a double integrator, at a sample time that is short enough."""
    model, parameters, *_ = six
    gains = {"kp": 100.0, "kd": 20.0, "velocity": MeasuredVelocity(), "sample_time": 1e-4}
    ComputedTorque(model, parameters, np.zeros(6), ki=1950.0, **gains)
    with pytest.raises(sy.InputError, match="is unstable"):
        ComputedTorque(model, parameters, np.zeros(6), ki=2500.0, **gains)


def test_where_it_starts_counts(six):
    """A damping of the first joint that is right where the arm is stretched is too much where it is folded."""
    model, parameters, plant, _ = six
    stretched, folded = np.zeros(6), np.array([0.0, -1.5, 2.8, 0.0, 0.0, 0.0])
    inertia = [1.0 / np.linalg.inv(plant.inertia_matrix(q))[0, 0] for q in (stretched, folded)]
    assert inertia[0] > 3.0 * inertia[1]
    gains = np.array([1.5 * inertia[0] / 0.001, 0.0, 0.0, 0.0, 0.0, 0.0])
    controller = FeedforwardTracking(model, parameters, stretched, kp=0.0, kd=gains)
    controller.start(Measurement(t=0.0, q=stretched))
    with pytest.raises(sy.InputError, match="joint 'shoulder_pan_joint'"):
        controller.start(Measurement(t=0.0, q=folded))


def test_the_loop_is_that_of_textbooks():
    """A unit mass with damping d: what the polynomial of its velocity allows, written down for each estimate."""
    one = np.ones((1, 1, 1))
    # v' = v - d T w, where the last difference is w = (v + v_1) / 2, and the parabola's slope (3 v + 2 v_1 - v_2) / 4.
    slopes = {
        None: [1.0],
        NumericalDifference(): [0.5, 0.5],
        NumericalDifference(order=2): [0.75, 0.5, -0.25],
        NumericalDifference(steps=2): [0.25, 0.5, 0.25],
    }
    for estimator, slope in slopes.items():
        order = len(slope)
        allowed = [
            x
            for x in np.linspace(0.01, 3.0, 300)
            if np.abs(
                np.roots(np.polyadd(np.eye(1, order + 1)[0] - np.eye(1, order + 1, k=1)[0], x * np.array(slope)))
            ).max()
            < 1.0
        ]
        loop = SampledLoop(one, 0.0 * one, 0.01, None if estimator is None else estimator.transfer(0.01))
        assert 0.1 * loop.gain_margin(Feedback(0.0 * one, 10.0 * one)) == pytest.approx(max(allowed), abs=0.011)
    # With a stiffness k and the true velocity: d T < 2, and k T < 2 d.
    loop = SampledLoop(one, 0.0 * one, 0.01, None)
    assert loop.is_stable(Feedback(1990.0 * one, 10.0 * one)).all()
    assert not loop.is_stable(Feedback(2010.0 * one, 10.0 * one)).any()
    # A slow loop has the sensitivity of continuous time.
    peak = SampledLoop(one, 0.0 * one, 1e-4, None).sensitivity_peak(Feedback(one, 0.6 * one))
    w = np.geomspace(0.01, 100.0, 20_001)
    assert peak == pytest.approx(np.abs((1j * w) ** 2 / ((1j * w) ** 2 + 0.6j * w + 1.0)).max(), rel=2e-2)


def test_viscous_friction_helps_and_impossible_parameters_are_left_alone():
    robot = sy.Robot.from_dh([(0, 1.0, 0, "q")]).with_terms(sy.Viscous())
    model = sy.Model(robot)
    names = model.parameter_names
    delta = np.zeros(len(names))
    delta[names.index("Lzz1")] = 0.001
    gains = {"kp": 0.0, "kd": 2.5}
    with pytest.raises(sy.InputError, match="joint 'joint1'"):
        FeedforwardTracking(model, delta, [0.0], **gains)
    delta[names.index("Fvj1")] = 3.0  # the held torque acts through 1 - exp(-3) of 1/3
    controller = FeedforwardTracking(model, delta, [0.0], **gains)
    # v' = e v + (1 - e) u / F and u = -k (x - x_1) / T, whose growth two states tell.
    e = math.exp(-3.0)
    low, high = 0.1, 50.0
    for _ in range(60):
        k = 0.5 * (low + high)
        # states v and the last difference: x' - x = T ((1 - e)/3 v + (1 - (1 - e)/3) u / F)
        share = (1.0 - e) / 3.0
        step = np.array([[e, (1 - e) / 3.0 * -k], [share, (1 - share) / 3.0 * -k]])
        low, high = (k, high) if np.abs(np.linalg.eigvals(step)).max() < 1.0 else (low, k)
    assert controller.gain_margin([0.0]) * 2.5 == pytest.approx(k, rel=1e-3)
    delta[names.index("Lzz1")] = -0.001
    assert FeedforwardTracking(model, delta, [0.0], **gains).gain_margin([0.0]) == math.inf
