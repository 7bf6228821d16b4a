"""Passes over tables: equal to NumPy's to the last bit, whatever the columns, and where values are missing."""

import numpy as np
import pytest

from steelyard.graph import column_passes
from steelyard.graph.column_passes import central_differences, column_facts, side_by_side

WIDTHS = (1, 2, 3, 6, 7, 8, 9, 15, 16, 17, 29)


@pytest.fixture(autouse=True)
def compiled(monkeypatch):
    monkeypatch.setattr(column_passes, "FEW", 1)


def are_finite(facts):
    return bool(np.isfinite([facts.low, facts.high]).all())


def table(count, width, seed=0):
    return np.random.default_rng(seed).normal(size=(count, width)).round(1)


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("count", [10, 11, 64, 1001])
def test_the_facts_of_columns_are_those_that_numpy_finds(count, width):
    values = table(count, width)
    facts, steps = column_facts(values), np.diff(values, axis=0)
    assert facts.low.tolist() == values.min(axis=0).tolist()
    assert facts.high.tolist() == values.max(axis=0).tolist()
    assert facts.least_step.tolist() == steps.min(axis=0).tolist()
    assert facts.greatest_step.tolist() == steps.max(axis=0).tolist()
    assert facts.zeros.tolist() == (values == 0.0).sum(axis=0).tolist()
    assert facts.ranges.tolist() == np.ptp(values, axis=0).tolist()
    assert are_finite(facts)


@pytest.mark.parametrize("width", [1, 7, 9])
@pytest.mark.parametrize("row", [0, 1, 500, 999])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_values_that_are_missing_or_infinite_are_seen_wherever_they_stand(width, row, value):
    values = table(1000, width)
    values[row, width - 1] = value
    facts = column_facts(values)
    assert not are_finite(facts)
    np.testing.assert_array_equal(facts.low, values.min(axis=0))
    np.testing.assert_array_equal(facts.high, values.max(axis=0))
    with np.errstate(invalid="ignore"):
        np.testing.assert_array_equal(facts.greatest_step, np.diff(values, axis=0).max(axis=0))


def test_what_stands_behind_a_table_is_no_part_of_it():
    whole = table(1000, 7)
    whole[600:] = np.nan
    facts = column_facts(whole[:600])
    assert are_finite(facts)
    assert facts.high.tolist() == whole[:600].max(axis=0).tolist()


@pytest.mark.parametrize("count", range(5))
def test_tables_of_few_rows_have_facts_too(count):
    values = table(count, 7)
    facts = column_facts(values)
    assert facts.low.tolist() == values.min(axis=0, initial=np.inf).tolist()
    assert facts.greatest_step.tolist() == np.diff(values, axis=0).max(axis=0, initial=-np.inf).tolist()


def test_huge_numbers_are_numbers_though_their_steps_are_not():
    values = np.tile([[1e308, 1.0], [-1e308, 2.0]], (50, 1))
    facts = column_facts(values)
    assert are_finite(facts)
    assert facts.high.tolist() == [1e308, 2.0]
    assert facts.least_step.tolist() == [-np.inf, -1.0]


@pytest.mark.parametrize("width", WIDTHS)
def test_columns_stand_side_by_side_part_after_part(width):
    values = table(1500, width)
    values[3, 0] = np.nan
    ends = [(0, 700), (700, 701), (701, 1500)]
    parts = [[np.ascontiguousarray(values[a:b, k]) for k in range(width)] for a, b in ends]
    parts[1] = [values[700:701, k] for k in range(width)]  # as they stand in another table
    np.testing.assert_array_equal(side_by_side(parts), values)


def test_columns_of_other_numbers_become_doubles():
    found = side_by_side([[np.arange(5, dtype=np.int32), np.arange(5, dtype=np.float32)]])
    assert found.dtype == np.float64
    assert found.tolist() == [[float(k)] * 2 for k in range(5)]


def test_columns_of_different_lengths_are_refused():
    with pytest.raises(ValueError, match="as many rows"):
        side_by_side([[np.zeros(5), np.zeros(4)]])


def fourth_order(values, step):
    return (8.0 * (values[3:-1] - values[1:-3]) - (values[4:] - values[:-4])) / (12.0 * step)


@pytest.mark.parametrize("width", WIDTHS)
def test_differences_are_those_of_numpy_to_the_last_bit(width):
    values = np.random.default_rng(1).normal(size=(200, width))
    out = np.full((196, width), np.nan)
    central_differences(values, 0.003, out)
    np.testing.assert_array_equal(out, fourth_order(values, 0.003))


def test_differences_of_tables_that_do_not_stand_together_are_the_same():
    values = np.random.default_rng(2).normal(size=(200, 14))[:, ::2]
    out = np.empty((196, 7))
    central_differences(values, 0.3, out)
    np.testing.assert_array_equal(out, fourth_order(values, 0.3))
