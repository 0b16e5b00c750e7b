"""Pictures with their bit depth, colour profile, EXIF, XMP and IPTC.

Reads and writes JPEG, PNG, TIFF, WebP and NumPy files; reads HEIC and raw files. Pixels are always in the sensor's
axes: the orientation in the EXIF block is not applied but carried over, so viewers still turn the result.
"""

from __future__ import annotations

import os
import struct
import threading
import time
import warnings
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from tokenize import TokenError
from typing import Any, BinaryIO, Literal

import imagecodecs
import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from rsdeblur._util import validate
from rsdeblur._util.atomic import atomic_write, check_target
from rsdeblur._util.files import checked_path, open_file, read_file
from rsdeblur._util.one_line import one_line
from rsdeblur._util.threads import held_at_forks
from rsdeblur.errors import FileFormatError, InputError, OutputError
from rsdeblur.io import _heif, _jpeg, _metadata, _raw, _tiff, claims, mapped, untrusted
from rsdeblur.io._encode import encode, quantised
from rsdeblur.io._metadata import Metadata
from rsdeblur.io.claims import Claim
from rsdeblur.io.source import Source

KINDS = {
    ".jpg": "JPEG",
    ".jpeg": "JPEG",
    ".png": "PNG",
    ".tif": "TIFF",
    ".tiff": "TIFF",
    ".webp": "WebP",
    ".npy": "NumPy",
}
DEPTHS = {"JPEG": (8,), "PNG": (8, 16), "TIFF": (8, 16, 32), "WebP": (8,), "NumPy": (8, 16, 32)}
# Solvers overshoot white a little; values of another scale exceed it by far.
OVERSHOOT = 2.0

# The largest phone sensors have 200 megapixels, the largest stitched camera files 400.
MAX_PIXELS = 500_000_000
# A file of a few bytes may claim any size. The size of a phone's picture is believed; a larger picture must not have
# more pixels per byte than a plain one: 85 as JPEG, 260 as lossy WebP, 340 as 8-bit PNG in colour, 1000 in grey.
BELIEVED_PIXELS = 64_000_000
PIXELS_PER_BYTE = 1000

PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
PNG_DEPTH = 24  # Offset of the bit depth: IHDR is always the first chunk.

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
    claim : Claim, optional
        Statement of a signed manifest for results; see :func:`rsdeblur.io.claims.with_claim`.
    """

    pixels: NDArray[Any]
    exif: bytes | None = None
    icc_profile: bytes | None = None
    linear: bool | None = None
    xmp: bytes | None = None
    iptc: bytes | None = None
    losses: tuple[str, ...] = ()
    modified_ns: int | None = None
    claim: Claim | None = None

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
    icc = _fitting(metadata.icc_profile, pixels)
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
    """Return width, height and EXIF block of a picture, if possible without decoding it.

    Raises
    ------
    FileFormatError
        See `read_picture`.
    """
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


def write_picture(
    path: str | os.PathLike[str],
    image: NDArray[Any],
    *,
    like: Picture | None = None,
    force: bool = False,
    bits: int | None = None,
) -> None:
    """Write a picture; the format follows from the extension, the file appears whole or not at all.

    JPEG is written at quality 95 without chroma subsampling and without alpha: colours stay as they are, not blended
    with a background. WebP and PNG are lossless, TIFF is deflated.

    Parameters
    ----------
    path : path-like
        Path that ends in .jpg, .jpeg, .png, .tif, .tiff, .webp or .npy, which keeps neither EXIF nor profile.
    image : ndarray of float, uint8 or uint16, shape (H, W) or (H, W, C)
        Values in [0, 1]; integers represent them by their full range. Values outside are clipped, except in float32
        files, and refused if most are far beyond 1, as of a picture from 0 to 255. C is 2 (grey and alpha), 3 or 4.
    like : Picture, optional
        Source of the bit depth (or the next lower one that the format has), of EXIF, XMP and IPTC, of the file's time,
        of the colour profile if it fits the number of channels, and of the claim, which is signed. Sizes, program,
        date of change and the thumbnail are renewed; XMP properties that belong to other parts of the original file
        are left out.
    force : bool, default False
        Replace an existing file.
    bits : {8, 16, 32}, optional
        Bit depth instead of that of `like`; 32 is float32, TIFF and NumPy only. Without either, that of `image` if it
        holds integers (or the next lower one that the format has), and 8 for floats.

    Raises
    ------
    InputError
        If `image` has a wrong shape or type, contains NaN or infinity, or would become white.
    OutputError
        If the extension is unknown, the format does not support `bits`, the size of the picture or a claim, the file
        exists and `force` is not set, or the file cannot be written.
    FileFormatError
        If the result cannot be signed; see :func:`rsdeblur.io.claims.with_claim`.

    Warns
    -----
    RsdeblurWarning
        If `like` has parts that no copy can keep (gain maps, C2PA manifests), or if EXIF or XMP is left out: it is too
        long for JPEG, XMP is damaged, or EXIF is damaged and the file is a TIFF.

    Examples
    --------
    >>> import numpy as np
    >>> import rsdeblur
    >>> rsdeblur.write_picture("grey.png", np.zeros((48, 64), np.uint8))
    >>> rsdeblur.read_picture("grey.png").pixels.shape
    (48, 64)
    """
    path = checked_path(path)
    claim = None if like is None else validate.instance("like", like, Picture).claim
    check_writable(path, force=force, signed=claim is not None)
    kind = KINDS[path.suffix.lower()]
    _check_image(image)
    source = like.pixels if like is not None else image if image.dtype.kind == "u" else None
    depth = _depth(path, kind, source, bits)
    _check_range(path, image, depth, OVERSHOOT)
    pixels = quantised(image, depth)
    if pixels.ndim == 3 and kind == "JPEG" and pixels.shape[2] in (2, 4):
        pixels = pixels[..., 0] if pixels.shape[2] == 2 else pixels[..., :3]
    metadata = _metadata_for(like, pixels, grey=kind != "WebP") if like else Metadata()
    try:
        data = encode(kind, np.ascontiguousarray(pixels), metadata)
    except DAMAGE as error:
        height, width = pixels.shape[:2]
        raise OutputError(f"{path}: cannot write {width}x{height} pixels as {kind}: {error}") from error
    with atomic_write(path) as file:
        with claims.signed(file, path, kind, claim) as unsigned:
            unsigned.write(data)
        _set_time(file, like)


@contextmanager
def picture_to_fill(
    path: str | os.PathLike[str], shape: tuple[int, ...], *, like: Picture, force: bool = False, in_place: bool = False
) -> Iterator[NDArray[Any]]:
    """Yield an array for the pixels of a picture, which is written when the block ends without an error.

    Parameters
    ----------
    path : path-like
        See `write_picture`.
    shape : (H, W) or (H, W, C)
        Shape of the array.
    like : Picture
        Source of the array's type, and see `write_picture`.
    force : bool, default False
        See `write_picture`.
    in_place : bool, default False
        Map the array to the file instead of keeping it in memory; for TIFF, which is then not compressed, and NumPy
        files only.

    Yields
    ------
    ndarray
        The array to fill.

    Raises
    ------
    InputError, OutputError
        See `write_picture`. Also refused are floats most of which would become white in a file of integers.
    """
    path = checked_path(path)
    check_writable(path, force=force, signed=like.claim is not None)
    _check_range(path, like.pixels, _depth(path, KINDS[path.suffix.lower()], like.pixels, None))
    if not in_place or path.suffix.lower() not in mapped.SUFFIXES:
        pixels = np.empty(shape, like.pixels.dtype)
        yield pixels
        write_picture(path, pixels, like=like, force=force)
        return
    empty = np.broadcast_to(like.pixels.dtype.type(0), shape)
    with atomic_write(path) as file:
        metadata = _metadata_for(like, empty, grey=True, is_done=False)
        with (
            claims.signed(file, path, KINDS[path.suffix.lower()], like.claim) as unsigned,
            mapped.mapped_samples(unsigned, path.suffix.lower(), shape, like.pixels.dtype, metadata) as out,
        ):
            yield out
        _set_time(file, like)


def _set_time(file: BinaryIO, like: Picture | None) -> None:
    """Give a file that is complete the time of the original's last change."""
    if like is not None and like.modified_ns is not None:
        file.flush()
        os.utime(file.name, ns=(time.time_ns(), like.modified_ns))


def check_writable(path: str | os.PathLike[str], *, force: bool, signed: bool = False) -> None:
    """Check that `write_picture` can write `path`, before the work that makes the picture.

    Parameters
    ----------
    path : path-like
        The file to be written.
    force : bool
        Whether an existing file may be replaced.
    signed : bool, default False
        Whether the file will be signed.

    Raises
    ------
    OutputError
        If the extension is unknown, or `signed` and that of a format that cannot be signed; if the folder is missing
        or not writable; or if `path` is a folder, a pipe or a device, or it exists and `force` is not set.
    """
    path = checked_path(path)
    validate.boolean("force", force)
    check_kind(path, signed=signed)
    check_target(path, force=force)


def check_kind(path: Path, *, signed: bool) -> None:
    """Check by its extension that `write_picture` can write a picture, and sign it if `signed`; see `check_writable`.

    Raises
    ------
    OutputError
        If it cannot.
    """
    if path.suffix.lower() not in KINDS:
        raise OutputError(f"{path}: unknown picture extension {path.suffix!r}; use one of {', '.join(KINDS)}")
    if signed:
        claims.check_kind(path, KINDS[path.suffix.lower()])


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
    if data.startswith(_jpeg.START):
        _jpeg.check_scans(data)
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


def _with_plain_mode(image: Image.Image) -> Image.Image:
    """Return `image` as L, LA, RGB or RGBA."""
    grey = image.mode in ("1", "L", "LA", "La")
    mode = ("LA" if grey else "RGBA") if image.has_transparency_data else ("L" if grey else "RGB")
    return image if image.mode == mode else image.convert(mode)


def _metadata_for(like: Picture, pixels: NDArray[Any], *, grey: bool, is_done: bool = True) -> Metadata:
    """Return the metadata of a result, which gets a thumbnail only if it `is_done`."""
    icc = _fitting(like.icc_profile, pixels, grey=grey)
    old = Metadata(like.exif, icc, like.xmp, like.iptc, like.losses)
    return _metadata.renewed(old, pixels, transfer=like.transfer, with_thumbnail=is_done)


def _fitting(icc: bytes | None, pixels: NDArray[Any], *, grey: bool = True) -> bytes | None:
    """Return the profile if its colour space (bytes 16 to 20) is that of `pixels`; `grey`: the file can be grey."""
    space = b"GRAY" if grey and (pixels.ndim == 2 or pixels.shape[2] == 2) else b"RGB "
    return icc if icc and icc[16:20] == space else None


def _check_image(image: NDArray[Any]) -> None:
    if isinstance(image, np.ma.MaskedArray):
        raise InputError("image must not be a masked array: choose values for masked elements with .filled()")
    if not isinstance(image, np.ndarray) or not (image.dtype.kind == "f" or image.dtype in (np.uint8, np.uint16)):
        kind = image.dtype if isinstance(image, np.ndarray) else type(image).__name__
        raise InputError(f"image must be an array of float in [0, 1], uint8 or uint16, got {kind}")
    if image.ndim not in (2, 3) or not image.size or (image.ndim == 3 and image.shape[2] not in (2, 3, 4)):
        raise InputError(f"image must have shape (H, W) or (H, W, C) with C = 2, 3 or 4, got {image.shape}")
    if image.dtype.kind == "f" and not np.isfinite(image).all():
        raise InputError(f"image must be finite, got {np.count_nonzero(~np.isfinite(image))} NaN or infinite values")


def _check_range(path: Path, image: NDArray[Any], bits: int, white: float = 1.0) -> None:
    if bits < 32 and validate.mostly_beyond_white(image, white):
        raise InputError(
            f"{path}: the picture has values of up to {image.max():g}, most of them beyond 1, which is white and the "
            f"most that {bits} bits can hold: divide the picture by its full scale, or write floats (TIFF or .npy)"
        )


def _depth(path: Path, kind: str, source: NDArray[Any] | None, bits: int | None) -> int:
    if bits is None:
        input_bits = 8 if source is None else 8 * source.dtype.itemsize
        return max(depth for depth in DEPTHS[kind] if depth <= max(input_bits, 8))
    if validate.count("bits", bits, maximum=64) not in DEPTHS[kind]:
        allowed = ", ".join(map(str, DEPTHS[kind]))
        raise OutputError(f"{path}: {kind} cannot hold {bits} bits per sample, only {allowed}; use another extension")
    return bits
