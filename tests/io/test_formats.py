"""Gyro logs in archives, JSON, pictures, projects and videos: each is read as what it contains, or refused."""

from __future__ import annotations

import json
import struct
import sys
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsdeblur.errors import FileFormatError, RsdeblurWarning
from rsdeblur.io import open_gyro, read_gyro
from rsdeblur.io.gyro_binary import check_sample_sizes
from rsdeblur.io.source import Source
from tests.hostile.seeds import base91
from tests.installed import needs
from tests.io.test_gyro_logs import EPOCH, EUROC, RATES, TIMESTAMPS, Write, assert_contains_the_samples, rows

HEADER = "time,seconds_elapsed,z,y,x\n"
CONTENT = HEADER + rows("{t},0.1,{z},{y},{x}")


def zipped(path: Path, *names: str, **others: str) -> Path:
    """Write an archive of logs of Sensor Logger, and of other files."""
    with zipfile.ZipFile(path, "w") as archive:
        for name in names:
            archive.writestr(name, CONTENT)
        for name, content in others.items():
            archive.writestr(name, content)
    return path


@pytest.mark.parametrize(
    ("name", "content", "advice"),
    [
        ("gyro.csv.gz", b"\x1f\x8b\x08\0" * 9, "gzip.*unpack"),
        ("gyro.mat", b"MATLAB 5.0 MAT-file".ljust(200, b"\0"), "CSV"),
        ("gyro.xls", b"\xd0\xcf\x11\xe0".ljust(600, b"\0"), "spreadsheet.*CSV"),
    ],
)
def test_what_is_no_text_is_named(write: Write, name: str, content: bytes, advice: str) -> None:
    with pytest.raises(FileFormatError, match=advice):
        read_gyro(write(content, name))


class TestZip:
    def test_the_gyroscope_is_found(self, tmp_path: Path) -> None:
        names = [f"session/{name}.csv" for name in ("Accelerometer", "GyroscopeUncalibrated", "Gyroscope")]
        metadata = {"session/Metadata.csv": "version,device name,platform\n3,SM-S931N,android\n"}
        path = zipped(tmp_path / "export.zip", *names, **metadata)
        facts = assert_contains_the_samples(path, "sensorlogger", "phone")
        assert facts == {"device name": "SM-S931N", "platform": "android"}

    @pytest.mark.parametrize(
        ("names", "message"),
        [
            (["Accelerometer.csv"], r"/Accelerometer\.csv: .*another sensor"),
            (["picture.png"], "no gyro log"),
            (["[Content_Types].xml"], "spreadsheet"),
            (["tuesday/Gyroscope.csv", "monday/Gyroscope.csv"], "more than one gyro log, monday.* and tuesday"),
            (["b.csv", "Accelerometer.csv", "a.csv"], "more than one gyro log, a.csv and b.csv"),
        ],
    )
    def test_refused(self, tmp_path: Path, names: list[str], message: str) -> None:
        with pytest.raises(FileFormatError, match=rf"export\.zip.*{message}"):
            read_gyro(zipped(tmp_path / "export.zip", *names))

    def test_an_app_s_format_comes_before_any_table(self, tmp_path: Path) -> None:
        """EuRoC's position of a laser is a table of four columns, as some gyro logs are."""
        laser, imu = "#timestamp,p_x,p_y,p_z\n" + rows("{t},{x},{y},{z}"), EUROC + rows("{t},{x},{y},{z},9.8")
        path = zipped(tmp_path / "euroc.zip", **{"a0/data.csv": laser, "imu0/data.csv": imu})
        assert_contains_the_samples(path, "euroc", "sensor")


class TestSensorLoggerJson:
    def entries(self, sensor: str) -> list[dict[str, str]]:
        return [
            {"sensor": sensor, "time": str(t), "seconds_elapsed": "0.1", "x": str(x), "y": str(y), "z": str(z)}
            for t, (x, y, z) in zip(TIMESTAMPS.tolist(), RATES.tolist(), strict=True)
        ]

    def test_the_gyroscope_is_found(self, write: Write) -> None:
        meta = {"sensor": "Metadata", "device name": "phone", "platform": "ios"}
        content = [meta, *self.entries("Accelerometer"), *self.entries("Gyroscope")]
        facts = assert_contains_the_samples(write(json.dumps(content)), "sensorlogger-json", "phone")
        assert facts == {"sensor": "Gyroscope", "device name": "phone", "platform": "ios"}

    def test_cut_off_or_broken(self, write: Write) -> None:
        entries = self.entries("Gyroscope")
        with pytest.raises(FileFormatError, match=r"log\.csv"):
            read_gyro(write(json.dumps(entries)[:-9]), format="sensorlogger-json")
        del entries[3]["y"]
        with pytest.raises(FileFormatError, match="lacks a number"):
            read_gyro(write(json.dumps(entries)))


def trailer(count: int = len(RATES), oldest: int = 7, total: int = 16384) -> bytes:
    """Return a JPEG with a ring buffer of samples at its end."""
    ring = [struct.pack("<q3fi", t, *rate, 0) for t, rate in zip(TIMESTAMPS.tolist(), RATES.tolist(), strict=True)]
    ring = ring[len(ring) - oldest :] + ring[: len(ring) - oldest]
    header = struct.pack("<16sqIIq", b"GYRODATA", EPOCH + 99, count, oldest, EPOCH)
    return b"\xff\xd8\xff\xe0 a picture \xff\xd9" + (header + b"".join(ring)).ljust(total, b"\0")


class TestTrailer:
    def test_the_ring_is_unrolled(self, write: Write) -> None:
        path = write(trailer(), "IMG.jpg")
        facts = assert_contains_the_samples(path, "gyrodata", "phone", RATES.astype(np.float32))
        assert facts == {"capture_ns": EPOCH + 99, "shutter_command_ns": EPOCH}

    @pytest.mark.parametrize(("count", "oldest"), [(0, 0), (700, 0), (40, 41)])
    def test_damaged(self, write: Write, count: int, oldest: int) -> None:
        content = bytearray(trailer())
        struct.pack_into("<II", content, len(content) - 16384 + 24, count, oldest)
        with pytest.raises(FileFormatError, match=r"IMG\.jpg: the GYRODATA trailer is damaged"):
            read_gyro(write(bytes(content), "IMG.jpg"))

    def test_a_jpeg_without_one(self, write: Write) -> None:
        with pytest.raises(FileFormatError, match=r"IMG\.jpg: not a gyro log"):
            read_gyro(write(trailer()[:-1], "IMG.jpg"))


class TestGyroflowProject:
    T_MS = 2.0 * np.arange(len(RATES))
    # xZy: Gyroflow's y is the raw z
    EXPECTED = np.stack([-RATES[:, 0], RATES[:, 2], -RATES[:, 1]], axis=1)

    def project(self, raw: Any, version: int | None = 4, **gyro: Any) -> str:
        content: dict[str, Any] = {"title": "Gyroflow data file", "offsets": {"1000000": -12.5}}
        content["gyro_source"] = {"imu_orientation": "xZy", "filepath": "video.mp4"} | raw | gyro
        content["stabilization"] = {"frame_readout_time": -15.0}
        return json.dumps(content | ({} if version is None else {"version": version}))

    def samples(self) -> list[dict[str, Any]]:
        degrees = np.degrees(RATES).tolist()
        return [
            {"timestamp_ms": t, "gyro": rate, "accl": None, "magn": None}
            for t, rate in zip(self.T_MS.tolist(), degrees, strict=True)
        ]

    def check(self, path: Path) -> None:
        file = open_gyro(path)
        assert (file.format, file.axes) == ("gyroflow", "gyroflow")
        np.testing.assert_allclose(file.log.t, self.T_MS * 1e-3, atol=1e-15)
        np.testing.assert_allclose(file.log.omega, self.EXPECTED, rtol=1e-13)
        assert file.facts["readout_time_s"] == 0.015
        assert file.facts["readout_direction"] == "bottom-up"
        assert file.facts["offsets_ms"] == {"1 s": -12.5}

    def bincode(self) -> str:
        packed = struct.pack("<Q", len(RATES))
        for t, rate in zip(self.T_MS, np.degrees(RATES), strict=True):
            packed += struct.pack("<dB3dB3dB", t, 1, *rate, 1, 0.0, 0.0, 1.0, 0)
        return base91(zlib.compress(packed))

    def test_current_versions(self, write: Write) -> None:
        cbor2 = needs("gyroflow")
        packed = base91(zlib.compress(cbor2.dumps({"raw_imu": self.samples(), "quaternions": {}})))
        self.check(write(self.project({"file_metadata": packed})))

    def test_former_versions(self, write: Write) -> None:
        self.check(write(self.project({"file_metadata": {"raw_imu": self.samples()}}, 3)))
        self.check(write(self.project({"raw_imu": self.bincode()}, 2)))
        raw = np.column_stack([self.T_MS * 1e-3, RATES, np.zeros_like(RATES)]).tolist()
        self.check(write(self.project({"raw_imu": raw}, None)))

    def test_bias_and_rotation_are_gyroflows(self, write: Write) -> None:
        plain = self.project({"raw_imu": self.bincode()})
        biased = self.project({"raw_imu": self.bincode()}, gyro_bias=[1.0, 2.0, 3.0])
        turned = self.project({"raw_imu": self.bincode()}, rotation=[0.0, 90.0, 0.0])
        omega = [read_gyro(write(content, f"{i}.gyroflow")).omega for i, content in enumerate((plain, biased, turned))]
        # the bias is in raw axes and added before they are turned
        np.testing.assert_allclose(omega[1] - omega[0], np.radians([[-1.0, 3.0, -2.0]] * len(RATES)), atol=1e-12)
        # roll turns about z
        np.testing.assert_allclose(omega[2], omega[0] @ [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-12)

    @pytest.mark.parametrize(
        ("raw", "message"),
        [
            ({}, "without gyro data.*video.mp4"),
            ({"raw_imu": "é"}, "damaged"),
            ({"raw_imu": [{"timestamp_ms": 0.0, "gyro": [1.0, 2.0]}]}, "damaged"),
            ({"raw_imu": [[0.0, 1.0, 2.0, float("nan")]]}, "damaged"),
        ],
    )
    def test_faults(self, write: Write, raw: dict[str, Any], message: str) -> None:
        with pytest.raises(FileFormatError, match=rf"log\.csv: .*{message}"):
            read_gyro(write(self.project(raw)))

    def test_cut_off(self, write: Write) -> None:
        with pytest.raises(FileFormatError, match="not JSON, or cut off"):
            read_gyro(write(self.project({"raw_imu": self.bincode()})[:-2]), format="gyroflow")
        with pytest.raises(FileFormatError, match=r"are (damaged|cut off)"):
            read_gyro(write(self.project({"raw_imu": self.bincode()[:-50]})))

    def test_without_cbor2(self, write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(sys.modules, "cbor2", None)
        with pytest.raises(FileFormatError, match=r"'\.\[gyroflow\]'"):
            read_gyro(write(self.project({"file_metadata": base91(zlib.compress(b"\xa0" * 9))})))


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


def test_gopro_sample(data_dir: Path) -> None:
    needs("telemetry")
    with pytest.warns(RsdeblurWarning, match="stabilised"):
        file = open_gyro(data_dir / "formats/gopro/max-heromode.mp4")
    assert (file.format, file.axes, file.rate_unit, len(file.log)) == ("video", "gyroflow", "deg/s", 2082)
    assert file.log.rate == pytest.approx(197.455, abs=1e-3)
    assert file.facts["readout_time_s"] == pytest.approx(0.0206, abs=1e-5)
