"""HEIC, whose pixels libheif turns upright; here they are turned back to how the sensor saw them."""

from __future__ import annotations

import struct
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")
ORIENTATION = 274
# The EXIF orientation that says the same as a number of quarter turns anticlockwise.
ORIENTATION_OF_TURNS = (1, 8, 3, 6)


class Missing(RuntimeError):
    """The package that reads the format is not installed; the message says how to get it."""


def is_heif(head: bytes) -> bool:
    """Whether a file that starts so is HEIC."""
    return head[4:8] == b"ftyp" and head[8:12] in BRANDS


def decode(data: bytes, max_pixels: int) -> tuple[NDArray[Any], bytes | None, bytes | None]:
    """Return pixels as stored by the sensor, EXIF block and colour profile of the primary picture."""
    try:
        import pillow_heif
    except ModuleNotFoundError:
        raise Missing("HEIC pictures need pillow-heif; install it with: pip install 'rsdeblur[heif]'") from None
    file = pillow_heif.open_heif(BytesIO(data), convert_hdr_to_8bit=False)
    width, height = file.size
    if width * height > max_pixels:
        raise ValueError(f"the picture claims {width}x{height} pixels; limit {max_pixels}")
    pixels = np.array(np.asarray(file))
    if pixels.dtype == np.uint16:
        # Ten and twelve bits come shifted up; repeating the top bits below makes the range full.
        pixels |= pixels >> np.uint16(file.info["bit_depth"])
    turns = _quarter_turns(data)
    pixels = np.ascontiguousarray(np.rot90(pixels, -turns))
    return pixels, _oriented(file.info.get("exif"), ORIENTATION_OF_TURNS[turns]), file.info.get("icc_profile")


def _quarter_turns(data: bytes) -> int:
    """How often libheif turned the picture anticlockwise; 0 where it was mirrored too, and stays as decoded."""
    # All boxes of properties stand before the coded pictures.
    start = data.find(b"meta")
    if start < 4:
        return 0
    box = data[start : start - 4 + struct.unpack_from(">I", data, start - 4)[0]]
    place = box.find(b"irot")
    return box[place + 4] & 3 if place >= 0 and b"imir" not in box else 0


def _oriented(exif: bytes | None, orientation: int) -> bytes | None:
    """Return the EXIF block with an orientation; HEIC has its own, and the one in the block counts for nothing."""
    block = Image.Exif()
    if exif:
        block.load(exif)
    if block.get(ORIENTATION, 1) == orientation:
        return exif
    block[ORIENTATION] = orientation
    return b"Exif\0\0" + block.tobytes().removeprefix(b"Exif\0\0")
