"""A log with unsteady stamps and missing rows is identified as the perfect log is, without a setting."""

import numpy as np
import pytest

import steelyard as sy

PERIOD, COUNT = 1e-3, 12_000


@pytest.fixture(scope="module")
def arm(simulation, tmp_path_factory):
    """Return the model, the file, and the error of an estimate on a motion that was not identified with."""
    folder = tmp_path_factory.mktemp("arm")
    path = folder / "robot.toml"
    path.write_text(simulation.robot_file)
    model = sy.Model.load(path)
    _, *other = simulation.trajectory(12).sample(50.0, 1.0)
    truth = model.inverse_dynamics(*other, simulation.true_parameters(model))

    def error(estimate):
        found = model.inverse_dynamics(*other, estimate.parameters)
        return float(np.linalg.norm(found - truth) / np.linalg.norm(truth))

    return model, path, error


def record(simulation, model, kind, folder):
    """A log of 12 s at 1 kHz, with noise of 1e-5 rad and 0.05 N·m."""
    random = np.random.default_rng(3)
    even = np.arange(COUNT) * PERIOD
    taken, kept = even, np.arange(COUNT)
    if "uneven" in kind:
        taken = even + random.uniform(-0.3, 0.3, COUNT) * PERIOD
    stamps = taken
    if "late" in kind:
        delay = random.uniform(50e-6, 300e-6, COUNT)
        for row in random.integers(100, COUNT - 100, 30):
            delay[row : row + 4] = np.arange(4, 0, -1) * PERIOD
        stamps = np.maximum.accumulate(even + delay - 2e-5 * kept) + 2e-5 * kept
    if "gaps" in kind:
        gone = random.choice(np.arange(10, COUNT - 10), 300, replace=False)
        kept = np.setdiff1d(kept, [*gone, *range(5000, 5004), *range(8000, 8015)])
    # One period of a motion of 10 s that repeats itself, at any instants.
    trajectory = simulation.trajectory(11)
    t, *fine = trajectory.sample(4000.0, 1.0)
    q, dq, ddq = (np.column_stack([np.interp(taken, t, c, period=10.0) for c in part.T]) for part in fine)
    torque = model.inverse_dynamics(q, dq, ddq, simulation.true_parameters(model))
    noise = np.random.default_rng(4)
    q = q + 1e-5 * noise.normal(size=q.shape)
    torque = torque + 0.05 * noise.normal(size=q.shape)
    log = sy.Recording(t=1.7e9 + stamps[kept], q=q[kept], torque=torque[kept], source="log.npz")
    return log.save(folder / f"{kind}.npz")


@pytest.fixture(scope="module")
def perfect(arm, simulation, tmp_path_factory):
    model, path, _ = arm
    return sy.identify(path, [record(simulation, model, "perfect", tmp_path_factory.mktemp("perfect"))])


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind",
    [*(pytest.param(k, marks=pytest.mark.slow) for k in ("gaps", "late", "uneven")), "late, gaps", "uneven, gaps"],
)
def test_the_answer_is_that_of_the_perfect_log(kind, arm, perfect, simulation, tmp_path):
    model, path, error = arm
    found = sy.identify(path, [record(simulation, model, kind, tmp_path)])
    # Interpolated torques are less noisy.
    assert found.estimate.relative_error < 1.03 * perfect.estimate.relative_error
    assert error(found.estimate) < 1.1 * error(perfect.estimate) + 1e-5
    clock = [remark for remark in found.remarks if "clock" in remark or "missing" in remark]
    assert clock
    assert not any("set `" in remark or "use `" in remark or "state `" in remark for remark in clock)


@pytest.mark.slow
def test_what_a_refusal_advises_is_accepted_and_helps(arm, simulation, tmp_path):
    model, path, error = arm
    log = record(simulation, model, "late, gaps", tmp_path)
    strict = tmp_path / "strict.toml"
    strict.write_text(path.read_text() + "resample = false\n")
    with pytest.raises(sy.InputError, match=r"let `resample` in \[processing\] have its default, true"):
        sy.identify(strict, [log])
    strict.write_text(path.read_text() + "resample = true\n")
    found = sy.identify(strict, [log])
    assert error(found.estimate) < 1.1 * error(sy.identify(path, [log]).estimate)
