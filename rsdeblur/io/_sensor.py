"""HEIC and raw files: pictures in the sensor's axes.

libheif turns the pixels of HEIC upright, this module turns them back. Raw files of cameras and DNG are developed to
linear light without a tone curve.
"""

import struct
from dataclasses import replace
from io import BytesIO

import numpy as np
import tifffile
from PIL.ExifTags import Base

from rsdeblur._util.validate import missing
from rsdeblur.errors import FileFormatError
from rsdeblur.image.transfer import linear_profile
from rsdeblur.io import _tiff
from rsdeblur.io.metadata import Picture, of_info, with_orientation

# Brands of HEIC; those of AVIF, which is not read, begin files of the same kind.
BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")
AVIF_BRANDS = (b"avif", b"avis")
# Makers' formats that are TIFF inside: their first bytes do not distinguish them from TIFF.
TIFF_SUFFIXES = (".cr2", ".nef", ".arw", ".pef", ".srw", ".3fr", ".iiq", ".nrw", ".erf", ".dng")
RAW_MAGIC = (b"FUJIFILMCCD-RAW", b"IIRO", b"IIRS", b"MMOR", b"IIU\0", b"FOVb")


def is_heif(head: bytes) -> bool:
    """Whether a file that starts with `head` is HEIC."""
    return head[4:8] == b"ftyp" and head[8:12] in BRANDS


def decode_heif(data: bytes, max_pixels: int) -> Picture:
    """Return the primary picture, in the sensor's axes."""
    try:
        import pillow_heif
    except ModuleNotFoundError:
        raise FileFormatError(missing("HEIC pictures need pillow-heif", "heif")) from None
    file = pillow_heif.open_heif(BytesIO(data), convert_hdr_to_8bit=False)
    width, height = file.size
    if width * height > max_pixels:
        raise ValueError(f"the picture claims {width}x{height} pixels; the limit is {max_pixels}")
    pixels = np.array(np.asarray(file))
    if pixels.dtype == np.uint16:
        # libheif shifts 10 and 12 bits up to 16; copying the top bits into the empty low ones makes white 65535.
        pixels |= pixels >> np.uint16(file.info["bit_depth"])
    turns = _quarter_turns(data)
    pixels = np.ascontiguousarray(np.rot90(pixels, -turns))
    # In a HEIC file the block's own orientation does not count, but 0, 1, 2 and 3 quarter turns anticlockwise.
    return of_info(file.info, data, pixels, with_orientation(file.info.get("exif"), (1, 8, 3, 6)[turns]))


def _quarter_turns(data: bytes) -> int:
    """Return how many quarter turns anticlockwise libheif applied; 0 for a mirrored picture, which stays as decoded."""
    # The meta box contains the properties of all pictures and comes before the coded data.
    start = data.find(b"meta")
    if start < 4:
        return 0
    box = data[start : start - 4 + struct.unpack_from(">I", data, start - 4)[0]]
    place = box.find(b"irot")
    return box[place + 4] & 3 if place >= 0 and b"imir" not in box else 0


def is_raw(data: bytes, suffix: str) -> bool:
    """Whether `data` is a raw file; where it is TIFF inside, a DNG version or the file's `suffix` decides."""
    if data.startswith(RAW_MAGIC) or data[4:12] == b"ftypcrx ":
        return True
    if not data.startswith(_tiff.MAGIC):
        return False
    if suffix.lower() in TIFF_SUFFIXES:
        return True
    try:
        with tifffile.TiffFile(BytesIO(data)) as file:
            return Base.DNGVersion in file.pages.first.tags
    except (ValueError, TypeError, LookupError, struct.error):
        return False


def decode_raw(data: bytes, max_pixels: int) -> Picture:
    """Return a picture (uint16, linear, sRGB's primaries) with the matching colour profile."""
    try:
        import rawpy
    except ModuleNotFoundError:
        raise FileFormatError(missing("raw files need rawpy", "raw")) from None
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
            picture = _tiff.of_page(file.pages.first, pixels, data)
    return replace(picture, icc_profile=linear_profile())
