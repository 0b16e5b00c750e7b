"""Small files that are refused, each on another way through a reader: seeds of the harnesses."""

from __future__ import annotations

import json
import struct
from io import BytesIO

import numpy as np

from benchmarks.fuzz import packets, seeds

TRAILER = seeds.trailer()
LOGS = [
    # A ring of more samples than it has room for.
    TRAILER[:-16360] + struct.pack("<I", 10**6) + TRAILER[-16356:],
    b'[3, {"sensor": "Gyroscope", "time": "1", "x": "nan", "y": 0, "z": 0}]',
    b'{"gyro_source": {"raw_imu": [[1e30, 1, 2, 3], [2e30, 1, 2, 3]]}}',
    b'{"gyro_source": {"raw_imu": []}}',
    seeds.trailer(np.nan),
    seeds.jpeg(),
]
LENSES = (
    {"distortion_model": "poly3"},
    {"digital_lens": "gopro_superview"},
    {"input_horizontal_stretch": 1.5},
    {"global_shutter": True, "crop": 1e9},
    {"use_opencv_standard": True, "calib_params": {}},
)
CAMERAS = [
    *(json.dumps(seeds.PROFILE | variant).encode() for variant in LENSES),
    b"cam0: {camera_model: omni}\n" + b"#" * 100_001,
    b"cam0: {distortion_model: fov, intrinsics: [1, 1, 2, 3], resolution: [6, 4]}\n",
    b"cameras: [1]\n",
]
CAPTURES = [b"0.5\n100.25\n"]


def _claimed(tiff: bytes, height: int, claimed: int) -> bytes:
    """Return a TIFF that claims another height."""
    return tiff.replace(struct.pack("<HHII", 257, 4, 1, height), struct.pack("<HHII", 257, 4, 1, claimed))


def pictures() -> list[bytes]:
    """Return pictures of kinds that are not read, or that claim more than is read."""
    grey, size = seeds.picture((12, 20), "uint8"), b"ispe" + bytes(4)
    return [
        b"",
        seeds.tiff(grey.view(np.int8)),
        _claimed(seeds.tiff(grey), 12, 10**8),
        _claimed(seeds.tiff(np.zeros((12, 20, 5)), photometric="minisblack", planarconfig="contig"), 12, 600_000),
        _claimed(seeds.dng(), 24, 3_000_000),
        packets.heics()[0].replace(size + struct.pack(">II", 64, 64), size + struct.pack(">II", 30_000, 30_000)),
    ]


def arrays() -> list[bytes]:
    """Return arrays that are no pictures, claim too much, or hold floats beyond white."""
    files = []
    for array in (np.zeros((2, 3), np.int64), np.full((6, 8), 9.0, np.float32), np.asfortranarray(np.zeros((5, 6, 3)))):
        buffer = BytesIO()
        np.save(buffer, array)
        files.append(buffer.getvalue())
    header = BytesIO()
    np.lib.format.write_array_header_2_0(header, {"descr": "|u1", "fortran_order": False, "shape": (30_000, 30_000)})
    return [*files, header.getvalue(), files[1][:-1]]
