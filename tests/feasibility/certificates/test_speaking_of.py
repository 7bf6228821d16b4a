"""Is a certificate about this robot? Also where a processor made other last digits of the robot's numbers."""

import copy
import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import steelyard as sy
from steelyard.errors import InputError
from steelyard.feasibility import verify_certificate
from steelyard.feasibility.certificates import speaks_of
from steelyard.feasibility.certificates.certificate import LAST_DIGITS
from steelyard.identification.saved import check_certificate, correct_estimate, matching_estimate

ROBOT = """
[description]
rows = [["pi/2", 0.1, 0.2, "q"], [0.3, 0.4, 0.1, "q"]]
[[constraints.center_of_mass_box]]
link = "link2"
lower = [-0.7, -0.7, -0.7]
upper = [0.7, 0.7, 0.7]
"""
POSSIBLE = {"Lxx": 0.4, "Lyy": 0.4, "Lzz": 0.3, "lx": 0.1, "ly": 0.2, "m": 4.0, "Fvj": 0.2, "Fcj": 0.1, "Foj": 0.1}


@pytest.fixture
def saved(tmp_path):
    """A robot file, an estimate of it, a refutation, and their set."""
    path = tmp_path / "arm.toml"
    path.write_text(ROBOT)
    file = sy.RobotFile.load(path)
    model = sy.Model.from_file(file)
    box = sy.CenterOfMassBox("link2", (-0.7,) * 3, (0.7,) * 3)
    feasible = sy.FeasibleSet(model, constraints=[box])
    possible = np.array([POSSIBLE.get(name[:-1], 0.0) for name in model.parameter_names])
    base = model.base_parameters().values(possible)
    factor = np.eye(len(base))
    # Names of one's own are what data that was reduced elsewhere has.
    info = sy.Information.from_factor(factor, factor @ base, 0.01, 100, [f"x{k}" for k in range(len(base))])
    sy.fit(info, feasible).save(tmp_path / "estimate.json")
    sy.least_squares(sy.Information.from_factor(factor, base, 0.01, 100, model.base_parameters().expressions)).save(
        tmp_path / "free.json"
    )
    base[[name.startswith("Fvj") for name in model.base_parameters().expressions]] = -1.0
    refuted = sy.check(feasible, base=base)
    assert refuted.feasible is False
    refuted.certificate.save(tmp_path / "refutation.json")
    return tmp_path, model, feasible


def other_digits(path, change):
    """The file as a processor had written it that finds other last digits of K; true, but of another robot."""
    document = json.loads(path.read_text())
    certificate = document.get("certificate", document)
    statement, proof = certificate["statement"], certificate["proof"]
    row, names = statement["base_map"][0], statement["parameter_names"]
    place = next(k for k, (i, _) in enumerate(row) if names[i].startswith("m") or (len(row) > 1 and k == len(row) - 1))
    row[place][1] = str(Fraction(row[place][1]) + Fraction(change))
    if certificate["verdict"] == "feasible":
        parameters = [Fraction(value) for value in proof["parameters"]]
        exact = sum(Fraction(value) * parameters[i] for i, value in row)
        statement["base"][0] = str(exact)
        document["base"][0] = float(exact)
    path.write_text(json.dumps(document))
    return certificate


def test_a_proof_of_other_last_digits_is_made_anew(saved):
    folder, model, feasible = saved
    robot = folder / "arm.toml"
    for name in ("estimate.json", "refutation.json"):
        sound = check_certificate(folder / name, robot)
        assert sound
        assert "anew" not in sound.sentence
    certificate = other_digits(folder / "estimate.json", "3e-15")
    assert verify_certificate(folder / "estimate.json")
    assert speaks_of(certificate, feasible) == "base map"
    assert speaks_of(certificate, feasible, rounding=LAST_DIGITS) == ""
    matching_estimate(model, folder / "estimate.json")
    for estimate in (None, folder / "estimate.json"):
        found = check_certificate(folder / "estimate.json", robot, estimate)
        assert found
        assert "was proved anew" in found.sentence


def test_a_robot_of_another_length_is_another_robot(saved):
    folder, model, feasible = saved
    certificate = other_digits(folder / "estimate.json", "1e-9")
    assert speaks_of(certificate, feasible, rounding=LAST_DIGITS) == "base map"
    assert "its base map differ from those" in check_certificate(folder / "estimate.json", folder / "arm.toml").sentence
    with pytest.raises(InputError):
        matching_estimate(model, folder / "estimate.json")


def test_a_refutation_of_other_last_digits_is_made_anew(saved):
    """The facet of a shape takes no part in the contradiction, and has another last digit."""
    folder, model, feasible = saved
    path = folder / "refutation.json"
    document = json.loads(path.read_text())
    without = sy.FeasibleSet(model)
    base = np.array([float(Fraction(value)) for value in document["statement"]["base"]])
    plain = json.loads(json.dumps(sy.check(without, base=base).certificate.to_dict()))
    facet = next(c for c in document["statement"]["conditions"] if not c["physical"])
    for change, accepted in (("1e-15", True), ("1e-9", False)):
        changed = copy.deepcopy(plain)
        changed["statement"]["conditions"].append(copy.deepcopy(facet))
        element = changed["statement"]["conditions"][-1]["coefficients"][0][1][0]
        element[2] = str(Fraction(element[2]) + Fraction(change))
        path.write_text(json.dumps(changed))
        assert verify_certificate(path)
        assert speaks_of(changed, feasible) == "conditions"
        assert (speaks_of(changed, feasible, rounding=LAST_DIGITS) == "") == accepted
        found = check_certificate(path, folder / "arm.toml")
        assert bool(found) == accepted
        assert ("was proved anew" in found.sentence) == accepted


def test_data_with_names_of_its_own_makes_estimates_that_can_be_read(saved):
    folder, model, _ = saved
    loaded = matching_estimate(model, folder / "estimate.json")
    assert loaded.base_expressions == model.base_parameters().expressions
    assert loaded.base_names[0] == "x0"


def test_what_correct_writes_can_be_read(saved):
    """Data that was reduced elsewhere names no joints, but their friction is told for each."""
    folder, model, _ = saved
    for name in ("free.json", "estimate.json"):
        corrected = correct_estimate(folder / "arm.toml", folder / name)
        corrected.save(folder / "corrected.json")
        assert matching_estimate(model, folder / "corrected.json").joint_names == ("joint1", "joint2")
        assert check_certificate(folder / "corrected.json", folder / "arm.toml", folder / "corrected.json")
        assert corrected.optimality_gap is None  # which is of the fit that came before


def test_what_an_estimate_may_say_of_its_feasibility(saved):
    folder, *_ = saved
    sound = json.loads((folder / "estimate.json").read_text())
    for change in (
        {"consistency": "whole", "certificate": None},
        {"parameters": None, "certificate": None},
        {"consistency": None},
    ):
        (folder / "changed.json").write_text(json.dumps(sound | change))
        with pytest.raises(InputError, match="consistency"):
            sy.Estimate.load(folder / "changed.json")
    (folder / "changed.json").write_text(json.dumps(sound | {"consistency": None, "certificate": None}))
    assert sy.Estimate.load(folder / "changed.json").parameters is not None
    with pytest.raises(InputError, match="without a proof; make one with"):
        verify_certificate(folder / "changed.json")
    other = check_certificate(folder / "estimate.json", folder / "arm.toml", None, "inertia")
    assert "give --consistency full" in other.sentence


def test_correct_leaves_parameters_alone_that_are_possible(saved):
    """Many robots have the same base parameters; those that were found for a reason stay."""
    folder, model, _ = saved
    robot, path = folder / "arm.toml", folder / "estimate.json"
    before, after = sy.Estimate.load(path), correct_estimate(robot, path)
    assert after.parameters.tolist() == before.parameters.tolist()
    assert "nothing changed" in after.remarks[-1]
    # Inertias that violate the triangle inequality alone.
    odd = before.parameters.copy()
    names = list(model.parameter_names)
    odd[names.index("Lxx1")] += 100.0  # which the motion does not show
    np.testing.assert_allclose(model.base_parameters().values(odd), before.base, rtol=0, atol=1e-13)
    replace(before, parameters=odd, consistency=None, certificate=None).save(path)
    after = correct_estimate(robot, path)
    assert abs(after.base - before.base).max() < 1e-12
    assert after.parameters.tolist() != odd.tolist()
    assert "were found anew" in after.remarks[-1]
    assert correct_estimate(robot, path, "inertia").parameters.tolist() == odd.tolist()


def test_a_claim_without_a_proof_is_not_believed(tmp_path):
    """Without its certificate an estimate may hold any numbers, but not the word that they are feasible."""
    model = sy.Model(sy.Robot.from_dh([("0", 0.0, 0.0, "q")], name="pendulum", gravity=(0, -9.81, 0)))
    info = sy.Information.from_factor(10 * np.eye(3), [-0.1, 5.0, 0.0], 0.02, 100, model.base_parameters().names)
    sy.fit(info, sy.FeasibleSet(model)).save(tmp_path / "estimate.json")
    document = json.loads((tmp_path / "estimate.json").read_text())
    document["certificate"] = None
    document["parameters"][9] = -1.0
    (tmp_path / "claim.json").write_text(json.dumps(document))
    with pytest.raises(sy.InputError, match="holds no certificate"):
        sy.Estimate.load(tmp_path / "claim.json")
    document["consistency"] = None
    (tmp_path / "numbers.json").write_text(json.dumps(document))
    assert "feasible (" not in repr(sy.Estimate.load(tmp_path / "numbers.json"))
