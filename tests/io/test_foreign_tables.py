"""Gyro logs as other apps and spreadsheets write them, and files that only look like logs."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from rsdeblur.errors import FileFormatError
from rsdeblur.io import detect_gyro_format, read_gyro
from tests.io.test_gyro_logs import RATES, Write


def spelled(header: str, separator: str = ",", row: str = "{t} {x} {y} {z}", comma: bool = False) -> str:
    """Return the reference rates at 100 Hz; spaces in `header` and `row` become the separator."""
    rows = [row.format(t=f"{0.01 * i:.2f}", x=x, y=y, z=z) for i, (x, y, z) in enumerate(RATES)]
    rows = [line.replace(".", ",") if comma else line for line in rows]
    return header + "".join(line.replace(" ", separator).replace("_", " ") + "\n" for line in rows)


@pytest.mark.parametrize(
    "text",
    [
        spelled("sep=;\nt;gx;gy;gz;date\n", ";", "{t} {x} {y} {z} 2024-01-01_10:00:00:123", comma=True),
        spelled("t\tdate\tgx\tgy\tgz\tmx\n", "\t", "{t} 2024-01-01_10:00:00 {x} {y} {z} 1"),
        spelled("t\tnote\tgx\tgy\tgz\tmx\tmy\n", "\t", "{t}  {x} {y} {z} 1 2"),
        spelled("t\t\tgx\t\tgy\t\tgz\n", "\t\t"),
        spelled("t,gx,gy,gz\n").replace("\n", "\r\r\n"),
        spelled("t,gx,gy,gz\n").replace("\n", "\r"),
        spelled("GYROSCOPE X (rad/s);Gyroscope Y;Gyroscope Z;Time since start in s \n", ";", "{x} {y} {z} {t}"),
        spelled("t_sec,gx_rad/s,gy_rad/s,gz_rad/s\n"),
        spelled("Unix time (s),gx (rad·s⁻¹),gy (rad s⁻¹),gz (rad s⁻¹)\n"),
        spelled("elapsed (s),x-axis (rad/s),y-axis (rad/s),z-axis (rad/s)\n"),
    ],
)
def test_tables_of_other_apps_and_spreadsheets(write: Write, text: str) -> None:
    log = read_gyro(write(text))
    np.testing.assert_allclose(log.t, 0.01 * np.arange(len(RATES)), atol=1e-9)
    np.testing.assert_array_equal(log.omega, RATES)


@pytest.mark.parametrize("header", ["", "timestamp,wx,wy,wz\n"])
def test_dates_may_be_the_timestamps(write: Write, header: str) -> None:
    rows = [f"2024-05-01T23:59:{59.9 + 0.005 * i:.3f}Z,{x},{y},{z}\n" for i, (x, y, z) in enumerate(RATES)]
    log = read_gyro(write(header + "".join(rows)))
    np.testing.assert_allclose(log.t, 0.005 * np.arange(len(RATES)), atol=1e-9)
    assert log.epoch_ns == 1_714_607_999_900_000_000


@pytest.mark.parametrize("names", ["Time Gyroscope", "Zeit Gyroskop", "Tiempo Giroscopio"])
def test_phyphox_names_columns_in_the_language_of_its_user(write: Write, names: str) -> None:
    time, gyro = names.split()
    header = ",".join([f'"{time} (s)"', *(f'"{gyro} {axis} (rad/s)"' for axis in "xyz")])
    assert detect_gyro_format(write(spelled(header + "\n"))) == "phyphox"


def test_samples_of_several_sensors_are_no_rates(write: Write) -> None:
    rows = "".join(f"{i},gyro,0.1,0,{i % 3}\n{i + 5},accelerometer,0,9.8,{i % 4}\n" for i in range(0, 400, 10))
    with pytest.raises(FileFormatError, match=r"line 2: column 2 names several sensors \(accelerometer, gyro\)"):
        read_gyro(write("timestamp,sensor,x,y,z\n" + rows))


def test_quoted_decimal_commas_between_commas_are_refused(write: Write) -> None:
    with pytest.raises(FileFormatError, match=r"line 2: .* must be numbers with decimal points"):
        read_gyro(write(spelled("t,gx,gy,gz\n", '","', '"{t} {x} {y} {z}"', comma=True)))


@pytest.mark.parametrize(
    ("name", "content", "advice"),
    [
        ("gyro.csv.gz", b"\x1f\x8b\x08\0" * 9, r"compressed \(gzip\); unpack it"),
        ("gyro.mat", b"MATLAB 5.0 MAT-file".ljust(200, b"\0"), "save the table as CSV"),
        ("gyro.xls", b"\xd0\xcf\x11\xe0".ljust(600, b"\0"), "a spreadsheet; save it as CSV"),
    ],
)
def test_what_is_no_text_is_named(tmp_path: Path, name: str, content: bytes, advice: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FileFormatError, match=advice):
        read_gyro(tmp_path / name)


def test_a_spreadsheet_is_no_archive_of_logs(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "gyro.xlsx", "w") as archive:
        archive.writestr("[Content_Types].xml", "<Types/>")
    with pytest.raises(FileFormatError, match="a spreadsheet; save it as CSV"):
        read_gyro(tmp_path / "gyro.xlsx")


@pytest.mark.parametrize(("mark", "quote"), [(";", ""), (",", '"')])
def test_gcsv_saved_by_a_spreadsheet(write: Write, mark: str, quote: str) -> None:
    """Its scales count: without them, integer rates would be thousands of times too fast."""
    head = [
        ["GYROFLOW IMU LOG"],
        ["orientation", "YxZ"],
        ["tscale", "0.001"],
        ["gscale", "0.5"],
        ["t", "gx", "gy", "gz"],
    ]
    lines = ["# note"]
    lines += [mark.join(f"{quote}{cell}{quote}" for cell in row) + mark * (4 - len(row)) for row in head]
    lines += [f"{10 * i}{mark}2{mark}4{mark}6" for i in range(4)]
    text = "\n".join(lines)
    log = read_gyro(write(text.replace(".", ",") if mark == ";" else text))
    np.testing.assert_array_equal(log.omega[0], [2, -1, 3])
