"""What the methods write can be read by what reads estimates."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.identification.saved import matching_estimate
from steelyard_thesis import Nakanishi2008, Rucker2022


@pytest.mark.parametrize("method", [pytest.param(Rucker2022, marks=pytest.mark.slow), Nakanishi2008])
def test_methods_write_what_can_be_read(tmp_path, method):
    robot = sy.Robot.from_dh([("pi/2", 0.1, 0.2, "q"), (0.3, 0.4, 0.1, "q")])
    model = sy.Model(robot)
    count = model.base_parameters().count
    # Names of one's own are what data that was reduced elsewhere has.
    info = sy.Information.from_factor(np.eye(count), np.ones(count), 0.01, 100, [f"x{k}" for k in range(count)])
    method().fit(info, sy.FeasibleSet(model)).save(tmp_path / "method.json")
    matching_estimate(model, tmp_path / "method.json")
