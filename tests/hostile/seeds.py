"""Small valid files of every format that is read, and functions that pack compressed formats."""

from __future__ import annotations

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

from rsdeblur.io.gyroflow import BASE91

EPOCH, STEP = 1_766_385_749_427_863_801, 5_000_000
RATES = np.random.default_rng(0).normal(0.0, 0.5, (12, 3)).round(4)
TIMESTAMPS = EPOCH + STEP * np.arange(len(RATES))


def rows(pattern: str) -> bytes:
    """Return a line for each sample; `pattern` has t (ns), s (seconds), x, y and z."""
    return "".join(
        pattern.format(t=t, s=f"{t // 10**9}.{t % 10**9:09d}", m=5 * i, x=x, y=y, z=z) + "\n"
        for i, (t, (x, y, z)) in enumerate(zip(TIMESTAMPS.tolist(), RATES.tolist(), strict=True))
    ).encode()


GYRO_TABLES: dict[str, list[bytes]] = {
    "mars": [
        b"Timestamp[nanosec],gx[rad/s],gy[rad/s],gz[rad/s],ax[m/s^2],ay[m/s^2],az[m/s^2]\n"
        + rows("{t},{x},{y},{z},0,9.8,0")
    ],
    "euroc": [
        b"#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1]\n" + rows("{t},{x},{y},{z}"),
        b"timestamp,omega_x,omega_y,omega_z,alpha_x,alpha_y,alpha_z\n" + rows("{t},{x},{y},{z},1,2,9"),
    ],
    "phyphox": [
        b'"Time (s)","Gyroscope x (rad/s)","Gyroscope y (rad/s)","Gyroscope z (rad/s)"\n' + rows("{s},{x},{y},{z}"),
        b'"Time (s)";"Gyroscope x (rad/s)";"Gyroscope y (rad/s)";"Gyroscope z (rad/s)"\n'
        + rows("{s};{x};{y};{z}").replace(b".", b","),
    ],
    "sensorlogger": [
        b"time,seconds_elapsed,z,y,x\n" + rows("{t},-0.1,{z},{y},{x}"),
        b"time,seconds_elapsed,gyroz,gyroy,gyrox\n" + rows("{t},-0.1,{z},{y},{x}"),
    ],
    "deepgyro": [rows("4 {t} {x} {y} {z}\n1 {t} 0 0 9.8"), rows("gyro,{t},{x},{y},{z}")],
    "opencamera": [rows("{x},{y},{z},{t}")],
    "plain": [
        rows("{s} {x} {y} {z}"),
        rows("{t}\t{x}\t{y}\t{z}").decode().encode("utf-16"),
        rows("{t} {x} {y} {z} 0.1 -9.7 1.1"),
        b"made by an app\nts;gyro x;gyro y;gyro z\n" + rows("{t};{x};{y};{z}"),
        b"t_ns,gx_dps,gy_dps,gz_dps\n" + rows("{t},{x},{y},{z}"),
        b"t;gx;gy;gz\ns;deg/s;deg/s;deg/s\n" + rows("{s};{x};{y};{z}").replace(b".", b","),
        rows("{x},{y},{z},{s}"),
    ],
    "gcsv": [
        b"GYROFLOW IMU LOG\nversion,1.3\nid,a\norientation,YxZ\nframe_readout_time,15\nframe_readout_direction,1\n"
        b"tscale,0.001\ngscale,0.01\nt,gx,gy,gz\n" + rows("{m},{x},{y},{z}"),
        b"CAMERA IMU LOG\ntscale,0.000001\ntime,gx,gy,gz\n" + rows("{m}000,{x},{y},{z}"),
    ],
}


UNSTAMPED = [rows("{x},{y},{z}"), b"gx[deg/s],gy[deg/s],gz[deg/s]\n" + rows("{x},{y},{z}")]
ACCELERATIONS = [
    b"Timestamp[nanosec],gx[rad/s],gy[rad/s],gz[rad/s],ax[m/s^2],ay[m/s^2],az[m/s^2]\n" + rows("{t},1,1,1,{x},9.8,{z}"),
    b"t[s],ax[g],ay[g],az[g]\n" + rows("{s},{x},1,{z}"),
    rows("4 {t} 1 1 1\n1 {t} {x} 9.8 {z}"),
    rows("{t} 0.1 0.2 0.3 {x} 9.8 {z}"),
    b"GYROFLOW IMU LOG\norientation,YxZ\nascale,0.5\nt,gx,gy,gz,ax,ay,az\n" + rows("{m},1,1,1,{x},2,{z}"),
]
TRAJECTORIES = [
    b"# timestamp tx ty tz qx qy qz qw\n" + rows("{s} {x} {y} {z} 0 0.6 0 0.8"),
    b"#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n"
    + rows("{t},{x},{y},{z},1,0,0,0"),
    rows("{t},{x},{y},{z}"),
]


def sensorlogger_json() -> bytes:
    """Return an export of Sensor Logger."""
    entries: list[dict[str, Any]] = [{"sensor": "Metadata", "device name": "phone", "platform": "ios"}]
    for t, (x, y, z) in zip(TIMESTAMPS.tolist(), RATES.tolist(), strict=True):
        entries.append({"sensor": "Gyroscope", "time": str(t), "x": str(x), "y": y, "z": z})
    return json.dumps(entries).encode()


def archive(member: bytes, metadata: str = "version,device name,platform\n3,phone,android\n") -> bytes:
    """Return a zip archive of a log and its metadata."""
    buffer = BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("session/Gyroscope.csv", member)
        file.writestr("session/Metadata.csv", metadata)
    return buffer.getvalue()


def trailer(factor: float = 1.0) -> bytes:
    """Return a JPEG with a ring buffer of gyro samples, their rates times `factor`."""
    rates = (factor * RATES).tolist()
    ring = [struct.pack("<q3fi", t, *rate, 0) for t, rate in zip(TIMESTAMPS.tolist(), rates, strict=True)]
    header = struct.pack("<16sqIIq", b"GYRODATA", EPOCH + 99, len(ring), 0, EPOCH)
    return jpeg() + (header + b"".join(ring)).ljust(16384, b"\0")


def base91(data: bytes) -> str:
    """Return `data` encoded as basE91 (Henke)."""
    out, bits, count = bytearray(), 0, 0
    for byte in data:
        bits |= byte << count
        count += 8
        if count > 13:
            width = 13 if bits & 8191 > 88 else 14
            value = bits & (2**width - 1)
            bits, count = bits >> width, count - width
            out += bytes([BASE91[value % 91], BASE91[value // 91]])
    if count:
        out.append(BASE91[bits % 91])
        if count > 7 or bits > 90:
            out.append(BASE91[bits // 91])
    return out.decode()


def project(gyro: Any) -> bytes:
    """Return a Gyroflow project with a lens profile in it."""
    content = {
        "title": "Gyroflow data file",
        "version": 4,
        "offsets": {"1000000": -12.5, "2000000": [-12.25, 0.1]},
        "gyro_source": {"imu_orientation": "xZy", "rotation": [0, 90, 0], "gyro_bias": [0.1, 0, 0]} | gyro,
        "stabilization": {"frame_readout_time": -15.0},
        "video_info": {"width": 1920, "height": 1080, "fps": 30.0, "rotation": 90},
        "calibration_data": PROFILE,
    }
    return json.dumps(content).encode()


def packed_project(payload: bytes, key: str) -> bytes:
    """Return a project whose gyro data are packed."""
    return project({key: base91(zlib.compress(payload))})


def cbor() -> bytes:
    """Return the payload of a current project."""
    import cbor2

    samples = [{"timestamp_ms": 5.0 * i, "gyro": rate} for i, rate in enumerate(np.degrees(RATES).tolist())]
    encoded: bytes = cbor2.dumps(
        {"raw_imu": samples, "quaternions": {}, "imu_orientation": "XYZ", "detected_source": "a camera"}
    )
    return encoded


def bincode() -> bytes:
    """Return the payload of a project of version 2."""
    packed = struct.pack("<Q", len(RATES))
    for i, rate in enumerate(np.degrees(RATES).tolist()):
        packed += struct.pack("<dB3dB3dB", 5.0 * i, 1, *rate, 1, 0.0, 0.0, 1.0, 0)
    return packed


PROFILE: dict[str, Any] = {
    "name": "a lens",
    "camera_brand": "GoPro",
    "calib_dimension": {"w": 3840, "h": 2160},
    "frame_readout_time": 8.34,
    "frame_readout_direction": "BottomToTop",
    "asymmetrical": True,
    "fps": 30.0,
    "crop": 1.0,
    "fisheye_params": {
        "RMS_error": 0.5,
        "camera_matrix": [[1755.2, 0.0, 1926.5], [0.0, 1755.1, 1091.9], [0.0, 0.0, 1.0]],
        "distortion_coeffs": [0.04, 0.03, -0.03, 0.01],
    },
    "compatible_settings": [
        {"width": 1920, "height": 1080, "fps": 30.0, "frame_readout_time": 8.4, "crop": 1.1},
        {"width": 1920, "height": 1080, "fps": 60.0, "frame_readout_time": 7.2},
    ],
}

# What lens profiles may contain beside that.
VARIANTS: list[dict[str, Any]] = [
    {"global_shutter": True, "compatible_settings": None, "frame_readout_time": "a"},
    {"frame_readout_time": 900.0, "compatible_settings": None},
    {"frame_readout_time": 0.0, "compatible_settings": None, "calib_dimension": {"w": 38400, "h": 21600}},
    {
        "fisheye_params": {
            "camera_matrix": [[1867, 0, 1920], [0, 1867, 1080], [0, 0, 1]],
            # The polynomial turns back between the sides and the corners of the picture.
            "distortion_coeffs": [0.2637886549, -0.3408966786, 1.0797288906, -0.9412173671],
        }
    },
]
LENSES = [json.dumps(PROFILE | variant).encode() for variant in ({}, *VARIANTS)]

KALIBR = [
    b"cam0: {intrinsics: [700, 700, 240, 320], resolution: [640, 480]}\n",
    b"""cam0:
  T_cam_imu:
  - [0.01486554298, 0.9995572490, -0.0257744366, 0.06522290953]
  - [-0.9998809296, 0.01496721332, 0.00375618835, -0.02070638549]
  - [0.00414029679, 0.02571552948, 0.99966072778, -0.00805460246]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0001, 1.7e-05]
  distortion_model: radtan
  intrinsics: &k [458.65, 457.29, 367.21, 248.37]
  line_delay: 3.4e-05
  resolution: [752, 480]
  timeshift_cam_imu: -0.0001
cam1:
  camera_model: pinhole
  distortion_coeffs: [0.0034, 0.0007, -0.002, 0.0002]
  distortion_model: equidistant
  intrinsics: *k
  resolution: [752, 480]
""",
    b"""%YAML:1.0
sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: [0.0, -1.0, 0.0, -0.02, 1.0, 0.0, 0.0, -0.06, 0.0, 0.0, 1.0, 0.009, 0.0, 0.0, 0.0, 1.0]
camera_model: pinhole
resolution: [752, 480]
intrinsics: [458.654, 457.296, 367.215, 248.375]
distortion_model: radial-tangential
distortion_coefficients: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
""",
    b"""cameras:
- camera:
    label: a
    line-delay-nanoseconds: 30000
    image_height: 480
    image_width: 752
    type: pinhole
    intrinsics: {cols: 1, rows: 4, data: [458.6, 457.3, 367.2, 248.4]}
    distortion: {type: equidistant, parameters: {cols: 1, rows: 4, data: [0.0, 0.01, 0.0, 0.0]}}
  T_B_C: {cols: 4, rows: 4, data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}
""",
]

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

CAPTURES = {
    "mars-captures": [
        b"Timestamp[nanosec],fx[px],fy[px],Frame No.,Exposure time[nanosec],ISO\n"
        + b"".join(b"%d,2943.75,2943.75,%d,20000000,null\n" % (EPOCH + i * 33_333_333, i) for i in range(5)),
        b"Timestamp[nanosec],fx[px],fy[px],cx[px],cy[px],exposure duration[nanosec],Frame readout time[nanosec],ISO\n"
        b"1000000000,1500.5,1500.5,960.1,540.2,20000000,30000000,100\n",
        b"Timestamp[nanosec],fx[px],fy[px]\n1000000000,null,null\n",
    ],
    "deepgyro-captures": [b"".join(b"%d 20000000\n" % (EPOCH + i * 33_333_333) for i in range(5))],
    "image-info": [b"%d 800 33333333 3182.59 3179.30 1458.69 2114.26 0\n" % EPOCH],
    "timestamps": [
        b"".join(b"%d\n" % (EPOCH + i * 33_333_333) for i in range(5)),
        b"Frame timestamp[nanosec]\n%d\n%d\n" % (EPOCH, EPOCH + 33_333_333),
        b"0.5\n0.533\n0.566\n",
    ],
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
        tiff(picture((12, 20, 4), "uint16"), photometric="rgb", extrasamples=["assocalpha"]),
        tiff(np.packbits(picture((12, 16), "uint8") > 99, axis=1), bitspersample=1, photometric="miniswhite"),
    ]


def npys() -> list[bytes]:
    """Return pictures in NumPy's own format."""
    files = []
    for shape, dtype in (((12, 20), "uint8"), ((12, 20, 3), "uint16"), ((12, 20, 4), "float32")):
        buffer = BytesIO()
        np.save(buffer, picture(shape, dtype))
        files.append(buffer.getvalue())
    return files


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
