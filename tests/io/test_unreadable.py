"""What no reader can read: a table of contents for each kind of file, each refused by file, line and cause.

`test_hostile_input.py` damages files at random.
"""

import struct
import sys
import zlib
from collections.abc import Callable
from functools import cache, partial
from io import BytesIO
from typing import Any

import numpy as np
import pytest
import tifffile

import rsdeblur
from rsdeblur import Camera, FileFormatError, read_gyro, read_picture, read_trajectory
from rsdeblur.io import open_camera, read_acceleration, read_depths
from rsdeblur.io.captures import clock_facts
from rsdeblur.io.pictures import read_psfs
from rsdeblur.io.source import Source
from tests._util import files, gyroflow
from tests._util.files import ANDROID, FORCES, IOS, LAYOUTS, MARS, STEP, npy, rows, tiff
from tests.installed import needs

Content = str | bytes | Callable[[], str | bytes]
# A name, a content or what makes it, the line of the fault or 0 for the whole file, and words of the message.
Fault = tuple[Content, int, str]


def loggers(*names: str) -> bytes:
    """Return an archive of logs of Sensor Logger."""
    return files.zipped(dict.fromkeys(names, LAYOUTS["sensor logger"][0]))


def retagged(pixels: Any, tags: dict[str, Any], **options: Any) -> bytes:
    """Return a TIFF with numbers of its directory replaced."""
    buffer = BytesIO(tiff(pixels, **options))
    with tifffile.TiffFile(buffer, mode="r+b") as file:
        for name, value in tags.items():
            file.pages.first.tags[name].overwrite(value)
        return buffer.getvalue()


def png_of(width: int, height: int) -> bytes:
    """Return a PNG that claims a size and has no pixels."""
    header = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sIIBBBBB", 13, b"IHDR", width, height, 8, 2, 0, 0, 0)
    return header + struct.pack(">I", zlib.crc32(header[12:])) + b"\0\0\0\0IEND\xae\x42\x60\x82"


def toml(line: str) -> str:
    """Return a camera file in which one line replaces that of its key."""
    whole = {"width": "width = 640", "height": "height = 480", "focal_length": "focal_length = 500"}
    return "\n".join([line, *(text for name, text in whole.items() if name != line.split()[0])])


KALIBR = "cam0: {camera_model: pinhole, intrinsics: %s, resolution: [640, 480], distortion_model: none}\n"


def laughs(first: str, following: str, levels: int) -> str:
    """Return a file whose aliases stand for nine times as many values at each level."""
    lines = (f"a{i + 1}: &a{i + 1} {following.format(', '.join([f'*a{i}'] * 9))}\n" for i in range(levels))
    return f"a0: &a0 {first}\n" + "".join(lines) + KALIBR % "[1, 2, 3, 4]"


@cache
def zip_bomb() -> bytes:
    return files.zipped({"gyro.csv": bytes(70_000_000)})


def small_claim() -> bytes:
    """Return an archive whose member is larger than its directory claims."""
    return zip_bomb().replace(struct.pack("<I", 70_000_000), struct.pack("<I", 100))


def shared_strips() -> bytes:
    """Return a TIFF whose strips are all in the same place."""
    pixels = np.zeros((64, 64), np.uint8)
    data = retagged(pixels, {"StripByteCounts": [512] * 8}, rowsperstrip=8)
    with tifffile.TiffFile(BytesIO(data)) as file:
        first = file.pages.first.tags["StripOffsets"].value[0]
    return retagged(pixels, {"StripByteCounts": [512] * 8, "StripOffsets": [first] * 8}, rowsperstrip=8)[:-3000]


PROJECT = {"raw_imu": [[0.005 * i, 1, 2, 3, 0, 0, 0] for i in range(20)]}

GOOD = "0.00,1,2,3\n0.01,1,2,3\n"
GCSV = "GYROFLOW IMU LOG\n"
SENSORS = "timestamp,sensor,x,y,z\n" + "".join(
    f"{i},gyro,0.1,0,{i % 3}\n{i + 5},accelerometer,0,9.8,{i % 4}\n" for i in range(0, 400, 10)
)
GYRO: list[Fault] = [
    (GOOD + "0.02,1,2\n0.03,1,2,3\n", 3, "too few columns: 3 found, at least 4"),
    (GOOD + "\n# note\n0.02,1,x,3\n", 5, "'x' in column 3 is not a number"),
    (GOOD + "0.02,1,,3\n", 3, "'' in column 3 is not a number"),
    ("0.00,1,2,-inf\n" + GOOD, 1, "'-inf' in column 4 is not finite"),
    (GOOD + "0.01,4,5,6\n0.02,1,2,3\n", 3, "duplicate timestamp 10000000 ns"),
    (GOOD + "0.02,1,2,3\n-0.5,1,2,3\n", 4, "-500000000 ns comes after 20000000 ns"),
    (GOOD + "0.0200000000001,1,2,3\n0.0200000000002,1,2,4\n", 4, "duplicate timestamp 20000000"),
    (GOOD + "0.02,1,2", 3, "too few columns: 3 found, at least 4"),
    (GOOD + "0.02,1,2,1e-", 3, "'1e-' in column 4"),
    (f"0,1,2,3\n{2**63},1,2,3\n{2**64},1,2,3", 2, "int64"),
    ("# one\n0.0,1,2,3\n", 2, "at least 2 samples"),
    ("0.00,1,2,3\n0.01,1,2,1e200\n0.02,1,2,3\n", 2, "impossible rates"),
    ("a,b\n1,2\n", 1, "unknown gyro log format"),
    ("0,1,2,3,4\n1,1,2,3,4\n", 1, "columns are 1 0, 2 1, .*--columns t="),
    ("t,wx[rpm],wy[rpm],wz[rpm]\n" + GOOD, 1, "unknown gyro log format"),
    ("time_ms,rot_x,rot_y,rot_z\n0,1,2,3\n5,1,2,3\n", 1, "--columns t=1,gx=2,gy=3,gz=4"),
    *((f"t[{unit}],gx,gy,gz\n0,1,2,3\n5,1,2,3\n10,1,2,3\n", 0, words) for unit, words in (
        ("us", "200 kHz|2e\\+05 Hz"), ("ns", "--columns t=1:us"))),
    ("4 0 1 2 3\n4 5 1 2 3\nx 9 1 2 3\n", 3, "'x' is not a sensor type"),
    ("4 0 1 2 3\n1 5 1 2 3\n4 9 1 2\n1 5 1 2 3\n", 3, "too few columns: 4 found, at least 5"),
    (GCSV + "gscale,-1\nt,gx,gy,gz\n0,1,2,3\n", 2, "gscale must be a number from"),
    (GCSV + "tscale,1e-9999\nt,gx,gy,gz\n0,1,2,3\n", 2, "tscale must be a number from"),
    (GCSV + "tscale,0.001\nt,gx,gy,gz\n0,1,2,3\n1,1,,3\n", 5, "'' in column 3"),
    (GCSV + "tscale,0.001\n", 0, "no line `t,gx,gy,gz`"),
    ("".join(f"{i / 100} 0.1 -9.75 0.{i % 10}\n" for i in range(30)), 0, "accelerometer at rest"),
    (SENSORS, 2, "column 2 names several sensors"),
    ("t,wx,wy,wz\n" + rows("{x},{y},{z},{t}"), 2, "column 1 .* does not rise, unlike column 4;"),
    ("".join(f"{i % 3},{i},{i * 0.01},0\n" for i in range(20)), 1, "unlike column 2;"),
    ("t,gx[deg/s],gy[rad/s],gz\n" + GOOD, 0, "deg/s and rad/s"),
    (f"t,gx,gy,gz\n{rows('{t},0,15,0,20,0,25')}", 2, "7 cells, .* 4 columns; .*decimal commas"),
    ("t,gx,gy,gz\n" + rows('"0,1","0,2","0,3","0,4"'), 2, "decimal points"),
    ("".join(f"{i * STEP} 0 0 {i}\n" for i in range(9000)) + f"{STEP}0000 0 0 0,1\n", 9001, "0,1|few"),
    ("", 0, "empty"),
    ("# t wx wy wz\n", 0, "empty but for comments"),
    ("t,wx,wy,wz\n\0\1\2", 0, "binary"),
    ("\x1f\x8b\x08\0" * 9, 0, "binary"),
    ("MATLAB 5.0 MAT-file".ljust(200, "\0"), 0, "binary.*export it as CSV"),
    (MARS, 0, "no samples"),
    ("1 0 1 2 3\n2 5 1 2 3\n", 0, "no line is of type 4"),
    ("0,1,2,3\n100000,1,2,3\n", 0, "unit of time"),
    *((f"0.5,1,2,3\n1.5,1,2,3\n{t},1,2,3\n3.5,1,2,3\n", 3, "column 1 is not a number") for t in (
        "-.", "1_0.5", "1.-5", "5 5.5", "0x10", "1d5")),
    *((f"{GOOD}{cell},1,2,3\n", 3, f"'{cell}' in column 1 is not finite") for cell in ("nan", "-inf", "1e400")),
    *((f't,gx,gy,gz,note\n{first},1,2,3,a\n1,2,3,4,"a\n2,3,4,5,a\n3,4,5,6,a\n', 3, "quote") for first in ("0", "0.5")),
    # Patterns that backtrack would take hours.
    *((f"t,gx,gy,gz\n0,{mark * 100_000}x,2,3\n" + f"{mark * 100_000}x\n" * 3, 0, "") for mark in (
        "[", "(", " ", "1", "[]", "a,", "1e", "\t")),
]  # fmt: skip
ARCHIVES: list[Fault] = [
    (lambda: loggers("Accelerometer.csv"), 0, r"/Accelerometer\.csv: .*another sensor"),
    (lambda: loggers("picture.png"), 0, "no gyro log"),
    (lambda: loggers("[Content_Types].xml"), 0, "spreadsheet"),
    (lambda: loggers("tuesday/Gyroscope.csv", "monday/Gyroscope.csv"), 0, "monday.* and tuesday"),
    (lambda: loggers("b.csv", "Accelerometer.csv", "a.csv"), 0, "a.csv and b.csv"),
    (zip_bomb, 0, "claims to contain 70000000 bytes"),
    (small_claim, 0, ""),
]  # fmt: skip
PROJECTS: list[Fault] = [
    *((gyroflow.project(raw), 0, words) for raw, words in (
        ({}, "without gyro data.*video.mp4"), ({"raw_imu": "é"}, "damaged"),
        ({"raw_imu": gyroflow.base91(b"x\x9c" + bytes(9))}, "damaged"),
        ({"raw_imu": [{"timestamp_ms": 0.0, "gyro": [1.0, 2.0]}]}, "damaged"),
        ({"raw_imu": [[0.0, 1.0, 2.0, float("nan")], [1.0, 2.0, 3.0, 4.0]]}, "sample 0: impossible rates"),
        ({"raw_imu": [[float("nan"), 1.0, 2.0, 3.0]]}, "sample 0: timestamp nan"),
        *(({"raw_imu": [{"timestamp_ms": t, "gyro": [1, 2, 3]} for t in (0, end)]}, "sample 1: timestamp") for end in (
            1e300, 9.3e12, -9.3e12)))),
    (gyroflow.project(PROJECT)[:-2], 0, "not JSON, or cut off|damaged"),
    *(('{"raw_imu": ' + nest * 100_000, 0, "") for nest in ("[", '{"a":')),
    (lambda: gyroflow.packed_project(bytes(70_000_000), "raw_imu"), 0, "unpack"),
]  # fmt: skip
VIDEOS: list[Fault] = [
    *((b"".join([struct.pack(">I4s", 16, b"ftyp") + bytes(8), *[struct.pack(">I4s", size, b"moov")] * 2000]), 0, "")
      for size in (0, 2, 7, 8, 2**32 - 1)),
]  # fmt: skip
EXPORTS: list[Fault] = [
    (files.sensorlogger_json()[:-9], 0, "not JSON, or cut off"),
    (files.sensorlogger_json().replace(b'"y"', b'"v"'), 0, "lacks a number"),
]
ACCELERATIONS: list[Fault] = [
    *((MARS + rows("{t},1,2,3,{x},{y},{z}", FORCES * factor), 0, words) for factor, words in (
        (1 / 9.80665, "read as m/s.*give their unit"), (0.02, "log with gravity"))),
    *((text, 0, "") for text in ("t,wx,wy,wz\n" + rows("{t},1,2,3"), rows("4 {t} 1 2 3"), rows("{t},1,2,3"))),
]  # fmt: skip
CAPTURES: list[Fault] = [
    ("1000.5 20\n1033.8 20\n", 1, "33.3 apart .* give the unit of time: --columns t=1:ms,exposure=2"),
    ("5 100\n5 200\n", 2, "timestamp 5 occurs twice"),
    ("1\n9\n5\n7\n", 3, "timestamp 5 comes after 9"),
    (f"{ANDROID}\nnull,1,1,1,5000000,1,1\n", 3, "'null' in column 1 is not a number"),
    (f"{IOS}\n1,1,1,1,1,5000000\n2,1,1,1,1,0\n", 4, "impossible exposure time of 0 ns"),
    ("1000000 0.05\n2000000 0.05\n", 1, "exposure time of 0.05 ns"),
    ("1000000 100\n2000000", 2, "too few columns"),
    ("a b c\n", 1, "known formats: .*named .*deepgyro"),
    *((f"{text}0{name}\n33{name}\n66{name}\n", 0, "33 apart .* --columns t=1:ms") for text, name in (
        ("", ""), ("timestamp\n", ""), ("", ",a.png"), ("", " 20"),
    )),
    ("", 0, "empty"),
    (b"\x89PGN\0", 0, "binary"),
    (ANDROID, 0, "no samples"),
]  # fmt: skip
CLOCKS: list[Fault] = [
    (f"# SENSOR_INFO_TIMESTAMP_SOURCE is UNKNOWN\n7 3 4\n{line}\n", 0, words)
    for line, words in (("1 2", "both clocks"), ("9000000 0 9000000", "drift apart"))
]
TRAJECTORIES: list[Fault] = [
    ("0.5 1 2 3 4\n1 1 2 3 4\n", 1, "unknown trajectory format"),
    ("0 1 2 3 0 0 0 0\n1 1 2 3 0 0 0 1\n", 0, "quaternion 0 has the norm 0"),
    ("0 1 2 3 0 0 0 1\n1 1 x 3 0 0 0 1\n2 1 2 3 0 0 0 1\n", 2, "'x' in column 3"),
    ("0 1 2 3\n1 1 2 3\n1 1 2 4\n2 1 2 3\n", 3, "duplicate timestamp"),
    *(("0 1 2 3\n", 0, "at least 2"), ("", 0, "empty"), ("timestamp tx ty tz qx qy qz qw\n", 0, "no samples")),
]
PROFILES: list[Fault] = [
    *((files.lens(**changes), 0, words) for changes, words in (
        ({"calib_dimension": {"w": 0, "h": 0}}, "no calibration"),
        ({"fisheye_params": {"camera_matrix": [[1, 2], [3, 4]]}}, "no calibration"),
        ({"distortion_model": "poly3"}, "poly3"), ({"digital_lens": "gopro_superview"}, "gopro_superview"),
        ({"input_horizontal_stretch": 1.33}, "stretches"), ({"crop": "half"}, "damaged"),
        *(({"crop": crop}, "crop is") for crop in (5e-324, 1e300, float("inf"))))),
    (gyroflow.project({}, calibration_data={}), 0, "contains no calibration"),
    *(('{"raw_imu": ' + nest * 100_000, 0, "") for nest in ("[", '{"a":')),
    ("a: 1" + "\n" * 100_000, 0, ""),
]  # fmt: skip
CHAINS: list[Fault] = [
    *((files.CHAIN.replace(*change), 0, words) for change, words in (
        (("pinhole", "omni"), "'omni'"), (("radtan", "fov"), "'fov'"), (("[400, 300]", "[400]"), "cam0: damaged"),
        (("intrinsics", "intrinsic"), "cam0: damaged"), (("[210.0", "[-210.0"), "cam0: focal_length"),
        (("[-1.0, 0.0, 0.0, 0.2]", "[1.0, 0.0, 0.0, 0.2]"), "determinant -1"), (("cam0:", "cam0: ["), "not YAML"))),
    # Billion laughs: lists and merged mappings.
    *((laughs(*given), 0, "aliases") for given in (
        ("[1, 2, 3, 4]", "[{}]", 60), ("{k: 1}", "{{<<: [{}]}}", 12))),
    *(("cam0: " + text, 0, "") for text in ("[" * 600, "{a: " * 600, "- " * 600, "a: 1\n" * 50_000)),
]  # fmt: skip
TOML: list[Fault] = [
    *((toml(line), 0, "") for line in (
        "width = " + "9" * 5000, "focal_length = 1e300", "principal_point = [1e308, -1e308]",
        "readout_time = " + "[" * 5000, "imu_to_camera = [[1e200, 0, 0], [0, 1e200, 0], [0, 0, 1e200]]",
        'distortion_model = "fisheye"\ndistortion = [1e308, 1e308, 1e308, 1e308]')),
    ("width = 6\nheight = 4\nfocal_length = 8\nread_out = 0.1", 0, "'read_out'; did you mean 'readout_"),
    ("width = 6\nreadout_time = 0.1", 0, "lacks height, focal"),
    *((b"width = 6\xff", 0, "utf-8"), ("width = 6\nheight 4", 0, "TOML .*line 2")),
    *((toml(line), 0, words) for line, words in (
        ("focal_length = 'long'", "focal_length must be"), ("readout_direction = 1", "readout_direction must be"),
        # TOML allows integers of any length.
        (f"time_offset = 1{'0' * 400}", "time_offset must be a number"))),
]  # fmt: skip
PHOTOS: list[Fault] = [
    *((partial(files.photo, (100, 68), **tags), 0, f"{words}.*rsdeblur camera new") for tags, words in (
        ({}, "no focal length in px"), ({"f35": 0, "focal_length": 4.2}, "only 4.2 mm"),
    )),
]  # fmt: skip
DEPTHS: list[Fault] = [
    (npy(np.ones((2, 3, 3))), 0, r"shape \(R, C\), found \(2, 3, 3\)"),
    (npy([[-60.0, 1.0]]), 0, "must be positive, found -60 m"),
    (npy(np.zeros((2, 3))), 0, "must be positive, found none"),
    (npy(np.ones((2, 3), complex)), 0, "found complex128"),
    (b"\x93NUMPY\x01\x00nonsense", 0, "not an array of depth maps"),
]
PSFS: list[Fault] = [
    (npy(np.zeros((3, 3))), 0, "the sum of a PSF must be positive"),
    *((npy(np.where(np.eye(9), nan, 0.5).astype(nan.dtype)), 0, "must be finite") for nan in (
        np.array(bits, f"u{size}").view(f"f{size}")[()] for size, bits in (
            (2, 0x7C01), (4, 0x7F800001), (8, 0x7FF0000000000001)))),
    (npy(np.ones(3)), 0, "a PSF has shape"),
    *((content, 0, "array of") for content in (npy([["a"]]), b"\x93NUMPY")),
    *((b"PK", 0, "not a PSF bank"), (b"hello", 0, "not a JPEG, PNG")),
]  # fmt: skip
COLOUR = np.random.default_rng(1).integers(0, 256, (64, 64, 3), np.uint8)
SMALL = npy(np.zeros((2, 2), np.uint8))
PICTURES: list[Fault] = [
    (b"", 0, "empty"),
    (b"a,b\n0,1\n", 0, "not a JPEG, PNG, TIFF, WebP, NumPy, HEIC or raw picture"),
    (files.encoded("GIF", COLOUR), 0, "not a JPEG"),
    (files.encoded("JPEG", COLOUR)[:2000], 0, "truncated"),
    (files.encoded("PNG", COLOUR)[:6000], 0, "truncated"),
    (files.encoded("PNG", COLOUR)[:20], 0, "truncated"),
    (files.encoded("WEBP", COLOUR)[:1000], 0, "truncated"),
    (files.encoded("TIFF", COLOUR)[:6000], 0, "truncated|take more bytes"),
    (tiff(COLOUR, photometric="rgb", compression="zlib")[:6000], 0, "truncated"),
    (b"II*\0\x08\0\0\0", 0, "truncated"),
    (tiff(np.zeros((4, 4), np.int32)), 0, "1 samples of 32 bits"),
    (tiff(np.zeros((3, 4), np.int16), photometric="minisblack"), 0, "without sign"),
    (tiff(np.zeros((6, 7, 5), np.uint8), photometric="rgb", planarconfig="contig"), 0, "5 samples"),
    (tiff(np.zeros((6, 16, 16), np.uint8), photometric="minisblack", volumetric=True, tile=(1, 16, 16)), 0, "1 samp"),
    (tiff(np.zeros((3, 4, 4), np.uint8), photometric="rgb", extrasamples=["assocalpha"]), 0, "plain alpha"),
    (npy(np.zeros((2, 2, 5), np.uint8)), 0, "shape"),
    (npy(np.zeros((0, 2), np.uint8)), 0, "shape"),
    (npy(np.zeros((2, 2))), 0, "float64"),
    (SMALL.replace(b"'|u1'", b"'|O' "), 0, "damaged"),
    (npy(np.zeros((20, 20), np.uint8))[:-1], 0, "damaged"),
    (SMALL.replace(b"(2, 2), }      ", b"(99999, 99999)}"), 0, "damaged|memory"),
    (SMALL[:20], 0, "truncated"),
    (lambda: retagged(COLOUR, {"ImageWidth": 0}, photometric="rgb"), 0, "no pixels|damaged"),
    (lambda: retagged(COLOUR, {"SamplesPerPixel": 1}, photometric="rgb"), 0, "not supp|damaged"),
    (lambda: png_of(20_000, 20_000), 0, "exceeds limit|20000"),
    (lambda: retagged(COLOUR[..., 0], {"ImageWidth": 20_000, "ImageLength": 20_000}), 0, "20000x20000 pixels"),
    (shared_strips, 0, "truncated or damaged"),
    (lambda: retagged(np.zeros((3, 2), np.uint16), {"ImageLength": 7_500_000}, rowsperstrip=1), 0, "than the file has"),
]  # fmt: skip
READERS: list[tuple[Callable[..., Any], str, list[Fault]]] = [
    *((read_gyro, name, faults) for name, faults in (
        ("log.csv", GYRO), ("export.zip", ARCHIVES), ("a.gyroflow", PROJECTS),
        ("video.mp4", VIDEOS))),
    (partial(read_gyro, format="sensorlogger-json"), "log.json", EXPORTS),
    (read_acceleration, "gyro_accel.csv", ACCELERATIONS),
    (partial(rsdeblur.read_captures, duration=0.01), "captures.csv", CAPTURES),
    (lambda path: clock_facts(Source(path, "file")), "clocks.txt", CLOCKS),
    (read_trajectory, "poses.txt", TRAJECTORIES),
    *((open_camera, name, faults) for name, faults in (
        ("lens.json", PROFILES), ("camera.yaml", CHAINS), ("a.jpg", PHOTOS))),
    (partial(open_camera, format="mars"), "movie.csv", [
        (files.CHAIN, 0, "MARS logger"), (files.CAPTURES["ios"].replace("1500.5", "1e-320"), 0, "focal")]),
    (Camera.load, "camera.toml", TOML),
    (read_depths, "depth.npy", DEPTHS),
    (partial(read_psfs, shape=(40, 60, 3)), "k.npy", PSFS),
    (read_picture, "picture", PICTURES),
]  # fmt: skip
CASES = [(read, name, *fault) for read, name, faults in READERS for fault in faults]


@pytest.mark.parametrize(
    ("read", "name", "content", "line", "words"), CASES, ids=[f"{case[1]}-{n}" for n, case in enumerate(CASES)]
)
def test_faults_name_the_file_and_the_line(write, read, name, content, line, words):
    if name.endswith((".yaml", ".mp4")):
        needs("kalibr" if name.endswith(".yaml") else "telemetry")
    path = write(content() if callable(content) else content, name)
    with pytest.raises(FileFormatError, match=rf"{name}{f', line {line}: ' if line else '.*'}.*({words})"):
        read(path)


MP4, HEIC = (b"\0\0\0\x18ftyp" + brand + bytes(99) for brand in (b"mp42", b"heic"))


@pytest.mark.parametrize(
    ("module", "extra", "read", "content"),
    [
        ("cbor2", "gyroflow", read_gyro, gyroflow.packed_project(b"\xa0" * 9, "file_metadata")),
        ("telemetry_parser", "telemetry", read_gyro, MP4),
        ("yaml", "kalibr", open_camera, files.CHAIN),
        ("pillow_heif", "heif", read_picture, HEIC),
        ("rawpy", "raw", read_picture, files.dng()),
    ],
)
def test_a_missing_package_is_named(write, monkeypatch, module, extra, read, content):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(FileFormatError, match=rf"'\.\[{extra}\]'"):
        read(write(content, "file"))
