"""The real recordings: what comes out of them, and that none is taken for broken."""

from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from steelyard.errors import InputError
from steelyard.recording import LogColumns, Processing, Recording, Samples, process_chunks

pytestmark = pytest.mark.data

RATIOS = np.diag([32.0, 32.0, 45.0, -48.0, 45.0, 32.0])


@pytest.fixture(scope="module")
def motor_columns() -> LogColumns:
    to_motor = RATIOS.copy()
    to_motor[5, 4] = 32.0
    to_torque = RATIOS.copy()
    to_torque[4, 5] = 32.0
    return LogColumns.from_dict(
        {
            "rate": 5000.0,
            "position": "qm{}",
            "torque": "taum{}",
            "position_matrix": np.linalg.inv(to_motor),
            "position_offset": [0, "-pi/2", "pi/2", 0, 0, 0],
            "torque_matrix": to_torque,
        }
    )


@pytest.fixture(scope="module")
def motor_files(shared_data: Path) -> list[Path]:
    return [shared_data / "staubli_tx40" / name for name in ("raw_q_motor_5khz.csv", "raw_tau_motor_5khz.csv")]


def test_motor_side_equals_the_joint_side_shipped_beside(
    shared_data: Path, motor_files: list[Path], motor_columns: LogColumns
) -> None:
    motor = Recording.read(motor_files, motor_columns, joints=6)
    joint = Recording.read(shared_data / "staubli_tx40" / "joint_500hz.csv", joints=6)
    samples = motor.process(cutoff=None, decimate=10, trim=0.0, velocity_threshold=None)
    assert samples.t is not None
    np.testing.assert_allclose(samples.t, joint.t, atol=1e-9)
    # The file has seven decimals of the positions and five of the torques.
    np.testing.assert_allclose(samples.q, joint.q, atol=6e-8)
    np.testing.assert_allclose(samples.torque, joint.torque, atol=6e-6)


def test_published_processing_of_the_motor_side(motor_files: list[Path], motor_columns: LogColumns) -> None:
    thresholds = [0.05009095, 0.05009095, 0.07504916, 0.0715585, 0.05585054, 0.12217305]
    processing = Processing(cutoff=100.0, order=4, decimate=(10, 10), trim=0.0, velocity_threshold=tuple(thresholds))
    motor = Recording.read(motor_files, motor_columns, joints=6)
    samples = motor.process(processing)
    # Published: 2076 rows; rows at the very threshold depend on how the ends are derived.
    assert abs(int(samples.used.sum()) - 2076) <= 4
    b, a = signal.butter(4, 100 / 2500)
    q = signal.filtfilt(b, a, motor.q, axis=0)
    np.testing.assert_allclose(samples.q, signal.decimate(signal.decimate(q, 10, axis=0), 10, axis=0), atol=1e-9)
    joined = Samples.joined(list(process_chunks(motor_files, motor_columns, processing, rows=4321, joints=6)))
    np.testing.assert_allclose(joined.ddq, samples.ddq, rtol=0, atol=1e-9 * np.abs(samples.ddq).max())
    np.testing.assert_array_equal(joined.mask, samples.mask)


def test_ur10(shared_data: Path) -> None:
    recording = Recording.read(shared_data / "ur10_unisa" / "exciting.csv", joints=6)
    assert recording.remarks == ()
    assert (recording.count, round(recording.rate, 6)) == (3441, 125.0)
    samples = recording.process(cutoff=4.0, trim=0.5, velocity_threshold=None)
    assert recording.velocity is not None
    # What is derived from the positions is what the robot measured.
    np.testing.assert_allclose(samples.dq, recording.velocity[63:-63][: samples.count], atol=0.05)


@pytest.mark.parametrize("name", ["opti_traj_testing1", "opti_traj_testing2"])
def test_kinova(name: str, shared_data: Path) -> None:
    recording = Recording.read(shared_data / "kinova_gen3" / f"{name}.csv", joints=7)
    assert recording.remarks == ()
    assert recording.process(trim=0.0).count == recording.count
    with pytest.raises(InputError, match=r"positions of 7 joints .* the robot has 6"):
        Recording.read(shared_data / "kinova_gen3" / f"{name}.csv", joints=6)


def test_kinova_with_a_dead_sensor(shared_data: Path) -> None:
    recording = Recording.read(shared_data / "kinova_gen3" / "RunTrajectory1.csv", joints=7)
    assert recording.remarks == ("The torque of joint 1 is 0 throughout: its sensor is stuck or not connected.",)
    with pytest.raises(InputError, match=r"exclude_joints = \[1\]"):
        recording.process()
    samples = recording.process(exclude_joints=[1], trim=0.0, velocity_threshold=None)
    assert samples.used.tolist() == [0] + [1942] * 6
