"""Fixtures shared by all tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

# Tests start Python processes from the repository root, where the bare source folder must not shadow the installation.
os.environ["PYTHONSAFEPATH"] = "1"


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder of real recordings, which are not part of the repository; tests that want it skip without it."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("RSDEBLUR_DATA", default))
    if not folder.is_dir():
        pytest.skip(f"no real recordings at {folder}; set RSDEBLUR_DATA to their folder")
    return folder
