"""Real robots: published numbers, and the table of all methods against NumPy."""

import numpy as np
import pytest

from steelyard_thesis.reproduction import Context
from steelyard_thesis.reproduction.recordings import parted, ur10
from steelyard_thesis.reproduction.sections import real_robots
from steelyard_thesis.reproduction.sections.published_robots import combination, tx40_comparisons, wam_2014_comparisons

ROBOTS = ("TX40", "UR10", "Gen3", "WAM")


def test_sums_of_parameters_are_compared_without_their_order_and_notation():
    assert combination("L_1yy + Ia_1 - 1.1*l_3y + m_3") == combination("Ia1 + m3 + Lyy1 - 1.1*ly3")
    assert combination("Iam6") == combination("Ia6")
    assert combination("Lxx2 - Lyy2") != combination("Lxx2 + Lyy2")


@pytest.mark.data
def test_the_wam_of_2014_agrees(shared_data):
    rows = list(wam_2014_comparisons(Context(shared_data)))
    assert len(rows) == 75
    assert all(row.agrees for row in rows)


@pytest.mark.data
def test_the_tx40_agrees_within_its_standard_deviations_nearly_everywhere(shared_data):
    rows = list(tx40_comparisons(Context(shared_data)))
    assert all(row.agrees for row in rows[:2])
    # As if the published values were drawn again: nothing beyond two standard deviations.
    assert all(abs(row.difference) < 2.0 * row.tolerance for row in rows[2:])
    assert len(rows) == 26


@pytest.mark.data
def test_errors_are_those_of_the_stacked_regression(shared_data):
    """Weighted least squares of the whole stacked regressor with NumPy, and its errors on both parts."""
    model, samples = ur10(shared_data)
    parts = parted(samples)
    assert [part.count for part in parts] == [2 * samples.count // 3, samples.count - 2 * samples.count // 3]
    K = model.base_parameters()
    stacked = [(model.regressor(s.q, s.dq, s.ddq) @ K.Pb, s.torque) for s in parts]
    H, torque = stacked[0]
    plain = np.linalg.lstsq(H.reshape(-1, K.count), torque.reshape(-1), rcond=None)[0]
    weight = 1.0 / np.sqrt(np.mean((torque - H @ plain) ** 2, axis=0))
    rows, target = (weight[:, None] * H).reshape(-1, K.count), (weight * torque).reshape(-1)
    beta = np.linalg.lstsq(rows, target, rcond=None)[0]
    robot = next(r for r in real_robots.robots(Context(shared_data)) if r.name == "UR10")
    outcome = next(iter(real_robots.estimates(robot)))
    np.testing.assert_allclose(outcome.estimate.base, beta, rtol=0, atol=2e-3 * np.abs(beta).max())
    for information, (columns, measured) in zip((robot.training, robot.held_out), stacked, strict=True):
        error = np.linalg.norm(measured - columns @ outcome.estimate.base) / np.linalg.norm(measured)
        assert information.relative_error(outcome.estimate.base) == pytest.approx(error, rel=1e-8)


def check_table_of_all_methods(result):
    """What the section of real robots must say, however it was computed."""
    table, best, *joints = result.tables
    assert [row[0] for row in table.rows] == [name for name in ROBOTS for _ in range(13)]
    for name in ROBOTS:
        rows = {(row[1], row[2]): row for row in table.rows if row[0] == name}
        least = rows["OLS" if name == "WAM" else "WLS", "none"]
        assert least[6] == "no"
        assert rows["ours, least residual", "inertia"][6] in ("yes", "inertia only")
        for key in (("ours, least residual", "full"), ("ours, default", "full")):
            assert rows[key][6] == "yes"
            assert rows[key][7] == 100.0
        # Nothing is below plain least squares in what it minimises; full is dearer than inertia.
        assert all(float(row[5]) >= -1e-9 for row in rows.values())
        assert rows["ours, least residual", "full"][5] >= rows["ours, least residual", "inertia"][5]
    # The error is the root of the criterion.
    assert all(0.5 * row[5] <= 1e-6 for row in best.rows)
    assert [len(t.rows) for t in joints] == [13, 13, 13]
