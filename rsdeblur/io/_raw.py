"""Raw files of cameras and DNG, developed to linear light without a tone curve and in the sensor's axes."""

from __future__ import annotations

import struct
from dataclasses import replace
from io import BytesIO
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from rsdeblur._util.extras import missing
from rsdeblur.io import _tiff, untrusted
from rsdeblur.io._heif import MissingPackage
from rsdeblur.io._metadata import Metadata, of_tiff

# Makers' formats that are TIFF inside: their first bytes do not distinguish them from TIFF.
TIFF_SUFFIXES = (".cr2", ".nef", ".arw", ".pef", ".srw", ".3fr", ".iiq", ".nrw", ".erf", ".dng")
MAGIC = (b"FUJIFILMCCD-RAW", b"IIRO", b"IIRS", b"MMOR", b"IIU\0", b"FOVb")
DNG_VERSION = 50706


def is_raw(data: bytes, suffix: str) -> bool:
    """Whether `data` is a raw file; where it is TIFF inside, a DNG version or the file's `suffix` decides."""
    if data.startswith(MAGIC) or data[4:12] == b"ftypcrx ":
        return True
    if not data.startswith(_tiff.MAGIC):
        return False
    if suffix.lower() in TIFF_SUFFIXES or untrusted.blocked():
        return suffix.lower() in TIFF_SUFFIXES
    try:
        with tifffile.TiffFile(BytesIO(data)) as file:
            return DNG_VERSION in file.pages.first.tags
    except (ValueError, TypeError, LookupError, struct.error):
        return False


def decode(data: bytes, max_pixels: int) -> tuple[NDArray[Any], Metadata]:
    """Return pixels (uint16, linear, sRGB's primaries), and metadata with the matching colour profile."""
    try:
        import rawpy
    except ModuleNotFoundError:
        raise MissingPackage(missing("raw files need rawpy", "raw")) from None
    try:
        with rawpy.RawPy() as raw:
            raw.open_buffer(BytesIO(data))
            width, height = raw.sizes.raw_width, raw.sizes.raw_height
            if width * height > max_pixels:
                raise ValueError(f"the picture claims {width}x{height} pixels; the limit is {max_pixels}")
            raw.unpack()
            pixels = raw.postprocess(
                gamma=(1.0, 1.0), no_auto_bright=True, output_bps=16, use_camera_wb=True, user_flip=0
            )
    except rawpy.LibRawError as error:
        raise ValueError(error.args[0] if error.args else "not a raw file that LibRaw can read") from error
    metadata = Metadata()
    if data.startswith(_tiff.MAGIC):
        with tifffile.TiffFile(BytesIO(data)) as file:
            metadata = of_tiff(file.pages.first, *_tiff.exif_block(BytesIO(data)))
    # A sensor without colour filters gives one channel; its axis is dropped.
    pixels = np.ascontiguousarray(pixels.squeeze(axis=2) if pixels.shape[2] == 1 else pixels)
    return pixels, replace(metadata, icc_profile=linear_profile())


def linear_profile() -> bytes:
    """Return an ICC profile (version 2.1) with sRGB's primaries and linear values."""

    def fixed(*numbers: float) -> bytes:
        return b"XYZ \0\0\0\0" + b"".join(struct.pack(">i", round(number * 65536)) for number in numbers)

    name = b"linear sRGB"
    description = b"desc\0\0\0\0" + struct.pack(">I", len(name) + 1) + name + b"\0" * 79
    # Primaries adapted to D50 (Bradford), as in the profiles of sRGB; an empty curve is the identity.
    tags = {
        b"desc": description,
        b"cprt": b"text\0\0\0\0public domain\0",
        b"wtpt": fixed(0.9642, 1.0, 0.8249),
        b"rXYZ": fixed(0.43607, 0.22249, 0.01392),
        b"gXYZ": fixed(0.38515, 0.71687, 0.09708),
        b"bXYZ": fixed(0.14307, 0.06061, 0.71410),
        **dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"), b"curv\0\0\0\0" + struct.pack(">I", 0)),
    }
    table, body = struct.pack(">I", len(tags)), b""
    start = 128 + 4 + 12 * len(tags)
    for key, value in tags.items():
        table += key + struct.pack(">II", start + len(body), len(value))
        body += value + b"\0" * (-len(value) % 4)
    size = start + len(body)
    header = struct.pack(">I4sI", size, b"\0" * 4, 0x02100000) + b"mntrRGB XYZ "
    header = header.ljust(36, b"\0") + b"acsp"
    header = header.ljust(68, b"\0") + struct.pack(">3i", *(round(v * 65536) for v in (0.9642, 1.0, 0.8249)))
    return header.ljust(128, b"\0") + table + body
