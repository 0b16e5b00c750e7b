"""Captures, clocks of sessions, and our own camera files."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from PIL import Image

from rsdeblur.errors import FileFormatError
from rsdeblur.io import read_captures
from rsdeblur.io.clocks import read_clocks
from rsdeblur.motion.exposure import Exposure

TIMESTAMP = 1_766_385_749_427_863_801
ANDROID = (
    "Timestamp[nanosec],fx[px],fy[px],Frame No.,Exposure time[nanosec],Sensor frame duration[nanosec],"
    "Frame readout time[nanosec],ISO,Focal length,Focus distance,AF mode"
)
IOS = "Timestamp[nanosec], fx[px], fy[px], cx[px], cy[px], exposure duration[nanosec]"
FILES = {
    "android": f"{ANDROID}\n"
    f"{TIMESTAMP},null,null,170,240000000,null,null,100,4.71,1.6,1\n{TIMESTAMP + 7},1,1,2,20000000,1\n",
    "ios": f"{IOS}\n"
    f"{TIMESTAMP}, 1500.1, 1500.1, 960, 540, 240000000\n{TIMESTAMP + 7}, null, null, null, null, 20000000\n",
    "named": f"timestamp_ns,exposure_ns\n{TIMESTAMP},240000000\n{TIMESTAMP + 7},20000000\n",
    "named, in ms": f"timestamp[ns],f,exposure time (ms)\n{TIMESTAMP},0,240\n{TIMESTAMP + 7},0,20\n",
    "deepgyro": f"# timestamps\n{TIMESTAMP} 240000000\n{TIMESTAMP + 7} 20000000\n",
}


def test_null_exposure_times_must_be_given(tmp_path: Path) -> None:
    path = tmp_path / "movie_metadata.csv"
    path.write_text("Timestamp[nanosec],fx[px],Exposure time[nanosec]\n1000,null,null\n2000,null,5000000\n")
    with pytest.raises(FileFormatError, match="give the exposure time"):
        read_captures(path)
    assert [exposure.duration for exposure in read_captures(path, duration=0.01)] == [0.01, 0.005]


@pytest.mark.parametrize(("source", "offset"), [("REALTIME", 0.0), ("UNKNOWN", -3.7948831225)])
def test_clocks_of_a_session(tmp_path: Path, source: str, offset: float) -> None:
    path = tmp_path / "edge_epochs.txt"
    path.write_text(
        "#Camera frame timestamp source according to CameraCharacteristics.SENSOR_INFO_TIMESTAMP_SOURCE is "
        f"SENSOR_INFO_TIMESTAMP_SOURCE_{source}.\n#elapsedRealtimeNanos()\tnanoTime()\tDifference\n"
        "1560503966948\t1556709084554\t3794882394\n1562660845704\t1558865961853\t3794883851\n"
    )
    assert read_clocks(path).time_offset == pytest.approx(offset, abs=1e-12)


@pytest.mark.parametrize(
    ("line", "message"),
    [("1 2", "three whole numbers"), ("5 3 1", "not the difference"), ("9000000 0 9000000", "drift apart")],
)
def test_clocks_that_contradict_each_other(tmp_path: Path, line: str, message: str) -> None:
    path = tmp_path / "edge_epochs.txt"
    path.write_text(f"# SENSOR_INFO_TIMESTAMP_SOURCE is UNKNOWN\n7 3 4\n{line}\n")
    with pytest.raises(FileFormatError, match=f"line 3: .*{message}"):
        read_clocks(path)


@pytest.mark.parametrize("text", FILES.values(), ids=FILES)
def test_formats(tmp_path: Path, text: str) -> None:
    path = tmp_path / "captures.txt"
    path.write_text(text)
    assert read_captures(path) == [Exposure(0.0, 0.24, TIMESTAMP), Exposure(0.0, 0.02, TIMESTAMP + 7)]


FAULTS = {
    "milliseconds": ("1000.5 20\n1033.8 20\n", 1, "the timestamps have fractions, so they are not in ns"),
    "two exposures for a timestamp": ("5 100\n5 200\n", 2, "timestamp 5 ns occurs twice"),
    "out of order": ("1\n9\n5\n7\n", 3, "timestamp 5 ns comes after 9 ns"),
    "null timestamp": (f"{ANDROID}\nnull,1,1,1,5000000,1,1\n", 2, "'null' in column 1 is not a number"),
    "zero exposure": (f"{IOS}\n1,1,1,1,1,5000000\n2,1,1,1,1,0\n", 3, "impossible exposure time of 0 ns"),
    "exposure in seconds": ("1 0.05\n2 0.05\n", 1, "exposure time of 0.05 ns"),
    "cut off": ("1 100\n2", 2, "cut off"),
    "unknown": ("a b c\n", 1, "known formats: .*mars .*deepgyro"),
}


@pytest.mark.parametrize(("text", "line", "message"), FAULTS.values(), ids=FAULTS)
def test_faults_name_the_file_and_the_line(tmp_path: Path, text: str, line: int, message: str) -> None:
    path = tmp_path / "captures.txt"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=rf"captures\.txt, line {line}: .*{message}"):
        read_captures(path)


@pytest.mark.parametrize(
    ("data", "message"), [(b"", "empty"), (b"\x89PGN\0", "binary"), (ANDROID.encode(), "no samples"), (None, "No such")]
)
def test_faults_of_the_whole_file_name_it(tmp_path: Path, data: bytes | None, message: str) -> None:
    path = tmp_path / "captures.txt"
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(FileFormatError, match=rf"captures\.txt: .*{message}"):
        read_captures(path)


def test_real_captures(data_dir: Path) -> None:
    mars = read_captures(data_dir / "real/mars-phone-240ms/movie_metadata.csv")
    burst = read_captures(data_dir / "real/shield-burst/images/images.txt")
    assert (len(mars), len(burst)) == (10, 7)
    assert mars[0] == Exposure(0.0, 0.24, 1_560_201_774_322)
    assert burst[-1] == Exposure(0.0, 0.02, 767_900_977_000)


def test_timestamps_alone_need_the_exposure_time(tmp_path: Path) -> None:
    path = tmp_path / "timestamps.csv"
    expected = [Exposure(0.0, 0.1, TIMESTAMP), Exposure(0.0, 0.1, TIMESTAMP + 10**7)]
    for header in ("", "Frame timestamp[nanosec]\n"):
        path.write_text(f"{header}{TIMESTAMP}\n{TIMESTAMP + 10**7}\n")
        assert read_captures(path, duration=0.1) == expected
        with pytest.raises(FileFormatError, match=r"timestamps\.csv: .*without exposure times"):
            read_captures(path)


@pytest.mark.parametrize(
    "text",
    [
        "#timestamp [ns],filename\n4000000000,4000000000.png\n4050000000,4050000000.png\n",
        "# colour images\n# timestamp filename\n4.0000 rgb/4.0000.png\n4.0500 rgb/4.0500.png\n",
        "#timestamp [us],filename\n4000000,a.jpeg\n4050000,b.jpeg\n",
    ],
    ids=["EuRoC", "TUM", "us"],
)
def test_timestamps_beside_the_names_of_pictures(tmp_path: Path, text: str) -> None:
    path = tmp_path / "data.csv"
    path.write_text(text)
    assert read_captures(path, duration=0.01) == [Exposure(0.0, 0.01, 4 * 10**9), Exposure(0.0, 0.01, 4_050_000_000)]
    with pytest.raises(FileFormatError, match="without exposure times"):
        read_captures(path)


@pytest.mark.parametrize(("header", "name"), [("", ""), ("timestamp\n", ""), ("", ",a.png")])
def test_milliseconds_are_not_nanoseconds(tmp_path: Path, header: str, name: str) -> None:
    path = tmp_path / "captures.csv"
    path.write_text(header + "".join(f"{33 * i}{name}\n" for i in range(9)))
    with pytest.raises(FileFormatError, match=r"captures are 33 ns apart; name the unit in a header"):
        read_captures(path, duration=0.01)


def test_a_jpeg_with_gyro_data_contains_its_capture(tmp_path: Path) -> None:
    exif, path = Image.Exif(), tmp_path / "a.jpg"
    exif.get_ifd(0x8769)[0x829A] = 0.0625
    Image.new("RGB", (8, 8)).save(path, exif=exif)
    header = struct.pack("<16sqIIq", b"GYRODATA", TIMESTAMP, 1, 0, 0)
    path.write_bytes(path.read_bytes() + header.ljust(16384, b"\0"))
    assert read_captures(path) == [Exposure(0.0, 0.0625, TIMESTAMP)]
