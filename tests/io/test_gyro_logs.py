"""Logs in tables, archives, JSON, pictures, projects and videos: unit, axes and exact timestamps, or a refusal."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsdeblur import Camera, FileFormatError, InputError, RsdeblurWarning, read_gyro
from rsdeblur.io import open_gyro, read_acceleration
from rsdeblur.io.gyro_logs import FORMATS, detect_gyro_format
from rsdeblur.io.samples import GYRO
from rsdeblur.motion import AccelerationLog
from rsdeblur.motion.axes import imu_to_camera
from rsdeblur.motion.track import OrientationTrack
from tests._util import files, gyroflow
from tests._util.files import (
    ACCELERATIONS,
    EPOCH,
    FORCES,
    LAYOUTS,
    PHYPHOX,
    RATES,
    TIMESTAMPS,
    UNSTAMPED,
    rows,
    sensorlogger_json,
)
from tests.installed import needs

Write = Callable[..., Path]


def assert_contains_the_samples(path: Path, format: str, axes: str, rates: np.ndarray = RATES) -> dict[str, Any]:
    """Check every timestamp and rate, and return the facts in the file."""
    file = open_gyro(path)
    assert (file.format, file.axes, file.log.epoch_ns) == (format, axes, EPOCH)
    np.testing.assert_array_equal(file.log.t, (TIMESTAMPS - EPOCH) * 1e-9)
    # a unit costs one multiplication
    np.testing.assert_allclose(file.log.omega, rates, rtol=1e-15)
    return dict(file.facts)


@pytest.mark.parametrize(("text", "format", "axes"), LAYOUTS.values(), ids=LAYOUTS)
def test_layouts(write: Write, text: str, format: str, axes: str) -> None:
    assert_contains_the_samples(write(text), format, axes)


@pytest.mark.parametrize("last", ["1;0;0;0", "1,005;0;0;0"])
def test_decimal_commas_are_seen_in_any_row(write: Write, last: str) -> None:
    log = read_gyro(write(f"t[s];gx;gy;gz\n0,98;0,1;0,2;0,3\n0,99;0,1;0,2;0,3\n{last}\n"))
    assert log.epoch_ns == 980_000_000
    np.testing.assert_array_equal(log.omega[0], [0.1, 0.2, 0.3])


def test_spreadsheets_round_timestamps_but_keep_their_place(write: Write) -> None:
    log = read_gyro(write("1.40363657975856E+018,0,0,0.1\n1.40363657976356E+018,0,0,0.2\n"))
    assert log.epoch_ns == 1_403_636_579_758_560_000
    np.testing.assert_array_equal(log.t, [0, 0.005])


def test_what_may_be_wrong_is_warned_about(write: Write) -> None:
    """The laws of late and repeated samples are those of test_log_properties.py."""
    lines = [f"{i / 100} 0 0 {i / 100}" for i in range(200)]
    warnings = {
        "degrees": "t,gx[rad/s],gy[rad/s],gz[rad/s]\n0,100,0,0\n0.01,100,0,0\n",
        "sampled at 20 Hz": "0,0,0,0\n0.05,0,0,0\n",
        "1 samples came late": "\n".join([*lines[:50], lines[51], lines[52], lines[50], *lines[53:]]),
        "1 repeated samples were dropped": "\n".join([*lines[:50], lines[49], *lines[50:]]),
    }
    for message, text in warnings.items():
        with pytest.warns(RsdeblurWarning, match=message):
            read_gyro(write(text))


def test_a_log_without_timestamps_needs_the_sampling_rate(write: Write) -> None:
    for content, factor in zip(UNSTAMPED, (1.0, np.pi / 180), strict=True):
        path = write(content)
        assert detect_gyro_format(path) == "unstamped"
        log = read_gyro(path, rate=400.0)
        np.testing.assert_array_equal(log.t, np.arange(len(RATES)) * 2_500_000 * 1e-9)
        np.testing.assert_array_equal(log.omega, RATES * factor)
        with pytest.raises(FileFormatError, match="give the sampling rate"):
            read_gyro(path)
    for rate in (-1.0, 11000.0, np.nan):
        with pytest.raises(InputError, match="rate must be"):
            read_gyro(path, rate=rate)
    with pytest.raises(FileFormatError, match="contains timestamps"):
        read_gyro(write(rows("{t},{x},{y},{z}")), rate=200.0)


def test_a_table_like_another_kind_prints_the_option_that_reads_it(write: Write) -> None:
    path = write("t_us,x,y,z\n0,1,2,3\n5000,1,2,3\n")
    with pytest.raises(FileFormatError, match=r"looks like a trajectory .* --columns t=1,gx=2,gy=3,gz=4"):
        read_gyro(path)
    np.testing.assert_array_equal(read_gyro(path, columns="t=1,gx=2,gy=3,gz=4").omega, [[1, 2, 3], [1, 2, 3]])


@pytest.mark.parametrize("name", ["Accelerometer.csv", "VID_1gravity.csv", "Magnetometer.csv", "VID_1accel.csv"])
@pytest.mark.parametrize("layout", ["sensor logger", "opencamera"])
def test_another_sensor_of_the_same_columns_is_refused(write: Write, name: str, layout: str) -> None:
    with pytest.raises(FileFormatError, match="another sensor"):
        read_gyro(write(LAYOUTS[layout][0], name))


@pytest.mark.parametrize("first", ["GYROFLOW IMU LOG", "CAMERA IMU LOG"])
@pytest.mark.parametrize("mark", [",", ":"])
@pytest.mark.parametrize("columns", ["t,gx,gy,gz", "time,gx,gy,gz,ax,ay,az"])
def test_gcsv(write: Write, first: str, mark: str, columns: str) -> None:
    keys = ("version 1.3", "note of,the:writer", "description a,b", "rate 200", "tscale 0.000001", "gscale 0.001")
    header = "\n".join([first, *(key.replace(" ", mark, 1) for key in keys), "orientation,YxZ", columns])
    accelerations = ",1,2,3" * ("ax" in columns)
    path = write(f"{header}\n1500,39,86,183{accelerations}\n3500.5,56,-100,202{accelerations}\n")
    log = read_gyro(path)
    assert log.epoch_ns == 1_500_000
    np.testing.assert_array_equal(log.t, [0, 2_000_500 * 1e-9])
    # orientation YxZ: Gyroflow's x is the raw y, its y the raw x negated
    np.testing.assert_array_equal(log.omega, np.array([[86, -39, 183], [-100, -56, 202]]) * 0.001)
    # An orientation that is given replaces the file's.
    np.testing.assert_array_equal(read_gyro(path, orientation="xZy").omega[0], np.array([-39, 183, -86]) * 0.001)
    with pytest.raises(InputError, match="orientation must name"):
        read_gyro(path, orientation="XXZ")


SHEET = "GYROFLOW IMU LOG\norientation;YxZ\ntscale;0,001\ngscale;0,5\nt;gx;gy;gz\n0;2;4;6\n10;2;4;6\n"


@pytest.mark.parametrize(
    ("content", "first", "step", "rates"),
    [
        # Defaults: milliseconds, radians and, with a warning, xzY.
        ("GYROFLOW IMU LOG\nt,gx,gy,gz\n0,1,2,3\n4,1,2,3\n", 0, 4_000_000, [-1, -3, 2]),
        # Spreadsheets change the separators; without the scales, rates would be thousands of times too fast.
        (SHEET, 0, 10_000_000, [2, -1, 3]),
        ('"' + SHEET.replace(",", ".").replace(";", '","').replace("\n", '"\n"')[:-1], 0, 10_000_000, [2, -1, 3]),
        # 2.5 ns and 2500007.5 ns, rounded half to even.
        ("GYROFLOW IMU LOG\ntscale,2.5e-9\norientation,XYZ\nt,gx,gy,gz\n1,1,2,3\n1000003,1,2,3", 2, 2500006, [1, 2, 3]),
    ],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore:.*xzY")
def test_scales_of_gcsv(write: Write, content: str, first: int, step: int, rates: list[float]) -> None:
    log = read_gyro(write(content))
    assert (log.epoch_ns, log.t[1]) == (first, step * 1e-9)
    np.testing.assert_array_equal(log.omega[0], rates)


@pytest.mark.parametrize("name", [*(each.name for each in FORMATS[GYRO]), "eurok"])
def test_a_forced_format_that_does_not_fit_is_refused(write: Write, name: str) -> None:
    with pytest.raises(FileFormatError, match=r"log\.csv"):
        read_gyro(write("no,gyro\nlog,at\nall,either\n"), format=name)


def test_a_format_that_is_given_overrides_the_content(write: Write) -> None:
    path = write(LAYOUTS["mars"][0])
    assert open_gyro(path, format="plain").format == "plain"
    np.testing.assert_array_equal(read_gyro(path, format="plain").t, read_gyro(path, "mars").t)
    assert open_gyro(write(PHYPHOX + rows("{s},{x},{y},{z}")), "phyphox").axes == "phone"


# Format, axes, unit of the rates, number of samples, first timestamp in ns and rate in Hz of real recordings.
SAMPLES = {
    "formats/euroc/data.csv": ("euroc", "sensor", "rad/s", 5000, 1_403_636_579_758_560_000, 200.0),
    "formats/gcsv/docs_example_v1.3.gcsv": ("gcsv", "gyroflow", "rad/s", 16, 0, 1000.0),
    "formats/gcsv/movie.gcsv": ("gcsv", "gyroflow", "rad/s", 1067, 0, 497.693),
    "formats/gyroflow-project/VID_20220615_110533_00_001.gyroflow": (
        "gyroflow", "gyroflow", "deg/s", 12094, 0, 500.0,
    ),
    "formats/opencamera-sensors/gyro_data.csv": ("opencamera", "phone", "rad/s", 3579, 538_148_030_566_750, 99.903),
    "formats/phyphox/Gyroscope.csv": ("phyphox", "phone", "rad/s", 4637, -75_790_430, 100.001),
    "formats/sensor-logger/android/Gyroscope.csv": (
        "sensorlogger", "phone", "rad/s", 5000, 1_766_385_749_427_863_800, 58.955,
    ),
    "gyro/phone-210hz.txt": ("plain", "sensor", "rad/s", 12_065, 1_309_154_983_495_295, 210.240),
    "real/mars-phone-240ms/gyro_accel.csv": ("mars", "phone", "rad/s", 1067, 1_560_489_219_555, 497.693),
    "real/shield-burst/imu.txt": ("deepgyro", "phone", "rad/s", 23, 767_705_436_983, 100.048),
}  # fmt: skip


@pytest.mark.parametrize(("name", "expected"), SAMPLES.items())
def test_real_logs(data_dir: Path, name: str, expected: tuple[Any, ...]) -> None:
    file = open_gyro(data_dir / name)
    log = file.log
    assert (file.format, file.axes, file.rate_unit, len(log), log.epoch_ns) == expected[:5]
    assert log.rate == pytest.approx(expected[5], abs=1e-3)


def test_the_same_recording_in_two_formats_agrees(data_dir: Path) -> None:
    mars = read_gyro(data_dir / "real/mars-phone-240ms/gyro_accel.csv")
    gcsv = read_gyro(data_dir / "formats/gcsv/movie.gcsv")
    np.testing.assert_array_equal(mars.t, gcsv.t)
    # in camera axes, each from its own; the .gcsv keeps whole microradians per second
    np.testing.assert_allclose(
        mars.omega @ imu_to_camera("phone-portrait").T, gcsv.omega @ imu_to_camera("gyroflow").T, atol=0.51e-6
    )


class TestZip:
    def test_the_gyroscope_is_found(self, write: Write) -> None:
        names = [f"session/{name}.csv" for name in ("Accelerometer", "GyroscopeUncalibrated", "Gyroscope")]
        members = dict.fromkeys(names, LAYOUTS["sensor logger"][0])
        assert_contains_the_samples(write(files.zipped(members), "export.zip"), "sensorlogger", "phone")

    def test_an_app_s_format_comes_before_any_table(self, write: Write) -> None:
        """EuRoC's position of a laser is a table of four columns, as some gyro logs are."""
        laser = "#timestamp,p_x,p_y,p_z\n" + files.rows("{t},{x},{y},{z}")
        path = write(files.zipped({"a0/data.csv": laser, "imu0/data.csv": LAYOUTS["euroc"][0]}), "euroc.zip")
        assert_contains_the_samples(path, "euroc", "sensor")


def test_json_of_sensor_logger(write: Write) -> None:
    export = files.sensorlogger_json()
    facts = assert_contains_the_samples(write(export), "sensorlogger-json", "phone")
    assert facts == {"sensor": "Gyroscope"}


def test_the_ring_is_unrolled(write: Write) -> None:
    facts = assert_contains_the_samples(
        write(files.trailer(), "IMG.jpg"), "gyrodata", "phone", RATES.astype(np.float32)
    )
    assert facts == {"capture_ns": EPOCH + 99, "shutter_command_ns": EPOCH}


PLAIN = {"raw_imu": [[0.005 * i, *rate, 0, 0, 0] for i, rate in enumerate(RATES.tolist())]}
ENTRIES = [{"timestamp_ms": 5.0 * i, "gyro": rate, "accl": None} for i, rate in enumerate(np.degrees(RATES).tolist())]
PROJECTS = {
    "written by Python": lambda: gyroflow.project(PLAIN),
    "version 2, bincode": lambda: gyroflow.packed_project(gyroflow.bincode(), "raw_imu"),
    "version 3": lambda: gyroflow.project({"file_metadata": {"raw_imu": ENTRIES}}),
    "current": lambda: gyroflow.packed_project(gyroflow.cbor(), "file_metadata"),
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

    def test_bias_and_rotation_are_gyroflows(self, write: Write) -> None:
        changes: list[dict[str, Any]] = [{}, {"gyro_bias": [1.0, 2.0, 3.0]}, {"rotation": [0.0, 90.0, 0.0]}]
        omega = [read_gyro(write(gyroflow.project(PLAIN | change))).omega for change in changes]
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


G = 9.80665


@pytest.mark.parametrize("name", ACCELERATIONS)
def test_formats_of_accelerometers(write: Write, name: str) -> None:
    log = read_acceleration(write(ACCELERATIONS[name], name))
    assert log.epoch_ns == EPOCH
    np.testing.assert_array_equal(log.t, (TIMESTAMPS - EPOCH) * 1e-9)
    # The .gcsv is scaled from g.
    np.testing.assert_allclose(log.force, FORCES, rtol=1e-15)


def test_exports_are_searched_for_gravity(write: Write) -> None:
    """Sensor Logger's Accelerometer is without gravity."""
    members = dict.fromkeys(("Accelerometer.csv", "Gyroscope.csv"), LAYOUTS["sensor logger"][0])
    members["TotalAcceleration.csv"] = ACCELERATIONS["TotalAcceleration.csv"]
    for content, name in ((files.zipped(members), "session.zip"), (sensorlogger_json(), "session.json")):
        np.testing.assert_array_equal(read_acceleration(write(content, name)).force, FORCES)


def test_units_of_accelerometers(write: Write) -> None:
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
