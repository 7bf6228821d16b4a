"""Task-space control against Pinocchio's dynamics and kinematics."""

import inspect

import numpy as np
import pytest
from scipy.linalg import null_space as kernel_of
from scipy.spatial.transform import Rotation

import steelyard as sy
from steelyard.control import (
    AdaptiveForceControl,
    ImpedanceControl,
    MeasuredVelocity,
    NullSpaceControl,
    PoseTrajectory,
    TaskSpaceControl,
    Tool,
)
from steelyard.control.task_space import TaskControl, TaskOptions
from steelyard.simulation import Measurement


def pose_of(random):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.random(random_state=int(random.integers(1 << 30))).as_matrix()
    pose[:3, 3] = random.normal(size=3)
    return pose


@pytest.mark.parametrize("axes", ["pose", "position", "orientation", ("x", "z", "ry"), ("y", "x", "z")])
def test_the_tool_becomes_a_double_integrator(arm, random, bent, axes):
    """Equation 2.34: the tool accelerates, by Pinocchio, as it was commanded to."""
    model, parameters, plant, link = arm
    named = {"pose": range(6), "position": range(3), "orientation": range(3, 6)}
    rows = list(named[axes]) if axes in named else [("x", "y", "z", "rx", "ry", "rz").index(axis) for axis in axes]
    target = (pose_of(random), random.normal(size=6), random.normal(size=6))
    controller = TaskSpaceControl(
        model, parameters, Tool(link), lambda t: target, kp=30.0, kd=9.0, axes=axes, velocity=MeasuredVelocity()
    )
    for _ in range(10):
        q, dq = bent(model, random)
        seen = Measurement(t=0.0, q=q, dq=dq)
        controller.start(seen)
        ddq = plant.acceleration(q, dq, controller.torque(seen))
        here = plant.pose(q)
        turn = Rotation.from_matrix(target[0][:3, :3] @ here[:3, :3].T).as_rotvec()
        error = np.concatenate((target[0][:3, 3] - here[:3, 3], turn))
        expected = target[2] + 9.0 * (target[1] - plant.jacobian(q) @ dq) + 30.0 * error
        np.testing.assert_allclose(plant.tool_acceleration(q, dq, ddq)[rows], expected[rows], rtol=1e-8, atol=1e-7)


def test_a_placed_tool_is_commanded_at_its_own_place(redundant, random, bent):
    model, parameters, plant, link = redundant
    placement = pose_of(random)
    placement[:3, 3] *= 0.1
    q, dq = bent(model, random)
    target = (plant.pose(q) @ placement, np.zeros(6), random.normal(size=6))
    controller = TaskSpaceControl(
        model, parameters, Tool(link, placement), lambda t: target, kp=30.0, kd=0.0, velocity=MeasuredVelocity()
    )
    seen = Measurement(t=0.0, q=q, dq=dq)
    controller.start(seen)
    ddq = plant.acceleration(q, dq, controller.torque(seen))
    frame = plant.tool_acceleration(q, dq, ddq)
    omega, arm = (plant.jacobian(q) @ dq)[3:], plant.pose(q)[:3, :3] @ placement[:3, 3]
    place = frame[:3] + np.cross(frame[3:], arm) + np.cross(omega, np.cross(omega, arm))
    np.testing.assert_allclose(place, target[2][:3], atol=1e-7)
    np.testing.assert_allclose(frame[3:], target[2][3:], atol=1e-7)


def test_the_inverse_is_dynamically_consistent(redundant, random, bent):
    """Equation 2.30: the joints move with the least kinetic energy, so that nothing moves in the null space."""
    model, parameters, plant, link = redundant
    for axes, rows in (("pose", slice(0, 6)), ("position", slice(0, 3))):
        controller = TaskSpaceControl(
            model,
            parameters,
            Tool(link),
            lambda t: (np.eye(4), np.zeros(6), np.ones(6)),
            kp=0.0,
            kd=0.0,
            axes=axes,
            null_space=NullSpaceControl(damping=0.0),
            velocity=MeasuredVelocity(),
        )
        q, _ = bent(model, random)
        seen = Measurement(t=0.0, q=q, dq=0 * q)
        controller.start(seen)
        ddq = plant.acceleration(q, 0 * q, controller.torque(seen))
        free = kernel_of(plant.jacobian(q)[rows])
        assert np.abs(ddq).max() > 0.1
        np.testing.assert_allclose(free.T @ plant.inertia_matrix(q) @ ddq, 0.0, atol=1e-9)


def test_the_configuration_does_not_move_the_tool(redundant, random, bent):
    model, parameters, plant, link = redundant
    q, dq = bent(model, random)
    seen = Measurement(t=0.0, q=q, dq=dq)
    found = []
    for null_space in (NullSpaceControl(damping=0.0), NullSpaceControl(q + 1.0, stiffness=50.0, damping=7.0)):
        controller = TaskSpaceControl(
            model,
            parameters,
            Tool(link),
            plant.pose(q),
            kp=30.0,
            kd=9.0,
            null_space=null_space,
            velocity=MeasuredVelocity(),
        )
        controller.start(seen)
        ddq = plant.acceleration(q, dq, controller.torque(seen))
        found.append((plant.tool_acceleration(q, dq, ddq), ddq))
    np.testing.assert_allclose(found[0][0], found[1][0], atol=1e-7)
    assert np.abs(found[0][1] - found[1][1]).max() > 1.0


def test_a_measured_force_is_taken_away(arm, random, bent):
    model, parameters, plant, link = arm
    q, dq = bent(model, random)
    wrench = random.normal(size=6) * 10.0
    controller = TaskSpaceControl(
        model, parameters, Tool(link), plant.pose(q), kp=0.0, kd=0.0, sensing=True, velocity=MeasuredVelocity()
    )
    seen = Measurement(t=0.0, q=q, dq=dq, force=wrench)
    controller.start(seen)
    ddq = plant.acceleration(q, dq, controller.torque(seen), wrench)
    np.testing.assert_allclose(plant.tool_acceleration(q, dq, ddq), 0.0, atol=1e-7)
    with pytest.raises(sy.InputError, match="force sensor"):
        controller.start(Measurement(t=0.0, q=q, dq=dq))


def test_a_way_is_tracked_and_the_elbow_comes_to_rest(redundant, bent, random):
    model, parameters, plant, link = redundant
    q, _ = bent(model, random)
    first = plant.pose(q)
    second = first.copy()
    second[:3, 3] += [0.05, -0.1, 0.08]
    second[:3, :3] = Rotation.from_rotvec([0.2, 0.3, -0.4]).as_matrix() @ first[:3, :3]
    reference = PoseTrajectory([0.1, 0.8], [first, second])
    controller = TaskSpaceControl(model, parameters, Tool(link), reference, kp=400.0, kd=40.0, sample_time=0.002)
    t, places, speeds = plant.run(controller, q, 0.0 * q, 1.6, velocity=False)
    for k in range(0, len(t), 40):
        wanted, here = reference.target(t[k]).pose, plant.pose(places[k])
        assert np.abs(wanted[:3, 3] - here[:3, 3]).max() < 1e-3
        assert Rotation.from_matrix(wanted[:3, :3] @ here[:3, :3].T).magnitude() < 5e-3
    assert np.abs(speeds[-1]).max() < 2e-3


def test_a_singular_configuration_asks_nothing_impossible(six):
    """The arm stretched out: no torque can pull the hand outwards, whatever the reference asks."""
    model, parameters, plant, link = six
    q = np.array([0.2, -0.7, 0.0, 0.3, 0.9, 0.1])
    pose = plant.pose(q)
    pose[:3, 3] += 1.0
    controller = TaskSpaceControl(model, parameters, Tool(link), pose, kp=100.0, kd=20.0)
    angles = np.concatenate((-np.logspace(0, -9, 40), [0.0], np.logspace(-9, 0, 40)))
    torques = []
    for angle in angles:
        q[2] = angle
        seen = Measurement(t=0.0, q=q.copy())
        controller.start(seen)
        torques.append(controller.torque(seen))
    torques = np.array(torques)
    assert np.linalg.cond(plant.jacobian(q * [1, 1, 0, 1, 1, 1])) > 1e12
    assert np.isfinite(torques).all()
    # 100/s² over 1 m, for 18 kg at levers of 1 m and less: 3 kN·m and gravity.
    assert np.abs(torques).max() < 4e3
    near = np.abs(angles) < 1e-6
    np.testing.assert_allclose(torques[near], torques[40][None].repeat(near.sum(), 0), atol=0.1)


@pytest.mark.slow
def test_an_unreachable_target_is_approached_and_held(six):
    """Through the singularity of the stretched arm the motion stays bounded, and ends there at rest."""
    model, parameters, plant, link = six
    q = np.array([0.2, -0.7, 0.9, 0.3, 0.9, 0.1])
    pose = plant.pose(q)
    pose[:3, 3] *= 1.3 / np.linalg.norm(pose[:3, 3])
    controller = TaskSpaceControl(model, parameters, Tool(link), pose, kp=25.0, kd=10.0, sample_time=0.002)
    _, places, speeds = plant.run(controller, q, 0.0 * q, 4.0, velocity=False)
    assert np.abs(speeds).max() < 50.0
    assert np.abs(speeds[-500:]).max() < 0.01
    end = plant.pose(places[-1])[:3, 3]
    assert np.linalg.norm(end) > 0.9
    assert end @ pose[:3, 3] > 0.97 * np.linalg.norm(end) * 1.3


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"axes": "everything"}, "axes must be"),
        ({"axes": ("x", "x")}, "each once"),
        ({"kp": np.ones((2, 2))}, "6 numbers or a 6 x 6 matrix"),
        ({"kp": np.triu(np.ones((6, 6)))}, "symmetric"),
        ({"kd": -np.eye(6)}, "semidefinite"),
        ({"reference": np.eye(3)}, r"\(\.\.\., 4, 4\)"),
        ({"reference": 2.0 * np.eye(4)}, "rotation matrix, a position"),
        ({"reference": "home"}, "pose reference"),
        ({"null_space": NullSpaceControl(stiffness=1.0)}, "no positions"),
        ({"null_space": NullSpaceControl([0.0], stiffness=1.0)}, "6 finite numbers"),
        ({"largest_mass": 0.0}, "largest_mass"),
        ({"tool": Tool("nothing")}, "nothing"),
    ],
)
def test_bad_input_is_refused(six, arguments, message):
    model, parameters, _, link = six
    given = {"tool": Tool(link), "reference": np.eye(4), "kp": 1.0, "kd": 1.0} | arguments
    with pytest.raises(sy.InputError, match=message):
        TaskSpaceControl(model, parameters, given.pop("tool"), given.pop("reference"), **given)


def test_a_task_needs_joints():
    model = sy.Model(sy.Robot.from_dh([(0, 1.0, 0, "q"), (0, 1.0, 0, "q")]))
    tool = Tool(model.robot.link_names[-1])
    with pytest.raises(sy.InputError, match="too much for robot with 2 joints"):
        TaskSpaceControl(model, np.ones(model.parameter_count), tool, np.eye(4), kp=1.0, kd=1.0)


@pytest.mark.parametrize("placement", [np.zeros((4, 4)), np.diag([1.0, 1.0, -1.0, 1.0]), [1.0, 2.0], [np.nan] * 3])
def test_a_tool_must_be_a_pose(placement):
    with pytest.raises(sy.InputError, match="must be a pose"):
        Tool("link1", placement)


def test_a_run_that_diverged_does_not_stop_the_others(six):
    model, parameters, _, link = six
    controller = TaskSpaceControl(model, parameters, Tool(link), np.eye(4), kp=1.0, kd=1.0)
    q = np.array([[0.2, -0.7, 0.9, 0.3, 0.9, 0.1], [np.nan] * 6])
    controller.start(Measurement(t=0.0, q=q))
    torques = controller.torque(Measurement(t=0.0, q=q))
    controller.start(Measurement(t=0.0, q=q[0]))
    np.testing.assert_allclose(torques[0], controller.torque(Measurement(t=0.0, q=q[0])), rtol=1e-9)
    assert np.isnan(torques[1]).all()


def test_parameters_without_inertia_give_not_a_number(six):
    model, parameters, _, link = six
    massless = parameters.copy()
    massless[-10:] = 0.0
    controller = TaskSpaceControl(model, massless, Tool(link), np.eye(4), kp=1.0, kd=1.0)
    seen = Measurement(t=0.0, q=np.array([0.2, -0.7, 0.9, 0.3, 0.9, 0.1]))
    controller.start(seen)
    assert controller.torque(seen).shape == (6,)


@pytest.mark.parametrize("controller", [TaskSpaceControl, ImpedanceControl, AdaptiveForceControl])
def test_controllers_of_a_tool_share_their_options(controller):
    """The defaults stand in the base class alone; the options that a type checker knows are those that it takes."""
    taken = inspect.signature(TaskControl).parameters.values()
    options = {p.name for p in taken if p.kind is inspect.Parameter.KEYWORD_ONLY}
    assert options == set(TaskOptions.__annotations__)
    own = inspect.signature(controller).parameters
    assert not options & set(own)
    assert any(p.kind is inspect.Parameter.VAR_KEYWORD for p in own.values())


def test_an_unknown_option_is_refused(arm):
    model, parameters, _, link = arm
    with pytest.raises(TypeError, match="largest_mas"):
        TaskSpaceControl(model, parameters, Tool(link), np.eye(4), kp=1.0, kd=1.0, largest_mas=1.0)  # type: ignore[call-arg]
