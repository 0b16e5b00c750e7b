"""Tables of text: exact timestamps, the right columns and units, or a refusal by line and the option that helps."""

import json
import sys
import warnings
from collections.abc import Callable
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsdeblur import FileFormatError, InputError, RsdeblurWarning, read_captures, read_gyro, read_trajectory
from rsdeblur.io import open_gyro, read_acceleration
from rsdeblur.io.samples import GyroFile
from rsdeblur.io.source import Source, Table, read_table
from tests._util.files import zipped
from tests.installed import needs

Write = Callable[..., Path]
# A device that turns about x at 0.5 rad/s and shakes; gravity turns the other way in its axes.
STEPS = np.arange(300)
RATES = np.stack([0.5 + 0 * STEPS, 0.2 * np.sin(STEPS / 9), 0.1 * np.cos(STEPS / 7)], axis=-1).round(6)
ANGLES = 0.5 * 0.005 * STEPS
FORCES = 9.81 * np.stack([0 * ANGLES, np.cos(ANGLES), -np.sin(ANGLES)], axis=-1)
DEGREES, DOWN = np.degrees(RATES), np.tile([0.0, 0.0, 1.0], (300, 1))
UNIX, UPTIME = 1_697_590_715_534, 86_400_000  # ms


def table(pattern: str, first: float = 0, step: float = 5, rates: Any = RATES, forces: Any = FORCES) -> str:
    """Return a line for each sample; `pattern` has t, r (a second clock), x, y, z, a, b, c and i."""
    lines = []
    for i, (rate, force) in enumerate(zip(np.asarray(rates).tolist(), np.asarray(forces).tolist(), strict=True)):
        cells = dict(zip("xyzabc", [*rate, *force], strict=True))
        t = first + step * i
        lines.append(pattern.format(t=t, r=t + 3 + (7 * i) % 4, i=i, **cells) + "\n")
    return "".join(lines)


ROW, SIX = "{t},{x},{y},{z}", "{t},{x},{y},{z},{a},{b},{c}"
AXES, AXES_SIX = "t,gx,gy,gz\n", "t,gx,gy,gz,ax,ay,az\n"
ROS = "%time,field.header.stamp,field.angular_velocity.x,field.angular_velocity.y,field.angular_velocity.z\n"
IPHONE = "timestamp,timeIntervalSince1970,GyroX,GyroY,GyroZ\n"
BLACKBOX = "loop, time (us), axisRate[0], axisRate[1], axisRate[2], gyroADC[0], gyroADC[1], gyroADC[2]\n"
PX4 = "timestamp,gyro_rad[0],gyro_rad[1],gyro_rad[2]\n"
# Units of time and of rates, and the rate in Hz.
USUAL, IN_DEGREES, IN_US = ("ms", "rad/s", 200.0), ("ms", "deg/s", 200.0), ("us", "rad/s", 200.0)
# What is read at once: the content, and what it is.
READ: dict[str, tuple[str, tuple[str, str, float]]] = {
    "unix ms, 5 Hz": (AXES + table(ROW, UNIX, 200), ("ms", "rad/s", 5)),
    "unix us": (AXES + table(ROW, 10**3 * UNIX, 10_000), ("us", "rad/s", 100)),
    "unix ns, 2 Hz": (AXES + table(ROW, 10**6 * UNIX, 5 * 10**8), ("ns", "rad/s", 2)),
    "unix ns, 5 kHz": (AXES + table(ROW, 10**6 * UNIX, 200_000), ("ns", "rad/s", 5000)),
    "unix s after dates": (IPHONE + table("18.10.2023,{t:.3f},{x},{y},{z}", UNIX / 1e3, 0.02), ("s", "rad/s", 50)),
    "uptime in ns": (table(ROW, 10**6 * UPTIME, 2_500_000), ("ns", "rad/s", 400)),
    "z, y, x, t": ("gyro_z,gyro_y,gyro_x,time_ms\n" + table("{z},{y},{x},{t}"), USUAL),
    "counted axes": (PX4 + table(ROW, 0, 5000), IN_US),
    "decimal commas": ("t;gx;gy;gz\n" + table("{t:.3f};{x};{y};{z}", 0, 0.01).replace(".", ","), ("s", "rad/s", 100)),
    "settings above tabs": ("app 3\nrate\t9\nt\tgx\tgy\tgz\n" + table(ROW.replace(",", "\t")), USUAL),
    "two clocks": (ROS + table("{r}000000,{t}000000,{x},{y},{z}", UNIX), ("ns", "rad/s", 200)),
    "degrees in words": (
        "t_ms,Gyro_X_deg_per_s,Gyro_Y_deg_per_s,Gyro_Z_deg_per_s\n" + table(ROW, rates=DEGREES),
        IN_DEGREES,
    ),
    "degrees at rest": (AXES_SIX + table(SIX, rates=DEGREES / 10, forces=DOWN), IN_DEGREES),
    "degrees by gravity": (AXES_SIX + table(SIX, rates=DEGREES), IN_DEGREES),
    "degrees by gravity without a header": (table(SIX, rates=DEGREES), IN_DEGREES),
    "radians by gravity": (AXES_SIX + table(SIX), USUAL),
}
# What is refused: the content, words of the message, the options that read it, and what it is then.
REFUSED: dict[str, tuple[str, str, dict[str, str], tuple[str, str, float]]] = {
    "two units": (
        *(AXES + table(ROW, 0, 400), "s?.2.5 Hz. or us .2.5e.03 Hz.*--columns t=1:ms,gx=2,gy=3,gz=4"),
        *({"columns": "t=1:us,gx=2,gy=3,gz=4"}, ("us", "rad/s", 2500)),
    ),
    "degrees": (AXES + table(ROW, rates=DEGREES), "--unit deg/s", {"unit": "deg/s"}, IN_DEGREES),
    "tags in ms": (table("gyroscope," + ROW, UPTIME, rates=DEGREES), "--unit deg/s", {"unit": "deg/s"}, IN_DEGREES),
    "us called ns": (
        *("t_ns,gx,gy,gz\n" + table(ROW, 0, 5000), "--columns t=1:us,gx=2,gy=3,gz=4"),
        *({"columns": "t=1:us,gx=2,gy=3,gz=4"}, IN_US),
    ),
    "unknown names": (
        *(
            "n,clock (us),rot_roll,rot_pitch,rot_yaw,batt\n" + table("{i},{t},{x},{y},{z},7", 0, 5000),
            "t=2,gx=3,gy=4,gz=5$",
        ),
        *({"columns": "t=2,gx=3,gy=4,gz=5"}, IN_US),
    ),
    "flight log": (
        *(BLACKBOX + table("{i}, {t}, 0, 0, {i}, {x}, {y}, {z}", 0, 5000, DEGREES), "--columns t=2,gx=6,gy=7,gz=8$"),
        *({"columns": "t=time (us),gx=gyroADC[0]:deg/s,gy=gyroADC[1],gz=8"}, ("us", "deg/s", 200)),
    ),
    "units below the header": (
        *("When,Rx,Ry,Rz\n[ms],[deg/s],[deg/s],[deg/s]\n" + table(ROW, rates=DEGREES), "1 When|1 .ms."),
        *({"columns": "t=When,gx=rx,gy=ry,gz=rz"}, IN_DEGREES),
    ),
    "five numbers": (table("{t},{i},{x},{y},{z}"), "t=1,gx=", {"columns": "t=1,gx=3,gy=4,gz=5"}, USUAL),
}


def opened(path: Path, **options: Any) -> GyroFile:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RsdeblurWarning)
        return open_gyro(path, **options)


def assert_is(file: GyroFile, expected: tuple[str, str, float]) -> None:
    assert (file.time_unit, file.rate_unit) == expected[:2]
    # timestamps in the files have whole units or three decimals
    assert file.log.rate == pytest.approx(expected[2], rel=1e-6)
    np.testing.assert_allclose(file.log.omega / file.log.omega[:, 0].max(), RATES / 0.5, atol=1e-9)
    assert file.log.epoch_ns in (0, 10**6 * UNIX, 10**6 * UPTIME)


@pytest.mark.parametrize("name", READ)
def test_units_by_evidence(write: Write, name: str) -> None:
    content, expected = READ[name]
    assert_is(opened(write(content)), expected)


@pytest.mark.parametrize("name", REFUSED)
def test_refusals_print_the_option_that_helps(write: Write, name: str) -> None:
    content, words, options, expected = REFUSED[name]
    path = write(content)
    with pytest.raises(FileFormatError, match=words):
        opened(path)
    assert_is(opened(path, **options), expected)


def test_a_pause_and_a_saturated_gyro_are_reported(write: Write) -> None:
    cut = np.clip(np.where(np.abs(RATES) > 0, 20 * np.sin(STEPS / 9)[:, None], 0), -17.4533, 17.4533)
    head = "t[ms],gx[rad/s],gy[rad/s],gz[rad/s]\n"
    with pytest.warns(RsdeblurWarning, match="saturated"):
        read_gyro(write(head + table(ROW, rates=cut)))
    events = "event;experiment time;system time\nSTART;0;100\nPAUSE;0.75;101\nSTART;0.75;113.5\n"
    samples = "Time (s);X (rad/s);Y (rad/s);Z (rad/s)\n" + table("{t:.3f};{x};{y};{z}", 0, 0.01)
    export = write(zipped({"Gyroscope.csv": samples, "meta/time.csv": events}), "export.zip")
    with pytest.warns(RsdeblurWarning, match=r"paused at 0\.75 s for 12\.500 s"):
        log = read_gyro(export)
    # One interval of 10 ms and the pause.
    np.testing.assert_allclose(log.gaps(), [[0.74, 13.25]], atol=1e-9)


def test_the_user_names_the_columns_of_an_accelerometer_too(write: Write) -> None:
    path = write("clock,u,v,w,a,b,c\n" + table(SIX, rates=DEGREES))
    columns = "t=clock:ms,gx=u,gy=v,gz=w,ax=a,ay=b,az=c"
    np.testing.assert_allclose(read_acceleration(path, columns=columns).force, FORCES, atol=1e-12)
    with pytest.warns(RsdeblurWarning, match="taken as deg/s"):
        np.testing.assert_allclose(read_gyro(path, columns=columns).omega, RATES, atol=1e-12)
    with pytest.raises(InputError, match="lacks ax"):
        read_acceleration(path, columns="t=clock:ms,gx=u,gy=v,gz=w")


def test_gyroflow_s_export_of_metadata_has_the_orientation_beside_the_samples(write: Write) -> None:
    samples = [{"timestamp_ms": 5.0 * i, "gyro": rate} for i, rate in enumerate(DEGREES.tolist())]
    omega = read_gyro(write(json.dumps({"imu_orientation": "YxZ", "raw_imu": samples}), "metadata.json")).omega
    np.testing.assert_allclose(omega, RATES[:, [1, 0, 2]] * [1, -1, 1], atol=1e-12)


def test_columns_without_timestamps_need_the_sampling_rate(write: Write) -> None:
    path = write("a,u,v,w\n" + table("{i},{x},{y},{z}"))
    np.testing.assert_allclose(read_gyro(path, columns="gx=2,gy=3,gz=4", rate=200.0).omega, RATES)


@pytest.mark.parametrize(
    ("error", "columns", "words"),
    [
        *((InputError, text, "is not like") for text in ("", "t", "t=", "t=1,foo=2", "t=1,gx=2,gy=3,gz=4,x=3")),
        (InputError, "t=1,gx=2,gy=3", "lacks gz"),
        (InputError, "t=1:deg/s,gx=2,gy=3,gz=4", "deg/s of t"),
        (InputError, "t=1,exposure=2", "lacks gx"),
        (FileFormatError, "t=zeit,gx=2,gy=3,gz=4", "log.csv: .*'zeit'; the columns are 1 t, 2 gx, 3 gy, 4 gz"),
        *((FileFormatError, f"t={t},gx=2,gy=3,gz=4", "log.csv: no line has numbers in all") for t in (0, 9)),
    ],
)
def test_wrong_choices(write: Write, error: type[ValueError], columns: str, words: str) -> None:
    with pytest.raises(error, match=words):
        read_gyro(write(AXES + table(ROW)), columns=columns)


@pytest.mark.parametrize(
    ("content", "columns", "durations"),
    [
        ("id,when,shutter\n0,{t}.5,8.5\n1,{u}.5,8.5\n", "t=when:s,exposure=shutter:ms", [0.0085] * 2),
        ("00000 {t}.5 8500\n00001 {u}.5 8500\n", "t=2:s,exposure=3:us", [0.0085] * 2),
        ("{t}500\n{u}500\n", None, [None] * 2),
        ("{t}500000000 {t}.5\n{u}500000000 {u}.5\n", None, [None] * 2),
        ("{t}.5 {t}500000000\n{u}.5 {u}500000000\n", None, [None] * 2),
    ],
)
def test_captures(write: Write, content: str, columns: str | None, durations: list[float | None]) -> None:
    path = write(content.format(t=1_650_458_716, u=1_650_458_717))
    captures = read_captures(path, duration=None if durations[0] else 0.01, columns=columns)
    assert [each.epoch_ns for each in captures] == [1_650_458_716_500_000_000, 1_650_458_717_500_000_000]
    assert [each.duration for each in captures] == [known or 0.01 for known in durations]


@pytest.mark.parametrize(
    ("content", "columns"),
    [
        ("1650458716500 1 2 3 0 0 0 1\n1650458716550 1 2 4 0 0 0 1\n", None),
        ("w,a,b,c,q,r,s,t\n1,2,3,1,0,0,0,1650458716.5\n1,2,4,1,0,0,0,1650458716.55\n",
         "t=t:s,x=c,y=1,z=3,qx=5,qy=6,qz=7,qw=4"),
    ],
)  # fmt: skip
def test_trajectories(write: Write, content: str, columns: str | None) -> None:
    track = read_trajectory(write(content), columns=columns)
    assert (track.epoch_ns, track.t[1]) == (1_650_458_716_500_000_000, 0.05)
    assert track.quaternion is not None
    np.testing.assert_array_equal(track.quaternion, [[0, 0, 0, 1]] * 2)


def test_a_log_that_only_telemetry_parser_knows(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the package, it is an unknown log."""
    needs("telemetry")
    head = "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n" + (
        "FMT, 45, 50, IMU, QBffffffIIfBBHH, TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz\n"
        "PARM, 1000, X, 1\nVSTB, 1000, 1, 2\n"
    )
    row = "IMU, {t}, 0, {x}, {y}, {z}, {a}, {b}, {c}, 0, 0, 40, 1, 1, 1000, 1000"
    path = write(head + table(row, 10**6, 5000), "flight.log")
    file = opened(path)
    assert (file.format, file.axes, file.facts["camera"]) == ("telemetry", "gyroflow", "ArduPilot .log")
    # telemetry-parser turns and negates axes
    np.testing.assert_allclose(sorted(np.ptp(file.log.omega, axis=0)), sorted(np.ptp(RATES, axis=0)), atol=1e-6)
    monkeypatch.setitem(sys.modules, "telemetry_parser", None)
    with pytest.raises(FileFormatError, match="unknown gyro log"):
        opened(path)


UNITS = [Decimal(1), Decimal(10**9), Decimal("976562.5"), Decimal("0.3"), Decimal("0.5"), Decimal("1e-3")]
FORMS: dict[str, Callable[[np.random.Generator], str]] = {
    "whole": lambda rng: str(rng.integers(-(10**6), 10**17)),
    "halves": lambda rng: f"{rng.integers(10**6)}{rng.choice(['', '.5', '.25', '.50'])}",
    "decimals": lambda rng: f"{rng.uniform(-10, 1e6):.{rng.integers(10)}f}",
    "since 1970": lambda rng: f"{rng.integers(10**9, 2 * 10**9)}.{rng.integers(10**9):09d}",
    "exponents": lambda rng: f"{rng.uniform(-10, 1e6):.9e}",
    "long": lambda rng: f"{rng.uniform(0, 1e3):.25f}",
    "longer": lambda rng: "0" * 60 + f"{rng.uniform(0, 1e3):.25f}" + "0" * 60,
    "signs": lambda rng: rng.choice(["+.5", "-.25", "-7.", "+7", " 8.5 ", "-0.0", '"9.5"']),
    "mixed": lambda rng: FORMS[rng.choice(["whole", "decimals", "exponents", "long", "signs"])](rng),
}


def two_columns(content: str) -> Table:
    source = Source("log.csv", "log", content.encode())
    return read_table(source, source.rows, [0, 1])


@pytest.mark.parametrize("form", FORMS)
def test_timestamps_are_exact(form: str) -> None:
    rng = np.random.default_rng(0)
    timestamps = [FORMS[form](rng) for _ in range(50)]
    found = two_columns("".join(f"{timestamp},{i}\n" for i, timestamp in enumerate(timestamps)))
    assert found.values[:, 0].tolist() == list(range(50))
    exact = [Decimal(timestamp.strip('"')) for timestamp in timestamps]
    for unit in UNITS:
        if max(abs(timestamp * unit) for timestamp in exact) < 2**62:
            assert found.nanoseconds(unit).tolist() == [round(timestamp * unit) for timestamp in exact]


@pytest.mark.parametrize("row", ["{},1\n", "{} 1\n", "{}\t1\n", '"{}","1"\n'])
def test_dates_with_a_zone_are_nanoseconds_since_1970(row: str) -> None:
    second = 1_714_564_800
    cells = {
        "1969-12-31T23:59:59.5Z": -(10**9) // 2,
        "2024-05-01T12:00:00.123Z": second * 10**9 + 123_000_000,
        "2024-05-01T14:00:00.123456789+02:00": second * 10**9 + 123_456_789,
        "2024-05-01T06:30:01-05:30": (second + 1) * 10**9,
    }
    assert two_columns("".join(map(row.format, cells))).nanoseconds(Decimal(1)).tolist() == list(cells.values())


@pytest.mark.parametrize("cell", ["2024-02-30T12:00:00Z", "2024-05-01T12:00:00"])
def test_what_is_no_date_with_a_zone_is_no_timestamp(cell: str) -> None:
    date = "2024-05-01T12:00:00Z,1\n"
    with pytest.raises(FileFormatError, match=f"line 2: '{cell}' in column 1 is not a number"):
        two_columns(f"{date}{cell},1\n{date}{date}")


def test_whole_timestamps_fill_int64() -> None:
    limit = 2**63 - 4096
    assert two_columns(f"{-limit},1\n{limit - 1},1\n").nanoseconds(Decimal(1)).tolist() == [-limit, limit - 1]
    for timestamp in (2**63 - 1, -(2**63), 2**63, 10**300, f"{limit}e3"):
        with pytest.raises(FileFormatError, match=r"line 2: timestamp .* is beyond the int64 range"):
            two_columns(f"0,1\n{timestamp},1\n").nanoseconds(Decimal(1))


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", "\r\r\n"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_lines_are_those_of_the_text(end: str, encoding: str) -> None:
    lines = ["# a", "1,2", "", " ", "\t# b", " 3,4", "\u3000", "\u3000\u00b5", "\x1c", "#", "5,6", "\x1c7"]
    parsed = Source("log.csv", "log", end.join(lines).encode(encoding))
    assert parsed.lines == lines
    assert parsed.rows.tolist() == [i for i, line in enumerate(lines) if line.strip() and line.strip()[0] != "#"]
