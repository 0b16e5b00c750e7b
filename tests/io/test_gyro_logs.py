"""Gyro logs: every format to the exact timestamp, and every fault with its file and line."""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

from rsdeblur.errors import FileFormatError, InputError, RsdeblurWarning
from rsdeblur.io import detect_gyro_format, read_gyro
from rsdeblur.io.gyro_logs import formats
from rsdeblur.io.samples import GYRO
from rsdeblur.motion.axes import imu_to_camera

# A timestamp that float64 cannot represent: its neighbours there are 256 ns apart.
EPOCH = 1_766_385_749_427_863_801
STEP = 5_000_000
RATES = [(0.1, -0.2, 0.3), (0.11, -0.21, 3.8e-4), (-1.5, 0.0, 2.0), (0.0, 1.0, -1.0)]

Write = Callable[..., Path]


def table(separator: str = ",", header: str = "", unit: int = 1, start: int = EPOCH) -> str:
    """Return RATES as text, stamped from `start` ns in units of `unit` ns."""
    rows = []
    for i, rates in enumerate(RATES):
        timestamp = Decimal(start + i * STEP) / unit
        rows.append(separator.join([f"{timestamp:f}", *map(repr, rates)]))
    return "\n".join([header, *rows] if header else rows) + "\n"


def assert_is_reference(path: Path, name: str, epoch: int = EPOCH) -> None:
    log = read_gyro(path)
    assert detect_gyro_format(path) == name
    assert log.epoch_ns == epoch
    np.testing.assert_array_equal(log.t, np.arange(len(RATES)) * STEP * 1e-9)
    np.testing.assert_array_equal(log.omega, RATES)


@pytest.mark.parametrize("unit", [1, 10**3, 10**6, 10**9], ids=["ns", "us", "ms", "s"])
def test_plain_units_follow_from_the_spacing_and_timestamps_stay_exact(write: Write, unit: int) -> None:
    assert_is_reference(write(table(unit=unit)), "plain")


@pytest.mark.parametrize(("unit", "name"), [(10**9, "s"), (10**6, "ms"), (10**3, "us"), (1, "ns")])
@pytest.mark.parametrize("rate", [20, 8000])
def test_the_slowest_and_the_fastest_gyro_are_recognised_in_all_units(
    write: Write, unit: int, name: str, rate: int
) -> None:
    step = Decimal(10**9) / rate / unit
    log = read_gyro(write("".join(f"{i * step:f} 0 0 {i}\n" for i in range(4))))
    # float64 arithmetic of the median spacing: a few units in the last place
    assert log.rate == pytest.approx(rate, rel=1e-12)


def test_windows_line_ends_byte_order_mark_and_no_final_line_break(write: Write) -> None:
    assert_is_reference(write("\ufeff" + table().rstrip("\n").replace("\n", "\r\n")), "plain")


MARS_HEADER = "Timestamp[nanosec], gx[rad/s], gy[rad/s], gz[rad/s], ax[m/s^2], ay[m/s^2], az[m/s^2]"


@pytest.mark.parametrize("header", [MARS_HEADER, MARS_HEADER.replace(" ", "") + ",Unix time[nanosec]"])
@pytest.mark.parametrize("separator", [",", ", "])
def test_mars(write: Write, header: str, separator: str) -> None:
    body = table(separator).replace("\n", f"{separator}0.1{separator}9.8{separator}2.2\n")
    assert_is_reference(write(f"{header}\n{body}"), "mars")


def test_mars_states_its_unit_whatever_the_rate(write: Write) -> None:
    path = write(f"{MARS_HEADER}\n0,0,0,0\n1000000000,0,0,0\n")
    with pytest.warns(RsdeblurWarning, match="in ns mean a sampling rate of 1 Hz, .* is the unit of time right?"):
        assert read_gyro(path).rate == pytest.approx(1)


def test_timestamps_in_another_unit_than_the_header_names(write: Write) -> None:
    for unit, step, rate in (("s", 5, "0.2"), ("ms", 0.005, "2e\\+05"), ("ns", 5, "2e\\+08")):
        rows = "".join(f"{step * i:.3f},0.1,0.2,0.3\n" for i in range(50))
        with pytest.warns(RsdeblurWarning, match=f"in {unit} mean a sampling rate of {rate} Hz"):
            read_gyro(write(f"t[{unit}],gx,gy,gz\n{rows}"))


def test_deepgyro_skips_other_sensors(write: Write) -> None:
    lines = [f"2 {EPOCH} 1 2 3"]
    for line in table(" ").splitlines():
        lines += [f"4 {line}", f"1 {EPOCH} 9 9 9"]
    assert_is_reference(write("\n".join(lines)), "deepgyro")


@pytest.mark.parametrize("first", ["GYROFLOW IMU LOG", "CAMERA IMU LOG"])
@pytest.mark.parametrize("mark", [",", ":"])
@pytest.mark.parametrize("columns", ["t,gx,gy,gz", "time,gx,gy,gz,ax,ay,az"])
def test_gcsv(write: Write, first: str, mark: str, columns: str) -> None:
    keys = ("version 1.3", "note of,the:writer", "description a,b", "rate 200", "tscale 0.000001", "gscale 0.001")
    header = "\n".join([first, *(key.replace(" ", mark, 1) for key in keys), "orientation,YxZ", columns])
    accelerations = ",1,2,3" * ("ax" in columns)
    log = read_gyro(write(f"{header}\n1500,39,86,183{accelerations}\n3500.5,56,-100,202{accelerations}\n"))
    assert log.epoch_ns == 1_500_000
    np.testing.assert_array_equal(log.t, [0, 2_000_500 * 1e-9])
    # orientation YxZ: Gyroflow's x is the raw y, its y the raw x negated
    np.testing.assert_array_equal(log.omega, np.array([[86, -39, 183], [-100, -56, 202]]) * 0.001)


def test_gcsv_defaults_are_milliseconds_and_radians(write: Write) -> None:
    with pytest.warns(RsdeblurWarning, match="default, xzY, is assumed"):
        log = read_gyro(write("GYROFLOW IMU LOG\nt,gx,gy,gz\n0,1,2,3\n4,1,2,3\n"))
    np.testing.assert_array_equal(log.t, [0, 4_000_000 * 1e-9])
    np.testing.assert_array_equal(log.omega[0], [-1, -3, 2])


def test_an_orientation_that_is_given_replaces_the_one_of_the_file(write: Write) -> None:
    path = write("GYROFLOW IMU LOG\norientation,YxZ\ngscale,0.5\nt,gx,gy,gz\n0,1,2,3\n4,1,2,3\n")
    np.testing.assert_array_equal(read_gyro(path, orientation="xZy").omega[0], [-0.5, 1.5, -1])
    np.testing.assert_array_equal(read_gyro(write(GOOD), orientation="YxZ").omega[0], [2, -1, 3])
    with pytest.raises(InputError, match="orientation must name each of X, Y and Z once, like 'YxZ'; got 'XXZ'"):
        read_gyro(path, orientation="XXZ")


def test_gcsv_with_a_scale_that_is_no_whole_number_of_nanoseconds(write: Write) -> None:
    keys = "GYROFLOW IMU LOG\ntscale,0.0000000025\norientation,XYZ\n"
    log = read_gyro(write(f"{keys}t,gx,gy,gz\n1,0,0,0\n1000003,0,0,0\n"))
    # 2.5 ns and 2500007.5 ns, rounded half to even
    assert log.epoch_ns == 2
    np.testing.assert_array_equal(log.t, [0, 2_500_006 * 1e-9])


def test_detection_looks_at_the_content_and_format_overrides_it(write: Write) -> None:
    path = write(f"{MARS_HEADER}\n0,0,0,0\n5000000,0,0,0\n")
    assert detect_gyro_format(path) == "mars"
    np.testing.assert_array_equal(read_gyro(path, format="plain").t, read_gyro(path, "mars").t)


def test_degrees_are_warned_about(write: Write) -> None:
    with pytest.warns(RsdeblurWarning, match="degrees"):
        read_gyro(write("0,100,0,0\n0.01,100,0,0\n"))


def test_late_samples_are_sorted_in_and_reported(write: Write) -> None:
    rows = [f"{i / 100} 0 0 {i / 100}" for i in range(200)]
    rows[50], rows[51], rows[52] = rows[51], rows[52], rows[50]
    with pytest.warns(RsdeblurWarning, match="log.csv: 1 samples came late and were sorted in"):
        log = read_gyro(write("\n".join(rows)))
    np.testing.assert_array_equal(log.omega[:, 2], np.arange(200) / 100)


def test_a_clock_that_is_set_back_is_not_taken_for_late_samples(write: Write) -> None:
    """The samples that follow continue from there, and no sample was missing where they are sorted in."""
    t = np.arange(400) * 0.005
    for step in (0.0059, 0.0075, 0.0201, 0.0449):
        rows = [f"{timestamp - step * (timestamp > 1):.4f} {i % 7} 0 0" for i, timestamp in enumerate(t)]
        with pytest.raises(FileFormatError, match=r"line 202: timestamp out of order: .*set back"):
            read_gyro(write("\n".join(rows)), unit="mdeg/s")


def test_several_late_samples_fill_their_own_holes(write: Write) -> None:
    rows = [f"{i / 200} 0 0 {i / 200}" for i in range(1000)]
    for i in (100, 101, 500):
        rows.insert(i + 4, rows.pop(i))
    with pytest.warns(RsdeblurWarning, match="samples came late"):
        np.testing.assert_array_equal(read_gyro(write("\n".join(rows))).omega[:, 2], np.arange(1000) / 200)


def moved(place: int, epoch: int = EPOCH, unit: int = 1, separator: str = ",") -> str:
    """Return the reference table, longer, with the timestamps in another column."""
    rows = []
    for i in range(20):
        cells = [str(rate) for rate in RATES[i % len(RATES)]]
        cells.insert(place, f"{Decimal(epoch + i * STEP) / unit:f}")
        rows.append(separator.join(cells))
    return "\n".join(rows) + "\n"


def test_a_header_that_names_the_wrong_column_is_refused_with_the_right_one(write: Write) -> None:
    with pytest.raises(FileFormatError, match=r"line 2: column 1 .* does not rise, unlike column 4;"):
        read_gyro(write("t,wx,wy,wz\n" + moved(3)))


def test_two_columns_that_rise_are_refused_by_their_numbers(write: Write) -> None:
    rows = "".join(f"{i % 3},{i},{i * 0.01},0\n" for i in range(20))
    with pytest.raises(FileFormatError, match=r"column 1 .* does not rise, unlike column 2 and column 3;"):
        read_gyro(write(rows))


def test_the_gyro_beside_an_accelerometer_is_found_wherever_the_timestamps_are(write: Write) -> None:
    gyro, gravity = "0.1,-0.2,0.3", "0.1,9.8,0.2"
    for cells in ("T,G,A", "T,A,G", "G,A,T", "A,G,T"):
        row = cells.replace("G", gyro).replace("A", gravity)
        log = read_gyro(write("".join(row.replace("T", f"{0.01 * i:.2f}") + "\n" for i in range(9))))
        np.testing.assert_array_equal(log.omega[0], [0.1, -0.2, 0.3])
        assert log.rate == pytest.approx(100)


def test_a_log_without_timestamps_needs_the_sampling_rate(write: Write) -> None:
    rates = "".join(f"{x},{y},{z}\n" for x, y, z in RATES)
    for text in (rates, f"gx[rad/s],gy[rad/s],gz[rad/s]\n{rates}"):
        path = write(text)
        assert detect_gyro_format(path) == "unstamped"
        log = read_gyro(path, rate=400.0)
        np.testing.assert_array_equal(log.t, np.arange(4) * 2_500_000 * 1e-9)
        np.testing.assert_array_equal(log.omega, RATES)
        with pytest.raises(FileFormatError, match="no timestamps; give the sampling rate"):
            read_gyro(path)
    for rate in (0.0, -1.0, 10.0, 9000.0, np.nan):
        with pytest.raises(InputError, match="rate must be"):
            read_gyro(write(rates), rate=rate)
    with pytest.raises(FileFormatError, match="the file contains timestamps; leave out"):
        read_gyro(write(table()), rate=200.0)


def test_columns_of_other_names_get_advice(write: Write) -> None:
    for header in ("time_ms,rot_x,rot_y,rot_z", "timestamp,roll rate,pitch rate,yaw rate"):
        with pytest.raises(FileFormatError, match="name the columns of a table in its first line, like t,wx,wy,wz, or"):
            read_gyro(write(f"{header}\n0,1,2,3\n5,1,2,3\n"))
    log = read_gyro(write("t_ms,wx_deg_s,wy_deg_s,wz_deg_s\n0,1,2,3\n5,1,2,3\n"))
    np.testing.assert_allclose(np.rad2deg(log.omega[0]), [1, 2, 3], atol=1e-12)


def test_the_user_says_that_x_y_and_z_are_rates(write: Write) -> None:
    path = write("t_us,x,y,z\n0,1,2,3\n5000,1,2,3\n")
    with pytest.raises(FileFormatError, match=r"looks like a trajectory .* if x, y and z are rates, add --gyro-format"):
        read_gyro(path)
    np.testing.assert_array_equal(read_gyro(path, "plain").omega, [[1, 2, 3], [1, 2, 3]])
    with pytest.raises(FileFormatError, match="named after another sensor"):
        read_gyro(path.rename(path.with_name("accelerometer.csv")), "plain")


def test_a_row_of_units_may_follow_the_names(write: Write) -> None:
    log = read_gyro(write("t;gx;gy;gz\n[ms];deg/s;deg/s;deg/s\n0;1;2;3\n5;0,5;1,5;-2\n"))
    np.testing.assert_array_equal(log.t, [0, 0.005])
    np.testing.assert_allclose(np.rad2deg(log.omega), [[1, 2, 3], [0.5, 1.5, -2]], atol=1e-12)
    with pytest.raises(FileFormatError, match=r"line 2: 's' in column 1"):
        read_gyro(write("t;gx;gy;gz\ns;furlong;deg/s;deg/s\n0;1;2;3\n"), format="plain")


def test_rates_of_several_units_are_refused(write: Write) -> None:
    with pytest.raises(FileFormatError, match="the values are in deg/s and rad/s; they must all have one unit"):
        read_gyro(write("t,gx[deg/s],gy[rad/s],gz\n" + GOOD))


@pytest.mark.parametrize("last", ["1;0;0;0", "1,05;0;0;0"])
def test_decimal_commas_are_seen_in_any_row(write: Write, last: str) -> None:
    log = read_gyro(write(f"t[s];gx;gy;gz\n0,9;0,1;0,2;0,3\n0,95;0,1;0,2;0,3\n{last}\n"))
    assert log.epoch_ns == 900_000_000
    np.testing.assert_array_equal(log.omega[0], [0.1, 0.2, 0.3])


def test_decimal_commas_between_commas_are_refused(write: Write) -> None:
    rows = "".join(f"{5_000_000 * i},0,15,0,20,0,25\n" for i in range(5))
    with pytest.raises(FileFormatError, match=r"line 2: 7 cells, but the header names 4 columns; .*decimal commas"):
        read_gyro(write(f"t,gx,gy,gz\n{rows}"))


def test_repeated_samples_are_dropped_and_reported(write: Write) -> None:
    with pytest.warns(RsdeblurWarning, match="1 repeated samples were dropped"):
        log = read_gyro(write(GOOD + "0.01,1,2,3\n0.02,1,2,3\n"))
    np.testing.assert_allclose(log.t, [0, 0.01, 0.02], atol=1e-15)


def test_a_long_log_round_trips(write: Write) -> None:
    rng = np.random.default_rng(2)
    timestamps = EPOCH + np.cumsum(rng.integers(1_000_000, 3_000_000, 100_000))
    omega = rng.normal(size=(len(timestamps), 3))
    rows = zip(timestamps.tolist(), omega.tolist(), strict=True)
    log = read_gyro(write("t,wx,wy,wz\n" + "".join(f"{t},{x!r},{y!r},{z!r}\n" for t, (x, y, z) in rows)))
    assert log.epoch_ns == timestamps[0]
    np.testing.assert_array_equal(log.t, (timestamps - timestamps[0]) * 1e-9)
    np.testing.assert_array_equal(log.omega, omega)


GOOD = "0.00,1,2,3\n0.01,1,2,3\n"
GCSV = "GYROFLOW IMU LOG\ntscale,0.001\n"
FAULTS = {
    "too few columns": (GOOD + "0.02,1,2\n0.03,1,2,3\n", 3, "too few columns: 3 found, at least 4"),
    "one column": (GOOD + "0.02\n0.03,1,2,3\n", 3, "too few columns: 1 found"),
    "not a number": (GOOD + "\n# note\n0.02,1,x,3\n", 5, "'x' in column 3 is not a number"),
    "empty cell": (GOOD + "0.02,1,,3\n", 3, "'' in column 3 is not a number"),
    "python number": (GOOD + "0.02,1,1_0,3\n", 3, "1_0"),
    "timestamp not a number": (GOOD + "abc,1,2,3\n", 3, "'abc' in column 1 is not a number"),
    "timestamp nan": (GOOD + "nan,1,2,3\n", 3, "'nan' in column 1 is not finite"),
    "timestamp with underscore": (GOOD + "1_0,1,2,3\n", 3, "'1_0' in column 1"),
    "integer timestamps with a bad one": ("0,1,2,3\n10,1,2,3\n2O,1,2,3\n", 3, "'2O' in column 1"),
    "nan sample": (GOOD + "0.02,1,nan,3\n", 3, "'nan' in column 3 is not finite"),
    "infinite sample": ("0.00,1,2,-inf\n" + GOOD, 1, "'-inf' in column 4 is not finite"),
    "duplicate": (GOOD + "0.01,4,5,6\n0.02,1,2,3\n", 3, "duplicate timestamp 10000000 ns with another value"),
    "set back": (GOOD + "0.02,1,2,3\n-0.5,1,2,3\n", 4, "-500000000 ns comes after 20000000 ns"),
    "reversed": ("0.03,1,2,3\n0.02,1,2,3\n0.01,1,2,3\n", 2, "out of order"),
    "same nanosecond": (GOOD + "0.0200000000001,1,2,3\n0.0200000000002,1,2,4\n", 4, "duplicate timestamp 20000000"),
    "cut off": (GOOD + "0.02,1,2", 3, "cut off: 3 of 4 columns"),
    "cut off within a number": (GOOD + "0.02,1,2,1e-", 3, "'1e-' in column 4 is not a number"),
    "cut off after the gyro": (f"{MARS_HEADER}\n0,1,2,3,4,5,6\n9,1,2,3,4", 3, "cut off: 5 of 7 columns"),
    "mars not a number": (f"{MARS_HEADER}\n0,1,2,3\n9,1,null,3\n", 3, "'null' in column 3"),
    "beyond int64": (f"0,1,2,3\n{2**63},1,2,3\n{2**64},1,2,3", 2, "beyond the int64 range"),
    "seconds beyond int64": ("0,1,2,3\n0.01,1,2,3\n0.02,1,2,3\n9.3e9,1,2,3\n", 4, "beyond the int64 range"),
    "astronomic": (GOOD + "1e999999999,1,2,3\n", 3, "in column 1 is not finite"),
    "one sample": ("# one\n0.0,1,2,3\n", 2, "at least 2 samples"),
    "overflow": ("0.00,1,2,3\n0.01,1,2,1e200\n0.02,1,2,3\n", 2, "impossible rates"),
    "unknown": ("a,b\n1,2\n", 1, "unknown gyro log format"),
    "five columns": ("0,1,2,3,4\n1,1,2,3,4\n", 1, "known formats: .*gcsv .*mars .*deepgyro .*plain"),
    "accelerometer header": ("t,ax,ay,az\n" + GOOD, 1, "unknown gyro log format"),
    "unknown unit": ("t,wx[rpm],wy[rpm],wz[rpm]\n" + GOOD, 1, "unknown gyro log format"),
    "deepgyro type": ("4 0 1 2 3\n4 5 1 2 3\nx 9 1 2 3\n", 3, "'x' is not a sensor type"),
    "deepgyro columns": ("4 0 1 2 3\n1 5 1 2 3\n4 9 1 2\n1 5 1 2 3\n", 3, "too few columns: 4 found, at least 5"),
    "gcsv scale": ("GYROFLOW IMU LOG\ngscale,-1\nt,gx,gy,gz\n0,1,2,3\n", 2, "gscale must be a number from 1e-12"),
    "gcsv small scale": ("GYROFLOW IMU LOG\ntscale,1e-9999\nt,gx,gy,gz\n0,1,2,3\n", 2, "from 1e-12 to 1e12"),
    "gcsv scale no number": ("GYROFLOW IMU LOG\ntscale,fast\nt,gx,gy,gz\n0,1,2,3\n", 2, "got 'fast'"),
    "gcsv cell": (GCSV + "t,gx,gy,gz\n0,1,2,3\n1,1,,3\n", 5, "'' in column 3"),
}


@pytest.mark.parametrize(("text", "line", "message"), FAULTS.values(), ids=FAULTS)
def test_faults_name_the_file_and_the_line(write: Write, text: str, line: int, message: str) -> None:
    with pytest.raises(FileFormatError, match=rf"log\.csv, line {line}: .*{message}"):
        read_gyro(write(text))


WHOLE_FILE_FAULTS = {
    "empty": ("", "empty"),
    "blank": ("\n \n", "empty"),
    "comments only": ("# t wx wy wz\n", "empty but for comments"),
    "binary": ("t,wx,wy,wz\n\0\1\2", "binary"),
    "header only": ("t,wx,wy,wz\n", "no samples"),
    "mars header only": (MARS_HEADER, "no samples"),
    "gcsv without columns": (GCSV, "no line `t,gx,gy,gz`"),
    "gcsv without samples": (GCSV + "t,gx,gy,gz\n", "no samples"),
    "deepgyro without gyro": ("1 0 1 2 3\n2 5 1 2 3\n", "no line is of type 4"),
    "one mars sample": (f"{MARS_HEADER}\n0,1,2,3\n", "at least 2 samples"),
    "10 Hz": ("0.0,1,2,3\n0.1,1,2,3\n0.2,1,2,3\n", "cannot determine the unit of time: .*0.1"),
    "10 kHz in ns": ("0,1,2,3\n100000,1,2,3\n", "cannot determine the unit of time"),
}


@pytest.mark.parametrize(("text", "message"), WHOLE_FILE_FAULTS.values(), ids=WHOLE_FILE_FAULTS)
def test_faults_of_the_whole_file_name_it(write: Write, text: str, message: str) -> None:
    with pytest.raises(FileFormatError, match=rf"log\.csv.*: .*{message}"):
        read_gyro(write(text))


def test_unknown_format_name_lists_the_known_ones(write: Write) -> None:
    with pytest.raises(
        FileFormatError, match=r"log\.csv: there is no gyro log format 'eurok'; known formats: gyrodata"
    ):
        read_gyro(write(table()), format="eurok")


@pytest.mark.parametrize("name", [each.name for each in formats(GYRO)])
def test_a_forced_format_that_does_not_fit_is_refused(write: Write, name: str) -> None:
    with pytest.raises(FileFormatError, match=r"log\.csv"):
        read_gyro(write("no,gyro\nlog,at\nall,either\n"), format=name)


def test_the_faulty_line_is_found_far_down(write: Write) -> None:
    lines = [f"{i * STEP} 0 0 {i}" for i in range(20_000)]
    lines[17_654] = "88270000000 0 0 0,1"
    with pytest.raises(FileFormatError, match=r"line 17655: '0,1'|line 17655: too few columns"):
        read_gyro(write("\n".join(lines)))


@pytest.mark.parametrize(
    ("name", "kind", "count", "epoch", "rate"),
    [
        ("real/mars-phone-240ms/gyro_accel.csv", "mars", 1067, 1_560_489_219_555, 497.693),
        ("real/shield-burst/imu.txt", "deepgyro", 23, 767_705_436_983, 100.048),
        ("gyro/phone-210hz.txt", "plain", 12_065, 1_309_154_983_495_295, 210.240),
        ("formats/gcsv/movie.gcsv", "gcsv", 1067, 0, 497.693),
        ("formats/gcsv/docs_example_v1.3.gcsv", "gcsv", 16, 0, 1000.0),
    ],
)
def test_real_logs(data_dir: Path, name: str, kind: str, count: int, epoch: int, rate: float) -> None:
    log = read_gyro(data_dir / name)
    assert detect_gyro_format(data_dir / name) == kind
    assert (len(log), log.epoch_ns) == (count, epoch)
    assert log.rate == pytest.approx(rate, abs=1e-3)


def test_the_same_recording_in_two_formats_agrees(data_dir: Path) -> None:
    mars = read_gyro(data_dir / "real/mars-phone-240ms/gyro_accel.csv")
    gcsv = read_gyro(data_dir / "formats/gcsv/movie.gcsv")
    np.testing.assert_array_equal(mars.t, gcsv.t)
    # in camera axes, each from its own; the .gcsv keeps whole microradians per second
    np.testing.assert_allclose(
        mars.omega @ imu_to_camera("phone-portrait").T, gcsv.omega @ imu_to_camera("gyroflow").T, atol=0.51e-6
    )
