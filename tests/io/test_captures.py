"""Captures and clocks of sessions: every layout gives the same captures, or is refused with its line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from rsdeblur.errors import FileFormatError
from rsdeblur.io import read_captures, read_clocks
from rsdeblur.motion.exposure import Exposure
from tests._util.files import ANDROID, CAPTURES, EPOCH, NEXT, trailer

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
    assert read_clocks(path).time_offset == pytest.approx(offset, abs=1e-12)


def test_real_captures(data_dir: Path) -> None:
    mars = read_captures(data_dir / "real/mars-phone-240ms/movie_metadata.csv")
    burst = read_captures(data_dir / "real/shield-burst/images/images.txt")
    assert (len(mars), len(burst)) == (10, 7)
    assert mars[0] == Exposure(0.0, 0.24, 1_560_201_774_322)
    assert burst[-1] == Exposure(0.0, 0.02, 767_900_977_000)


def test_a_jpeg_with_gyro_data_contains_its_capture(write: Write) -> None:
    assert read_captures(write(trailer(), "a.jpg")) == [Exposure(0.0, 0.02, EPOCH + 99)]
