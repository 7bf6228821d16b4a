"""The snippets of the guide run as they stand."""

import re
import tomllib
from pathlib import Path

import pytest

import steelyard as sy
from steelyard.collision import GEOMETRY_KEYS, geometry_from_dict

GUIDE = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "collision-free-motion.md"


@pytest.mark.slow
def test_the_guide(tmp_path, monkeypatch, capsys):
    pytest.importorskip("coal", reason="coal (extra `collision`) is not installed")
    text = GUIDE.read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    names = {}
    snippets = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(snippets) == 2
    exec(compile(snippets[0], "guide", "exec"), names)
    printed = capsys.readouterr().out
    for said in ("('fore to base',)", "base and upper: adjacent", "upper and fore: adjacent"):
        assert said in printed
    exec(compile(snippets[1], "guide", "exec"), names)
    assert all(margin.clearance >= 0 for margin in names["design"].margins)

    # The limits file beside it is for the same robot.
    (toml,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    tables = {key: value for key, value in tomllib.loads(toml).items() if key in GEOMETRY_KEYS}
    assert set(tables) == set(GEOMETRY_KEYS)
    found = geometry_from_dict(tables, sy.Robot.from_urdf("arm.urdf"), tmp_path)
    assert [one.name for one in found] == ["self-collision", "obstacles", "table plane", "workspace"]
