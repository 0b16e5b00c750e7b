"""Accelerometers: read from every format, in m/s^2, in the axes of the gyro, and refused without gravity."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rsdeblur import Camera, InputError, read_gyro
from rsdeblur.io import read_acceleration
from rsdeblur.motion import AccelerationLog
from rsdeblur.motion.track import OrientationTrack
from tests._util.files import ACCELERATIONS, EPOCH, FORCES, LAYOUTS, TIMESTAMPS, rows, sensorlogger_json
from tests.installed import needs

Write = Callable[..., Path]
G = 9.80665


@pytest.mark.parametrize("name", ACCELERATIONS)
def test_formats(write: Write, name: str) -> None:
    log = read_acceleration(write(ACCELERATIONS[name], name))
    assert log.epoch_ns == EPOCH
    np.testing.assert_array_equal(log.t, (TIMESTAMPS - EPOCH) * 1e-9)
    # The .gcsv is scaled from g.
    np.testing.assert_allclose(log.force, FORCES, rtol=1e-15)


def test_exports_are_searched_for_gravity(write: Write, tmp_path: Path) -> None:
    """Sensor Logger's Accelerometer is without gravity."""
    with zipfile.ZipFile(tmp_path / "session.zip", "w") as archive:
        for name in ("Accelerometer.csv", "Gyroscope.csv"):
            archive.writestr(name, LAYOUTS["sensor logger"][0])
        archive.writestr("TotalAcceleration.csv", ACCELERATIONS["TotalAcceleration.csv"])
    for path in (tmp_path / "session.zip", write(sensorlogger_json(), "session.json")):
        np.testing.assert_array_equal(read_acceleration(path).force, FORCES)


def test_units(write: Write) -> None:
    for header, factor, unit in (("t,ax[g],ay[g],az[g]\n", 1 / G, None), ("t,ax,ay,az\n", 1000 / G, "mg")):
        path = write(header + rows("{t},{x},{y},{z}", FORCES * factor))
        # Divided and multiplied again.
        np.testing.assert_allclose(read_acceleration(path, unit=unit).force, FORCES, rtol=1e-15)
    for unknown in ("gal", ["g"]):
        with pytest.raises(InputError, match="unit must be one of"):
            read_acceleration(path, unit=unknown)


def test_a_shift_moves_the_span() -> None:
    assert AccelerationLog([0.0, 1.0], np.ones((2, 3))).shifted(0.5).span == (0.5, 1.5)


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
