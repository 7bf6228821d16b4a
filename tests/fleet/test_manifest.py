"""Manifests are read as they say, and refused in a sentence."""

from __future__ import annotations

from pathlib import Path

import polars as pl
import pytest

import steelyard as sy
from steelyard.fleet import FleetManifest

ENTRY = '[[robots]]\nid = "A"\nlogs = ["a.csv"]\n'


def written(folder: Path, text: str) -> Path:
    path = folder / "fleet.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (f'robt = "x"\n{ENTRY}', "'robt' is not known here; did you mean \"robot\"?"),
        ('robot = "x"\n', "names no robots"),
        (ENTRY, "lacks 'robot', and the manifest names none for all"),
        ('robot = "x"\n[[robots]]\nid = "A"\n', "neither logs nor informations"),
        (f'robot = "x"\n{ENTRY}informations = ["a.json"]\n', "so that no data counts twice"),
        (f'robot = "x"\n{ENTRY}{ENTRY}', "robot 'A' is there twice without a date, first in "),
        (f'robot = "x"\n{ENTRY}date = 2026-03-01\n{ENTRY}', "has no date here, but has one in"),
        (f'robot = "x"\n{ENTRY}date = "March"\n', "date must be a date such as 2026-03-01"),
        (f'robot = "x"\n{ENTRY}date = "20260301"\n{ENTRY}date = 2026-03-01\n', "is there twice on 2026-03-01"),
        (f'robot = "x"\n{ENTRY}grup = "a"\n', 'did you mean "group"?'),
        (f'robot = "x"\nfalse_discovery_rate = 5\n{ENTRY}', "a number between 0 and 1"),
        (f'robot = "x"\nintervals = "some"\n{ENTRY}', '"base" or "all"'),
        ('robot = "x"\n[[robots]]\nid = ["A"]\nlogs = ["a.csv"]\n', "id must be a text"),
        ('robot = "x"\n[[robots]]\nid = "A\\nB"\nlogs = ["a.csv"]\n', "id must be a text of one line"),
        (f'robot = "x"\n[[robots]]\nid = "{"A" * 201}"\nlogs = ["a.csv"]\n', "at most 200 letters"),
        ('robot = "x"\ntable = "none.csv"\n', "correct `table` in the manifest"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path: Path, text: str, told: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(sy.errors.InputError) as error:
        FleetManifest.load(path)
    assert told in str(error.value)
    assert str(tmp_path) in str(error.value)


def test_a_log_that_is_named_again_counts_once(tmp_path: Path) -> None:
    """Also so that a short manifest cannot ask for one log to be read a hundred thousand times."""
    text = ENTRY.replace('["a.csv"]', '["a.csv", "b.csv", "./a.csv", "x/../b.csv"]')
    [entry] = FleetManifest.load(written(tmp_path, f'robot = "x"\n{text}')).entries
    assert entry.logs == (str(tmp_path / "a.csv"), str(tmp_path / "b.csv"))


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_tables_say_the_same_as_toml(tmp_path: Path, kind: str) -> None:
    path = written(
        tmp_path,
        'robot = "arm.urdf"\n[[robots]]\nid = "7"\ndate = 2026-03-01\ngroup = "b"\nlogs = ["x/*.csv", "s3://a/b.csv"]\n'
        '[[robots]]\nid = "8"\nrobot = "other.urdf"\ninformations = ["8.json"]\nvalidate = ["v.csv"]\n',
    )
    frame = pl.DataFrame(
        {
            "id": [7, 8],
            "date": ["2026-03-01", None],
            "group": ["b", ""],
            "robot": ["arm.urdf", "other.urdf"],
            "logs": ["x/*.csv; s3://a/b.csv", None],
            "informations": [None, "8.json"],
            "validate": ["", "v.csv"],
        }
    )
    table = tmp_path / f"fleet.{kind}"
    if kind == "csv":
        frame.write_csv(table)
    else:
        frame.write_parquet(table)
    manifest = FleetManifest.load(path)
    assert FleetManifest.load(table).entries == manifest.entries
    first, second = manifest.entries
    assert first.label == "7 (2026-03-01)"
    assert first.logs == (str(tmp_path / "x" / "*.csv"), "s3://a/b.csv")
    assert second.robot == tmp_path / "other.urdf"


def test_times_with_zones_are_ordered_as_they_follow_each_other(tmp_path: Path) -> None:
    dates = ("2026-03-01T12:00:00+02:00", "2026-03-01T11:00:00Z")
    entries = [f'[[robots]]\nid = "A"\nlogs = ["a"]\ndate = {date}\n' for date in dates]
    manifest = FleetManifest.load(written(tmp_path, 'robot = "x"\n' + "".join(entries)))
    assert [one.date for one in manifest.entries] == ["2026-03-01T10:00:00+00:00", "2026-03-01T11:00:00+00:00"]


@pytest.mark.parametrize(
    ("dates", "message"),
    [
        (["2026-03-01T12:00:00+02:00", "2026-03-01T11:00:00"], "has no time zone, and one in .*; give all or none"),
        (["2026-03-01T11:00:00", "2026-03-01T12:00:00+02:00"], "has a time zone, and none in .*; give all or none"),
        (["0001-01-01T00:00:00+14:00"], "a date such as 2026-03-01"),
    ],
)
def test_times_that_cannot_be_ordered_are_refused(tmp_path: Path, dates: list[str], message: str) -> None:
    entries = [f'[[robots]]\nid = "A"\nlogs = ["a"]\ndate = {date}\n' for date in dates]
    with pytest.raises(sy.errors.InputError, match=message):
        FleetManifest.load(written(tmp_path, 'robot = "x"\n' + "".join(entries)))


def test_a_column_that_is_unknown_is_named(tmp_path: Path) -> None:
    (tmp_path / "fleet.csv").write_text("id,lgos\nA,a.csv\n", encoding="utf-8")
    with pytest.raises(sy.errors.InputError, match="'lgos' is no column of a manifest; did you mean \"logs\""):
        FleetManifest.load(tmp_path / "fleet.csv")


def test_the_folder_of_a_manifest_is_no_pattern(tmp_path: Path) -> None:
    """Else the manifest in `[x]` takes the logs of its neighbour `x`."""
    own, neighbour = tmp_path / "[x]", tmp_path / "x"
    for folder in (own, neighbour):
        (folder / "A").mkdir(parents=True)
        (folder / "A" / "b.json").write_text("{}")
    (own / "A" / "a.json").write_text("{}")
    robots = [f'[[robots]]\nid = "{k}"\ninformations = ["{one}"]\n' for k, one in enumerate(("A/*.json", "A/b.json"))]
    several, one = FleetManifest.load(written(own, 'robot = "x"\n' + "".join(robots))).entries
    assert several.files("informations") == (str(own / "A" / "a.json"), str(own / "A" / "b.json"))
    assert one.files("informations") == (str(own / "A" / "b.json"),)
    (own / "A" / "b.json").unlink()
    with pytest.raises(sy.errors.InputError, match="correct informations of 1"):
        FleetManifest.load(own / "fleet.toml").entries[1].files("informations")
    assert several.robot == own / "x"


def test_each_file_of_a_log_of_several_counts_from_the_folder_of_the_manifest(tmp_path: Path) -> None:
    given = ["a.csv+b.csv", "/elsewhere/a.csv + day 2/b.csv", "day+night/*.csv", "whole+.csv", "c++"]
    (tmp_path / "whole+.csv").touch()
    path = tmp_path / "fleet.toml"
    path.write_text(f'robot = "robot.toml"\n[[robots]]\nid = "a"\nlogs = {given}\n')
    [entry] = FleetManifest.load(path).entries
    assert entry.logs == (
        f"{tmp_path}/a.csv+{tmp_path}/b.csv",
        f"/elsewhere/a.csv+{tmp_path}/day 2/b.csv",
        *(f"{tmp_path}/{one}" for one in given[2:]),
    )
