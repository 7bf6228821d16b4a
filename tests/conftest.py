"""Fixtures shared by all the tests."""

from pathlib import Path

import pytest

SHARED = Path(__file__).resolve().parent.parent.parent / "shared"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real recordings, or a skip where it is absent."""
    folder = SHARED / "data"
    if not folder.is_dir():
        pytest.skip("the real recordings (../shared/data) are not here")
    return folder


@pytest.fixture(scope="session")
def thesis_tables() -> Path:
    """The folder with the tables of the thesis as CSV, or a skip where it is absent."""
    folder = SHARED / "thesis" / "tables"
    if not folder.is_dir():
        pytest.skip("the tables of the thesis (../shared/thesis/tables) are not here")
    return folder
