"""Small valid files of every format that is read, and functions that pack compressed formats."""

import json
import struct
import zipfile
import zlib
from io import BytesIO
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray
from PIL import Image

# A timestamp in ns that float64 cannot represent, and the samples in all logs: t in ns; x, y, z in rad/s or m/s^2.
EPOCH, STEP = 1_766_385_749_427_863_801, 5_000_000
RATES = np.random.default_rng(0).normal(0.0, 0.5, (20, 3)).round(6)
FORCES = RATES + np.array([0.5, 9.7, 1.25])
TIMESTAMPS = EPOCH + STEP * np.arange(len(RATES))


def rows(pattern: str, values: NDArray[np.float64] = RATES) -> str:
    """Return a line for each sample; `pattern` has t (ns), s (seconds), m (ms from 0), d (date), x, y and z."""
    lines = []
    for i, (t, (x, y, z)) in enumerate(zip(TIMESTAMPS.tolist(), values.tolist(), strict=True)):
        seconds, rest = f"{t // 10**9}.{t % 10**9:09d}", t - 1_766_385_720 * 10**9
        date = f"2025-12-22T06:42:{rest // 10**9}.{rest % 10**9:09d}Z"
        lines.append(pattern.format(t=t, s=seconds, m=5 * i, d=date, x=x, y=y, z=z) + "\n")
    return "".join(lines)


EUROC = "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2]"
EUROC_FORCE = f"{EUROC},a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n"
KALIBR_IMU = "timestamp,omega_x,omega_y,omega_z,alpha_x,alpha_y,alpha_z\n"
MARS = "Timestamp[nanosec], gx[rad/s], gy[rad/s], gz[rad/s], ax[m/s^2], ay[m/s^2], az[m/s^2]\n"
PHYPHOX = '"Time (s)","Gyroscope x (rad/s)","Gyroscope y (rad/s)","Gyroscope z (rad/s)"\n'
ZEIT = '"Zeit (s)","Gyroskop x (rad/s)","Gyroskop y (rad/s)","Gyroskop z (rad/s)"\n'
ROS = "%time,field.header.seq,field.angular_velocity.x,field.angular_velocity.y,field.angular_velocity.z\n"
SENSORLOG = "loggingTime(txt),gyroTimestamp_sinceReboot(s),gyroRotationX(rad/s),gyroRotationY(rad/s),"
MOTION = "motionTimestamp_sinceReboot(s),motionYaw(rad),motionRotationRateX(rad/s),motionRotationRateY(rad/s),"
RENAMED = "time,seconds_elapsed,GYROSCOPE Z (rad/s),GYROSCOPE Y (rad/s),GYROSCOPE X (rad/s)\n"
SENSORLOGGER = "time,seconds_elapsed,z,y,x\n"

# Header, row and format of each layout of a table of rates, by their axes.
PHONE = {
    "phyphox": (PHYPHOX, "{s},{x},{y},{z}", "phyphox"),
    "phyphox in another language": (ZEIT, "{s},{x},{y},{z}", "phyphox"),
    "phyphox without the sensor": ("Time (s),X (rad/s),Y (rad/s),Z (rad/s)\n", "{s},{x},{y},{z}", "phyphox"),
    "spaces between tabs": (PHYPHOX.replace(",", "\t"), "{s}\t{x}\t{y}\t{z}", "phyphox"),
    "sensor logger": (SENSORLOGGER, "{t},-0.1,{z},{y},{x}", "sensorlogger"),
    "quoted cells": (SENSORLOGGER, '"{t}","0.1","{z}","{y}","{x}"', "sensorlogger"),
    "renamed": (RENAMED, "{t},0.1,{z},{y},{x}", "sensorlogger"),
    "opencamera": ("", "{x},{y},{z},{t}", "opencamera"),
    "tags": ("", "4 {t} {x} {y} {z}\n1 {t} 0 0 9.8", "deepgyro"),
    "tags of another separator": ("", "1,{t},0,0,9.8\n4,{t},{x},{y},{z}", "deepgyro"),
    "tags in words": ("", "gyro,{t},{x},{y},{z}", "deepgyro"),
    "uncalibrated": ("", "16 {t} {x} {y} {z}", "deepgyro"),
    "mars": (MARS, "{t}, {x}, {y}, {z}, 0.1, 9.8, 2.2", "mars"),
    "mars ios": (MARS.replace(" ", "")[:-1] + ",Unix time[nanosec]\n", "{t},{x},{y},{z},0,9.8,0,7", "mars"),
}
SENSOR = {
    "euroc": (EUROC + "\n", "{t},{x},{y},{z},9.8", "euroc"),
    "kalibr": (KALIBR_IMU, "{t},{x},{y},{z},1,2,9", "euroc"),
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
    "lines above the header": ("From an app\nDevice: phone\nts;gyro x;gyro y;gyro z\n", "{t};{x};{y};{z}", "plain"),
    "dates beside the timestamps": ("t\tdate\tgx\tgy\tgz\n", "{s}\t2024-01-01 10:00:00\t{x}\t{y}\t{z}", "plain"),
    "dates": ("timestamp,wx,wy,wz\n", "{d},{x},{y},{z}", "plain"),
    "an empty column": ("t\tnote\tgx\tgy\tgz\tmx\n", "{s}\t\t{x}\t{y}\t{z}\t1", "plain"),
    "double tabs": ("t\t\tgx\t\tgy\t\tgz\n", "{s}\t\t{x}\t\t{y}\t\t{z}", "plain"),
    "words": ("GYROSCOPE X (rad/s);Gyroscope Y;Gyroscope Z;Time since start in s \n", "{x};{y};{z};{s}", "plain"),
    "the unit as the clock's name": ("index,nanos,gx,gy,gz\n", "1,{t},{x},{y},{z}", "plain"),
    "underscores": ("t_sec,gx_rad/s,gy_rad/s,gz_rad/s\n", "{s},{x},{y},{z}", "plain"),
    "exponents": ("Unix time (s),gx (rad·s⁻¹),gy (rad s⁻¹),gz (rad s⁻¹)\n", "{s},{x},{y},{z}", "plain"),
}
LAYOUTS = {
    name: (header + rows(pattern), format, axes)
    for axes, layouts in (("phone", PHONE), ("sensor", SENSOR))
    for name, (header, pattern, format) in layouts.items()
}
COMMAS = PHYPHOX.replace(",", ";") + rows("{s};{x};{y};{z}").replace(".", ",")
LAYOUTS["decimal commas"] = (COMMAS, "phyphox", "phone")
LAYOUTS["byte-order mark"] = ("\ufeff" + rows("{t} {x} {y} {z}").rstrip(), "plain", "sensor")
# Tables by their format.
GYRO_TABLES: dict[str, list[bytes]] = {}
for _text, _format, _ in LAYOUTS.values():
    GYRO_TABLES.setdefault(_format, []).append(_text.encode())
GYRO_TABLES["plain"].append(rows("{t}\t{x}\t{y}\t{z}").encode("utf-16"))
GCSV = "{}\nversion,1.3\nid,a\norientation,YxZ\nframe_readout_time,15.5\nframe_readout_direction,1\ntscale,{}\n{}\n"
GYRO_TABLES["gcsv"] = [
    (GCSV.format("GYROFLOW IMU LOG", 0.001, "gscale,0.01\nt,gx,gy,gz") + rows("{m},{x},{y},{z}")).encode(),
    (GCSV.format("CAMERA IMU LOG", 1e-6, "time,gx,gy,gz,ax,ay,az") + rows("{m}000,{x},{y},{z},1,2,3")).encode(),
]
UNSTAMPED = [rows("{x},{y},{z}").encode(), b"gx[deg/s],gy[deg/s],gz[deg/s]\n" + rows("{x},{y},{z}").encode()]

# Logs of an accelerometer by the names of their files.
ACCELERATIONS = {
    "gyro_accel.csv": MARS + rows("{t},1,2,3,{x},{y},{z}", FORCES),
    "data.csv": EUROC_FORCE + rows("{t},1,2,3,{x},{y},{z}", FORCES),
    "imu0.csv": KALIBR_IMU + rows("{t},1,1,1,{x},{y},{z}", FORCES),
    "Accelerometer.csv": '"Time (ns)","Acceleration x (m/s^2)","Acceleration y (m/s^2)","Acceleration z (m/s^2)"\n'
    + rows("{t},{x},{y},{z}", FORCES),
    "TotalAcceleration.csv": SENSORLOGGER + rows("{t},0.1,{z},{y},{x}", FORCES),
    "VID_accel.csv": rows("{x},{y},{z},{t}", FORCES),
    "imu.txt": rows("1 {t} {x} {y} {z}\n4 {t} 1 2 3", FORCES),
    "seven.txt": rows("{t} 0.1 0.2 0.3 {x} {y} {z}", FORCES),
    "log.gcsv": f"GYROFLOW IMU LOG\ntscale,1e-9\nascale,{1 / 9.80665!r}\norientation,XYZ\nt,gx,gy,gz,ax,ay,az\n"
    + rows("{t},1,2,3,{x},{y},{z}", FORCES),
}
POSES = (
    "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], v_RS_R_x"
)
# Trajectories that agree but for orientations, which the last lacks.
TRAJECTORIES = {
    "tum": "# timestamp tx ty tz qx qy qz qw\n" + rows("{s} {x} {y} {z} 0 0.6 0 0.8"),
    "tum without a header": rows("{s} {x} {y} {z} 0 0.6 0 0.8"),
    "tum in ns": rows("{t} {x} {y} {z} 0 0.6 0 0.8"),
    "euroc": POSES + "\n" + rows("{t},{x},{y},{z},0.8,0,0.6,0,0.5"),
    "named": "time;px;py;pz;qw;qx;qy;qz\n" + rows("{s};{x};{y};{z};0.8;0;0.6;0"),
    "positions": "t[s],x[m],y[m],z[m]\n" + rows("{s},{x},{y},{z}"),
    "positions without a header": rows("{s},{x},{y},{z}"),
}


def sensorlogger_json() -> bytes:
    """Return an export of Sensor Logger."""
    entries: list[dict[str, Any]] = [{"sensor": "Metadata", "device name": "phone", "platform": "ios"}]
    for t, (x, y, z), force in zip(TIMESTAMPS.tolist(), RATES.tolist(), FORCES.tolist(), strict=True):
        entries.append({"sensor": "Accelerometer", "time": str(t), "x": 0, "y": 0, "z": "0"})
        entries.append({"sensor": "TotalAcceleration", "time": str(t), **dict(zip("xyz", force, strict=True))})
        entries.append({"sensor": "Gyroscope", "time": str(t), "x": str(x), "y": y, "z": z})
    return json.dumps(entries).encode()


def zipped(members: dict[str, Any], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    """Return a zip archive."""
    buffer = BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as file:
        for name, content in members.items():
            file.writestr(name, content)
    return buffer.getvalue()


def archive(member: bytes, metadata: str = "version,device name,platform\n3,phone,android\n") -> bytes:
    """Return a zip archive of a log and its metadata."""
    return zipped({"session/Gyroscope.csv": member, "session/Metadata.csv": metadata})


def trailer(count: int = len(RATES), oldest: int = 7) -> bytes:
    """Return a JPEG with a ring buffer of gyro samples, which claims `count` of them, the oldest at `oldest`."""
    ring = [struct.pack("<q3fi", t, *rate, 0) for t, rate in zip(TIMESTAMPS.tolist(), RATES.tolist(), strict=True)]
    ring = ring[len(ring) - 7 :] + ring[: len(ring) - 7]
    header = struct.pack("<16sqIIq", b"GYRODATA", EPOCH + 99, count, oldest, EPOCH)
    return jpeg() + (header + b"".join(ring)).ljust(16384, b"\0")


PROFILE: dict[str, Any] = {
    "camera_brand": "GoPro",
    "calib_dimension": {"w": 400, "h": 300},
    "fisheye_params": {
        "RMS_error": 0.5,
        "camera_matrix": [[210.0, 0.0, 190.0], [0.0, 211.0, 160.0], [0.0, 0.0, 1.0]],
        "distortion_coeffs": [0.05, -0.02, 0.01, -0.003],
    },
    "asymmetrical": False,
    "frame_readout_time": 15.0,
    "fps": 30.0,
    "crop": None,
    "distortion_model": None,
    "compatible_settings": [
        {"width": 200, "height": 150, "fps": 30.0, "frame_readout_time": 8.0},
        {"width": 200, "height": 150, "fps": 60.0, "frame_readout_time": 4.0, "crop": 1.25},
        {"width": 100, "height": 75, "fps": 90.0, "frame_readout_time": 3.0},
        {"width": 100, "height": 75, "fps": 99.0, "frame_readout_time": 2.0},
    ],
}
# The polynomial turns back at 1.075 focal lengths; the picture's sides are at 0.95, its corners at 1.18.
BENT = [0.2637886549359052, -0.3408966786255753, 1.079728890594674, -0.9412173670690532]
# What lens profiles may contain instead.
VARIANTS: list[dict[str, Any]] = [
    {"global_shutter": True, "compatible_settings": None, "frame_readout_time": "a"},
    {"frame_readout_time": 900.0, "compatible_settings": None},
    {"frame_readout_time": 0.0, "frame_readout_direction": "BottomToTop"},
    {"fisheye_params": PROFILE["fisheye_params"] | {"distortion_coeffs": BENT}},
]
LENSES = [json.dumps(PROFILE | variant).encode() for variant in ({}, *VARIANTS)]

MATRIX = [[0.0, -1.0, 0.0, 0.1], [-1.0, 0.0, 0.0, 0.2], [0.0, 0.0, -1.0, 0.3], [0.0, 0.0, 0.0, 1.0]]
INVERSE = np.linalg.inv(MATRIX).tolist()
CHAIN = f"""cam0:
  T_cam_imu: {MATRIX}
  camera_model: pinhole
  distortion_coeffs: [-0.05, 1e-3, 0.001, -0.002]
  distortion_model: radtan
  intrinsics: [210.0, 211.0, 190.0, 140.0]
  resolution: [400, 300]
  timeshift_cam_imu: 0.012
  line_delay: 5e-05
"""
FLAT = np.ravel(MATRIX).tolist()
# The same camera in each form; the last two forms lack the time offset, and EuRoC's the readout time.
KALIBR = {
    "plain": CHAIN,
    "opencv header": "%YAML:1.0 # a remark\n---\n" + CHAIN,
    "flat": CHAIN.replace(str(MATRIX), str(FLAT)),
    "inverse": CHAIN.replace(f"T_cam_imu: {MATRIX}", f"T_imu_cam: {INVERSE}"),
    "opencv matrix": CHAIN.replace(str(MATRIX), f"!!opencv-matrix {{rows: 4, cols: 4, data: {FLAT}}}"),
    "alias": CHAIN.replace("intrinsics: [", "intrinsics: &k [") + "k: *k\n",
    "swapped, and the principal point outside": CHAIN.replace("[400, 300]", "[300, 400]").replace("190.0", "340.0"),
    "swapped": CHAIN.replace("[400, 300]", "[300, 400]").replace("140.0", "145.0"),
    "maplab": f"""label: rig
cameras:
- T_B_C: {{cols: 4, rows: 4, data: {INVERSE}}}
  camera:
    line-delay-nanoseconds: 50000
    image_width: 400
    image_height: 300
    type: pinhole
    intrinsics: {{cols: 1, rows: 4, data: [210.0, 211.0, 190.0, 140.0]}}
    distortion: {{type: radial-tangential, parameters: {{cols: 1, rows: 4, data: [-0.05, 0.001, 0.001, -0.002]}}}}
""",
    "euroc": f"""sensor_type: camera
T_BS: {{cols: 4, rows: 4, data: {np.ravel(INVERSE).tolist()}}}
resolution: [400, 300]
camera_model: pinhole
intrinsics: [210.0, 211.0, 190.0, 140.0]
distortion_model: radial-tangential
distortion_coefficients: [-0.05, 0.001, 0.001, -0.002]
""",
}

KALIBR["vins"] = f"""%YAML:1.0
---
model_type: PINHOLE
image_width: 400
image_height: 300
distortion_parameters: {{k1: -0.05, k2: 0.001, p1: 0.001, p2: -0.002}}
projection_parameters: {{fx: 210.0, fy: 211.0, cx: 190.0, cy: 150.0}}
body_T_cam0: !!opencv-matrix
   rows: 4
   cols: 4
   dt: d
   data: {[value for row in INVERSE for value in row]}
td: 0.012
rolling_shutter: 1
rolling_shutter_tr: 0.015
"""
# A FOV lens, relative to the size, and a radial-tangential one.
DSO = (
    "0.35 0.44 0.49 0.5 0.93\n1280 1024\ncrop\n640 480\n",
    "RadTan 367.7 369.8 312.1 222.3 -0.3 0.08 0.002 -0.0006\n640 480\nnone\n640 480\n",
)
KALIBR["advio"] = KALIBR["maplab"].replace("T_B_C", "T_cam_imu").replace(str(INVERSE), str(MATRIX))

CAMERA_TOML = [
    b"""# a camera
width = 1920
height = 1080
focal_length = [1500.0, 1501.0]
principal_point = [959.5, 539.5]
readout_time = 0.03
readout_direction = "left-right"
imu_to_camera = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]
time_offset = -0.017
distortion_model = "radtan"
distortion = [-0.1, 0.01, 0.001, 0.0002]
timestamp_marks = "middle"
""",
    b'width = 640\nheight = 480\nfocal_length = 700\nimu_to_camera = "YxZ"\ndistortion_model = "fisheye"\n'
    b"distortion = [0.04, 0.03, -0.03, 0.01]\n",
    b"width = 640\r\nheight = 480\r\nfocal_length = 700\r\n",
]

ANDROID = (
    "Timestamp[nanosec],fx[px],fy[px],Frame No.,Exposure time[nanosec],Sensor frame duration[nanosec],"
    "Frame readout time[nanosec],ISO,Focal length,Focus distance,AF mode\n"
)
IOS = "Timestamp[nanosec], fx[px], fy[px], cx[px], cy[px], exposure duration[nanosec]\n"
NEXT = EPOCH + 33_333_333
# The same two captures, with exposure times of 240 and 20 ms where the format has them.
CAPTURES = {
    "android": f"{ANDROID}{EPOCH},3000,3000,170,240000000,1,30000000,100,4.7,1,1\n{NEXT},3000,null,171,20000000,1\n",
    "ios": f"{IOS}{EPOCH}, 1500.5, 1500.5, 960.1, 540.2, 240000000\n{NEXT}, null, null, null, null, 20000000\n",
    "another order": f"exposure duration[nanosec],ISO,Timestamp[nanosec]\n240000000,null,{EPOCH}\n20000000,1,{NEXT}\n",
    "named": f"timestamp_ns,exposure_ns\n{EPOCH},240000000\n{NEXT},20000000\n",
    "named, in ms": f"timestamp[ns],f,exposure time (ms)\n{EPOCH},0,240\n{NEXT},0,20\n",
    "deepgyro": f"# timestamps\n{EPOCH} 240000000\n{NEXT} 20000000\n",
    "image-info": f"{EPOCH} 8 240000000 3182.59 3179.3 1458.69 2114 0\n{NEXT} 8 20000000 3182.5 3179.3 1458 2114 0\n",
    "timestamps": f"{EPOCH}\n{NEXT}\n",
    "named timestamps": f"Frame timestamp[nanosec]\n{EPOCH}\n{NEXT}\n",
    "seconds": f"{EPOCH // 10**9}.{EPOCH % 10**9}\n{NEXT // 10**9}.{NEXT % 10**9}\n",
    "euroc": f"#timestamp [ns],filename\n{EPOCH},a.png\n{NEXT},b.png\n",
    "tum": f"# colour images\n# timestamp filename\n{EPOCH // 10**9}.{EPOCH % 10**9} rgb/a.png\n"
    f"{NEXT // 10**9}.{NEXT % 10**9} rgb/b.png\n",
}


def picture(shape: tuple[int, ...], dtype: str) -> NDArray[Any]:
    """Return a picture with slopes and noise."""
    rng = np.random.default_rng(1)
    values = np.linspace(0, 0.7, int(np.prod(shape))).reshape(shape) + 0.3 * rng.random(shape)
    return values.astype(dtype) if dtype == "float32" else (values * np.iinfo(dtype).max).astype(dtype)


def exif() -> bytes:
    """Return an EXIF block with all tags that are read."""
    block = Image.Exif()
    block[271], block[272], block[274], block[306] = "Maker", "Model", 6, "2024:05:06 07:08:09"
    camera = {0x829A: 0.02, 0x920A: 4.2, 0xA405: 26, 0xA20E: 8000.0, 0xA210: 3, 0xA002: 4000, 36867: "2024:05:06"}
    block.get_ifd(34665).update(camera)
    block[34853] = {1: "N", 2: (1.0, 2.0, 3.5)}
    return block.tobytes()


def lens(**changes: Any) -> str:
    """Return a lens profile without other settings."""
    return json.dumps(PROFILE | {"compatible_settings": None} | changes)


def photo(size: tuple[int, int], **tags: Any) -> bytes:
    """Return a JPEG with tags of the camera."""
    numbers = {"f35": 0xA405, "focal_length": 0x920A, "resolution": 0xA20E, "unit": 0xA210, "across": 0xA002}
    block, buffer = Image.Exif(), BytesIO()
    block.get_ifd(0x8769).update({(numbers | {"zoom": 0xA404})[name]: value for name, value in tags.items()})
    Image.new("RGB", size).save(buffer, "JPEG", exif=block)
    return buffer.getvalue()


def encoded(kind: str, pixels: NDArray[Any], mode: str | None = None, **options: Any) -> bytes:
    """Return a picture encoded by Pillow."""
    buffer = BytesIO()
    image = Image.fromarray(pixels)
    (image.convert(mode) if mode else image).save(buffer, kind, **options)
    return buffer.getvalue()


def jpeg(block: bytes | None = None, **options: Any) -> bytes:
    """Return a JPEG with an EXIF block."""
    # A segment of a JPEG cannot contain more.
    kept = exif() if block is None else block[:60_000]
    return encoded("JPEG", picture((12, 20, 3), "uint8"), exif=kept, **options)


def jpegs() -> list[bytes]:
    """Return JPEGs of several kinds."""
    return [
        jpeg(),
        jpeg(progressive=True, quality=50),
        encoded("JPEG", picture((9, 10), "uint8")),
        encoded("JPEG", picture((16, 16, 3), "uint8"), "CMYK"),
        jpeg(restart_marker_blocks=1),
    ]


def pngs() -> list[bytes]:
    """Return PNGs of several kinds."""
    import imagecodecs

    rgb = picture((12, 20, 3), "uint8")
    return [
        encoded("PNG", rgb, exif=exif(), icc_profile=b"\0" * 16 + b"RGB " + b"\0" * 108),
        encoded("PNG", rgb, "P"),
        encoded("PNG", rgb, "1"),
        encoded("PNG", picture((12, 20, 4), "uint8")),
        bytes(imagecodecs.png_encode(picture((12, 20, 3), "uint16"))),
        bytes(imagecodecs.png_encode(picture((12, 20, 4), "uint16"))),
    ]


def mended_png(data: bytes) -> bytes:
    """Return a PNG with corrected check sums of its chunks, so that damage reaches the decoder."""
    out, place = bytearray(data), 8
    while place + 12 <= len(out):
        end = place + 8 + int.from_bytes(out[place : place + 4], "big")
        if end + 4 > len(out):
            break
        out[end : end + 4] = zlib.crc32(out[place + 4 : end]).to_bytes(4, "big")
        place = end + 4
    return bytes(out)


def webps() -> list[bytes]:
    """Return WebPs of several kinds."""
    return [
        encoded("WebP", picture((12, 20, 3), "uint8"), lossless=True, exif=exif()),
        encoded("WebP", picture((12, 20, 4), "uint8"), quality=50),
    ]


def tiff(pixels: NDArray[Any], **options: Any) -> bytes:
    """Return a TIFF."""
    buffer = BytesIO()
    tifffile.imwrite(buffer, pixels, **options)
    return buffer.getvalue()


def tiffs() -> list[bytes]:
    """Return TIFFs of several kinds."""
    rgb, grey = picture((12, 20, 3), "uint8"), picture((12, 20), "uint16")
    return [
        tiff(rgb, photometric="rgb", compression="zlib", predictor=True, rowsperstrip=5),
        tiff(grey, compression="lzw"),
        tiff(picture((12, 20, 3), "float32"), photometric="rgb", byteorder=">"),
        tiff(picture((32, 48), "uint8"), tile=(16, 16), compression="zstd"),
        tiff(np.moveaxis(rgb, -1, 0), photometric="rgb", planarconfig="separate", bigtiff=True),
        tiff(rgb[..., 0], photometric="palette", colormap=np.zeros((3, 256), np.uint16)),
        encoded("TIFF", rgb, exif=exif()),
        tiff(picture((16, 16, 3), "uint8"), photometric="ycbcr", compression="jpeg"),
        tiff(picture((12, 20, 4), "uint8"), photometric="separated"),
        tiff(picture((12, 20, 4), "uint16"), photometric="rgb", extrasamples=["unassalpha"]),
        tiff(np.packbits(picture((12, 16), "uint8") > 99, axis=1), bitspersample=1, photometric="miniswhite"),
    ]


def npy(pixels: NDArray[Any]) -> bytes:
    """Return an array in NumPy's own format."""
    buffer = BytesIO()
    np.save(buffer, pixels)
    return buffer.getvalue()


def npys() -> list[bytes]:
    """Return pictures in NumPy's own format."""
    kinds = (((12, 20), "uint8"), ((12, 20, 3), "uint16"), ((12, 20, 4), "float32"))
    return [npy(picture(shape, dtype)) for shape, dtype in kinds]


def dng(mosaic: NDArray[Any] | None = None, orientation: int = 1) -> bytes:
    """Return the smallest DNG: an RGGB mosaic of a camera whose primaries are those of sRGB."""
    mosaic = picture((24, 32), "uint16") if mosaic is None else mosaic.astype(np.uint16)
    xyz = (32406, -15372, -4986, -9689, 18758, 415, 557, -2040, 10570)
    tags = [
        (50706, "B", 4, (1, 4, 0, 0), True),
        (50708, "s", 0, "Test", True),
        (33421, "H", 2, (2, 2), True),
        (33422, "B", 4, (0, 1, 1, 2), True),
        (50721, "2i", 9, tuple(n for value in xyz for n in (value, 10000)), True),
        (50778, "H", 1, 21, True),
        (50728, "2I", 3, (1, 1, 1, 1, 1, 1), True),
        (50717, "H", 1, 65535, True),
        (274, "H", 1, orientation, True),
    ]
    return tiff(mosaic, photometric=32803, extratags=tags, metadata=None)


def heic() -> bytes:
    """Return a HEIC picture."""
    import pillow_heif

    pixels = picture((16, 24, 3), "uint8")
    buffer = BytesIO()
    pillow_heif.from_bytes("RGB", (24, 16), pixels.tobytes()).save(buffer, quality=50, exif=exif())
    return buffer.getvalue()


def bank() -> bytes:
    """Return a file of PSFs."""
    from rsdeblur.psf import PsfBank

    buffer = BytesIO()
    kernels = np.full((2, 1, 3, 3), 1 / 9)
    stored = PsfBank(kernels, np.array([2.0, 7.0]), np.array([5.0]))
    np.savez(buffer, kernels=stored.kernels, rows=stored.rows, cols=stored.cols)
    return buffer.getvalue()
