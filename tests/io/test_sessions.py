"""Poses of other programs, folders of loggers, and times of photos from EXIF."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from PIL.ExifTags import IFD, Base

from rsdeblur import read_trajectory
from rsdeblur.errors import ClockError, InputError
from rsdeblur.io.exif import Exif, capture_time, on_clock_of, shown_time
from rsdeblur.io.sessions import camera_in, files_in
from rsdeblur.motion.gyro import GyroLog
from tests._util.files import EPOCH, RATES, TIMESTAMPS, TRAJECTORIES


def test_results_are_not_taken_for_photos(tmp_path: Path) -> None:
    """A batch may write into its session; a later one into another folder must not deblur the results again."""
    for name in ("a.png", "frames/b.png", "old/c.png", "old/batch.json", "new/d.png"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    photos = [tmp_path / "a.png", tmp_path / "frames" / "b.png"]
    assert files_in(tmp_path, without=tmp_path / "new") == photos
    for output in (tmp_path, tmp_path.parent):
        assert files_in(tmp_path, without=output) == [*photos, tmp_path / "new" / "d.png"]


def test_one_camera_file_is_that_of_the_photos() -> None:
    assert camera_in([Path("a.png"), Path("b.TOML")]) == Path("b.TOML")
    assert camera_in([Path("a.toml"), Path("b.toml")]) is None


@pytest.mark.parametrize("name", TRAJECTORIES)
def test_layouts(write: Callable[..., Path], name: str) -> None:
    trajectory = read_trajectory(write(TRAJECTORIES[name], "poses.txt"))
    assert trajectory.epoch_ns == EPOCH
    np.testing.assert_array_equal(trajectory.t, (TIMESTAMPS - EPOCH) * 1e-9)
    np.testing.assert_array_equal(trajectory.position, RATES)
    assert (trajectory.quaternion is None) == ("positions" in name)
    if trajectory.quaternion is not None:
        np.testing.assert_array_equal(trajectory.quaternion, [[0.0, 0.6, 0.0, 0.8]] * len(RATES))


# 2025-12-22 06:42:29 UTC.
NOON_NS = 1_766_385_749_000_000_000
LOCAL = "2025:12:22 08:42:29"


def exif_of(tags: dict[int, str]) -> Exif:
    block = Image.Exif()
    block.get_ifd(IFD.Exif).update(tags)
    return Exif(block.tobytes())


def log_at(ns: int, seconds: float = 10.0) -> GyroLog:
    t = np.arange(0.0, seconds, 0.01)
    return GyroLog(t, np.zeros((len(t), 3)), epoch_ns=ns)


@pytest.mark.parametrize(
    "exif",
    [
        exif_of({Base.DateTimeOriginal: LOCAL, Base.SubsecTimeOriginal: "25", Base.OffsetTimeOriginal: "+02:00"}),
        # No zone: the log covers the photo in one zone only.
        exif_of({Base.DateTimeOriginal: LOCAL, Base.SubsecTimeOriginal: "250000"}),
    ],
    ids=["offset", "log"],
)
def test_the_zone_follows_from_offset_or_log(exif: Exif) -> None:
    assert on_clock_of(capture_time(exif), log_at(NOON_NS - 10**9)) == NOON_NS + 250_000_000


def test_times_without_a_place_are_refused() -> None:
    for year in ("0000:00:00", "0001:01:01", "9999:12:31"):
        with pytest.raises(InputError, match="no DateTimeOriginal"):
            capture_time(exif_of({Base.DateTimeOriginal: f"{year} 00:00:00", Base.OffsetTimeOriginal: "-14:00"}))
    local = capture_time(exif_of({Base.DateTimeOriginal: LOCAL}))
    assert shown_time(exif_of({Base.DateTimeOriginal: LOCAL})) == "2025-12-22 08:42:29.000 local time"
    with pytest.raises(ClockError, match="not Unix time"):
        on_clock_of(local, log_at(10**15))
    with pytest.raises(ClockError, match="the log does not cover it"):
        on_clock_of(local, log_at(NOON_NS + 60 * 10**9))
    with pytest.raises(ClockError, match="several time zones fit"):
        on_clock_of(local, log_at(NOON_NS - 10**9, 1000.0))
