"""Inspection of robots with many joints."""

import json

import numpy as np
import pytest

from steelyard.cli.main import main
from steelyard.robot import RobotFile


def chain(count):
    links = "".join(f'<link name="link{k}"/>' for k in range(count + 1))
    joints = "".join(
        f'<joint name="joint{k}" type="revolute"><parent link="link{k}"/><child link="link{k + 1}"/>'
        f'<origin xyz="0.1 0 0.05" rpy="{1.5707963267948966 * (k % 2)} 0 0"/><axis xyz="0 0 1"/>'
        '<limit lower="-3" upper="3" velocity="2" effort="9"/></joint>'
        for k in range(count)
    )
    return f'<robot name="chain">{links}{joints}</robot>'


@pytest.mark.parametrize(("count", "counted"), [(6, True), (50, False)])
def test_regressors_of_long_chains_are_not_built(count, counted, tmp_path, capsys, monkeypatch):
    """The regressor of 300 joints is half a million expressions, minutes and gigabytes."""
    path = tmp_path / "chain.urdf"
    path.write_text(chain(count))
    monkeypatch.setattr("sys.argv", ["steelyard", "inspect", str(path)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    text = capsys.readouterr().out
    assert ("base regressor" in text) is counted
    assert (f"{count * (count + 1) // 2} blocks" in text) is not counted
    assert text.count(" + ") > 5 * count


SLIP = """<robot name="r"><link name="a"/>
  <link name="b"><!-- keep --><inertial><origin xyz="0.2 0 0"/><mass value="3"/>
    <inertia ixx="0.002" ixy="0" ixz="0" iyy="0.04" iyz="0" izz="0.4"/></inertial>
  <collision><origin xyz="0.2 0 0"/><geometry><box size="0.4 0.06 0.06"/></geometry></collision></link>
  <joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/></joint></robot>"""
SDF = """<sdf version="1.9"><model name="r"><link name="a"/><link name="b"><!-- keep -->
  <inertial><pose>0.2 0 0 0 0 0</pose><mass>3</mass>
  <inertia><ixx>0.002</ixx><iyy>0.04</iyy><izz>0.4</izz></inertia></inertial></link>
  <joint name="j" type="revolute"><parent>a</parent><child>b</child><axis><xyz>0 1 0</xyz></axis></joint>
</model></sdf>"""


MJCF = """<mujoco model="r"><worldbody><body name="b"><!-- keep --><joint name="j" axis="0 1 0"/>
  <inertial pos="0.2 0 0" mass="3" diaginertia="0.002 0.04 0.4"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(("suffix", "text"), [("urdf", SLIP), ("sdf", SDF), ("xml", MJCF)])
def test_a_description_is_repaired_in_its_own_format(suffix, text, tmp_path, capsys, monkeypatch):
    source, target = tmp_path / f"r.{suffix}", tmp_path / f"repaired.{suffix}"
    source.write_text(text)
    monkeypatch.setattr("sys.argv", ["steelyard", "inspect", str(source), "--repair", "--output", str(target)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    said = capsys.readouterr().out
    assert "b: no body has these moments of inertia (the least second moment is -0.82 of the largest)" in said
    assert "b: principal moments of inertia from (0.002, 0.04, 0.4) to" in said
    assert "<!-- keep -->" in target.read_text()
    body = RobotFile.load(target).robot.links[0].inertia
    moments = np.linalg.eigvalsh(body.about_com)
    assert moments[2] <= moments[0] + moments[1]
    if suffix == "urdf":  # its shape tells what is wrong
        assert "probably decimal slip of izz" in said
        assert moments == pytest.approx([0.002, 0.04, 0.04])
    assert source.read_text() == text


@pytest.mark.parametrize("suffix", ["urdf", "sdf", "xml"])
def test_a_mass_below_zero_is_told_in_every_format(suffix, tmp_path, capsys, monkeypatch):
    text = {"urdf": SLIP.replace('"3"', '"-3"'), "sdf": SDF.replace(">3<", ">-3<"), "xml": MJCF.replace('"3"', '"-3"')}
    source, target = tmp_path / f"r.{suffix}", tmp_path / f"repaired.{suffix}"
    source.write_text(text[suffix])
    monkeypatch.setattr("sys.argv", ["steelyard", "inspect", str(source), "--repair", "--output", str(target)])
    with pytest.raises(SystemExit):
        main()
    said = capsys.readouterr().out
    assert "b: has a mass of -3 kg" in said
    assert "No numbers follow from what is said of b: left as it was." in said
    assert target.read_text() == source.read_text()


def test_repair_needs_a_file(tmp_path, capsys, monkeypatch):
    (tmp_path / "r.urdf").write_text(SLIP)
    monkeypatch.setattr("sys.argv", ["steelyard", "inspect", str(tmp_path / "r.urdf"), "--repair"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert "give both --repair and --output FILE" in capsys.readouterr().err


def test_findings_and_repairs_are_told_as_json(tmp_path, capsys, monkeypatch):
    source, target = tmp_path / "r.urdf", tmp_path / "repaired.urdf"
    source.write_text(SLIP)
    arguments = ["steelyard", "inspect", str(source), "--json", "--repair", "--output", str(target)]
    monkeypatch.setattr("sys.argv", arguments)
    with pytest.raises(SystemExit):
        main()
    told = json.loads(capsys.readouterr().out)
    (link,) = told["links"]
    assert (link["link"], link["possible"], link["cause"]) == ("b", False, "decimal slip of izz")
    assert link["evidence"].startswith("no body has these moments of inertia")
    assert link["finding"] == f"{link['evidence']}; probably {link['cause']}"
    assert link["remedy"] == f"Let --repair change its {told['repaired']['changes']['b']}"
    assert told["repaired"]["file"] == str(target)
    assert target.exists()
