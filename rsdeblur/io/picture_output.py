"""Pictures written with the bit depth, colour profile, EXIF, XMP and IPTC of their originals."""

import os
import zlib
from io import BytesIO
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image
from PIL.PngImagePlugin import putchunk

from rsdeblur._util import validate
from rsdeblur._util.binary import DAMAGE, PREFIX
from rsdeblur._util.files import atomic_write, check_target, checked_path
from rsdeblur.errors import InputError, OutputError
from rsdeblur.image.transfer import quantised
from rsdeblur.io import _tiff
from rsdeblur.io.metadata import Picture, renewed

KINDS = {
    **{".jpg": "JPEG", ".jpeg": "JPEG", ".png": "PNG", ".tif": "TIFF", ".tiff": "TIFF", ".webp": "WebP"},
    ".npy": "NumPy",
}
DEPTHS = {"JPEG": (8,), "PNG": (8, 16), "TIFF": (8, 16, 32), "WebP": (8,), "NumPy": (8, 16, 32)}


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
        Source of the bit depth (or the next lower one that the format has), of EXIF, XMP and IPTC, and of the colour
        profile if it fits the number of channels. The thumbnail is removed from the EXIF block.
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
        If the format is unknown or cannot hold the picture, or the file exists without `force` or cannot be written.

    Warns
    -----
    RsdeblurWarning
        If `like` has parts that the file does not keep, as gain maps, C2PA manifests, or blocks that it cannot hold.

    Examples
    --------
    >>> import numpy as np
    >>> import rsdeblur
    >>> rsdeblur.write_picture("grey.png", np.zeros((48, 64), np.uint8))
    >>> rsdeblur.read_picture("grey.png").pixels.shape
    (48, 64)
    """
    path = checked_path(path)
    if like is not None:
        validate.instance("like", like, Picture)
    check_writable(path, force=force)
    kind = KINDS[path.suffix.lower()]
    image = _checked(image)
    source = like.pixels if like is not None else image if image.dtype.kind == "u" else None
    depth = _depth(path, kind, source, bits)
    # Solvers overshoot white a little; values of another scale exceed it by far.
    if depth < 32:
        validate.not_beyond_white(image, "write floats (TIFF or .npy)", 2.0)
    pixels = quantised(image, depth)
    if pixels.ndim == 3 and kind == "JPEG" and pixels.shape[2] in (2, 4):
        pixels = pixels[..., 0] if pixels.shape[2] == 2 else pixels[..., :3]
    pixels = np.ascontiguousarray(pixels)
    picture = renewed(like, pixels, kind) if like else Picture(pixels)
    try:
        data = encode(kind, picture)
    except DAMAGE as error:
        height, width = pixels.shape[:2]
        raise OutputError(f"{path}: cannot write {width}x{height} pixels as {kind}: {error}") from error
    with atomic_write(path) as file:
        file.write(data)


def check_writable(path: str | os.PathLike[str], *, force: bool) -> None:
    """Check that `write_picture` can write `path`, before the work that makes the picture."""
    path = checked_path(path)
    validate.boolean("force", force)
    check_kind(path)
    check_target(path, force=force)


def check_kind(path: Path) -> None:
    """Check by its extension that `write_picture` can write a picture."""
    if path.suffix.lower() not in KINDS:
        raise OutputError(f"{path}: unknown picture extension {path.suffix!r}; use one of {', '.join(KINDS)}")


def _checked(image: ArrayLike) -> NDArray[Any]:
    """Return a picture that can be written, as an array."""
    array = validate.array("image", image)
    if array.dtype.kind != "f" and array.dtype not in (np.uint8, np.uint16):
        raise InputError(f"image must be an array of float in [0, 1], uint8 or uint16, got {array.dtype}")
    if array.ndim not in (2, 3) or not array.size or (array.ndim == 3 and array.shape[2] not in (2, 3, 4)):
        raise InputError(f"image must have shape (H, W) or (H, W, C) with C = 2, 3 or 4, got {array.shape}")
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        raise InputError(f"image must be finite, got {np.count_nonzero(~np.isfinite(array))} NaN or infinite values")
    return array


def _depth(path: Path, kind: str, source: NDArray[Any] | None, bits: int | None) -> int:
    if bits is None:
        input_bits = 8 if source is None else 8 * source.dtype.itemsize
        return max(depth for depth in DEPTHS[kind] if depth <= max(input_bits, 8))
    if validate.count("bits", bits, maximum=64) not in DEPTHS[kind]:
        allowed = ", ".join(map(str, DEPTHS[kind]))
        raise OutputError(f"{path}: {kind} cannot hold {bits} bits per sample, only {allowed}; use another extension")
    return bits


def encode(kind: str, picture: Picture) -> bytes:
    """Return the file of a picture, with metadata that its format can hold."""
    if kind == "TIFF":
        return _tiff.encode(picture)
    if kind == "PNG":
        return _encode_png(picture)
    buffer = BytesIO()
    if kind == "NumPy":
        np.save(buffer, picture.pixels, allow_pickle=False)
        return buffer.getvalue()
    options: dict[str, Any] = {"quality": 95, "subsampling": 0}
    if kind == "WebP":
        # The fastest lossless method; the slower ones save 3 % for 3 times the time.
        options = {"lossless": True, "exact": True, "method": 0}
    elif picture.iptc:
        options["extra"] = iptc_segment(picture.iptc)
    blocks = {"exif": picture.exif, "xmp": picture.xmp, "icc_profile": picture.icc_profile}
    options |= {name: block for name, block in blocks.items() if block}
    Image.fromarray(picture.pixels).save(buffer, kind, **options)
    return buffer.getvalue()


def _encode_png(picture: Picture) -> bytes:
    # zlib's default, 6, makes photographs 3 % smaller in 3 times the time.
    data = bytes(imagecodecs.png_encode(picture.pixels, level=2))
    extra = BytesIO()
    if picture.icc_profile:
        putchunk(extra, b"iCCP", b"ICC profile\0\0", zlib.compress(picture.icc_profile))
    if picture.exif:
        putchunk(extra, b"eXIf", picture.exif.removeprefix(PREFIX))
    if picture.xmp:
        putchunk(extra, b"iTXt", b"XML:com.adobe.xmp", bytes(5), picture.xmp)
    header = 33  # bytes of the magic number and IHDR; colour profile and metadata may follow
    return data[:header] + extra.getvalue() + data[header:]


def iptc_segment(record: bytes) -> bytes:
    """Return the segment of a JPEG that holds an IPTC record."""
    body = b"Photoshop 3.0\0" + b"8BIM\x04\x04\0\0" + len(record).to_bytes(4, "big") + record + bytes(len(record) % 2)
    return b"\xff\xed" + (len(body) + 2).to_bytes(2, "big") + body
