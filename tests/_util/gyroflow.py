"""Made projects of Gyroflow."""

import json
import struct
import zlib
from typing import Any

import numpy as np

from rsdeblur._util.binary import BASE91
from tests._util.files import PROFILE, RATES


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


def project(gyro: Any, **changes: Any) -> bytes:
    """Return a Gyroflow project with a lens profile in it."""
    content = {
        "title": "Gyroflow data file",
        "version": 4,
        "offsets": {"1000000": -12.5, "2000000": [-14.5, 0.1]},
        "gyro_source": {"imu_orientation": "xZy", "filepath": "video.mp4"} | gyro,
        "stabilization": {"frame_readout_time": -15.0},
        "video_info": {"width": 200, "height": 150, "fps": 30.0, "rotation": 90},
        "calibration_data": PROFILE,
    }
    return json.dumps(content | changes).encode()


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
