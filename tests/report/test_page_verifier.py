"""The verifier of certificates that the report carries accepts the proofs of the tests, and refuses the forgeries."""

import json
import os
import shutil
import subprocess
import sys
from importlib import resources
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parents[1]
RUN = """
require(process.argv[1]);
const lines = require("fs").readFileSync(process.argv[2], "utf8").split("\\n").filter(Boolean);
console.log(JSON.stringify(lines.map(line => steelyardCertificate.verify(JSON.parse(line)[0]).valid)));
"""


def verdicts(file: Path) -> list[bool]:
    """What the page's verifier says of each line of a file, a list whose first element is the text of a certificate."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("Node.js is not installed")
    with resources.as_file(resources.files("steelyard.report").joinpath("certificate.js")) as script:
        done = subprocess.run([node, "-e", RUN, str(script), str(file)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    found: list[bool] = json.loads(done.stdout)
    return found


@pytest.mark.slow
def test_every_certificate_and_every_forgery_of_the_tests_is_judged_as_ours_judges_it(tmp_path: Path) -> None:
    """A plugin writes down whatever the tests of certificates verify; they then run in a process of their own."""
    recorded = tmp_path / "recorded.jsonl"
    where = TESTS / "feasibility" / "certificates"
    command = [sys.executable, "-m", "pytest", "-q", "-n0", "-p", "certificate_recorder", "-m", "slow or not slow"]
    environment = os.environ | {"STEELYARD_RECORDED_CERTIFICATES": str(recorded)}
    environment["PYTHONPATH"] = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    done = subprocess.run(
        [*command, str(where)],
        env=environment,
        cwd=TESTS.parent,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:]
    lines = [json.loads(line) for line in recorded.read_text(encoding="utf-8").splitlines()]
    ours = [valid for _, valid in lines]
    assert sum(ours) > 200
    assert ours.count(False) > 200
    different = [text for (text, valid), theirs in zip(lines, verdicts(recorded), strict=True) if valid != theirs]
    assert different == []


@pytest.mark.slow
def test_what_is_no_certificate_proves_nothing(tmp_path: Path) -> None:
    texts = ["", "{", "[]", "{}", "[" * 100_000, "\0", '{"format": "steelyard-certificate-1"}', '{"a": 1} {"a": 1}']
    file = tmp_path / "texts.jsonl"
    file.write_text("".join(json.dumps([text]) + "\n" for text in texts))
    assert verdicts(file) == [False] * len(texts)
