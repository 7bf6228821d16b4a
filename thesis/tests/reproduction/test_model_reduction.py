"""Section 6.4: the reductions by plain least squares on fewer columns, and the thesis's figures beside them."""

import numpy as np
import pytest

import steelyard as sy
from steelyard.identification.wam import simulated_log, wam_model
from steelyard_thesis.reproduction.section import Context
from steelyard_thesis.reproduction.sections.identification import SEED
from steelyard_thesis.reproduction.sections.model_reduction import SECTION

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def result():
    return SECTION.compute(Context())


def test_published_figures_stand_beside_ours(result):
    thesis, ours = result.tables[0].rows
    assert thesis[1:] == ("feasible with 36 of 76 excluded", "4.66", "4.57", "4.62")
    assert ours[1] == "never feasible, up to 75 of 76 excluded"
    assert float(ours[3]) <= float(ours[4])
    assert result.comparisons == ()  # the recordings are not public


def test_errors_are_those_of_least_squares_on_fewer_columns(result):
    model = wam_model()
    samples = simulated_log(model, "A", SEED).process(cutoff=4.8, order=3, trim=0.5, velocity_threshold=None)
    information = sy.Information.from_samples(model, samples)
    reduced = information.reduced(information.joint_weights("joint"))
    names = model.base_parameters().expressions
    table = result.tables[2]
    kept = np.ones(len(names), dtype=bool)
    errors = result.charts[0].curves[0]
    assert errors.x.tolist() == list(range(76))
    # The weakest parameter by its relative standard deviation, again and again.
    for count in range(40):
        columns = np.flatnonzero(kept)
        base = np.zeros(len(names))
        base[columns] = np.linalg.lstsq(reduced.R[:, columns], reduced.rho, rcond=None)[0]
        assert 100.0 * information.relative_error(base) == pytest.approx(errors.y[count], rel=1e-7)
        spread = np.sqrt(np.diag(np.linalg.inv(reduced.R[:, columns].T @ reduced.R[:, columns])))
        kept[columns[np.argmax(spread / np.abs(base[columns]))]] = False
        if f", {count} excluded:" in table.title:
            assert all((row[1] == "yes") == (row[0] not in np.array(names)[columns]) for row in table.rows)


def test_what_fails_is_a_moment_of_inertia_held_at_zero(result):
    worst = result.tables[2].rows[0]
    assert worst[1] == "yes"
    assert worst[2] == 0.0
    assert worst[3] > 0.0
    assert worst[4] > 0.0
