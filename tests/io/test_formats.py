"""Gyro logs of apps and cameras: each is read with its unit, axes and exact timestamps, or refused."""

from __future__ import annotations

import json
import struct
import sys
import zipfile
import zlib
from collections.abc import Callable
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

# A timestamp in ns that float64 cannot represent, and the samples in all files below: t in ns; x, y, z in rad/s.
EPOCH = 1_766_385_749_427_863_801
STEP = 5_000_000
RATES = np.random.default_rng(0).normal(0.0, 0.5, (40, 3)).round(6)
TIMESTAMPS = EPOCH + STEP * np.arange(len(RATES))

Write = Callable[..., Path]


def rows(pattern: str, scale: float = 1.0) -> str:
    """Return a line for each sample; `pattern` contains t, s (seconds), x, y and z."""
    return "".join(
        pattern.format(t=t, s=f"{t // 10**9}.{t % 10**9:09d}", x=x, y=y, z=z) + "\n"
        for t, (x, y, z) in zip(TIMESTAMPS.tolist(), (RATES / scale).tolist(), strict=True)
    )


def assert_contains_the_samples(path: Path, format: str, axes: str, rates: np.ndarray = RATES) -> dict[str, Any]:
    """Check every timestamp and rate, and return the facts in the file."""
    file = open_gyro(path)
    assert (file.format, file.axes, file.log.epoch_ns) == (format, axes, EPOCH)
    np.testing.assert_array_equal(file.log.t, (TIMESTAMPS - EPOCH) * 1e-9)
    # a unit costs one multiplication
    np.testing.assert_allclose(file.log.omega, rates, rtol=1e-15)
    return dict(file.facts)


TABLES = {
    "euroc": ("#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2]\n",
              "{t},{x},{y},{z},9.8", "euroc", "sensor"),
    "kalibr": ("timestamp,omega_x,omega_y,omega_z,alpha_x,alpha_y,alpha_z\n", "{t},{x},{y},{z},1,2,9",
               "euroc", "sensor"),
    "phyphox": ('"Time (s)","Gyroscope x (rad/s)","Gyroscope y (rad/s)","Gyroscope z (rad/s)"\n', "{s},{x},{y},{z}",
                "phyphox", "phone"),
    "sensor logger": ("time,seconds_elapsed,z,y,x\n", "{t},-0.1,{z},{y},{x}", "sensorlogger", "phone"),
    "renamed": ("time,seconds_elapsed,GYROSCOPE Z (rad/s),GYROSCOPE Y (rad/s),GYROSCOPE X (rad/s)\n",
                "{t},0.1,{z},{y},{x}", "sensorlogger", "phone"),
    "opencamera": ("", "{x},{y},{z},{t}", "opencamera", "phone"),
    "tags": ("", "4 {t} {x} {y} {z}\n1 {t} 0 0 9.8", "deepgyro", "phone"),
    "tags of another separator": ("", "1,{t},0,0,9.8\n4,{t},{x},{y},{z}", "deepgyro", "phone"),
    "uncalibrated": ("", "16 {t} {x} {y} {z}", "deepgyro", "phone"),
    "mars ios": ("Timestamp[nanosec],gx[rad/s],gy[rad/s],gz[rad/s],ax[m/s^2],ay[m/s^2],az[m/s^2],Unix time[nanosec]\n",
                 "{t},{x},{y},{z},0,9.8,0,7", "mars", "phone"),
    "ros": ("%time,field.header.seq,field.angular_velocity.x,field.angular_velocity.y,field.angular_velocity.z\n",
            "{t},1,{x},{y},{z}", "plain", "sensor"),
    "sensorlog": ("loggingTime(txt),gyroTimestamp_sinceReboot(s),gyroRotationX(rad/s),gyroRotationY(rad/s),"
                  "gyroRotationZ(rad/s)\n", "2020-01-01,{s},{x},{y},{z}", "plain", "sensor"),
    "sensorlog without the gyro itself": ("motionTimestamp_sinceReboot(s),motionYaw(rad),motionRotationRateX(rad/s),"
                                          "motionRotationRateY(rad/s),motionRotationRateZ(rad/s)\n",
                                          "{s},9,{x},{y},{z}", "plain", "sensor"),
    "seven columns": ("", "{t} {x} {y} {z} 0.1 -9.7 1.1", "plain", "sensor"),
    "seven columns, accelerometer first": ("", "{t} 0.1 -9.7 1.1 {x} {y} {z}", "plain", "sensor"),
    "seconds elapsed alone": ("seconds_elapsed,GYRO Z (rad/s),GYRO Y (rad/s),GYRO X (rad/s)\n", "{s},{z},{y},{x}",
                              "plain", "sensor"),
    "a bar": ("", "{t}|{x}|{y}|{z}", "plain", "sensor"),
    "a separator at the end": ("", "{t},{x},{y},{z},", "plain", "sensor"),
    "quoted cells": ("time,seconds_elapsed,z,y,x\n", '"{t}","0.1","{z}","{y}","{x}"', "sensorlogger", "phone"),
    "spaces between tabs": ('"Time (s)"\t"Gyroscope x (rad/s)"\t"Gyroscope y (rad/s)"\t"Gyroscope z (rad/s)"\n',
                            "{s}\t{x}\t{y}\t{z}", "phyphox", "phone"),
    "header behind a per cent sign": ("% t wx wy wz\n", "{t} {x} {y} {z}", "plain", "sensor"),
    "bare axes of a unit that only a gyro has": ("Time (s),X (rad/s),Y (rad/s),Z (rad/s)\n", "{s},{x},{y},{z}",
                                                 "plain", "sensor"),
    "lines above the header": ("Recorded with an app\nDevice: phone\nts;gyro x;gyro y;gyro z\n", "{t};{x};{y};{z}",
                               "plain", "sensor"),
}  # fmt: skip


@pytest.mark.parametrize(("header", "pattern", "format", "axes"), TABLES.values(), ids=TABLES)
def test_tables(write: Write, header: str, pattern: str, format: str, axes: str) -> None:
    assert_contains_the_samples(write(header + rows(pattern)), format, axes)


def test_opencamera_while_the_camera_turns_faster_and_faster(write: Write) -> None:
    ramp = "".join(f"{0.01 * i},0.1,0.2,{EPOCH + i * STEP}\n" for i in range(100))
    file = open_gyro(write(ramp))
    assert (file.format, file.log.epoch_ns, file.log.omega[99, 0]) == ("opencamera", EPOCH, 0.99)


@pytest.mark.parametrize("unit", ["deg/s", "°/s", "dps", "degrees/s"])
def test_the_header_declares_degrees(write: Write, unit: str) -> None:
    header = f"timestamp (ns),gyro_x ({unit}),gyro_y ({unit}),gyro_z ({unit})\n"
    file = open_gyro(write(header + rows("{t},{x},{y},{z}", np.pi / 180)))
    assert file.rate_unit == "deg/s"
    np.testing.assert_allclose(file.log.omega, RATES, rtol=1e-12)


def test_the_user_declares_degrees(write: Write) -> None:
    path = write(rows("{t},{x},{y},{z}", np.pi / 180))
    np.testing.assert_allclose(read_gyro(path, unit="deg/s").omega, RATES, rtol=1e-12)


def test_decimal_commas(write: Write) -> None:
    header = '"Time (s)";"Gyroscope x (rad/s)";"Gyroscope y (rad/s)";"Gyroscope z (rad/s)"\n'
    assert_contains_the_samples(write(header + rows("{s};{x};{y};{z}").replace(".", ",")), "phyphox", "phone")
    assert_contains_the_samples(write(rows("{s}\t{x}\t{y}\t{z}").replace(".", ",")), "plain", "sensor")


def test_text_of_sixteen_bits(write: Write) -> None:
    assert_contains_the_samples(write(rows("{t}\t{x}\t{y}\t{z}").encode("utf-16")), "plain", "sensor")


def test_spreadsheets_round_timestamps_but_keep_their_place(write: Write) -> None:
    log = read_gyro(write("1.40363657975856E+018,0,0,0.1\n1.40363657976356E+018,0,0,0.2\n"))
    assert log.epoch_ns == 1_403_636_579_758_560_000
    np.testing.assert_array_equal(log.t, [0, 0.005])


@pytest.mark.parametrize("name", ["Accelerometer.csv", "VID_1gravity.csv", "Magnetometer.csv", "VID_1accel.csv"])
@pytest.mark.parametrize("pattern", ["time,seconds_elapsed,z,y,x\n{t},0,{z},{y},{x}", "{x},{y},{z},{t}"])
def test_another_sensor_of_the_same_columns_is_refused(write: Write, name: str, pattern: str) -> None:
    header, _, line = pattern.rpartition("\n")
    with pytest.raises(FileFormatError, match="the file is named after another sensor"):
        read_gyro(write(f"{header}\n{rows(line)}", name))


def test_gravity_is_refused(write: Write) -> None:
    with pytest.raises(FileFormatError, match=r"samples of an accelerometer at rest"):
        read_gyro(write("".join(f"{i / 100} 0.1 -9.75 0.{i % 10}\n" for i in range(30))))


class TestZip:
    HEADER = "time,seconds_elapsed,z,y,x\n"

    def test_the_gyroscope_is_found(self, write: Write, tmp_path: Path) -> None:
        content = self.HEADER + rows("{t},0.1,{z},{y},{x}")
        with zipfile.ZipFile(tmp_path / "export.zip", "w") as archive:
            archive.writestr("session/Accelerometer.csv", content)
            archive.writestr("session/GyroscopeUncalibrated.csv", content)
            archive.writestr("session/Gyroscope.csv", content)
            archive.writestr("session/Metadata.csv", "version,device name,platform\n3,SM-S931N,android\n")
        facts = assert_contains_the_samples(tmp_path / "export.zip", "sensorlogger", "phone")
        assert facts == {"device name": "SM-S931N", "platform": "android"}

    def test_without_a_gyroscope(self, tmp_path: Path) -> None:
        path = tmp_path / "export.zip"
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("Accelerometer.csv", self.HEADER + rows("{t},0.1,{z},{y},{x}"))
        with pytest.raises(FileFormatError, match=r"export\.zip/Accelerometer\.csv: .*another sensor"):
            read_gyro(path)
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("picture.png", b"")
        with pytest.raises(FileFormatError, match=r"export\.zip: the archive contains no gyro log"):
            read_gyro(path)

    @pytest.mark.parametrize(
        ("first", "second"),
        [
            ("monday/Gyroscope.csv", "tuesday/Gyroscope.csv"),
            ("GyroscopeUncalibrated.csv", "b/GyroscopeUncalibrated.csv"),
            ("a.csv", "b.csv"),
        ],
    )
    def test_two_gyroscopes(self, tmp_path: Path, first: str, second: str) -> None:
        path = tmp_path / "export.zip"
        with zipfile.ZipFile(path, "w") as archive:
            for name in (second, "Accelerometer.csv", first):
                archive.writestr(name, self.HEADER + rows("{t},0.1,{z},{y},{x}"))
        for format in (None, "sensorlogger"):
            with pytest.raises(FileFormatError, match=f"export.zip: .* more than one gyro log, {first} and {second};"):
                read_gyro(path, format)

    def test_an_app_s_format_comes_before_any_table(self, tmp_path: Path) -> None:
        """EuRoC's position of a laser is a table of four columns, as some gyro logs are."""
        with zipfile.ZipFile(tmp_path / "euroc.zip", "w") as archive:
            archive.writestr("a0/data.csv", "#timestamp,p_x,p_y,p_z\n" + rows("{t},{x},{y},{z}"))
            archive.writestr(
                "imu0/data.csv",
                "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1]\n"
                + rows("{t},{x},{y},{z}"),
            )
        assert_contains_the_samples(tmp_path / "euroc.zip", "euroc", "sensor")


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
        with pytest.raises(FileFormatError, match="lacks a number: KeyError"):
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

    @pytest.mark.parametrize(("count", "oldest"), [(0, 0), (700, 0), (40, 41), (2**32 - 1, 0)])
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

    def test_version_2(self, write: Write) -> None:
        self.check(write(self.project({"raw_imu": self.bincode()}, 2)))

    def test_current_versions(self, write: Write) -> None:
        cbor2 = needs("gyroflow")
        packed = base91(zlib.compress(cbor2.dumps({"raw_imu": self.samples(), "quaternions": {}})))
        self.check(write(self.project({"file_metadata": packed})))

    def test_metadata_that_is_not_packed(self, write: Write) -> None:
        self.check(write(self.project({"file_metadata": {"raw_imu": self.samples()}}, 3)))

    def test_the_first_versions(self, write: Write) -> None:
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
            ({}, "was saved without gyro data; give the file they come from: video.mp4"),
            ({"raw_imu": "AAAA"}, "damaged"),
            ({"raw_imu": "é"}, "damaged"),
            ({"raw_imu": [[0.0, 1.0]]}, "damaged"),
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
        packed = base91(zlib.compress(b"\xa0" * 9))
        with pytest.raises(FileFormatError, match=r"need cbor2.*'\.\[gyroflow\]'"):
            read_gyro(write(self.project({"file_metadata": packed})))


class TestVideo:
    def test_without_telemetry_parser(self, write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(sys.modules, "telemetry_parser", None)
        with pytest.raises(FileFormatError, match=r"pip install '\.\[telemetry\]'"):
            read_gyro(write(b"\0\0\0\x18ftypmp42" + bytes(99), "video.mp4"))

    def test_without_telemetry(self, write: Write) -> None:
        needs("telemetry")
        with pytest.raises(FileFormatError, match=r"video\.mp4: the video contains no gyro data"):
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


# For each sample file: format, axes, unit of the rates, number of samples, first timestamp in ns, rate in Hz.
SAMPLES = {
    "euroc/data.csv": ("euroc", "sensor", "rad/s", 5000, 1_403_636_579_758_560_000, 200.0),
    "gcsv/docs_example_v1.3.gcsv": ("gcsv", "gyroflow", "rad/s", 16, 0, 1000.0),
    "gcsv/movie.gcsv": ("gcsv", "gyroflow", "rad/s", 1067, 0, 497.693),
    "gyroflow-project/VID_20220615_110533_00_001.gyroflow": ("gyroflow", "gyroflow", "deg/s", 12094, 0, 500.0),
    "opencamera-sensors/gyro_data.csv": ("opencamera", "phone", "rad/s", 3579, 538_148_030_566_750, 99.903),
    "phyphox/Gyroscope.csv": ("phyphox", "phone", "rad/s", 4637, -75_790_430, 100.001),
    "sensor-logger/android/Gyroscope.csv": ("sensorlogger", "phone", "rad/s", 5000, 1_766_385_749_427_863_800, 58.955),
    "sensor-logger/renamed/Gyroscope_renamed_headers.csv": (
        "sensorlogger", "phone", "rad/s", 2000, 1_667_581_571_396_870_000, 99.781,
    ),
}  # fmt: skip


@pytest.mark.parametrize(("name", "expected"), SAMPLES.items())
def test_samples(data_dir: Path, name: str, expected: tuple[Any, ...]) -> None:
    file = open_gyro(data_dir / "formats" / name)
    log = file.log
    assert (file.format, file.axes, file.rate_unit, len(log), log.epoch_ns) == expected[:5]
    assert log.rate == pytest.approx(expected[5], abs=1e-3)


def test_gopro_sample(data_dir: Path) -> None:
    needs("telemetry")
    with pytest.warns(RsdeblurWarning, match=r"stabilised the video itself \(HS HLevel\)"):
        file = open_gyro(data_dir / "formats/gopro/max-heromode.mp4")
    assert (file.format, file.axes, file.rate_unit, len(file.log)) == ("video", "gyroflow", "deg/s", 2082)
    assert file.log.rate == pytest.approx(197.455, abs=1e-3)
    assert file.facts["readout_time_s"] == pytest.approx(0.0206, abs=1e-5)


REFUSED = {
    "euroc/sensor.yaml": "unknown gyro log format, the content starts with 'sensor_type: imu'",
    "exif/Canon_40D.jpg": "not a gyro log: it looks like a picture; give it as the photo",
    "gyroflow-lens-profile/S25Ultra_23mm_3840x2160.json": "not a gyro log: it looks like a camera file .Gyroflow lens",
    "kalibr/rs_camchain_line_delay.yaml": "not a gyro log: it looks like a camera file .Kalibr.*; give it as --camera",
    "opencamera-sensors/timestamps.csv": "looks like a capture file .one timestamp in ns a line.; give it as --capture",
    "sensor-logger/android/Metadata.csv": "unknown gyro log format, the content starts with 'version,device name",
}


@pytest.mark.parametrize(("name", "reason"), REFUSED.items())
def test_other_files_are_refused(data_dir: Path, name: str, reason: str) -> None:
    with pytest.raises(FileFormatError, match=reason):
        read_gyro(data_dir / "formats" / name)
