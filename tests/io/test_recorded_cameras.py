"""Cameras from MARS logger's metadata, `.gcsv` logs and videos: what they contain is used, what they lack is named."""

from __future__ import annotations

import math
import struct
from pathlib import Path

import pytest

from rsdeblur.errors import FileFormatError
from rsdeblur.io import open_camera
from rsdeblur.io.gyro_binary import frame_exposures
from tests.installed import needs

ANDROID = """Timestamp[nanosec],fx[px],fy[px],Frame No.,Exposure time[nanosec],Frame readout time[nanosec],ISO,\
Focal length
1000000000,3000,3000,1,20000000,30000000,100,4.7
1033000000,3000,3000,2,20000000,30000000,null,4.7
"""
IOS = """Timestamp[nanosec],fx[px],fy[px],cx[px],cy[px],exposure duration[nanosec]
1000000000,1500.5,1500.5,960.1,540.2,20000000
"""
GCSV = """GYROFLOW IMU LOG
version,1.3
orientation,YxZ
frame_readout_time,15.5
frame_readout_direction,1
tscale,0.001
t,gx,gy,gz
"""


@pytest.fixture
def mars(tmp_path: Path) -> Path:
    path = tmp_path / "movie_metadata.csv"
    path.write_text(ANDROID)
    return path


def test_mars_android(mars: Path) -> None:
    with pytest.raises(FileFormatError, match="--size 1920x1080"):
        open_camera(mars)
    file = open_camera(mars, size=(1080, 1920), sensor_width=4000)
    camera = file.camera
    assert camera.focal_length == (1440.0, 1440.0)
    assert (camera.readout_time, camera.readout_direction) == (0.03, "right-left")
    assert (file.facts["exposure_s"], file.facts["iso"]) == (0.02, 100.0)
    # Without the sensor's width the focal length may be that of the whole sensor, which shows in the field of view.
    assert any("--sensor-width" in assumption.text for assumption in open_camera(mars, size=(1080, 1920)).assumptions)
    assert open_camera(mars, size=(1920, 1080), focal_length=1500.0).camera.focal_length == (1500.0, 1500.0)


def test_mars_ios_contains_the_size(mars: Path) -> None:
    mars.write_text(IOS)
    file = open_camera(mars)
    assert (file.camera.width, file.camera.height, file.camera.focal_length[0]) == (1920, 1080, 1500.5)
    assert any("no readout time" in assumption.text for assumption in file.assumptions)


@pytest.mark.parametrize(("text", "message"), [(GCSV, "not MARS logger's"), (IOS.replace("1500.5", "1e-320"), "focal")])
def test_mars_refuses_what_is_no_camera(mars: Path, text: str, message: str) -> None:
    mars.write_text(text)
    with pytest.raises(FileFormatError, match=f"{mars.name}.*{message}"):
        open_camera(mars, "mars")


def test_gcsv(tmp_path: Path) -> None:
    path = tmp_path / "clip.gcsv"
    path.write_text(GCSV + "".join(f"{5 * i},0.1,0.2,0.3\n" for i in range(20)))
    with pytest.raises(FileFormatError, match="size of the picture"):
        open_camera(path)
    with pytest.raises(FileFormatError, match="--focal-length or --focal35"):
        open_camera(path, size=(1920, 1080))
    camera = open_camera(path, size=(1920, 1080), focal_length=1400).camera
    assert (camera.readout_time, camera.readout_direction, camera.timestamp_marks) == (0.0155, "bottom-up", "middle")


def test_gopro(data_dir: Path) -> None:
    needs("telemetry")
    needs("video")
    video = data_dir / "formats" / "gopro" / "max-heromode.mp4"
    camera = open_camera(video).camera
    assert (camera.width, camera.height, camera.distortion_model) == (848, 480, "fisheye")
    assert camera.readout_time == pytest.approx(0.0206, abs=1e-4)
    # The angle between the corner and the axis is half the diagonal field of view that the camera reports.
    x, y, z = camera.rays((camera.width - 0.5, camera.height - 0.5))
    assert math.degrees(math.atan2(math.hypot(x, y), z)) == pytest.approx(137.388 / 2, rel=1e-3)
    assert len(frame_exposures(video)) == 316


def test_exposures_of_insta360(tmp_path: Path) -> None:
    """The trailer is as telemetry-parser reads it; the first frame of the video is the third one measured."""
    needs("telemetry")
    first_frame = b"\xc0\x01\x43"  # field 24 of a Protobuf message: 67 (ms)
    gyro = b"".join(struct.pack("<Q6d", ms, *[0.0] * 6) for ms in range(20))
    exposures = b"".join(
        struct.pack("<Qd", ms, seconds) for ms, seconds in [(0, 0.5), (34, 0.5), (67, 0.01), (100, 0.02)]
    )
    records = b"".join(
        data + struct.pack("<2BI", 0, kind, len(data)) for kind, data in [(4, exposures), (3, gyro), (1, first_frame)]
    )
    end = bytes(32) + struct.pack("<2I", len(records) + 72, 3) + b"8db42d694ccc418790edff439fe026bf"
    video = tmp_path / "clip.mp4"
    video.write_bytes(b"\0\0\0\x18ftypmp42" + bytes(99) + records + end)
    assert frame_exposures(video) == [0.01, 0.02]
