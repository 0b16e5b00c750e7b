"""Tables of any kind: read rightly, or refused with the option that reads them."""

from __future__ import annotations

import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsdeblur import FileFormatError, InputError, read_captures, read_gyro, read_trajectory
from rsdeblur.errors import RsdeblurWarning
from rsdeblur.io import open_gyro, read_acceleration
from rsdeblur.io.samples import GyroFile
from tests.installed import needs

Write = Callable[..., Path]
# A device that turns about x at 0.5 rad/s and shakes; gravity turns the other way in its axes.
STEPS = np.arange(300)
RATES = np.stack([0.5 + 0 * STEPS, 0.2 * np.sin(STEPS / 9), 0.1 * np.cos(STEPS / 7)], axis=-1).round(6)
ANGLES = 0.5 * 0.005 * STEPS
FORCES = 9.81 * np.stack([0 * ANGLES, np.cos(ANGLES), -np.sin(ANGLES)], axis=-1)
UNIX_MS, UPTIME_NS = 1_697_590_715_534, 86_400 * 10**9


def table(pattern: str, first: float = 0, step: float = 5, rates: Any = RATES, forces: Any = FORCES) -> str:
    """Return a line for each sample; `pattern` has t, r (a second clock), x, y, z, a, b, c and i."""
    lines = []
    for i, (rate, force) in enumerate(zip(np.asarray(rates).tolist(), np.asarray(forces).tolist(), strict=True)):
        cells = dict(zip("xyzabc", [*rate, *force], strict=True))
        t = first + step * i
        lines.append(pattern.format(t=t, r=t + 3 + (7 * i) % 4, i=i, **cells) + "\n")
    return "".join(lines)


DEGREES = np.degrees(RATES)
AXES = "t,gx,gy,gz\n"
SIX = "t,gx,gy,gz,ax,ay,az\n"
ROW, SIX_ROW = "{t},{x},{y},{z}", "{t},{x},{y},{z},{a},{b},{c}"
# What is read at once: content, unit of time, unit of rates, rate in Hz, first timestamp in ns.
READ: dict[str, tuple[str, str, str, float, int]] = {
    "unix ms, 5 Hz": (AXES + table(ROW, UNIX_MS, 200), "ms", "rad/s", 5, UNIX_MS * 10**6),
    "unix us": (AXES + table(ROW, 10**3 * UNIX_MS, 10_000), "us", "rad/s", 100, UNIX_MS * 10**6),
    "unix ns, 2 Hz": (AXES + table(ROW, 10**6 * UNIX_MS, 5 * 10**8), "ns", "rad/s", 2, UNIX_MS * 10**6),
    "unix s beside dates": (
        "date,t,gx,gy,gz\n" + table("2023-10-18 00:00:00,{t:.3f},{x},{y},{z}", UNIX_MS / 1e3, 0.02),
        *("s", "rad/s", 50, UNIX_MS * 10**6),
    ),
    "dates called time, before the numbers": (
        "timestamp,timeIntervalSince1970,GyroX,GyroY,GyroZ\n"
        + table("18.10.2023,{t:.3f},{x},{y},{z}", UNIX_MS / 1e3, 0.02),
        *("s", "rad/s", 50, UNIX_MS * 10**6),
    ),
    "uptime in ns, 400 Hz": (table(ROW, UPTIME_NS, 2_500_000), "ns", "rad/s", 400, UPTIME_NS),
    "5 kHz": (AXES + table(ROW, 10**6 * UNIX_MS, 200_000), "ns", "rad/s", 5000, UNIX_MS * 10**6),
    "z, y, x, t": ("gyro_z,gyro_y,gyro_x,time_ms\n" + table("{z},{y},{x},{t}"), "ms", "rad/s", 200, 0),
    "counted axes": ("timestamp,gyro_rad[0],gyro_rad[1],gyro_rad[2]\n" + table(ROW, 0, 5000), "us", "rad/s", 200, 0),
    "decimal commas": (
        "t;gx;gy;gz\n" + table("{t:.3f};{x};{y};{z}", 0, 0.01).replace(".", ","), "s", "rad/s", 100, 0,
    ),
    "settings above tabs": ("app 3\nrate\t200\nt\tgx\tgy\tgz\n" + table("{t}\t{x}\t{y}\t{z}"), "ms", "rad/s", 200, 0),
    "two clocks of ROS": (
        "%time,field.header.stamp,field.angular_velocity.x,field.angular_velocity.y,field.angular_velocity.z\n"
        + table("{r}000000,{t}000000,{x},{y},{z}", UNIX_MS),
        *("ns", "rad/s", 200, UNIX_MS * 10**6),
    ),
    "degrees in the header": (
        "ms,Gyro_X_deg_per_s,Gyro_Y_deg_per_s,Gyro_Z_deg_per_s\n".replace("ms", "t_ms") + table(ROW, rates=DEGREES),
        *("ms", "deg/s", 200, 0),
    ),
    "degrees that gravity shows, at rest": (
        SIX + table(SIX_ROW, rates=DEGREES / 10, forces=np.tile([0, 0, 1.0], (300, 1))), "ms", "deg/s", 200, 0,
    ),
    "degrees that gravity shows, turning": (SIX + table(SIX_ROW, rates=DEGREES), "ms", "deg/s", 200, 0),
    "radians that gravity shows": (SIX + table(SIX_ROW), "ms", "rad/s", 200, 0),
    "degrees that gravity shows, without a header": (table(SIX_ROW, rates=DEGREES), "ms", "deg/s", 200, 0),
}  # fmt: skip
# What is refused: content, words of the message, the options that read it, unit of time, unit of rates, rate in Hz.
REFUSED: dict[str, tuple[str, str, dict[str, str], str, str, float]] = {
    "2.5 kHz in us for a moment": (
        AXES + table(ROW, 0, 400, RATES), "ms .2.5 Hz. or us .2.5e.03 Hz.",
        {"columns": "t=1:us,gx=2,gy=3,gz=4"}, "us", "rad/s", 2500,
    ),
    "degrees without a unit": (
        AXES + table(ROW, rates=DEGREES), "--unit deg/s", {"unit": "deg/s"}, "ms", "deg/s", 200,
    ),
    "tags in ms, degrees": (
        table("gyroscope,{t},{x},{y},{z}", 411_480, rates=DEGREES), "--unit deg/s", {"unit": "deg/s"},
        "ms", "deg/s", 200,
    ),
    "us called ns": (
        "t_ns,gx,gy,gz\n" + table(ROW, 0, 5000), "--columns t=1:us,gx=2,gy=3,gz=4",
        {"columns": "t=1:us,gx=2,gy=3,gz=4"}, "us", "rad/s", 200,
    ),
    "unknown names": (
        "n,clock (us),rot_roll,rot_pitch,rot_yaw,batt\n" + table("{i},{t},{x},{y},{z},7", 0, 5000),
        *("--columns t=2,gx=3,gy=4,gz=5$", {"columns": "t=2,gx=3,gy=4,gz=5"}, "us", "rad/s", 200),
    ),
    "raw gyro beside filtered": (
        "loop, time (us), axisRate[0], axisRate[1], axisRate[2], gyroADC[0], gyroADC[1], gyroADC[2]\n"
        + table("{i}, {t}, 0, 0, {i}, {x}, {y}, {z}", 0, 5000, DEGREES),
        "--columns t=2,gx=6,gy=7,gz=8$",
        {"columns": "t=time (us),gx=gyroADC[0]:deg/s,gy=gyroADC[1],gz=8"}, "us", "deg/s", 200,
    ),
    "units below the header": (
        "When,Rx,Ry,Rz\n[ms],[deg/s],[deg/s],[deg/s]\n" + table(ROW, rates=DEGREES), "--columns t=",
        {"columns": "t=When,gx=rx,gy=ry,gz=rz"}, "ms", "deg/s", 200,
    ),
    "five numbers": (
        table("{t},{i},{x},{y},{z}"), "--columns t=1,gx=", {"columns": "t=1,gx=3,gy=4,gz=5"}, "ms", "rad/s", 200,
    ),
}  # fmt: skip


def opened(path: Path, **options: Any) -> GyroFile:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RsdeblurWarning)
        return open_gyro(path, **options)


def assert_is(file: GyroFile, time: str, unit: str, hz: float) -> None:
    assert (file.time_unit, file.rate_unit) == (time, unit)
    # timestamps in the files have whole units or three decimals
    assert file.log.rate == pytest.approx(hz, rel=1e-6)
    turn = file.log.omega[:, 0].max()
    np.testing.assert_allclose(file.log.omega / turn, RATES / 0.5, atol=1e-9)


@pytest.mark.parametrize("name", READ)
def test_units_by_evidence(write: Write, name: str) -> None:
    content, time, unit, hz, epoch = READ[name]
    file = opened(write(content))
    assert_is(file, time, unit, hz)
    assert file.log.epoch_ns == epoch


@pytest.mark.parametrize("name", REFUSED)
def test_refusals_print_the_option_that_helps(write: Write, name: str) -> None:
    content, words, options, time, unit, hz = REFUSED[name]
    path = write(content)
    with pytest.raises(FileFormatError, match=words):
        opened(path)
    assert_is(opened(path, **options), time, unit, hz)


def test_a_pause_and_a_saturated_gyro_are_reported(write: Write, tmp_path: Path) -> None:
    cut = np.clip(np.where(np.abs(RATES) > 0, 20 * np.sin(STEPS / 9)[:, None], 0), -17.4533, 17.4533)
    head = "t[ms],gx[rad/s],gy[rad/s],gz[rad/s]\n"
    with pytest.warns(RsdeblurWarning, match="saturated"):
        read_gyro(write(head + table(ROW, rates=cut)))
    events = "event;experiment time;system time\nSTART;0;100\nPAUSE;0.75;101\nSTART;0.75;113.5\n"
    with zipfile.ZipFile(tmp_path / "export.zip", "w") as archive:
        archive.writestr(
            "Gyroscope.csv", "Time (s);X (rad/s);Y (rad/s);Z (rad/s)\n" + table("{t:.3f};{x};{y};{z}", 0, 0.01)
        )
        archive.writestr("meta/time.csv", events)
    with pytest.warns(RsdeblurWarning, match=r"paused at 0\.75 s for 12\.500 s"):
        log = read_gyro(tmp_path / "export.zip")
    # One interval of 10 ms and the pause.
    np.testing.assert_allclose(log.gaps(), [[0.74, 13.25]], atol=1e-9)


def test_the_user_names_the_columns_of_an_accelerometer_too(write: Write) -> None:
    path = write("clock,u,v,w,a,b,c\n" + table(SIX_ROW, rates=DEGREES))
    columns = "t=clock:ms,gx=u,gy=v,gz=w,ax=a,ay=b,az=c"
    np.testing.assert_allclose(read_acceleration(path, columns=columns).force, FORCES, atol=1e-12)
    with pytest.warns(RsdeblurWarning, match="taken as deg/s"):
        np.testing.assert_allclose(read_gyro(path, columns=columns).omega, RATES, atol=1e-12)
    with pytest.raises(InputError, match="lacks ax"):
        read_acceleration(path, columns="t=clock:ms,gx=u,gy=v,gz=w")


def test_columns_without_timestamps_need_the_sampling_rate(write: Write) -> None:
    path = write("a,u,v,w\n" + table("{i},{x},{y},{z}"))
    np.testing.assert_allclose(read_gyro(path, columns="gx=2,gy=3,gz=4", rate=200.0).omega, RATES)


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        *((text, "is not like") for text in ("", "t", "t=", "t=1,foo=2", "t=1,gx=2,gy=3,gz=4,x=3")),
        ("t=1,gx=2,gy=3", "lacks gz"),
        *(("t=1:deg/s,gx=2,gy=3,gz=4", "deg/s of t"), ("t=1,exposure=2", "lacks t, gx|lacks gx")),
    ],
)  # fmt: skip
def test_wrong_choices(write: Write, columns: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_gyro(write(AXES + table(ROW)), columns=columns)


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ("t=zeit,gx=2,gy=3,gz=4", "line|'zeit'; the columns are 1 t, 2 gx, 3 gy, 4 gz"),
        ("t=1,gx=2,gy=3,gz=9", "no line has numbers in all columns of .*; the columns are 1 t, 2 gx"),
        ("t=0,gx=2,gy=3,gz=4", "no line has numbers"),
    ],
)
def test_columns_that_a_table_lacks(write: Write, columns: str, words: str) -> None:
    with pytest.raises(FileFormatError, match=rf"log\.csv.*({words})"):
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
    """Without the package, or where decoders of strangers' files are forbidden, it is an unknown log."""
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
    monkeypatch.setenv("RSDEBLUR_BLOCK_UNTRUSTED", "1")
    with pytest.raises(FileFormatError, match="unknown gyro log"):
        opened(path)
