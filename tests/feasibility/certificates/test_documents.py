"""Certificates as files: anybody can verify them, and what was tampered with is refused."""

import copy
import json
import subprocess
import sys
from fractions import Fraction

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.feasibility import FeasibleSet, TotalMass, check, load_certificate, verify_certificate
from steelyard.feasibility.certificates import FeasibilityCertificate, speaks_of, verify_document

GOOD = [1.5, 0.1, 0.25, 0.3, 0.4, 0.1]
BAD = [0.5, 0.1, 0.25, 0.3, 0.4, 0.1]


@pytest.fixture
def witness(two_links):
    return json.loads(json.dumps(check(FeasibleSet(two_links), base=GOOD).certificate.to_dict()))


@pytest.fixture
def refutation(two_links):
    return json.loads(json.dumps(check(FeasibleSet(two_links), base=BAD).certificate.to_dict()))


def test_documents_prove_what_they_say(witness, refutation):
    assert verify_document(witness)
    assert "are feasible" in verify_document(witness).sentence
    assert verify_document(refutation)
    assert "no parameters" in verify_document(refutation).sentence


def test_a_saved_certificate_is_verified_by_a_process_without_numpy(two_links, tmp_path):
    """The verifying modules need the standard library alone."""
    path = tmp_path / "certificate.json"
    check(FeasibleSet(two_links), base=BAD).certificate.save(path)
    assert verify_certificate(path)
    code = (
        "import sys, types, importlib.util, pathlib, json\n"
        "import steelyard\n"
        "root = pathlib.Path(steelyard.__file__).parent\n"
        "for name in ('regression', 'feasibility', 'feasibility.certificates'):\n"
        "    package = types.ModuleType('steelyard.' + name)\n"
        "    package.__path__ = [str(root / name.replace('.', '/'))]\n"
        "    sys.modules['steelyard.' + name] = package\n"
        "from steelyard.feasibility.certificates.document import verify_certificate\n"
        f"print(bool(verify_certificate({str(path)!r})))\n"
        "assert not {'numpy', 'scipy', 'clarabel'} & set(sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.stdout.strip(), done.stderr) == ("True", "")


def test_the_separating_direction_separates(two_links, point_cloud_parameters):
    """y·β is negative, but not for the base parameters of any body made of points."""
    feasible = FeasibleSet(two_links)
    certificate = check(feasible, base=BAD).certificate
    assert certificate.direction @ np.array(BAD) < 0
    rng = np.random.default_rng(3)
    for _ in range(300):
        delta = np.full(22, rng.uniform(0, 1))
        for start in (0, 11):
            points = rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(-2, 1)
            delta[start : start + 10] = point_cloud_parameters(10.0 ** rng.uniform(-2, 2, 3), points)
        base = feasible.K @ delta
        assert certificate.direction @ base >= -1e-12 * np.abs(base).max()


def _halved(document, *path):
    changed = copy.deepcopy(document)
    place = changed
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = str(place[path[-1]]) + "1" if "." in str(place[path[-1]]) else str(place[path[-1]]) + ".5"
    return changed


def test_a_changed_witness_is_refused(witness):
    names = witness["statement"]["parameter_names"]
    for name in ("Lzz1", "m2", "Lzz2", "lx2", "Fvj1"):
        assert not verify_document(_halved(witness, "proof", "parameters", names.index(name)))
    for index in range(6):
        check_of = verify_document(_halved(witness, "statement", "base", index))
        assert not check_of
        assert "do not have the base parameter" in check_of.sentence
    shorter = copy.deepcopy(witness)
    shorter["proof"]["parameters"].pop()
    assert not verify_document(shorter)


def test_a_changed_dual_point_is_refused(refutation):
    for index, (_, elements) in enumerate(refutation["proof"]["duals"]):
        for element in range(len(elements)):
            assert not verify_document(_halved(refutation, "proof", "duals", index, 1, element, 2))
    for index, value in enumerate(refutation["proof"]["direction"]):
        if value != "0":
            assert not verify_document(_halved(refutation, "proof", "direction", index))
    opposite = copy.deepcopy(refutation)
    opposite["proof"]["direction"] = [f"-{v}".replace("--", "") for v in opposite["proof"]["direction"]]
    assert not verify_document(opposite)


def test_a_proof_of_one_is_not_a_proof_of_the_other(witness, refutation):
    moved = copy.deepcopy(refutation)
    moved["statement"]["base"] = witness["statement"]["base"]
    assert not verify_document(moved)
    moved = copy.deepcopy(witness)
    moved["statement"]["base"] = refutation["statement"]["base"]
    assert not verify_document(moved)


def test_a_shift_costs_reach(refutation):
    shifted = copy.deepcopy(refutation)
    shifted["proof"]["shift"] = "1e-9"
    found = verify_document(shifted)
    assert found
    assert found.trace_bound == pytest.approx(found.gap / 1e-9)
    assert found.sentence.startswith("Proved in exact arithmetic, as far as the traces")
    shifted["proof"]["shift"] = "-1e-9"
    assert not verify_document(shifted)


def test_a_proof_that_does_not_reach_far_is_none(witness):
    """With a large shift the zero matrices contradict every robot that weighs more than nothing."""
    weak = copy.deepcopy(witness)
    assert weak["statement"]["conditions"][2]["coefficients"] == [[10, [[0, 0, "1"]]]]
    # y of a friction that is 0.3: Z = -y of that condition, semidefinite once shifted.
    index = weak["statement"]["base_map"].index([[10, "1"]])
    direction = ["0"] * 6
    direction[index] = "-1"
    weak["verdict"] = "infeasible"
    weak["proof"] = {"direction": direction, "duals": [[2, [[0, 0, "-1"]]]], "multipliers": [], "shift": "1"}
    found = verify_document(weak)
    assert not found
    assert "must reach 1e+06" in found.sentence


def test_bodies_are_checked_whether_the_file_names_them_or_not(witness):
    names = witness["statement"]["parameter_names"]
    witness["statement"]["conditions"] = []
    honest = verify_document(witness)
    assert honest
    assert "make 2 possible bodies" in honest.sentence
    assert "all 0 conditions" in honest.sentence
    impossible = copy.deepcopy(witness)
    impossible["proof"]["parameters"][names.index("lz2")] = "1000"
    assert "no body has the mass m2" in verify_document(impossible).sentence
    renamed = copy.deepcopy(impossible)
    renamed["statement"]["parameter_names"][names.index("lz2")] = "other"
    assert "does not name the ten" in verify_document(renamed).sentence


def test_statements_that_anything_satisfies_are_refused(two_links):
    feasible = FeasibleSet(two_links, constraints=[TotalMass(equal=3.0)])
    document = check(feasible, base=GOOD).certificate.to_dict()
    assert verify_document(document)
    document["statement"]["equations"][0]["tolerance"] = "100"
    assert "be missed by 100" in verify_document(document).sentence
    document["statement"]["consistency"] = "whole"
    assert "nothing defines" in verify_document(document).sentence
    document["statement"]["parameter_names"][1] = document["statement"]["parameter_names"][0]
    with pytest.raises(InputError, match="share a name"):
        verify_document(document)


@pytest.mark.parametrize("part", ["statement", "proof", "verdict"])
def test_missing_parts_are_said(witness, part):
    del witness[part]
    with pytest.raises(InputError, match=r"lacks its statement|verdict"):
        verify_document(witness)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("statement", "parameter_names"), None),
        (("statement", "base"), ["1"]),
        (("statement", "base", 0), "1e99999"),
        (("statement", "base_map", 0, 0), [999, "1"]),
        (("statement", "base_map", 0, 0), [-1, "1"]),
        (("statement", "base_map", 0, 0), [True, "1"]),
        (("statement", "conditions", 0, "size"), 10**12),
        (("statement", "conditions", 0, "size"), "4"),
        (("statement", "conditions", 0, "strict"), 1),
        (("statement", "conditions", 0, "coefficients", 0), [0, [[3, 1, "1"]]]),
        (("proof", "parameters", 0), 1.5),
        (("proof", "parameters"), 5),
    ],
)
def test_damaged_documents_are_said(witness, path, value):
    place = witness
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    with pytest.raises(InputError, match="is damaged"):
        verify_document(witness, "file.json")


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"format": "steelyard-estimate-3"}', "\0", "[" * 100000])
def test_files_that_are_no_certificates(tmp_path, text):
    path = tmp_path / "certificate.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"certificate\.json: (is not|format is)"):
        load_certificate(path)


def test_missing_files(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        load_certificate(tmp_path / "nothing.json")


def test_a_certificate_speaks_of_one_robot(two_links, witness):
    assert speaks_of(witness, FeasibleSet(two_links)) == ""
    assert speaks_of(witness, FeasibleSet(two_links), np.array(GOOD)) == ""
    assert speaks_of(witness, FeasibleSet(two_links), np.array(BAD)) == "base parameters"
    assert speaks_of(witness, FeasibleSet(two_links, "inertia")) == "consistency"
    assert speaks_of(witness, FeasibleSet(two_links, constraints=[TotalMass(maximum=3.0)])) == "conditions"
    assert speaks_of(witness, FeasibleSet(two_links, constraints=[TotalMass(equal=3.0)])) == "equations"


def test_more_is_proved_by_feasibility_and_less_by_infeasibility(two_links, witness, refutation):
    """What is possible with a constraint is without; what is impossible without is with."""
    constrained = FeasibleSet(two_links, constraints=[TotalMass(maximum=30.0)])
    assert speaks_of(check(constrained, base=GOOD).certificate.to_dict(), FeasibleSet(two_links)) == ""
    assert speaks_of(check(constrained, base=BAD).certificate.to_dict(), FeasibleSet(two_links)) == "conditions"
    assert speaks_of(refutation, constrained) == ""
    assert speaks_of(witness, constrained) == "conditions"


def test_a_certificate_is_of_its_own_base_parameters_to_the_last_digit(two_links, witness):
    near = np.array(GOOD)
    near[0] = np.nextafter(near[0], 2.0)
    assert speaks_of(witness, FeasibleSet(two_links), near) == "base parameters"


def test_a_certificate_of_parameters_holds_these_very_numbers(two_links):
    feasible = FeasibleSet(two_links)
    parameters = check(feasible, base=GOOD).parameters * 1.1
    certificate = FeasibilityCertificate.of_parameters(feasible, parameters)
    document = certificate.to_dict()
    assert verify_document(document)
    assert [Fraction(text) for text in document["proof"]["parameters"]] == [
        Fraction(repr(v)) for v in parameters.tolist()
    ]
    sums = [
        sum(Fraction(c) * Fraction(repr(float(parameters[k]))) for k, c in row)
        for row in document["statement"]["base_map"]
    ]
    assert certificate.base.tolist() == [float(value) for value in sums]
