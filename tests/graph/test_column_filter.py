"""Compiled filters of columns beside SciPy's."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.signal import butter, sosfilt, sosfilt_zi, sosfiltfilt

from steelyard.graph.column_filter import filter_columns
from steelyard.recording.filters import zero_phase


@pytest.mark.parametrize("width", [1, 3, 4, 7, 8, 9, 17])
@pytest.mark.parametrize("order", [1, 3, 6])
def test_columns_are_filtered_as_by_scipy(width: int, order: int) -> None:
    random = np.random.default_rng(width)
    given = random.standard_normal((200, width))
    guarded = np.full((202, width), np.nan)  # what is written beyond the rows would show
    sections = butter(order, 0.2, output="sos")
    states = random.standard_normal((len(sections), 2, width))
    for backwards in (False, True):
        guarded[1:-1] = given
        filter_columns(sections, states, guarded[1:-1], backwards)
        rows = given[::-1] if backwards else given
        expected, _ = sosfilt(sections, rows, axis=0, zi=np.moveaxis(states, 1, 1))
        np.testing.assert_allclose(guarded[1:-1], expected[::-1] if backwards else expected, atol=1e-12)
        assert np.isnan(guarded[[0, -1]]).all()


def test_no_rows_and_other_arrays() -> None:
    sections = butter(3, 0.2, output="sos")
    filter_columns(sections, np.zeros((2, 2, 2)), np.empty((0, 2)))
    with pytest.raises(ValueError, match="C-contiguous"):
        filter_columns(sections, np.zeros((2, 2, 2)), np.zeros((2, 5)).T)


@pytest.mark.parametrize("rows", [40, 3000])
@pytest.mark.parametrize(("order", "cutoff"), [(1, 3.0), (3, 4.8), (4, 60.0), (8, 490.0)])
def test_tables_are_filtered_as_by_scipy(order: int, cutoff: float, rows: int) -> None:
    values = np.cumsum(np.random.default_rng(1).standard_normal((rows, 7)), axis=0)
    found = zero_phase.low_pass(values, 1000.0, cutoff, order, "log")
    expected = sosfiltfilt(butter(order, cutoff / 500.0, output="sos"), values, axis=0)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12 * np.abs(values).max())


def exact_steady_states(sections: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the states that a constant 1 leaves as they are, by fractions, and what rounding may make of them.

    Sections are in the transposed direct form II. Where the cutoff is low, 1 + a1 + a2 nearly cancels: its last digits
    are those of the coefficients, whichever way the states are computed.
    """
    level, found, allowed = Fraction(1), [], []
    for section in sections:
        b0, b1, b2, a0, a1, a2 = map(Fraction, section.tolist())
        left = a0 + a1 + a2
        output = (b0 + b1 + b2) / left
        found.append([level * (b1 + b2 - (a1 + a2) * output), level * (b2 - a2 * output)])
        size = level * (abs(b1) + abs(b2) + (abs(a1) + abs(a2)) * output)
        allowed.append([4 * np.finfo(float).eps * float(size * (1 + 1 / left))] * 2)
        level *= output
    return np.array(found, dtype=float), np.array(allowed)


@pytest.mark.parametrize("order", range(1, 13))
def test_filters_are_designed_as_by_scipy(order: int) -> None:
    for cutoff in (0.001, 0.0096, 0.2, 0.5, 0.97):
        sections, steady = zero_phase._sections(order, cutoff)
        expected = butter(order, cutoff, output="sos")
        np.testing.assert_allclose(sections, expected, rtol=4e-16, atol=0.0)
        exact, allowed = exact_steady_states(sections)
        assert (np.abs(steady - exact) <= allowed).all()
        assert (np.abs(steady - sosfilt_zi(expected)) <= allowed).all()
        _, poles, gain = butter(order, cutoff, output="zpk")
        found, own_gain = zero_phase._poles(order, cutoff)
        np.testing.assert_allclose(found, poles, rtol=4e-16, atol=0.0)
        np.testing.assert_allclose(own_gain, gain, rtol=4e-16)
