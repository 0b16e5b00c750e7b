"""Captures and clocks of sessions, poses of other programs, folders of loggers, and times of photos from EXIF."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from PIL.ExifTags import IFD, Base

from rsdeblur import Exposure, FileFormatError, GyroLog, InputError, read_captures, read_trajectory
from rsdeblur.errors import ClockError
from rsdeblur.io.captures import clock_facts
from rsdeblur.io.metadata import Exif, capture_time, on_clock_of, shown_time
from rsdeblur.io.sessions import camera_in, files_in
from rsdeblur.io.source import Source
from tests._util.files import ANDROID, CAPTURES, EPOCH, NEXT, RATES, TIMESTAMPS, TRAJECTORIES

Write = Callable[..., Path]
UNTIMED = ("timestamps", "named timestamps", "seconds", "euroc", "tum")


@pytest.mark.parametrize("name", CAPTURES)
def test_layouts(write: Write, name: str) -> None:
    path = write(CAPTURES[name], "captures.txt")
    if name in UNTIMED:
        assert read_captures(path, duration=0.01) == [Exposure(0.0, 0.01, EPOCH), Exposure(0.0, 0.01, NEXT)]
        with pytest.raises(FileFormatError, match=r"captures\.txt: .*without exposure times"):
            read_captures(path)
    else:
        assert read_captures(path) == [Exposure(0.0, 0.24, EPOCH), Exposure(0.0, 0.02, NEXT)]


def test_null_exposure_times_must_be_given(write: Write) -> None:
    path = write(f"{ANDROID}1000000,null,1,1,null\n2000000,null,1,1,5000000\n")
    with pytest.raises(FileFormatError, match="give the exposure time"):
        read_captures(path)
    assert [exposure.duration for exposure in read_captures(path, duration=0.01)] == [0.01, 0.005]


@pytest.mark.parametrize(("source", "offset"), [("REALTIME", 0.0), ("UNKNOWN", -3.7948831225)])
def test_clocks_of_a_session(write: Write, source: str, offset: float) -> None:
    path = write(
        "#Camera frame timestamp source according to CameraCharacteristics.SENSOR_INFO_TIMESTAMP_SOURCE is "
        f"SENSOR_INFO_TIMESTAMP_SOURCE_{source}.\n#elapsedRealtimeNanos()\tnanoTime()\tDifference\n"
        "1560503966948\t1556709084554\t3794882394\n1562660845704\t1558865961853\t3794883851\n"
    )
    facts = clock_facts(Source(path, "file"))
    assert facts is not None
    assert facts["time_offset_s"] == pytest.approx(offset, abs=1e-12)


def test_real_captures(data_dir: Path) -> None:
    mars = read_captures(data_dir / "real/mars-phone-240ms/movie_metadata.csv")
    burst = read_captures(data_dir / "real/shield-burst/images/images.txt")
    assert (len(mars), len(burst)) == (10, 7)
    assert mars[0] == Exposure(0.0, 0.24, 1_560_201_774_322)
    assert burst[-1] == Exposure(0.0, 0.02, 767_900_977_000)


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
def test_layouts_of_trajectories(write: Callable[..., Path], name: str) -> None:
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


def test_a_time_of_whole_seconds_lacks_the_rest_of_the_second() -> None:
    whole, exact = (
        capture_time(exif_of({Base.DateTimeOriginal: LOCAL} | more)) for more in ({}, {Base.SubsecTimeOriginal: "25"})
    )
    assert exact.error[0] - whole.error[0] == 1.0
    assert exact.error[1] == whole.error[1]


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
