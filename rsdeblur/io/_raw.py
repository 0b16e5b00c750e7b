"""Raw files of cameras and DNG, developed to linear light without a tone curve and in the sensor's axes."""

from __future__ import annotations

import struct
from dataclasses import replace
from io import BytesIO

import numpy as np
import tifffile

from rsdeblur._util.extras import missing
from rsdeblur.io import _tiff, untrusted
from rsdeblur.io._heif import MissingPackage
from rsdeblur.io._metadata import Picture, linear_profile, of_tiff

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


def decode(data: bytes, max_pixels: int) -> Picture:
    """Return a picture (uint16, linear, sRGB's primaries) with the matching colour profile."""
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
    # A sensor without colour filters gives one channel; its axis is dropped.
    pixels = np.ascontiguousarray(pixels.squeeze(axis=2) if pixels.shape[2] == 1 else pixels)
    picture = Picture(pixels)
    if data.startswith(_tiff.MAGIC):
        with tifffile.TiffFile(BytesIO(data)) as file:
            picture = of_tiff(file.pages.first, pixels, *_tiff.exif_block(BytesIO(data)))
    return replace(picture, icc_profile=linear_profile())
