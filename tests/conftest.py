"""Fixtures shared by all the tests."""

import csv
import os
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

SHARED = Path(__file__).resolve().parent.parent.parent / "shared"

settings.register_profile("steelyard", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("steelyard")

# Compiled code of the tests stays out of the user's cache.
_cache = tempfile.TemporaryDirectory(prefix="steelyard-cache-")
os.environ["STEELYARD_CACHE_DIR"] = _cache.name


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


def table(path: Path) -> list[dict[str, str]]:
    """Read a CSV table as a list of rows."""
    with path.open() as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="session")
def wam():
    """The WAM of thesis section 4.2, built from the thesis's own tables where they are here."""
    from steelyard.laboratory.wam import wam_model

    return wam_model()


@pytest.fixture
def random():
    """A seeded generator."""
    return np.random.default_rng(20141129)
