"""Fixtures shared by all tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from rsdeblur.gyro import GyroLog
from rsdeblur.shake import hand_shake

# Tests start Python processes from the repository root, where the bare source folder must not shadow the installation.
os.environ["PYTHONSAFEPATH"] = "1"


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Keep measured FFT plans out of the user's cache."""
    os.environ["XDG_CACHE_HOME"] = str(tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder of real recordings, which are not part of the repository; tests that want it skip without it."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("RSDEBLUR_DATA", default))
    if not folder.is_dir():
        pytest.skip(f"no real recordings at {folder}; set RSDEBLUR_DATA to their folder")
    return folder


@pytest.fixture(scope="session")
def shaky_log():
    """Builder of a hand-shake log of 0.4 s at 200 Hz, about 1 rad/s, its rates about x, y, z multiplied by `axes`."""

    def build(axes: tuple[float, float, float] = (1.0, 1.0, 1.0), *, seed: int = 0) -> GyroLog:
        log = hand_shake(0.4, seed=seed)
        return GyroLog(log.t, log.omega * axes)

    return build
