"""What a missing extra is asked for with: a command that installs it, in a copy of the source as well as elsewhere."""

import re
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

from steelyard import errors

ROOT = Path(__file__).resolve().parent.parent
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
METADATA = [f'{one}; extra == "{extra}"' for extra, packages in EXTRAS.items() for one in packages if ";" not in one]


@pytest.mark.parametrize("extra", sorted(set(EXTRAS) - {"test", "oracles", "lint", "docs"}))
def test_the_command_names_the_packages_of_an_extra(extra, monkeypatch):
    command = errors.install_command(extra)
    assert re.fullmatch(r"pip install( '[\w.-]+(\[\w+\])?>=[\w.]+')+", command)
    assert "steelyard" not in command
    # Installed from an index there is no pyproject.toml, and what was installed tells the same.
    monkeypatch.setattr(errors, "__file__", "/nowhere/site-packages/steelyard/errors.py")
    monkeypatch.setattr(
        metadata,
        "requires",
        lambda name: [*METADATA, "numpy>=2.0", "backports.zstd>=1.0; python_version < '3.14' and extra == 'zstd'"],
    )
    assert errors.install_command(extra) == command
