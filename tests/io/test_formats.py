"""Gyro logs in archives, JSON, pictures, projects and videos: each is read as what it contains, or refused."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsdeblur.errors import RsdeblurWarning
from rsdeblur.io import open_gyro, read_gyro
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


def test_the_ring_is_unrolled(write: Write) -> None:
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


def test_gopro(data_dir: Path) -> None:
    needs("telemetry")
    with pytest.warns(RsdeblurWarning, match="stabilised"):
        file = open_gyro(data_dir / "formats/gopro/max-heromode.mp4")
    assert (file.format, file.axes, file.rate_unit, len(file.log)) == ("video", "gyroflow", "deg/s", 2082)
    assert file.log.rate == pytest.approx(197.455, abs=1e-3)
    assert file.facts["readout_time_s"] == pytest.approx(0.0206, abs=1e-5)
