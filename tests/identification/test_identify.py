"""The main job on simulated robots with known parameters, in chunks, and with columns mixed up."""

import json
import re
from dataclasses import replace

import numpy as np
import polars as pl
import pytest

import steelyard as sy
from steelyard.errors import InputError
from steelyard.identification import check_estimate
from steelyard.recording import process_chunks


@pytest.mark.parametrize("option", [{"prior": None}, {"prefer": "lightest"}, {"estimator": lambda *_, **__: None}])
def test_a_weight_without_its_prior_is_refused(option):
    robot = sy.Robot.from_dh([(0, 1.0, 0, "q")])
    with pytest.raises(InputError, match=r"prior_weight .--prior-weight. is that of the prior"):
        sy.identify(robot, "absent.csv", prior_weight=3.0, **option)


@pytest.mark.slow
def test_without_noise_the_truth_comes_back(elbow, simulation):
    path, model, folder = elbow
    log = simulation.record(model, folder / "log.csv", seed=1, noise=0.0)
    result = sy.identify(path, [log])
    truth = model.base_parameters().values(simulation.true_parameters(model))
    # The filter and the finite differences are not perfect, the regression is.
    np.testing.assert_allclose(result.unconstrained.base, truth, atol=2e-2 * np.abs(truth).max())
    assert result.unconstrained.relative_error < 0.02
    assert result.estimate.consistency == "full"
    assert sy.check(result.feasible_set, parameters=result.estimate.parameters).feasible


@pytest.mark.slow
def test_every_answer_is_physically_possible(elbow, simulation):
    path, model, folder = elbow
    log = simulation.record(model, folder / "log.csv", seed=2, noise=2.0)
    other = simulation.record(model, folder / "other.csv", seed=3, noise=2.0)
    result = sy.identify(path, [log], validate=[other])
    parameters = result.estimate.parameters
    for columns in model.link_columns:
        xx, xy, xz, yy, yz, zz, lx, ly, lz, m = parameters[columns]
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        com = np.array([lx, ly, lz]) / m
        about_com = tensor - m * (com @ com * np.eye(3) - np.outer(com, com))
        a, b, c = np.sort(np.linalg.eigvalsh(about_com))
        assert m > 0
        assert a > 0
        assert a + b >= c * (1 - 1e-9)
    names = model.parameter_names
    assert all(parameters[names.index(f"{s}{k}")] >= 0 for s in ("Fvj", "Fcj", "Ia") for k in (1, 2, 3))
    assert [p.role for p in result.predictions] == ["identification", "validation"]
    assert result.estimate.relative_error >= result.unconstrained.relative_error
    held_out = result.predictions[1]
    samples = sy.Recording.read(other, joints=3).process(cutoff=10.0, trim=0.5)
    predicted = model.inverse_dynamics(samples.q, samples.dq, samples.ddq, parameters)
    error = np.linalg.norm(predicted - samples.torque) / np.linalg.norm(samples.torque)
    assert held_out.feasible_error == pytest.approx(error, rel=1e-9)
    assert held_out.trace.feasible.shape == held_out.trace.measured.shape == (len(held_out.trace.t), 3)


@pytest.mark.slow
def test_chunks_change_nothing(elbow, simulation):
    path, model, folder = elbow
    log = simulation.record(model, folder / "log.csv", seed=4, rate=500.0, periods=2.0)
    whole, chunked = sy.identify(path, [log]), sy.identify(path, [log], chunk_rows=1000)
    assert len(list(process_chunks(log, None, sy.Processing(cutoff=10.0, trim=0.5), rows=1000, joints=3))) > 5
    # To the last bit: standard parameters choose among near ties, which a difference of 1e-13 moves by 1e-3.
    for a, b in zip(whole.information.factors, chunked.information.factors, strict=True):
        np.testing.assert_array_equal(a.triangle, b.triangle)
    np.testing.assert_array_equal(chunked.estimate.parameters, whole.estimate.parameters)
    np.testing.assert_array_equal(chunked.unconstrained.standard_error, whole.unconstrained.standard_error)
    assert chunked.information.count == whole.information.count
    assert chunked.remarks == whole.remarks


@pytest.mark.slow
def test_two_logs_are_one_regression(elbow, simulation):
    path, model, folder = elbow
    logs = [simulation.record(model, folder / f"log{k}.csv", seed=k) for k in (5, 6)]
    both, first, second = sy.identify(path, logs), sy.identify(path, logs[:1]), sy.identify(path, logs[1:])
    assert both.information.count == first.information.count + second.information.count
    joined = sy.least_squares(first.information + second.information, "joint")
    np.testing.assert_allclose(both.unconstrained.base, joined.base, rtol=1e-9, atol=1e-10)


@pytest.mark.slow
def test_swapped_torque_columns_are_found(elbow, simulation):
    path, model, folder = elbow
    simulation.record(model, folder / "good.csv", seed=7)
    good = sy.Recording.read(folder / "good.csv", joints=3)
    assert not any("swapped" in r for r in sy.identify(path, [folder / "good.csv"]).remarks)
    mixed = sy.Recording(t=good.t, q=good.q, torque=good.torque[:, [0, 2, 1]], source="mixed")
    mixed.save(folder / "mixed.csv")
    remarks = sy.identify(path, [folder / "mixed.csv"]).remarks
    assert any("The torque columns of joint2 and joint3 look swapped" in remark for remark in remarks)


@pytest.mark.slow
def test_swapped_position_columns_are_found(elbow, simulation):
    path, model, folder = elbow
    simulation.record(model, folder / "good.csv", seed=7)
    good = sy.Recording.read(folder / "good.csv", joints=3)
    mixed = sy.Recording(t=good.t, q=good.q[:, [1, 0, 2]], torque=good.torque, source="mixed")
    mixed.save(folder / "mixed.csv")
    remarks = sy.identify(path, [folder / "mixed.csv"]).remarks
    assert any("The position columns of joint1 and joint2 look swapped" in remark for remark in remarks)


@pytest.mark.slow
def test_torques_of_the_wrong_sign_are_said(elbow, simulation):
    """The negative of a robot fits as well as the robot, and cannot exist."""
    path, model, folder = elbow
    simulation.record(model, folder / "good.csv", seed=7)
    good = sy.Recording.read(folder / "good.csv", joints=3)
    assert not any("sign" in remark for remark in sy.identify(path, [folder / "good.csv"]).remarks)
    sy.Recording(t=good.t, q=good.q, torque=-good.torque, source="negative").save(folder / "negative.csv")
    result = sy.identify(path, [folder / "negative.csv"])
    assert any("all joints look wrong: with `torque_sign = -1` in [log] the error falls" in r for r in result.remarks)
    assert result.verdict.status == "infeasible"


@pytest.mark.slow
def test_constraints_of_the_robot_file_hold(elbow, simulation):
    path, model, folder = elbow
    log = simulation.record(model, folder / "log.csv", seed=8)
    path.write_text(simulation.robot_file + "\n[constraints]\ntotal_mass = { equal = 9.0 }\n")
    result = sy.identify(path, [log])
    assert result.total_mass == pytest.approx(9.0, abs=1e-6)


@pytest.mark.slow
def test_a_saved_estimate_is_judged(elbow, simulation):
    path, model, folder = elbow
    log = simulation.record(model, folder / "log.csv", seed=9, noise=2.0)
    result = sy.identify(path, [log])
    result.estimate.save(folder / "good.json")
    result.unconstrained.save(folder / "raw.json")
    assert check_estimate(path, folder / "good.json").feasible
    assert check_estimate(path, folder / "raw.json").feasible == result.verdict.feasible
    document = json.loads((folder / "good.json").read_text())
    document["parameters"][9] = -1.0
    (folder / "bad.json").write_text(json.dumps(document))
    verdict = check_estimate(path, folder / "bad.json")
    assert not verdict.feasible
    assert any("link1" in violation.block for violation in verdict.violations)


@pytest.mark.slow
def test_same_inputs_same_answer(elbow, simulation):
    path, model, folder = elbow
    log = simulation.record(model, folder / "log.csv", seed=10, noise=1.0)
    a, b = sy.identify(path, [log]), sy.identify(path, [log])
    assert a.estimate.to_dict() == b.estimate.to_dict()


@pytest.mark.slow
@pytest.mark.parametrize("removed", [False, True])
def test_a_log_that_is_written_while_it_is_read_is_refused(elbow, simulation, removed):
    path, model, folder = elbow
    log = simulation.record(model, folder / "log.csv", seed=1)

    def meanwhile(step):
        if step == "least squares" and removed:
            log.unlink()
        elif step == "least squares":
            log.write_text(log.read_text().replace("0.1", "0.2"))

    if removed:  # all of it was read
        assert sy.identify(path, [log], progress=meanwhile).prediction.word == "good"
        return
    with pytest.raises(InputError, match=r"log.csv was written while it was read.*; wait until it is complete"):
        sy.identify(path, [log], progress=meanwhile)


@pytest.mark.parametrize("content", ["no,number\n", ""])
def test_what_is_wrong_with_a_log_since_it_was_written_is_no_fault_of_it(elbow, simulation, content):
    path, model, folder = elbow
    log = simulation.record(model, folder / "log.csv", seed=1)

    def meanwhile(step):
        if step.startswith("reading"):
            log.write_text(log.read_text() + content if content else content)

    with pytest.raises(InputError, match=r"log.csv was written while it was read.*; wait until it is complete"):
        sy.identify(path, [log], progress=meanwhile)


def test_logs_of_which_nothing_is_left_are_refused(elbow, simulation):
    path, model, folder = elbow
    logs = [simulation.record(model, folder / f"log{seed}.csv", seed=seed) for seed in (1, 2)]
    with pytest.raises(InputError, match=r"log1\.csv has .* rows in .*, of which \[processing\] leaves none to use"):
        sy.identify(path, logs, processing={"velocity_threshold": 1e3})
    samples = sy.Recording.read(logs[0]).process(cutoff=10.0)
    nothing = replace(samples, mask=np.zeros(samples.q.shape, dtype=bool))
    with pytest.raises(InputError, match="`mask` leaves none to use"):
        sy.identify(path, [samples, nothing])


@pytest.mark.parametrize("rows", [0, -3, 2.5, True, 10**20])
def test_chunks_have_rows_that_a_record_can_hold(elbow, simulation, rows):
    """What `run.json` cannot hold would leave a folder of results that no later run takes for one."""
    path, model, folder = elbow
    log = simulation.record(model, folder / "log.csv", seed=1)
    with pytest.raises(InputError, match=r"`chunk_rows` is .*; it must be a whole number from 1"):
        sy.identify(path, log, chunk_rows=rows)


def test_what_the_end_of_a_log_tells_names_its_path(elbow, simulation):
    """Parts of a partitioned data set all have files of one name."""
    path, model, folder = elbow
    table = pl.read_csv(simulation.record(model, folder / "log.csv", seed=1))
    for day, torque in (("day=1", table["tau1"]), ("day=2", pl.lit(0.0))):
        (folder / "logs" / day).mkdir(parents=True)
        table.with_columns(tau1=torque).write_csv(folder / "logs" / day / "part-0.csv")
    with pytest.raises(InputError, match=r"day=2.part-0\.csv: the torque of joint .* is 0 throughout"):
        sy.identify(path, str(folder / "logs"))


@pytest.mark.slow
def test_a_long_log_among_many_short_ones_is_cut_into_folds(elbow, simulation):
    path, model, folder = elbow
    logs = [simulation.record(model, folder / "long.csv", seed=1, periods=3.0)]
    whole = sy.Recording.read(simulation.record(model, folder / "whole.csv", seed=2))
    for number in range(24):
        rows = slice(70 * number, 70 * number + 300)
        logs.append(folder / f"short{number}.csv")
        sy.Recording(t=whole.t[rows], q=whole.q[rows], torque=whole.torque[rows]).save(logs[-1])
    assert sy.identify(path, logs).prediction.source == "5 stretches of the logs, each left out in turn"


@pytest.mark.parametrize("processing", [None, {"cutoff": 5.0, "velocity_threshold": 0.01}])
def test_what_is_wrong_with_a_partition_names_its_path(elbow, simulation, processing):
    path, model, folder = elbow
    for day in (1, 2):
        (folder / f"day={day}").mkdir()
        log = simulation.record(model, folder / f"day={day}" / "part-0.csv", seed=day)
    lines = log.read_text().splitlines()
    log.write_text("\n".join([*lines[:500], lines[500].rpartition(",")[0] + ",", *lines[501:]]))
    with pytest.raises(InputError, match=f"\n{re.escape(str(log))} has no finite number in column .* on line 501"):
        sy.identify(path, str(folder / "day=*/part-0.csv"), processing=processing)
