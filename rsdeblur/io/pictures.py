"""Pictures with their bit depth, colour profile, EXIF, XMP and IPTC; PSFs and depths in pictures and NumPy files.

Reads JPEG, PNG, TIFF, WebP, NumPy, HEIC and raw files; :mod:`rsdeblur.io.picture_output` writes pictures. Pixels are
always in the sensor's axes: the orientation in the EXIF block is not applied but carried over, so viewers still turn
the result.
"""

import os
import warnings
from dataclasses import replace
from io import BytesIO
from typing import Any

import imagecodecs
import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError
from scipy import ndimage

from rsdeblur._util import validate
from rsdeblur._util.binary import DAMAGE
from rsdeblur._util.files import checked_path, open_file, read_file
from rsdeblur.errors import FileFormatError, InputError
from rsdeblur.io import _sensor, _tiff
from rsdeblur.io.formats import mistaken
from rsdeblur.io.metadata import Picture as Picture
from rsdeblur.io.metadata import fitting_profile, of_info
from rsdeblur.io.source import Source
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatArray

# The largest phone sensors have 200 megapixels, the largest stitched camera files 400.
MAX_PIXELS = 500_000_000
# A file of a few bytes may claim any size. The size of a phone's picture is believed; a larger picture must not have
# more pixels per byte than a plain one: 85 as JPEG, 260 as lossy WebP, 340 as 8-bit PNG in colour, 1000 in grey.
BELIEVED_PIXELS = 64_000_000
PIXELS_PER_BYTE = 1000

PNG_MAGIC, NPY_MAGIC = b"\x89PNG\r\n\x1a\n", b"\x93NUMPY"


def read_picture(path: str | os.PathLike[str]) -> Picture:
    """Read a JPEG, PNG, TIFF, WebP, NumPy, HEIC or raw file; the content decides the format.

    Palettes become RGB, bilevel pictures 8-bit grey, and CMYK and other colour spaces RGB (without their profile). Of
    several pages or frames the first is read. HEIC (extra ``[heif]``) is turned back to the sensor's axes. Raw files
    and DNG (extra ``[raw]``) are developed with the camera's white balance to linear light; makers' formats that are
    TIFF inside are recognised by their extension.

    Parameters
    ----------
    path : path-like
        The picture.

    Returns
    -------
    Picture
        The picture, with read-only pixels as stored.

    Raises
    ------
    FileFormatError
        If the file is damaged or not a picture of these formats; if its extra is not installed; or if it has more than
        500 megapixels, more than 64 at over 1000 pixels per byte, or samples other than 1 to 8 bit, 16 bit or float.

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
    data = read_file(path, "picture")
    if not data:
        raise FileFormatError(f"{path}: not a picture: the file is empty")
    try:
        picture = _decode(data, path.suffix)
    except UnidentifiedImageError:
        raise mistaken(Source(path, "picture")) or FileFormatError(
            f"{path}: not a JPEG, PNG, TIFF, WebP, NumPy, HEIC or raw picture, or its header is damaged; convert other "
            "pictures first"
        ) from None
    except (Image.DecompressionBombError, FileFormatError) as error:
        raise FileFormatError(f"{path}: {error}") from error
    except MemoryError as error:
        raise FileFormatError(f"{path}: not enough memory for the picture, or its size is damaged") from error
    except DAMAGE as error:
        raise FileFormatError(f"{path}: the picture is truncated or damaged: {error}") from error
    if not picture.pixels.size:
        raise FileFormatError(f"{path}: the picture has no pixels")
    picture.pixels.setflags(write=False)
    return replace(picture, icc_profile=fitting_profile(picture.icc_profile, picture.pixels))


def _of_npy(data: bytes) -> NDArray[Any]:
    pixels = np.load(BytesIO(data), allow_pickle=False)
    is_picture = pixels.ndim == 2 or (pixels.ndim == 3 and pixels.shape[2] in (2, 3, 4))
    if not is_picture or not pixels.size or pixels.dtype not in (np.uint8, np.uint16, np.float32):
        raise FileFormatError(
            f"the array has shape {pixels.shape} and type {pixels.dtype}; a picture is not empty, and has shape (H, W) "
            "or (H, W, C) with C = 2, 3 or 4 and type uint8, uint16 or float32"
        )
    return np.ascontiguousarray(pixels)


def is_picture(source: Source) -> bool:
    """Whether the content starts like a picture."""
    head = source.head
    magic = (b"\xff\xd8\xff", PNG_MAGIC, NPY_MAGIC, *_tiff.MAGIC, *_sensor.RAW_MAGIC)
    is_webp = head[:4] == b"RIFF" and head[8:12] == b"WEBP"
    return head.startswith(magic) or is_webp or head[4:12] == b"ftypcrx " or _sensor.is_heif(head)


def read_header(path: str | os.PathLike[str]) -> tuple[int, int, bytes | None]:
    """Return width, height and EXIF block of a picture, if possible without decoding it."""
    try:
        with open_file(path, "picture") as file, Image.open(file, formats=("JPEG", "PNG", "WEBP")) as image:
            return *image.size, image.info.get("exif")
    except FileFormatError:
        raise
    except (*DAMAGE, Image.DecompressionBombError):
        picture = read_picture(path)
        height, width = picture.pixels.shape[:2]
        return width, height, picture.exif


def _decode(data: bytes, suffix: str) -> Picture:
    limit = min(MAX_PIXELS, max(BELIEVED_PIXELS, PIXELS_PER_BYTE * len(data)))
    if _sensor.is_raw(data, suffix):
        return _sensor.decode_raw(data, limit)
    if _sensor.is_heif(data):
        return _sensor.decode_heif(data, limit)
    if data.startswith(_tiff.MAGIC):
        return _tiff.decode(data, limit)
    if data.startswith(NPY_MAGIC):
        return Picture(_of_npy(data))
    # Pillow warns of more than 179 megapixels, and refuses more than 358.
    with warnings.catch_warnings(action="ignore", category=Image.DecompressionBombWarning):
        image = Image.open(BytesIO(data), formats=("JPEG", "PNG", "WEBP"))
    if image.width * image.height > limit:
        raise FileFormatError(f"the picture claims {image.width}x{image.height} pixels; the limit is {limit}")
    with image:
        image.load()
        # Pillow reduces 16-bit colour to 8 bit. IHDR, with the bit depth at byte 24, is always the first chunk.
        if image.format == "PNG" and data[24] == 16:
            pixels = imagecodecs.png_decode(data)
        else:
            pixels = np.array(_with_plain_mode(image))
        return of_info(image.info, data, pixels, image.info.get("exif"))


def _with_plain_mode(image: Image.Image) -> Image.Image:
    """Return `image` as L, LA, RGB or RGBA."""
    grey = image.mode in ("1", "L", "LA", "La")
    mode = ("LA" if grey else "RGBA") if image.has_transparency_data else ("L" if grey else "RGB")
    return image if image.mode == mode else image.convert(mode)


def read_psfs(path: str | os.PathLike[str], shape: tuple[int, ...]) -> PsfBank:
    """Read the PSFs of a picture."""
    with open_file(path, "PSF") as file:
        if file.read(2) == b"PK":
            return PsfBank.load(path)
    stored, is_picture = _array_or_picture(path, "PSF")
    try:
        values = validate.real_array("PSFs", stored, most=validate.MOST_LIGHT)
        if is_picture and values.ndim == 3:  # the mean of the colours, without alpha
            values = values[:, :, : values.shape[2] - (values.shape[2] in (2, 4))].mean(axis=2)
        if values.ndim not in (2, 4) or values.size == 0:
            raise InputError(f"a PSF has shape (kh, kw), PSFs have (B, S, kh, kw), found {values.shape}")
        return PsfBank.for_picture(values, shape)
    except InputError as error:
        raise FileFormatError(f"{path}: {error}") from error


def read_depths(path: str | os.PathLike[str]) -> FloatArray:
    """Read a map of depths, as `depth` of :class:`rsdeblur.Translation` takes it.

    Parameters
    ----------
    path : path-like
        A NumPy file or a picture of one channel that spans the photo as stored, at any resolution. Floats are metres;
        whole numbers of 16 bits or more are millimetres. Where a value is 0 or not a number, the depth is unknown.

    Returns
    -------
    ndarray, shape (R, C), float64
        Depths along the optical axis in m. An unknown depth is that of the nearest place that is known.

    Raises
    ------
    FileFormatError
        If the file cannot be read, has several channels or 8 bits, or contains a negative or no depth.

    Examples
    --------
    >>> import numpy as np, rsdeblur, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     np.save(f"{folder}/depth.npy", np.array([[900, 0], [2500, 2500]], dtype=np.uint16))
    ...     rsdeblur.io.read_depths(f"{folder}/depth.npy")
    array([[0.9, 0.9],
           [2.5, 2.5]])
    """
    stored, _ = _array_or_picture(path, "depth map")
    if stored.dtype.kind not in "uif" or stored.dtype.itemsize < 2:
        raise FileFormatError(f"{path}: depths are floats in m or whole numbers of 16 bits in mm, found {stored.dtype}")
    if stored.ndim != 2:
        raise FileFormatError(f"{path}: a map of depths has shape (R, C), found {stored.shape}")
    depths = stored.astype(np.float64) * (1.0 if stored.dtype.kind == "f" else 1e-3)
    known = np.isfinite(depths) & (depths != 0)
    if not known.any() or depths[known].min() < 0:
        found = f"{depths[known].min():g} m" if known.any() else "none"
        raise FileFormatError(f"{path}: depths must be positive, found {found}")
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    filled: FloatArray = depths[tuple(nearest)]
    return filled


def _array_or_picture(path: str | os.PathLike[str], what: str) -> tuple[NDArray[Any], bool]:
    """Return the values of a NumPy file or of a picture, and whether it is a picture."""
    with open_file(path, what) as file:
        if file.read(len(NPY_MAGIC)) != NPY_MAGIC:
            return read_picture(path).pixels, True
        file.seek(0)
        try:
            return np.load(file, allow_pickle=False), False
        except Exception as error:  # NumPy's header parser raises many kinds on damaged files
            raise FileFormatError(f"{path}: not an array of {what}s: {error}") from error
