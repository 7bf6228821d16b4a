"""A result that a newer version saved asks for an upgrade, not for the work to be done again."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import steelyard as sy
from steelyard.excitation import load_trajectory
from steelyard.feasibility import load_certificate
from steelyard.identification.saved_result import SavedResult


def load_result(path: Path) -> SavedResult:
    information = sy.Information.from_factor([[2.0, 1.0], [0.0, 1.0]], [4.0, 3.0], 0.5, 100, ["a", "b"])
    sy.least_squares(information).save(path.with_name("estimate.json"))
    path.rename(path.with_name("run.json"))
    return SavedResult.load(path.parent)


@pytest.mark.parametrize(
    ("kind", "load"),
    [
        ("estimate", sy.Estimate.load),
        ("information", sy.Information.load),
        ("certificate", load_certificate),
        ("trajectory", load_trajectory),
        ("run", load_result),
    ],
)
def test_a_newer_format_asks_for_an_upgrade(kind: str, load: Callable[[Path], Any], tmp_path: Path) -> None:
    for version, newer in (("0", False), ("99", True), ("99a", False), ("", False), ("9" * 5000, False)):
        path = tmp_path / "saved.json"
        path.write_text(json.dumps({"format": f"steelyard-{kind}-{version}"}))
        with pytest.raises(sy.InputError, match=f"steelyard-{kind}-[0-9]+'; ") as caught:
            load(path)
        assert ("newer Steelyard wrote it: upgrade" in str(caught.value)) is newer
        assert "identify" not in str(caught.value) or not newer
