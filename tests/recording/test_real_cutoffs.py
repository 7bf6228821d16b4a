"""Cutoffs chosen on real recordings: near the documented ones, and no worse for the identification."""

from pathlib import Path

import numpy as np
import pytest

import steelyard as sy
from steelyard.recording import Recording, find_stiction
from steelyard.recording.cutoff import motion_spectra
from steelyard.regression import ParameterCovariance
from steelyard.robot import RobotFile

pytestmark = pytest.mark.data

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
TX40 = "staubli_tx40/raw_q_motor_5khz.csv+staubli_tx40/raw_tau_motor_5khz.csv"


def read(shared_data: Path, robot: str, logs: str) -> tuple[sy.Model, Recording, dict[str, object]]:
    file = RobotFile.load(EXAMPLES / f"{robot}.toml")
    log = [shared_data / part for part in logs.split("+")]
    return (
        sy.Model.from_file(file),
        Recording.read(log, file.section("log"), file.robot.dof),
        file.section("processing"),
    )


def error(model: sy.Model, recording: Recording, **options: object) -> float:
    samples = recording.process(**options)
    return sy.least_squares(sy.Information.from_samples(model, samples)).relative_error


@pytest.mark.parametrize(
    ("robot", "log", "low", "high"),
    [
        # A filter of 100 Hz, then two decimations whose last leaves 20 Hz (README there).
        ("staubli_tx40", TX40, 15.0, 25.0),
        # The robot's own example uses 3.66 Hz by the rule of ten, tests of reading 4 Hz.
        ("ur10", "ur10_unisa/exciting.csv", 3.0, 7.0),
        # 3 Hz in the README; a run of five seconds.
        ("kinova_gen3", "kinova_gen3/opti_traj_testing1.csv", 2.0, 4.5),
    ],
)
def test_choice_is_reasonable(shared_data, robot, log, low, high):
    model, recording, documented = read(shared_data, robot, log)
    choice = recording.choose_cutoff(int(str(documented.get("order", 3))))
    assert low < choice.cutoff < high
    # The relative error of the identification: at most 0.3 percentage points above the documented processing.
    before = error(model, recording, **documented)
    after = error(model, recording, **{**documented, "cutoff": "auto"})
    assert after <= before + 0.003


@pytest.mark.parametrize("log", ["opti_traj_testing2", "RunTrajectory1"])
def test_quick_runs_of_the_kinova(shared_data, log):
    """Two seconds of faster motion: higher than the 3 Hz of the slow run, and below where noise takes over."""
    _, recording, _ = read(shared_data, "kinova_gen3", f"kinova_gen3/{log}.csv")
    choice = recording.choose_cutoff()
    assert 3.0 < choice.cutoff < 10.0
    assert np.all(motion_spectra(recording.q, recording.rate).crossover < 12.0)


@pytest.mark.parametrize("kind", ["kalman", "savitzky_golay"])
def test_other_filters_identify_as_well(shared_data, kind):
    model, recording, documented = read(shared_data, "ur10", "ur10_unisa/exciting.csv")
    before = error(model, recording, **documented)
    assert error(model, recording, **{**documented, "cutoff": "auto", "filter": kind}) <= before + 0.001


def test_joints_of_the_tx40_stick(shared_data):
    """They pause by turns: the published processing drops rows below a velocity threshold (README there)."""
    model, recording, documented = read(shared_data, "staubli_tx40", TX40)
    found = find_stiction(recording)
    assert np.all(found.count > 5000)
    with_thresholds = recording.process(**documented)
    both = recording.process(**documented, stiction=True)
    # Nearly all that is found is what the thresholds leave out anyway.
    assert both.used.sum() > 0.98 * with_thresholds.used.sum()
    without = {key: value for key, value in documented.items() if key != "velocity_threshold"}
    assert error(model, recording, **without, stiction=True) < error(model, recording, **without)


def test_findings_on_the_kinova(shared_data):
    """The logger wrote some rows twice; nothing is clipped."""
    _, recording, _ = read(shared_data, "kinova_gen3", "kinova_gen3/opti_traj_testing1.csv")
    found = recording.diagnose()
    assert not found.saturation
    rows = np.flatnonzero(found.repeated.flags[:, 0])
    assert 5 < len(rows) < 50
    np.testing.assert_array_equal(recording.torque[rows], recording.torque[rows - 1])
    np.testing.assert_array_equal(recording.q[rows], recording.q[rows - 1])
    assert found.clock.verdict == "even"
    assert found.clock.period == pytest.approx(1e-3, rel=1e-6)


def test_filtered_residuals_are_far_from_independent(shared_data):
    """With torques filtered at 3 Hz each row tells next to nothing new; plain deviations are ten times too small."""
    model, recording, documented = read(shared_data, "kinova_gen3", "kinova_gen3/opti_traj_testing1.csv")
    information = sy.Information.from_samples(model, recording.process(**documented))
    independent = ParameterCovariance.of_reduced(information.reduced()).standard_error
    assert np.median(ParameterCovariance.of(information).standard_error / independent) > 5.0
