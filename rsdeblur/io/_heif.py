"""HEIC pictures: libheif turns their pixels upright, this module turns them back to the sensor's axes."""

from __future__ import annotations

import struct
from io import BytesIO

import numpy as np

from rsdeblur._util.extras import missing
from rsdeblur.io._exif_block import with_orientation
from rsdeblur.io._metadata import Picture, of_heif

# Brands of HEIC; those of AVIF, which is not read, begin files of the same kind.
BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")
AVIF_BRANDS = (b"avif", b"avis")


class MissingPackage(RuntimeError):
    """The package that reads the format is not installed; the message says how to install it."""


def is_heif(head: bytes) -> bool:
    """Whether a file that starts with `head` is HEIC."""
    return head[4:8] == b"ftyp" and head[8:12] in BRANDS


def decode(data: bytes, max_pixels: int) -> Picture:
    """Return the primary picture, in the sensor's axes."""
    try:
        import pillow_heif
    except ModuleNotFoundError:
        raise MissingPackage(missing("HEIC pictures need pillow-heif", "heif")) from None
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
    exif = with_orientation(file.info.get("exif"), (1, 8, 3, 6)[turns])
    return of_heif(file.info, exif, data, pixels)


def _quarter_turns(data: bytes) -> int:
    """Return how many quarter turns anticlockwise libheif applied.

    0 for a picture that is mirrored too: it stays as decoded.
    """
    # The meta box contains the properties of all pictures and comes before the coded data.
    start = data.find(b"meta")
    if start < 4:
        return 0
    box = data[start : start - 4 + struct.unpack_from(">I", data, start - 4)[0]]
    place = box.find(b"irot")
    return box[place + 4] & 3 if place >= 0 and b"imir" not in box else 0
