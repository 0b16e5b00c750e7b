"""Accelerometers: read from every format, in m/s^2, in the axes of the gyro, and refused without gravity."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from rsdeblur import Camera, FileFormatError, InputError, read_gyro
from rsdeblur.io import read_acceleration
from rsdeblur.motion import AccelerationLog
from rsdeblur.motion.track import OrientationTrack
from tests.installed import needs

EPOCH, STEP = 1_766_385_749_427_863_801, 10_000_000
FORCES = np.array([(0.5, 9.7, 1.25), (0.25, 9.5, 1.5), (-0.5, 9.75, 1.0)])
G = 9.80665


def rows(*columns: str, values: np.ndarray = FORCES, mark: str = ",") -> str:
    """Return lines whose cells are `t` (ns), `x`, `y`, `z` or the text itself."""
    lines = []
    for i, force in enumerate(values.tolist()):
        cells = {"t": str(EPOCH + i * STEP), **dict(zip("xyz", map(repr, force), strict=True))}
        lines.append(mark.join(cells.get(column, column) for column in columns))
    return "\n".join(lines) + "\n"


MARS = "Timestamp[nanosec], gx[rad/s], gy[rad/s], gz[rad/s], ax[m/s^2], ay[m/s^2], az[m/s^2]\n"
EUROC = "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
EUROC += "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n"
FILES = {
    "gyro_accel.csv": MARS + rows("t", "1", "2", "3", "x", "y", "z"),
    "data.csv": EUROC + rows("t", "1", "2", "3", "x", "y", "z"),
    "imu0.csv": "timestamp,omega_x,omega_y,omega_z,alpha_x,alpha_y,alpha_z\n" + rows("t", *"111", "x", "y", "z"),
    "Accelerometer.csv": '"Time (ns)","Acceleration x (m/s^2)","Acceleration y (m/s^2)","Acceleration z (m/s^2)"\n'
    + rows("t", "x", "y", "z"),
    "TotalAcceleration.csv": "time,seconds_elapsed,z,y,x\n" + rows("t", "0.1", "z", "y", "x"),
    "VID_accel.csv": rows("x", "y", "z", "t"),
    "imu.txt": rows("1", "t", "x", "y", "z", mark=" ") + rows("4", "t", *"123", mark=" "),
    "seven.txt": rows("t", "0.1", "0.2", "0.3", "x", "y", "z"),
    "log.gcsv": f"GYROFLOW IMU LOG\ntscale,1e-9\nascale,{1 / G!r}\norientation,XYZ\nt,gx,gy,gz,ax,ay,az\n"
    + rows("t", "1", "2", "3", "x", "y", "z"),
}


@pytest.mark.parametrize("name", FILES)
def test_formats(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(FILES[name])
    log = read_acceleration(path)
    assert log.epoch_ns == EPOCH
    np.testing.assert_array_equal(log.t, np.arange(3) * STEP * 1e-9)
    # The .gcsv is scaled from g.
    np.testing.assert_allclose(log.force, FORCES, rtol=1e-15)


def test_an_archive_is_searched_for_gravity(tmp_path: Path) -> None:
    """Sensor Logger's Accelerometer.csv is without gravity."""
    path = tmp_path / "session.zip"
    with zipfile.ZipFile(path, "w") as archive:
        linear = "time,seconds_elapsed,z,y,x\n" + rows("t", "0.1", "z", "y", "x", values=FORCES * 0.01)
        archive.writestr("Accelerometer.csv", linear)
        archive.writestr("Gyroscope.csv", linear)
        archive.writestr("TotalAcceleration.csv", FILES["TotalAcceleration.csv"])
    np.testing.assert_array_equal(read_acceleration(path).force, FORCES)


def test_json_of_sensor_logger(tmp_path: Path) -> None:
    path = tmp_path / "session.json"
    entries = [
        {"sensor": sensor, "time": str(EPOCH + i * STEP), **dict(zip("xyz", map(str, factor * force), strict=True))}
        for i, force in enumerate(FORCES)
        for sensor, factor in (("Accelerometer", 0.01), ("TotalAcceleration", 1.0), ("Gyroscope", 0.1))
    ]
    path.write_text(json.dumps(entries))
    np.testing.assert_array_equal(read_acceleration(path).force, FORCES)


def test_units(tmp_path: Path) -> None:
    path = tmp_path / "accel.csv"
    for header, factor, unit in (("t,ax[g],ay[g],az[g]\n", 1 / G, None), ("t,ax,ay,az\n", 1000 / G, "mg")):
        path.write_text(header + rows("t", "x", "y", "z", values=FORCES * factor))
        np.testing.assert_allclose(read_acceleration(path, unit=unit).force, FORCES, rtol=1e-15)
    for unknown in ("gal", ["g"]):
        with pytest.raises(InputError, match="unit must be one of"):
            read_acceleration(path, unit=unknown)


@pytest.mark.parametrize(
    ("factor", "message"),
    [(1 / G, "look like g"), (0.02, "gravity already removed"), (1000 / G, "look like mg")],
)
def test_values_that_are_not_gravity_are_refused(tmp_path: Path, factor: float, message: str) -> None:
    path = tmp_path / "gyro_accel.csv"
    path.write_text(MARS + rows("t", "1", "2", "3", "x", "y", "z", values=FORCES * factor))
    with pytest.raises(FileFormatError, match=rf"gyro_accel\.csv: .*{message}"):
        read_acceleration(path)


def test_files_without_an_accelerometer_are_refused(tmp_path: Path) -> None:
    for text in ("t,wx,wy,wz\n" + rows("t", "1", "2", "3"), rows("4", "t", "1", "2", "3", mark=" "), rows("t", *"123")):
        path = tmp_path / "log.csv"
        path.write_text(text)
        with pytest.raises(FileFormatError, match=r"log\.csv"):
            read_acceleration(path)


def test_the_log_checks_its_values() -> None:
    with pytest.raises(InputError, match=r"force must be in m/s\^2"):
        AccelerationLog([0.0, 1.0], [[0, 0, 0], [1e13, 0, 0]])
    with pytest.raises(InputError, match="t must increase"):
        AccelerationLog([0.0, 0.0], np.ones((2, 3)))
    log = AccelerationLog([0.0, 1.0], np.ones((2, 3))).shifted(0.5)
    assert isinstance(log, AccelerationLog)
    assert log.span == (0.5, 1.5)


@pytest.mark.parametrize("name", ["real/mars-phone-240ms/gyro_accel.csv", "formats/gopro/max-heromode.mp4"])
@pytest.mark.filterwarnings("ignore:.*stabilised")
def test_gravity_turns_as_the_gyro_says(data_dir: Path, name: str) -> None:
    """In world axes, over half seconds, the force of a real recording varies less than in others."""
    if name.endswith("mp4"):
        needs("telemetry")
    gyro, log = read_gyro(data_dir / name), read_acceleration(data_dir / name)
    track = OrientationTrack.from_log(gyro, Camera(16, 16, 16.0), *gyro.span, gyro.epoch_ns)
    t = log.t + (log.epoch_ns - gyro.epoch_ns) * 1e-9
    rotations = track.at(t)
    world, reversed_ = (np.einsum(axes, rotations, log.force) for axes in ("nji,nj->ni", "nij,nj->ni"))
    spreads = [
        sum(part.var(axis=0).sum() for part in np.array_split(forces, int(2 * t[-1])))
        for forces in (world, log.force, reversed_)
    ]
    assert spreads[0] < spreads[1] < spreads[2]
