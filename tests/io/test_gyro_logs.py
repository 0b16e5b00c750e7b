"""Gyro logs as tables: every layout is read with its unit, axes and exact timestamps, every fault with its line."""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsdeblur.errors import FileFormatError, InputError, RsdeblurWarning
from rsdeblur.io import detect_gyro_format, open_gyro, read_gyro
from rsdeblur.io.gyro_logs import formats
from rsdeblur.io.samples import GYRO
from rsdeblur.motion.axes import imu_to_camera

# A timestamp in ns that float64 cannot represent, and the samples in all files below: t in ns; x, y, z in rad/s.
EPOCH = 1_766_385_749_427_863_801
STEP = 5_000_000
RATES = np.random.default_rng(0).normal(0.0, 0.5, (40, 3)).round(6)
TIMESTAMPS = EPOCH + STEP * np.arange(len(RATES))

Write = Callable[..., Path]


def rows(pattern: str, scale: float = 1.0) -> str:
    """Return a line for each sample; `pattern` contains t (ns), s (seconds), d (date), x, y and z."""
    lines = []
    for t, (x, y, z) in zip(TIMESTAMPS.tolist(), (RATES / scale).tolist(), strict=True):
        seconds, rest = f"{t // 10**9}.{t % 10**9:09d}", t - 1_766_385_720 * 10**9
        date = f"2025-12-22T06:42:{rest // 10**9}.{rest % 10**9:09d}Z"
        lines.append(pattern.format(t=t, s=seconds, d=date, x=x, y=y, z=z) + "\n")
    return "".join(lines)


def assert_contains_the_samples(path: Path, format: str, axes: str, rates: np.ndarray = RATES) -> dict[str, Any]:
    """Check every timestamp and rate, and return the facts in the file."""
    file = open_gyro(path)
    assert (file.format, file.axes, file.log.epoch_ns) == (format, axes, EPOCH)
    np.testing.assert_array_equal(file.log.t, (TIMESTAMPS - EPOCH) * 1e-9)
    # a unit costs one multiplication
    np.testing.assert_allclose(file.log.omega, rates, rtol=1e-15)
    return dict(file.facts)


EUROC = "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2]\n"
MARS = "Timestamp[nanosec], gx[rad/s], gy[rad/s], gz[rad/s], ax[m/s^2], ay[m/s^2], az[m/s^2]"
PHYPHOX = '"Time (s)","Gyroscope x (rad/s)","Gyroscope y (rad/s)","Gyroscope z (rad/s)"\n'
ZEIT = '"Zeit (s)","Gyroskop x (rad/s)","Gyroskop y (rad/s)","Gyroskop z (rad/s)"\n'
ROS = "%time,field.header.seq,field.angular_velocity.x,field.angular_velocity.y,field.angular_velocity.z\n"
SENSORLOG = "loggingTime(txt),gyroTimestamp_sinceReboot(s),gyroRotationX(rad/s),gyroRotationY(rad/s),"
MOTION = "motionTimestamp_sinceReboot(s),motionYaw(rad),motionRotationRateX(rad/s),motionRotationRateY(rad/s),"
RENAMED = "time,seconds_elapsed,GYROSCOPE Z (rad/s),GYROSCOPE Y (rad/s),GYROSCOPE X (rad/s)\n"

# Header, row and format of each layout, by the axes of the rates.
PHONE = {
    "phyphox": (PHYPHOX, "{s},{x},{y},{z}", "phyphox"),
    "phyphox in another language": (ZEIT, "{s},{x},{y},{z}", "phyphox"),
    "spaces between tabs": (PHYPHOX.replace(",", "\t"), "{s}\t{x}\t{y}\t{z}", "phyphox"),
    "sensor logger": ("time,seconds_elapsed,z,y,x\n", "{t},-0.1,{z},{y},{x}", "sensorlogger"),
    "quoted cells": ("time,seconds_elapsed,z,y,x\n", '"{t}","0.1","{z}","{y}","{x}"', "sensorlogger"),
    "renamed": (RENAMED, "{t},0.1,{z},{y},{x}", "sensorlogger"),
    "opencamera": ("", "{x},{y},{z},{t}", "opencamera"),
    "tags": ("", "4 {t} {x} {y} {z}\n1 {t} 0 0 9.8", "deepgyro"),
    "tags of another separator": ("", "1,{t},0,0,9.8\n4,{t},{x},{y},{z}", "deepgyro"),
    "uncalibrated": ("", "16 {t} {x} {y} {z}", "deepgyro"),
    "mars": (MARS + "\n", "{t}, {x}, {y}, {z}, 0.1, 9.8, 2.2", "mars"),
    "mars ios": (MARS.replace(" ", "") + ",Unix time[nanosec]\n", "{t},{x},{y},{z},0,9.8,0,7", "mars"),
}
SENSOR = {
    "euroc": (EUROC, "{t},{x},{y},{z},9.8", "euroc"),
    "kalibr": ("timestamp,omega_x,omega_y,omega_z,alpha_x,alpha_y,alpha_z\n", "{t},{x},{y},{z},1,2,9", "euroc"),
    "ros": (ROS, "{t},1,{x},{y},{z}", "plain"),
    "sensorlog": (SENSORLOG + "gyroRotationZ(rad/s)\n", "2020-01-01,{s},{x},{y},{z}", "plain"),
    "sensorlog without the gyro itself": (MOTION + "motionRotationRateZ(rad/s)\n", "{s},9,{x},{y},{z}", "plain"),
    "seven columns": ("", "{t} {x} {y} {z} 0.1 -9.7 1.1", "plain"),
    "seven columns, accelerometer first": ("", "{t} 0.1 -9.7 1.1 {x} {y} {z}", "plain"),
    "seven columns, timestamps last": ("", "{x} {y} {z} 0.1 -9.7 1.1 {t}", "plain"),
    "seconds elapsed alone": ("seconds_elapsed,GYRO Z (rad/s),GYRO Y,GYRO X\n", "{s},{z},{y},{x}", "plain"),
    "a bar": ("", "{t}|{x}|{y}|{z}", "plain"),
    "a separator at the end": ("", "{t},{x},{y},{z},", "plain"),
    "header behind a per cent sign": ("% t wx wy wz\n", "{t} {x} {y} {z}", "plain"),
    "units of a gyro": ("Time (s),X (rad/s),Y (rad/s),Z (rad/s)\n", "{s},{x},{y},{z}", "plain"),
    "lines above the header": ("From an app\nDevice: phone\nts;gyro x;gyro y;gyro z\n", "{t};{x};{y};{z}", "plain"),
    "dates beside the timestamps": ("t\tdate\tgx\tgy\tgz\n", "{s}\t2024-01-01 10:00:00\t{x}\t{y}\t{z}", "plain"),
    "dates alone": ("", "{d},{x},{y},{z}", "plain"),
    "dates under a header": ("timestamp,wx,wy,wz\n", "{d},{x},{y},{z}", "plain"),
    "an empty column": ("t\tnote\tgx\tgy\tgz\tmx\tmy\n", "{s}\t\t{x}\t{y}\t{z}\t1\t2", "plain"),
    "double tabs": ("t\t\tgx\t\tgy\t\tgz\n", "{s}\t\t{x}\t\t{y}\t\t{z}", "plain"),
    "words": ("GYROSCOPE X (rad/s);Gyroscope Y;Gyroscope Z;Time since start in s \n", "{x};{y};{z};{s}", "plain"),
    "underscores": ("t_sec,gx_rad/s,gy_rad/s,gz_rad/s\n", "{s},{x},{y},{z}", "plain"),
    "exponents": ("Unix time (s),gx (rad·s⁻¹),gy (rad s⁻¹),gz (rad s⁻¹)\n", "{s},{x},{y},{z}", "plain"),
    "axes": ("elapsed (s),x-axis (rad/s),y-axis (rad/s),z-axis (rad/s)\n", "{s},{x},{y},{z}", "plain"),
}
LAYOUTS = {
    name: (*layout, axes) for axes, all_ in (("phone", PHONE), ("sensor", SENSOR)) for name, layout in all_.items()
}


@pytest.mark.parametrize(("header", "pattern", "format", "axes"), LAYOUTS.values(), ids=LAYOUTS)
def test_layouts(write: Write, header: str, pattern: str, format: str, axes: str) -> None:
    assert_contains_the_samples(write(header + rows(pattern)), format, axes)


def test_decimal_commas_and_encodings(write: Write) -> None:
    text = PHYPHOX.replace(",", ";") + rows("{s};{x};{y};{z}").replace(".", ",")
    assert_contains_the_samples(write(text), "phyphox", "phone")
    text = "sep=;\nt;gx;gy;gz;date\n" + rows("{s};{x};{y};{z};2024-01-01 10:00:00:123").replace(".", ",")
    assert_contains_the_samples(write(text), "plain", "sensor")
    assert_contains_the_samples(write(rows("{t}\t{x}\t{y}\t{z}").encode("utf-16")), "plain", "sensor")
    assert_contains_the_samples(write("\ufeff" + rows("{t} {x} {y} {z}").rstrip()), "plain", "sensor")


@pytest.mark.parametrize("last", ["1;0;0;0", "1,05;0;0;0"])
def test_decimal_commas_are_seen_in_any_row(write: Write, last: str) -> None:
    log = read_gyro(write(f"t[s];gx;gy;gz\n0,9;0,1;0,2;0,3\n0,95;0,1;0,2;0,3\n{last}\n"))
    assert log.epoch_ns == 900_000_000
    np.testing.assert_array_equal(log.omega[0], [0.1, 0.2, 0.3])


@pytest.mark.parametrize("unit", ["deg/s", "°/s", "dps", "degrees/s"])
def test_degrees_are_declared_by_the_header_or_the_user(write: Write, unit: str) -> None:
    table = rows("{t},{x},{y},{z}", np.pi / 180)
    file = open_gyro(write(f"timestamp (ns),gyro_x ({unit}),gyro_y ({unit}),gyro_z ({unit})\n{table}"))
    assert file.rate_unit == "deg/s"
    np.testing.assert_allclose(file.log.omega, RATES, rtol=1e-12)
    np.testing.assert_allclose(read_gyro(write(table), unit="deg/s").omega, RATES, rtol=1e-12)


def test_a_row_of_units_may_follow_the_names(write: Write) -> None:
    log = read_gyro(write("t;gx;gy;gz\n[ms];deg/s;deg/s;deg/s\n0;1;2;3\n5;0,5;1,5;-2\n"))
    np.testing.assert_array_equal(log.t, [0, 0.005])
    np.testing.assert_allclose(np.rad2deg(log.omega), [[1, 2, 3], [0.5, 1.5, -2]], atol=1e-12)


def test_opencamera_while_the_camera_turns_faster_and_faster(write: Write) -> None:
    ramp = "".join(f"{0.01 * i},0.1,0.2,{EPOCH + i * STEP}\n" for i in range(100))
    file = open_gyro(write(ramp))
    assert (file.format, file.log.epoch_ns, file.log.omega[99, 0]) == ("opencamera", EPOCH, 0.99)


def test_spreadsheets_round_timestamps_but_keep_their_place(write: Write) -> None:
    log = read_gyro(write("1.40363657975856E+018,0,0,0.1\n1.40363657976356E+018,0,0,0.2\n"))
    assert log.epoch_ns == 1_403_636_579_758_560_000
    np.testing.assert_array_equal(log.t, [0, 0.005])


@pytest.mark.parametrize("unit", [10**9, 10**6, 10**3, 1], ids=["s", "ms", "us", "ns"])
@pytest.mark.parametrize("rate", [20, 8000])
def test_the_slowest_and_the_fastest_gyro_are_recognised_in_all_units(write: Write, unit: int, rate: int) -> None:
    step = Decimal(10**9) / rate / unit
    log = read_gyro(write("".join(f"{i * step:f} 0 0 {i}\n" for i in range(4))))
    # float64 arithmetic of the median spacing: a few units in the last place
    assert log.rate == pytest.approx(rate, rel=1e-12)


def test_timestamps_in_another_unit_than_the_header_names(write: Write) -> None:
    for unit, step in (("s", 5), ("ms", 0.005), ("ns", 5)):
        table = "".join(f"{step * i:.3f},0.1,0.2,0.3\n" for i in range(50))
        with pytest.warns(RsdeblurWarning, match=f"in {unit} mean a sampling rate"):
            read_gyro(write(f"t[{unit}],gx,gy,gz\n{table}"))


def test_degrees_are_warned_about(write: Write) -> None:
    with pytest.warns(RsdeblurWarning, match="degrees"):
        read_gyro(write("0,100,0,0\n0.01,100,0,0\n"))


def test_late_and_repeated_samples_are_reported(write: Write) -> None:
    """Their laws are those of tests/io/test_log_properties.py."""
    lines = [f"{i / 100} 0 0 {i / 100}" for i in range(200)]
    late = [*lines[:50], lines[51], lines[52], lines[50], *lines[53:]]
    repeated = [*lines[:50], lines[49], *lines[50:]]
    for order, message in ((late, "1 samples came late"), (repeated, "1 repeated samples were dropped")):
        with pytest.warns(RsdeblurWarning, match=rf"log\.csv: {message}"):
            log = read_gyro(write("\n".join(order)))
        np.testing.assert_array_equal(log.omega[:, 2], np.arange(200) / 100)


def test_a_log_without_timestamps_needs_the_sampling_rate(write: Write) -> None:
    table = rows("{x},{y},{z}")
    for text in (table, f"gx[rad/s],gy[rad/s],gz[rad/s]\n{table}"):
        path = write(text)
        assert detect_gyro_format(path) == "unstamped"
        log = read_gyro(path, rate=400.0)
        np.testing.assert_array_equal(log.t, np.arange(len(RATES)) * 2_500_000 * 1e-9)
        np.testing.assert_array_equal(log.omega, RATES)
        with pytest.raises(FileFormatError, match="give the sampling rate"):
            read_gyro(path)
    for rate in (-1.0, 9000.0, np.nan):
        with pytest.raises(InputError, match="rate must be"):
            read_gyro(write(table), rate=rate)
    with pytest.raises(FileFormatError, match="contains timestamps"):
        read_gyro(write(rows("{t},{x},{y},{z}")), rate=200.0)


def test_the_user_says_that_x_y_and_z_are_rates(write: Write) -> None:
    path = write("t_us,x,y,z\n0,1,2,3\n5000,1,2,3\n")
    with pytest.raises(FileFormatError, match=r"looks like a trajectory .* --gyro-format"):
        read_gyro(path)
    np.testing.assert_array_equal(read_gyro(path, "plain").omega, [[1, 2, 3], [1, 2, 3]])
    with pytest.raises(FileFormatError, match="another sensor"):
        read_gyro(path.rename(path.with_name("accelerometer.csv")), "plain")


@pytest.mark.parametrize("name", ["Accelerometer.csv", "VID_1gravity.csv", "Magnetometer.csv", "VID_1accel.csv"])
@pytest.mark.parametrize("layout", ["sensor logger", "opencamera"])
def test_another_sensor_of_the_same_columns_is_refused(write: Write, name: str, layout: str) -> None:
    header, pattern, *_ = LAYOUTS[layout]
    with pytest.raises(FileFormatError, match="another sensor"):
        read_gyro(write(header + rows(pattern), name))


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


def test_gcsv_defaults_are_milliseconds_and_radians(write: Write) -> None:
    with pytest.warns(RsdeblurWarning, match="xzY"):
        log = read_gyro(write("GYROFLOW IMU LOG\nt,gx,gy,gz\n0,1,2,3\n4,1,2,3\n"))
    np.testing.assert_array_equal(log.t, [0, 4_000_000 * 1e-9])
    np.testing.assert_array_equal(log.omega[0], [-1, -3, 2])


@pytest.mark.parametrize(("mark", "quote"), [(";", ""), (",", '"')])
def test_gcsv_saved_by_a_spreadsheet(write: Write, mark: str, quote: str) -> None:
    """Its scales count: without them, integer rates would be thousands of times too fast."""
    keys = ["GYROFLOW IMU LOG", "orientation YxZ", "tscale 0.001", "gscale 0.5", "t gx gy gz"]
    head = [mark.join(f"{quote}{cell}{quote}" for cell in key.split(" ")) for key in keys[1:]]
    lines = ["# note", keys[0], *head, *(f"{10 * i}{mark}2{mark}4{mark}6" for i in range(4))]
    text = "\n".join(lines)
    log = read_gyro(write(text.replace(".", ",") if mark == ";" else text))
    np.testing.assert_array_equal(log.omega[0], [2, -1, 3])


def test_gcsv_with_a_scale_that_is_no_whole_number_of_nanoseconds(write: Write) -> None:
    keys = "GYROFLOW IMU LOG\ntscale,0.0000000025\norientation,XYZ\n"
    log = read_gyro(write(f"{keys}t,gx,gy,gz\n1,0,0,0\n1000003,0,0,0\n"))
    # 2.5 ns and 2500007.5 ns, rounded half to even
    assert log.epoch_ns == 2
    np.testing.assert_array_equal(log.t, [0, 2_500_006 * 1e-9])


GOOD = "0.00,1,2,3\n0.01,1,2,3\n"
GCSV = "GYROFLOW IMU LOG\ntscale,0.001\n"
# Text, the line of the fault or 0 for the whole file, and words of the message. test_text.py has more cells.
FAULTS = {
    "too few columns": (GOOD + "0.02,1,2\n0.03,1,2,3\n", 3, "too few columns: 3 found, at least 4"),
    "not a number": (GOOD + "\n# note\n0.02,1,x,3\n", 5, "'x' in column 3 is not a number"),
    "empty cell": (GOOD + "0.02,1,,3\n", 3, "'' in column 3 is not a number"),
    "timestamp not a number": (GOOD + "abc,1,2,3\n", 3, "'abc' in column 1 is not a number"),
    "infinite sample": ("0.00,1,2,-inf\n" + GOOD, 1, "'-inf' in column 4 is not finite"),
    "duplicate": (GOOD + "0.01,4,5,6\n0.02,1,2,3\n", 3, "duplicate timestamp 10000000 ns"),
    "set back": (GOOD + "0.02,1,2,3\n-0.5,1,2,3\n", 4, "-500000000 ns comes after 20000000 ns"),
    "same nanosecond": (GOOD + "0.0200000000001,1,2,3\n0.0200000000002,1,2,4\n", 4, "duplicate timestamp 20000000"),
    "cut off": (GOOD + "0.02,1,2", 3, "cut off: 3 of 4 columns"),
    "cut off within a number": (GOOD + "0.02,1,2,1e-", 3, "'1e-' in column 4"),
    "cut off after the gyro": (f"{MARS}\n0,1,2,3,4,5,6\n9,1,2,3,4", 3, "cut off: 5 of 7 columns"),
    "beyond int64": (f"0,1,2,3\n{2**63},1,2,3\n{2**64},1,2,3", 2, "int64"),
    "one sample": ("# one\n0.0,1,2,3\n", 2, "at least 2 samples"),
    "overflow": ("0.00,1,2,3\n0.01,1,2,1e200\n0.02,1,2,3\n", 2, "impossible rates"),
    "unknown": ("a,b\n1,2\n", 1, "unknown gyro log format"),
    "five columns": ("0,1,2,3,4\n1,1,2,3,4\n", 1, "known formats: .*gcsv .*mars .*deepgyro .*plain"),
    "unknown unit": ("t,wx[rpm],wy[rpm],wz[rpm]\n" + GOOD, 1, "unknown gyro log format"),
    "unknown unit in a row": ("t;gx;gy;gz\ns;furlong;deg/s;deg/s\n0;1;2;3\n", 2, "'s' in column 1"),
    "other names": ("time_ms,rot_x,rot_y,rot_z\n0,1,2,3\n5,1,2,3\n", 1, "name the columns"),
    "deepgyro type": ("4 0 1 2 3\n4 5 1 2 3\nx 9 1 2 3\n", 3, "'x' is not a sensor type"),
    "deepgyro columns": ("4 0 1 2 3\n1 5 1 2 3\n4 9 1 2\n1 5 1 2 3\n", 3, "too few columns: 4 found, at least 5"),
    "gcsv scale": ("GYROFLOW IMU LOG\ngscale,-1\nt,gx,gy,gz\n0,1,2,3\n", 2, "gscale must be a number from"),
    "gcsv small scale": ("GYROFLOW IMU LOG\ntscale,1e-9999\nt,gx,gy,gz\n0,1,2,3\n", 2, "tscale must be a number from"),
    "gcsv cell": (GCSV + "t,gx,gy,gz\n0,1,2,3\n1,1,,3\n", 5, "'' in column 3"),
    "gravity": ("".join(f"{i / 100} 0.1 -9.75 0.{i % 10}\n" for i in range(30)), 0, "accelerometer at rest"),
    "several sensors": (
        "timestamp,sensor,x,y,z\n"
        + "".join(f"{i},gyro,0.1,0,{i % 3}\n{i + 5},accelerometer,0,9.8,{i % 4}\n" for i in range(0, 400, 10)),
        2,
        r"column 2 names several sensors \(accelerometer, gyro\)",
    ),
    "the wrong column": ("t,wx,wy,wz\n" + rows("{x},{y},{z},{t}"), 2, "column 1 .* does not rise, unlike column 4;"),
    "two columns that rise": ("".join(f"{i % 3},{i},{i * 0.01},0\n" for i in range(20)), 1, "column 2 and column 3;"),
    "several units": ("t,gx[deg/s],gy[rad/s],gz\n" + GOOD, 0, "deg/s and rad/s"),
    "decimal commas": (f"t,gx,gy,gz\n{rows('{t},0,15,0,20,0,25')}", 2, "7 cells, .* 4 columns; .*decimal commas"),
    "quoted decimal commas": ("t,gx,gy,gz\n" + rows('"0,1","0,2","0,3","0,4"'), 2, "decimal points"),
    "far down": ("".join(f"{i * STEP} 0 0 {i}\n" for i in range(17_654)) + "88270000000 0 0 0,1\n", 17_655, "0,1|few"),
    "empty": ("", 0, "empty"),
    "comments only": ("# t wx wy wz\n", 0, "empty but for comments"),
    "binary": ("t,wx,wy,wz\n\0\1\2", 0, "binary"),
    "header only": ("t,wx,wy,wz\n", 0, "no samples"),
    "mars header only": (MARS, 0, "no samples"),
    "gcsv without columns": (GCSV, 0, "no line `t,gx,gy,gz`"),
    "deepgyro without gyro": ("1 0 1 2 3\n2 5 1 2 3\n", 0, "no line is of type 4"),
    "10 Hz": ("0.0,1,2,3\n0.1,1,2,3\n0.2,1,2,3\n", 0, "unit of time: .*0.1"),
    "10 kHz in ns": ("0,1,2,3\n100000,1,2,3\n", 0, "unit of time"),
}


@pytest.mark.parametrize(("text", "line", "message"), FAULTS.values(), ids=FAULTS)
def test_faults_name_the_file_and_the_line(write: Write, text: str, line: int, message: str) -> None:
    with pytest.raises(FileFormatError, match=rf"log\.csv{f', line {line}' if line else '.*'}: .*({message})"):
        read_gyro(write(text))


def test_an_unknown_format_is_named_beside_the_known_ones(write: Write) -> None:
    with pytest.raises(FileFormatError, match=r"log\.csv: .*'eurok'; known formats: gyrodata"):
        read_gyro(write(GOOD), format="eurok")


@pytest.mark.parametrize("name", [each.name for each in formats(GYRO)])
def test_a_forced_format_that_does_not_fit_is_refused(write: Write, name: str) -> None:
    with pytest.raises(FileFormatError, match=r"log\.csv"):
        read_gyro(write("no,gyro\nlog,at\nall,either\n"), format=name)


def test_a_format_that_is_given_overrides_the_content(write: Write) -> None:
    path = write(MARS + "\n" + rows("{t},0,0,0,0,9.8,0"))
    assert open_gyro(path, format="plain").format == "plain"
    np.testing.assert_array_equal(read_gyro(path, format="plain").t, read_gyro(path, "mars").t)


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
