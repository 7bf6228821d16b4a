"""The picture is an SVG that draws the torques at the right height and names the verdicts."""

import re
from pathlib import Path

import lxml.etree
import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.identification import Identification
from steelyard.report import torque_picture, torque_svg

from .conftest import JOINTS, Reference

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def root(identification: Identification) -> lxml.etree._Element:
    return lxml.etree.fromstring(torque_svg(identification).encode())


def test_says_verdicts_and_errors(root: lxml.etree._Element, reference: Reference) -> None:
    words = [" ".join(element.itertext()) for element in root.iter(f"{SVG}text")]
    assert "An impossible robot" in words
    assert "A robot that can exist" in words
    assert f"error {reference.errors(1, reference.parameters)[2]:.2f} %" in root.findtext(f"{SVG}desc")
    assert [word for word in words if word.startswith("<script>")] == [f"{JOINTS[0]}  N·m"]
    assert not list(root.iter(f"{SVG}script", f"{SVG}image", f"{SVG}foreignObject"))


def test_measured_curves_have_the_shape_of_the_data(root: lxml.etree._Element, reference: Reference) -> None:
    curves = [element.get("d") for element in root.iter(f"{SVG}path") if element.get("stroke") == "#8b8b8b"][:2]
    for joint, curve in enumerate(curves):
        points = np.array(re.findall(r"([-\d.]+) ([-\d.]+)", curve), dtype=float)
        recorded = reference.torques[1][:, joint]
        drawn = recorded[:: -(-len(recorded) // len(points))][: len(points)]
        assert np.corrcoef(-points[:, 1], drawn)[0, 1] > 0.999
        assert np.all(np.diff(points[:, 0]) > 0)


def test_is_written_whole(identification: Identification, tmp_path: Path) -> None:
    torque_picture(identification, tmp_path / "torques.svg")
    assert (tmp_path / "torques.svg").read_text(encoding="utf-8") == torque_svg(identification)
    assert [path.name for path in tmp_path.iterdir()] == ["torques.svg"]
    with pytest.raises(InputError, match="cannot be written"):
        torque_picture(identification, tmp_path / "missing" / "torques.svg")
