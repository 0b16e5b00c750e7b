"""Pictures with their bit depth, colour profile, EXIF, XMP and IPTC.

Reads JPEG, PNG, TIFF, WebP, NumPy, HEIC and raw files; :mod:`rsdeblur.io.picture_output` writes pictures. Pixels are
always in the sensor's axes: the orientation in the EXIF block is not applied but carried over, so viewers still turn
the result.
"""

from __future__ import annotations

import os
import re
import struct
import threading
import warnings
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from tokenize import TokenError
from typing import Any, Literal

import imagecodecs
import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from rsdeblur._util import validate
from rsdeblur._util.files import checked_path, open_file, read_file
from rsdeblur._util.one_line import one_line
from rsdeblur._util.threads import held_at_forks
from rsdeblur.errors import FileFormatError
from rsdeblur.io import _heif, _metadata, _raw, _tiff, mapped, untrusted
from rsdeblur.io._metadata import Metadata
from rsdeblur.io.source import Source

# The largest phone sensors have 200 megapixels, the largest stitched camera files 400.
MAX_PIXELS = 500_000_000
# A file of a few bytes may claim any size. The size of a phone's picture is believed; a larger picture must not have
# more pixels per byte than a plain one: 85 as JPEG, 260 as lossy WebP, 340 as 8-bit PNG in colour, 1000 in grey.
BELIEVED_PIXELS = 64_000_000
PIXELS_PER_BYTE = 1000

PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
PNG_DEPTH = 24  # Offset of the bit depth: IHDR is always the first chunk.

# Encoders write about ten scans into a progressive picture. Each scan takes as long to decode as a whole picture,
# but its data may be as short as fifty bytes.
MOST_SCANS = 100
# Pictures may have twelve scans at any size, and more while the pixels of all scans are at most these: some 2 s.
ORDINARY_SCANS, MOST_SCANNED = 12, 1_000_000_000

JPEG_START, END, SCAN = b"\xff\xd8", b"\xff\xd9", b"\xff\xda"
# Start of frame, of any coding; after the segment's length and the precision it has height and width.
FRAMES = [bytes((0xFF, kind)) for kind in range(0xC0, 0xD0) if kind not in (0xC4, 0xC8, 0xCC)]
# Inside coded samples, 0xFF is followed by 0 or by a restart marker (D0 to D7); these are not matched.
MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")

# Errors that decoders are known to raise on damaged files.
DAMAGE = (
    *(OSError, EOFError, ValueError, TypeError, LookupError, ArithmeticError, AttributeError, struct.error, zlib.error),
    *(SyntaxError, AssertionError),  # Pillow
    RuntimeError,  # imagecodecs
    TokenError,  # NumPy, from the header of its files
)

_limit_lock = held_at_forks(threading.RLock())


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    r"""A picture as stored in a file.

    Parameters
    ----------
    pixels : ndarray, shape (H, W) or (H, W, C)
        Samples: uint8 or uint16 of full range, or float32. C is 2 for grey and alpha, 3 for RGB, 4 for RGB and alpha.
    exif : bytes, optional
        The EXIF block, from its ``Exif\0\0`` prefix on.
    icc_profile : bytes, optional
        The colour profile.
    linear : bool, optional
        Whether the values are proportional to light. By default true for floats and for pictures with the colour
        profile that raw files get here.
    xmp : bytes, optional
        The XMP packet.
    iptc : bytes, optional
        The IPTC record.
    losses : tuple of str, optional
        Parts of the file that a copy cannot keep, in words, such as gain maps and C2PA manifests.
    modified_ns : int, optional
        Time of the file's last change, in ns since 1970.
    """

    pixels: NDArray[Any]
    exif: bytes | None = None
    icc_profile: bytes | None = None
    linear: bool | None = None
    xmp: bytes | None = None
    iptc: bytes | None = None
    losses: tuple[str, ...] = ()
    modified_ns: int | None = None

    @property
    def transfer(self) -> Literal["srgb", "linear"]:
        """How the values encode light."""
        linear = self.linear
        if linear is None:
            linear = self.pixels.dtype.kind == "f" or self.icc_profile == _raw.linear_profile()
        return "linear" if linear else "srgb"


def read_picture(path: str | os.PathLike[str], *, in_place: bool = False) -> Picture:
    """Read a JPEG, PNG, TIFF, WebP, NumPy, HEIC or raw file; the content decides the format.

    Palettes become RGB, bilevel pictures 8-bit grey, and CMYK and other colour spaces RGB (without their profile). Of
    several pages or frames the first is read. HEIC (extra ``[heif]``) is turned back to the sensor's axes. Raw files
    and DNG (extra ``[raw]``) are developed with the camera's white balance to linear light; makers' formats that are
    TIFF inside are recognised by their extension.

    Parameters
    ----------
    path : path-like
        The picture.
    in_place : bool, default False
        Map the pixels of a NumPy file or an uncompressed TIFF into memory instead of reading them. The file must not
        change while they are in use.

    Returns
    -------
    Picture
        The picture, with read-only pixels as stored.

    Raises
    ------
    FileFormatError
        If the file cannot be read, is empty, truncated, damaged or not a picture of these formats; if its extra is not
        installed or the memory is too small; or if it has more than 500 megapixels, more than 64 megapixels (a TIFF:
        16) at over 1000 pixels per byte, or samples other than 1 to 8 bit, 16 bit or float.

    Examples
    --------
    >>> import numpy as np
    >>> import rsdeblur
    >>> rsdeblur.write_picture("photo.png", np.zeros((48, 64, 3), np.uint8))
    >>> picture = rsdeblur.read_picture("photo.png")
    >>> picture.pixels.dtype, picture.transfer
    (dtype('uint8'), 'srgb')
    """
    path = checked_path(path)
    if validate.boolean("in_place", in_place):
        with open_file(path, "picture") as file, _decoding(path):
            if content := mapped.map_picture(file, MAX_PIXELS):
                return _picture(*content, path)
    data = read_file(path, "picture")
    if not data:
        raise FileFormatError(f"{path}: not a picture: the file is empty")
    with _decoding(path):
        picture = _picture(*_decode(data, path.suffix), path)
    if not picture.pixels.size:
        raise FileFormatError(f"{path}: the picture has no pixels")
    picture.pixels.setflags(write=False)
    return picture


def _picture(pixels: NDArray[Any], metadata: Metadata, path: Path) -> Picture:
    icc = fitting_profile(metadata.icc_profile, pixels)
    more = metadata.xmp, metadata.iptc, metadata.losses, path.stat().st_mtime_ns
    return Picture(pixels, metadata.exif, icc, None, *more)


@contextmanager
def _decoding(path: Path) -> Iterator[None]:
    """Turn the errors of decoders into errors that name the file."""
    try:
        yield
    except UnidentifiedImageError:
        # Imported here because it imports the readers of all kinds.
        from rsdeblur.io.kinds import mistaken

        source = Source(path, "picture")
        if is_picture(source):
            raise FileFormatError(f"{path}: the picture is truncated or damaged: its header cannot be read") from None
        raise mistaken(source) or FileFormatError(
            f"{path}: not a JPEG, PNG, TIFF, WebP, NumPy, HEIC or raw picture; convert other pictures first"
        ) from None
    except (Image.DecompressionBombError, _tiff.Unsupported, _heif.MissingPackage, untrusted.Blocked) as error:
        raise FileFormatError(f"{path}: {error}") from error
    except MemoryError as error:
        raise FileFormatError(f"{path}: not enough memory for the picture, or its size is damaged") from error
    except DAMAGE as error:
        raise FileFormatError(f"{path}: the picture is truncated or damaged: {error}") from error


def is_picture(source: Source) -> bool:
    """Whether the content starts like a picture."""
    head = source.head
    return (
        head.startswith((b"\xff\xd8\xff", PNG_MAGIC, *_tiff.MAGIC, *_raw.MAGIC))
        or (head[:4], head[8:12]) == (b"RIFF", b"WEBP")
        or head[4:12] == b"ftypcrx "
        or head.startswith(mapped.NPY_MAGIC)
        or _heif.is_heif(head)
    )


def read_header(path: str | os.PathLike[str]) -> tuple[int, int, bytes | None]:
    """Return width, height and EXIF block of a picture, if possible without decoding it."""
    try:
        with (
            open_file(path, "picture") as file,
            _size_limit(),
            Image.open(file, formats=("JPEG", "PNG", "WEBP")) as image,
        ):
            return *image.size, image.info.get("exif")
    except FileFormatError:
        raise
    except (*DAMAGE, Image.DecompressionBombError):
        picture = read_picture(path)
        height, width = picture.pixels.shape[:2]
        return width, height, picture.exif


@contextmanager
def _size_limit(pixels: int = MAX_PIXELS) -> Iterator[None]:
    """Move Pillow's guard against decompression bombs from 179 megapixels to `pixels`."""
    with _limit_lock, warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        saved = Image.MAX_IMAGE_PIXELS
        # Pillow refuses pictures of more than twice this.
        Image.MAX_IMAGE_PIXELS = pixels // 2
        try:
            yield
        finally:
            Image.MAX_IMAGE_PIXELS = saved


def _decode(data: bytes, suffix: str) -> tuple[NDArray[Any], Metadata]:
    limit = min(MAX_PIXELS, max(BELIEVED_PIXELS, PIXELS_PER_BYTE * len(data)))
    if _raw.is_raw(data, suffix):
        return _raw.decode(data, limit)
    if _heif.is_heif(data):
        return _heif.decode(data, limit)
    if data.startswith(_tiff.MAGIC):
        return _tiff.decode(data, min(limit, max(_tiff.BELIEVED_PIXELS, PIXELS_PER_BYTE * len(data))))
    if data.startswith(mapped.NPY_MAGIC):
        return mapped.decode_npy(data, MAX_PIXELS), Metadata()
    if data.startswith(JPEG_START):
        check_scans(data)
    with _size_limit(limit):
        image = Image.open(BytesIO(data), formats=("JPEG", "PNG", "WEBP"))
    with image:
        image.load()
        if image.format == "PNG" and data[PNG_DEPTH] == 16:
            # Pillow reduces 16-bit colour to 8 bit.
            untrusted.check("16-bit PNG", "imagecodecs")
            pixels = imagecodecs.png_decode(data)
        else:
            pixels = np.array(_with_plain_mode(image))
        return pixels, _metadata.of_image(image, data)


def check_scans(data: bytes) -> None:
    """Refuse a JPEG with too many scans."""
    place, scans, most = len(JPEG_START), 0, MOST_SCANS
    while (marker := MARKER.search(data, place)) and marker[0] != END:
        start = marker.end()
        if marker[0] in FRAMES:
            height, width = (int.from_bytes(data[start + n : start + n + 2], "big") for n in (3, 5))
            most = min(MOST_SCANS, max(ORDINARY_SCANS, MOST_SCANNED // max(height * width, 1)))
        scans += marker[0] == SCAN
        if scans > most:
            raise ValueError(f"the JPEG has more than {most} scans")
        place = start + int.from_bytes(data[start : start + 2], "big")


def _with_plain_mode(image: Image.Image) -> Image.Image:
    """Return `image` as L, LA, RGB or RGBA."""
    grey = image.mode in ("1", "L", "LA", "La")
    mode = ("LA" if grey else "RGBA") if image.has_transparency_data else ("L" if grey else "RGB")
    return image if image.mode == mode else image.convert(mode)


def fitting_profile(icc: bytes | None, pixels: NDArray[Any], *, grey: bool = True) -> bytes | None:
    """Return the profile if its colour space (bytes 16 to 20) is that of `pixels`; `grey`: the file can be grey."""
    space = b"GRAY" if grey and (pixels.ndim == 2 or pixels.shape[2] == 2) else b"RGB "
    return icc if icc and icc[16:20] == space else None
