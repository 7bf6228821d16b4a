"""The verifier in the documentation, which shares no line with ours, agrees with ours on proofs and on forgeries."""

import copy
import json
import subprocess
import sys
from fractions import Fraction as Q
from pathlib import Path

import numpy as np
import pytest

import steelyard as sy
from steelyard.errors import InputError
from steelyard.feasibility import check, verify_certificate, verify_document

SCRIPT = Path(__file__).resolve().parents[3] / "docs" / "reference" / "verify_certificate.py"


def verdicts(folder: Path, documents: list[dict]) -> list[bool]:
    """What the script says of each document, in one process; a file that it cannot read proves nothing."""
    for index, document in enumerate(documents):
        (folder / f"{index}.json").write_text(json.dumps(document))
    code = (
        "import runpy, sys\n"
        f"for index in range({len(documents)}):\n"
        f"    sys.argv = ['verify', {str(folder)!r} + f'/{{index}}.json']\n"
        "    try:\n"
        f"        runpy.run_path({str(SCRIPT)!r})\n"
        "    except (SystemExit, ValueError, KeyError, IndexError, TypeError, AttributeError) as error:\n"
        "        print('Refused:', error)\n"
        "assert not {'steelyard', 'numpy', 'scipy'} & set(sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-I", "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr == ""
    lines = done.stdout.splitlines()
    assert len(lines) == len(documents)
    return [line.startswith("Proved") for line in lines]


def ours(document: dict) -> bool:
    try:
        return bool(verify_document(document))
    except InputError:
        return False


def places(value, path=()):
    """Every place of a document that holds no list and no object."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from places(item, (*path, key))
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from places(item, (*path, index))
    else:
        yield path


def forged(document: dict, random: np.random.Generator) -> dict:
    """A copy with one place changed."""
    changed = copy.deepcopy(document)
    options = [path for path in places(changed) if path[-1] not in ("robot", "format", "name")]
    path = options[random.integers(len(options))]
    holder = changed
    for key in path[:-1]:
        holder = holder[key]
    value = holder[path[-1]]
    if isinstance(value, bool):
        holder[path[-1]] = not value
    elif isinstance(value, int):
        holder[path[-1]] = value + int(random.integers(-1, 2))
    else:
        texts = ["0", "1", f"-{value}", f"{value}1", "1e-7", "-3/7", "1000000"]
        holder[path[-1]] = texts[random.integers(len(texts))]
    return changed


@pytest.fixture(scope="module")
def certificates():
    robot = sy.Robot.from_dh([("-pi/2", 0.0, 0.3, "q"), ("0", 0.5, 0.0, "q")])
    robot = robot.with_terms(sy.Viscous(), sy.Coulomb())
    model = sy.Model(robot)
    mass = sy.TotalMass(equal=8.0)
    found = []
    for consistency in ("full", "inertia"):
        for constraints in ([], [mass]):
            feasible = sy.FeasibleSet(model, consistency, constraints)
            good = check(sy.FeasibleSet(model, consistency, [mass]), base=0.05 * np.ones(model.base_parameters().count))
            bodies = np.tile([0.4, 0.01, 0.0, 0.4, 0.02, 0.3, 0.1, 0.2, 0.0, 4.0, 0.2, 0.1], 2)
            base = model.base_parameters().values(bodies)
            possible = check(feasible, base=base)
            assert possible.feasible, (good, possible)
            base[0] = -3.0
            impossible = check(feasible, base=base)
            assert impossible.feasible is False
            found += [json.loads(json.dumps(v.certificate.to_dict())) for v in (possible, impossible)]
    return found


@pytest.mark.slow
@pytest.mark.parametrize("count", [4, pytest.param(100, marks=pytest.mark.slow)])
def test_both_accept_proofs_and_refuse_forgeries(certificates, tmp_path, count):
    random = np.random.default_rng(7)
    documents = certificates + [forged(document, random) for document in certificates for _ in range(count)]
    theirs, own = verdicts(tmp_path, documents), [ours(document) for document in documents]
    assert all(own[: len(certificates)])
    assert own == theirs
    assert len(certificates) < sum(own) < len(own) - 3 * count  # changes of what a proof does not use leave it a proof


def test_it_ties_the_numbers_of_an_estimate(tmp_path):
    model = sy.Model(sy.Robot.from_dh([("0", 0.0, 0.0, "q")], name="pendulum", gravity=(0, -9.81, 0)))
    names = model.base_parameters().names
    info = sy.Information.from_factor(10 * np.eye(3), [-0.1, 5.0, 0.0], 0.02, 100, names)
    sy.fit(info, sy.FeasibleSet(model)).save(tmp_path / "estimate.json")
    sound = json.loads((tmp_path / "estimate.json").read_text())
    documents = [sound]
    for name in ("parameters", "base"):
        for index in range(len(sound[name])):
            changed = copy.deepcopy(sound)
            changed[name][index] = float(np.nextafter(changed[name][index], 10.0))
            documents.append(changed)
    assert verdicts(tmp_path, documents) == [True] + [False] * (len(documents) - 1)
    for index, document in enumerate(documents):
        path = tmp_path / f"{index}.json"
        path.write_text(json.dumps(document))
        assert bool(verify_certificate(path)) == (index == 0)
        if index:
            with pytest.raises(InputError, match="while its certificate proves"):
                sy.Estimate.load(path)


def test_both_refuse_what_the_format_does_not_know(certificates, tmp_path):
    """Places of three indices would count in products, but not in the matrices that must be semidefinite."""
    witness, refutation = certificates[:2]
    hidden = copy.deepcopy(witness)
    hidden["verdict"] = "infeasible"
    hidden["statement"]["conditions"][0]["constant"] = [[0, 1, 5, "-1"]]
    hidden["proof"] = {
        "direction": ["0"] * len(witness["statement"]["base"]),
        "duals": [[0, [[0, 1, 5, "1"]]]],
        "multipliers": [],
        "shift": "0",
    }
    documents = [hidden]
    sizes = [condition["size"] for condition in witness["statement"]["conditions"]]
    for path, value in (
        (("proof", "parameters", 0), float(Q(witness["proof"]["parameters"][0]))),
        (("statement", "conditions", 0, "strict"), "false"),
        (("statement", "conditions", sizes.index(1), "size"), True),
        (("statement", "base_map", 0, 0, 0), float(witness["statement"]["base_map"][0][0][0])),
        (("format",), "steelyard-certificate-0"),
    ):
        changed = copy.deepcopy(witness)
        holder = changed
        for key in path[:-1]:
            holder = holder[key]
        holder[path[-1]] = value
        documents.append(changed)
    documents.append({"format": "steelyard-estimate-3", "certificate": None})
    assert verdicts(tmp_path, [*documents, witness, refutation]) == [False] * len(documents) + [True, True]
    for index, _ in enumerate(documents):
        with pytest.raises(InputError):
            verify_certificate(tmp_path / f"{index}.json")


def test_numbers_beyond_the_largest_double_are_judged(certificates, tmp_path):
    """Exact numbers have no largest: what proves a contradiction of 1e400 proves it."""
    huge = copy.deepcopy(certificates[1])
    proof = huge["proof"]
    proof["direction"] = [str(Q(v) * 10**400) for v in proof["direction"]]
    proof["duals"] = [[b, [[i, j, str(Q(v) * 10**400)] for i, j, v in Z]] for b, Z in proof["duals"]]
    assert verify_document(huge)
    assert verify_document(huge).gap == float("inf")
    loose = copy.deepcopy(next(c for c in certificates if c["statement"]["equations"] and c["verdict"] == "feasible"))
    loose["statement"]["equations"][0]["tolerance"] = "1e400"
    assert "be missed by inf" in verify_document(loose).sentence
    assert verdicts(tmp_path, [huge, loose]) == [True, False]


def test_both_refuse_two_verdicts(certificates, tmp_path):
    """Readers of JSON differ in which one of two they take."""
    path = tmp_path / "two.json"
    path.write_text(json.dumps(certificates[0]).replace('"verdict":', '"verdict": "infeasible", "verdict":', 1))
    done = subprocess.run([sys.executable, "-I", str(SCRIPT), str(path)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, "Not a proof: a key is there twice.\n")
    with pytest.raises(InputError, match="twice"):
        verify_certificate(path)
