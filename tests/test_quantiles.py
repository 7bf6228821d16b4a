"""Quantiles beside those of SciPy."""

import math

import numpy as np
import pytest
from scipy import special

from steelyard.quantiles import normal_quantile, student_quantile

PROBABILITIES = (1e-300, 1e-8, 1e-4, 0.01, 0.025, 0.2, 0.499, 0.5, 0.501, 0.9, 0.975, 0.9999)


@pytest.mark.parametrize("probability", PROBABILITIES)
def test_normal_quantiles_are_those_of_scipy(probability: float) -> None:
    assert normal_quantile(probability) == pytest.approx(special.ndtri(probability), rel=1e-14, abs=1e-15)


@pytest.mark.parametrize("degrees", [1.0, 1.5, 2.0, 3.0, 4.9, 5.1, 12.0, 59.0, 61.0, 377.0, 999.0, 1001.0, 37499.0])
def test_quantiles_of_student_are_those_of_scipy(degrees: float) -> None:
    chosen = np.array(PROBABILITIES[1:])
    found = [student_quantile(float(one), degrees) for one in chosen]
    np.testing.assert_allclose(found, special.stdtrit(degrees, chosen), rtol=1e-11, atol=1e-15)


def test_with_infinitely_many_degrees_of_freedom_they_are_normal() -> None:
    assert student_quantile(0.3, math.inf) == normal_quantile(0.3)
