"""Delays of played logs, whose motion stops at every reversal: none is claimed that the data does not hold."""

from dataclasses import replace

import numpy as np
import pytest

import steelyard as sy
from steelyard.control.play import play
from steelyard.identification.wam import TRAJECTORIES, simulated_log, true_parameters, wam_model
from steelyard.recording import Processing, Recording, estimate_delay
from steelyard.recording.diagnosis import advanced
from steelyard.simulation import Sensors


@pytest.fixture(scope="module")
def model() -> sy.Model:
    return wam_model()


@pytest.fixture(scope="module", params=[pytest.param(0.0, marks=pytest.mark.slow), 0.004])
def played(request, model) -> tuple[float, Recording]:
    # The zero-order hold of the controller logs the torque half a period before the motion's mean.
    sensors = Sensors(encoder_resolution=2 * np.pi / 172032, torque_noise=0.1, torque_delay=request.param)
    delta = true_parameters()
    # A controller that knows the friction would not let the joints stop.
    friction = np.array([name[:2] in ("Fv", "Fc", "Fo") for name in model.parameter_names])
    log = play(model, delta, TRAJECTORIES["A"], sensors=sensors, nominal=np.where(friction, 0.0, delta))
    return request.param - 0.0005, log


@pytest.mark.slow
@pytest.mark.parametrize("cutoff", ["auto", 2.2, 10.0, 50.0])
def test_uncertainty_holds_the_truth_at_any_cutoff(played, model, cutoff):
    true, log = played
    found = estimate_delay(log.process(cutoff=cutoff), model)
    assert abs(found.delay - true) < 2.0 * found.standard_deviation
    assert not found.is_sure


@pytest.mark.slow
def test_unsure_delay_is_not_applied(played, model):
    _, log = played
    plain = log.process(Processing(cutoff=5.0), model)
    left = log.process(Processing(cutoff=5.0, delay="automatic"), model)
    np.testing.assert_array_equal(left.torque, plain.torque)
    assert any(
        remark.startswith("Torques were not moved: the delay behind the motion that the model shows")
        for remark in left.remarks
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "cutoff", [pytest.param(2.2, marks=pytest.mark.slow), 4.8, pytest.param(10.0, marks=pytest.mark.slow)]
)
def test_delay_of_an_undisturbed_motion_stays_sure(model, cutoff):
    log = simulated_log(model, "A", seed=1)
    late = replace(log, torque=advanced(log.torque, -3.7)[0])
    found = estimate_delay(late.process(cutoff=cutoff), model)
    assert found.is_sure
    assert abs(found.delay - 0.0037) < 2.0 * found.standard_deviation < 1e-3
