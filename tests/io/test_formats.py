"""Gyro logs in archives, JSON, pictures, projects and videos: each is read as what it contains, or refused."""

from __future__ import annotations

import struct
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsdeblur.errors import FileFormatError, RsdeblurWarning
from rsdeblur.io import open_gyro, read_gyro
from rsdeblur.io.gyro_binary import check_sample_sizes
from rsdeblur.io.source import Source
from tests._util import files
from tests._util.files import EPOCH, LAYOUTS, RATES
from tests.installed import needs
from tests.io.test_gyro_logs import Write, assert_contains_the_samples


def zipped(path: Path, *names: str, **others: str) -> Path:
    """Write an archive of logs of Sensor Logger, and of other files."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in {**dict.fromkeys(names, LAYOUTS["sensor logger"][0]), **others}.items():
            archive.writestr(name, content)
    return path


class TestZip:
    def test_the_gyroscope_is_found(self, tmp_path: Path) -> None:
        names = [f"session/{name}.csv" for name in ("Accelerometer", "GyroscopeUncalibrated", "Gyroscope")]
        metadata = {"session/Metadata.csv": "version,device name,platform\n3,SM-S931N,android\n"}
        path = zipped(tmp_path / "export.zip", *names, **metadata)
        facts = assert_contains_the_samples(path, "sensorlogger", "phone")
        assert facts == {"device name": "SM-S931N", "platform": "android"}

    def test_an_app_s_format_comes_before_any_table(self, tmp_path: Path) -> None:
        """EuRoC's position of a laser is a table of four columns, as some gyro logs are."""
        laser = "#timestamp,p_x,p_y,p_z\n" + files.rows("{t},{x},{y},{z}")
        path = zipped(tmp_path / "euroc.zip", **{"a0/data.csv": laser, "imu0/data.csv": LAYOUTS["euroc"][0]})
        assert_contains_the_samples(path, "euroc", "sensor")


def test_json_of_sensor_logger(write: Write) -> None:
    export = files.sensorlogger_json()
    facts = assert_contains_the_samples(write(export), "sensorlogger-json", "phone")
    assert facts == {"sensor": "Gyroscope", "device name": "phone", "platform": "ios"}


class TestTrailer:
    def test_the_ring_is_unrolled(self, write: Write) -> None:
        facts = assert_contains_the_samples(
            write(files.trailer(), "IMG.jpg"), "gyrodata", "phone", RATES.astype(np.float32)
        )
        assert facts == {"capture_ns": EPOCH + 99, "shutter_command_ns": EPOCH}


PLAIN = {"raw_imu": [[0.005 * i, *rate, 0, 0, 0] for i, rate in enumerate(RATES.tolist())]}
SAMPLES = [{"timestamp_ms": 5.0 * i, "gyro": rate, "accl": None} for i, rate in enumerate(np.degrees(RATES).tolist())]
PROJECTS = {
    "written by Python": lambda: files.project(PLAIN),
    "version 2, bincode": lambda: files.packed_project(files.bincode(), "raw_imu"),
    "version 3": lambda: files.project({"file_metadata": {"raw_imu": SAMPLES}}),
    "current": lambda: files.packed_project(files.cbor(), "file_metadata"),
}


class TestGyroflowProject:
    @pytest.mark.parametrize("version", PROJECTS)
    def test_versions(self, write: Write, version: str) -> None:
        if version == "current":
            needs("gyroflow")
        file = open_gyro(write(PROJECTS[version]()))
        assert (file.format, file.axes) == ("gyroflow", "gyroflow")
        np.testing.assert_allclose(file.log.t, 0.005 * np.arange(len(RATES)), atol=1e-15)
        # xZy: Gyroflow's y is the raw z. Degrees are converted.
        np.testing.assert_allclose(file.log.omega, RATES[:, [0, 2, 1]] * [-1, 1, -1], rtol=1e-13)
        assert (file.facts["readout_time_s"], file.facts["readout_direction"]) == (0.015, "bottom-up")
        assert file.facts["offsets_ms"] == {"1 s": -12.5, "2 s": -14.5}

    def test_bias_and_rotation_are_gyroflows(self, write: Write) -> None:
        changes: list[dict[str, Any]] = [{}, {"gyro_bias": [1.0, 2.0, 3.0]}, {"rotation": [0.0, 90.0, 0.0]}]
        omega = [read_gyro(write(files.project(PLAIN | change))).omega for change in changes]
        # the bias is in raw axes and added before they are turned
        np.testing.assert_allclose(omega[1] - omega[0], np.radians([[-1.0, 3.0, -2.0]] * len(RATES)), atol=1e-12)
        # roll turns about z
        np.testing.assert_allclose(omega[2], omega[0] @ [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-12)

    def test_without_cbor2(self, write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(sys.modules, "cbor2", None)
        with pytest.raises(FileFormatError, match=r"'\.\[gyroflow\]'"):
            read_gyro(write(files.packed_project(b"\xa0" * 9, "file_metadata")))


class TestVideo:
    def test_without_telemetry_parser(self, write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(sys.modules, "telemetry_parser", None)
        with pytest.raises(FileFormatError, match=r"pip install '\.\[telemetry\]'"):
            read_gyro(write(b"\0\0\0\x18ftypmp42" + bytes(99), "video.mp4"))

    def test_without_telemetry(self, write: Write) -> None:
        needs("telemetry")
        with pytest.raises(FileFormatError, match=r"video\.mp4: .*no gyro data"):
            read_gyro(write(b"\0\0\0\x18ftypmp42" + bytes(99), "video.mp4"))

    @pytest.mark.parametrize(
        ("table", "claimed"),
        [
            (struct.pack(">III", 0, 300, 2), 300),
            (struct.pack(">III2I", 0, 0, 2, 9, 2**32 - 1), 2**32 - 1),
            # Entries do not count where all samples have one size, nor beyond the end of the table.
            (struct.pack(">III2I", 0, 9, 2, 9, 300), None),
            (struct.pack(">IIII", 0, 0, 2**31, 9), None),
            (b"", None),
        ],
        ids=["one size", "sizes", "one size, and others", "cut off", "empty"],
    )
    @pytest.mark.parametrize("header", [struct.Struct(">I4s"), struct.Struct(">I4sQ")], ids=["32 bits", "64 bits"])
    def test_no_sample_is_larger_than_the_file(
        self, write: Write, table: bytes, claimed: int | None, header: struct.Struct
    ) -> None:
        video = table
        for kind in (b"stsz", b"stbl", b"minf", b"mdia", b"trak", b"moov"):
            size = header.size + len(video)
            video = (header.pack(1, kind, size) if header.size > 8 else header.pack(size, kind)) + video
        source = Source(write(b"\0\0\0\x10ftypmp42\0\0\0\0" + video, "video.mp4"), "gyro log")
        if claimed is None:
            check_sample_sizes(source)
        else:
            with pytest.raises(FileFormatError, match=rf"video\.mp4: .* claims a sample of {claimed} bytes"):
                check_sample_sizes(source)

    @pytest.mark.parametrize("size", [0, 2, 7, 8, 2**32 - 1])
    def test_boxes_end_with_the_file(self, write: Write, size: int) -> None:
        nested = b"".join(struct.pack(">I4s", size, b"moov") for _ in range(2000))
        check_sample_sizes(Source(write(nested, "video.mp4"), "gyro log"))

    def test_gopro(self, data_dir: Path) -> None:
        needs("telemetry")
        with pytest.warns(RsdeblurWarning, match="stabilised"):
            file = open_gyro(data_dir / "formats/gopro/max-heromode.mp4")
        assert (file.format, file.axes, file.rate_unit, len(file.log)) == ("video", "gyroflow", "deg/s", 2082)
        assert file.log.rate == pytest.approx(197.455, abs=1e-3)
        assert file.facts["readout_time_s"] == pytest.approx(0.0206, abs=1e-5)
