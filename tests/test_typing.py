"""What a type checker says of programs that use the package."""

import subprocess
import sys
from pathlib import Path

import pytest

import steelyard as sy

RIGHT = """
from pathlib import Path
from typing import assert_type

import numpy as np
from numpy.typing import NDArray

import steelyard as sy
from steelyard import InputError

robot = sy.Robot.from_urdf("arm.urdf").with_terms(sy.Viscous(), sy.Coulomb())
assert_type(robot, sy.Robot)
model = sy.Model(robot)
recording = sy.Recording.read(Path("log.csv"))
assert_type(recording, sy.Recording)
samples = recording.process(cutoff=5.0)
assert_type(samples, sy.Samples)
info = sy.Information.from_samples(model, samples)
assert_type(sy.least_squares(info), sy.Estimate)
feasible = sy.FeasibleSet(model, consistency="full", constraints=[sy.TotalMass(maximum=10.0)])
try:
    estimate = sy.fit(info, feasible)
except InputError as error:
    raise SystemExit(str(error)) from error
assert_type(estimate.base, NDArray[np.float64])
verdict = sy.check(feasible, base=estimate.base)
assert_type(verdict, sy.Verdict)
if verdict.feasible:
    estimate.save("estimate.json")
assert_type(sy.simulation.Sensors(), sy.simulation.Sensors)
"""

WRONG = """
import steelyard as sy

sy.this_does_not_exist
robot: str = sy.Robot.from_dh([(0, 1.0, 0, "q")])
sy.Model(3)
sy.TotalMass(maximum="ten")
sy.Recording.read("log.csv").velocities
"""


def test_the_list_of_names_is_that_of_the_module() -> None:
    lines = Path(sy.__file__).with_suffix(".pyi").read_text(encoding="utf-8").splitlines()
    names = {line.rpartition(" ")[2] for line in lines if line.startswith("from .") and not line.startswith("from . ")}
    assert names == set(sy.__all__) - {"__version__"}
    assert [name for name in names if getattr(sy, name).__name__ != name] == []


@pytest.mark.slow
def test_mypy_tells_right_from_wrong(tmp_path: Path) -> None:
    pytest.importorskip("mypy", reason="mypy is not installed")
    (tmp_path / "right.py").write_text(RIGHT)
    (tmp_path / "wrong.py").write_text(WRONG)
    names = [name for name in sy.__all__ if name != "__version__"]
    (tmp_path / "names.py").write_text("import steelyard as sy\n" + "".join(f"reveal_type(sy.{n})\n" for n in names))
    command = [sys.executable, "-m", "mypy", "--strict", "--no-error-summary", "right.py", "wrong.py", "names.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    lines = [line.split(":", maxsplit=3) for line in done.stdout.splitlines()]
    errors = {(file, int(number)): text for file, number, kind, text in lines if kind.strip() == "error"}
    assert set(errors) == {("wrong.py", number) for number in (4, 5, 6, 7, 8)}, done.stdout + done.stderr
    assert 'Module has no attribute "this_does_not_exist"' in errors["wrong.py", 4]
    revealed = [text for file, _, _, text in lines if file == "names.py"]
    assert len(revealed) == len(names)
    for name, text in zip(names, revealed, strict=True):  # neither modules nor Any
        assert text.startswith((' Revealed type is "def (', ' Revealed type is "Overload')), (name, text)
