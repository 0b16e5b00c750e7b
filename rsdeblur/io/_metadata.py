"""Metadata of pictures: found in files of each format, and renewed for a result."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass, replace
from io import BytesIO
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray
from PIL import Image

from rsdeblur._config import VERSION
from rsdeblur.errors import RsdeblurWarning
from rsdeblur.io import _exif_renewal, _xmp, directories

AGENT = f"rsdeblur {VERSION}"

# Parts that belong to the original only; the texts are for messages.
C2PA = "the C2PA manifest, which is valid for the bytes of the original only"
GAIN_MAP = "the HDR gain map, which fits the blurred picture"
APPENDED = "the pictures behind the photo (MPF: gain map, preview, depth)"
MOTION = "the video of the motion photo"
EXTENDED = "the extended part of the XMP packet (depth map or original picture)"

# Photoshop's numbers of resources, and TIFF's of tags.
IPTC_RESOURCE = 0x0404
XMP_TAG, IPTC_TAG, C2PA_TAG = 700, 33723, 0xCD41
# The type of the box that holds a manifest in a HEIF file.
C2PA_BOX = bytes.fromhex("d8fec3d61b0e483c92975828877ec481")
HEIF_GAIN_MAPS = (b"aux:hdrgainmap", b"tmap")
PNG_IPTC = "Raw profile type iptc"

# px: the size of a thumbnail that EXIF recommends; and its quality as a JPEG, which makes some 6 kB.
THUMBNAIL = 160, 160
QUALITY = 80


@dataclass(frozen=True, slots=True)
class Metadata:
    """Metadata of a picture.

    Parameters
    ----------
    exif, icc_profile, xmp, iptc : bytes, optional
        EXIF block, colour profile, XMP packet, IPTC record.
    losses : tuple of str
        Parts of the file that no copy can keep, in words.
    """

    exif: bytes | None = None
    icc_profile: bytes | None = None
    xmp: bytes | None = None
    iptc: bytes | None = None
    losses: tuple[str, ...] = ()


def of_image(image: Image.Image, data: bytes) -> Metadata:
    """Return the metadata of a JPEG, PNG or WebP file, which Pillow has loaded."""
    exif, xmp, resources = image.info.get("exif"), image.info.get("xmp"), image.info.get("photoshop", {})
    if exif and not exif.startswith(directories.PREFIX):
        exif = directories.PREFIX + exif
    iptc = resources.get(IPTC_RESOURCE) or _png_iptc(image.info.get(PNG_IPTC))
    segments = getattr(image, "applist", [])
    found = {
        C2PA: any(name == "APP11" and b"jumb" in body and b"c2pa" in body for name, body in segments)
        or any(name == b"caBX" for name, *_ in getattr(image, "private_chunks", []))
        or (image.format == "WEBP" and b"C2PA" in _riff_chunks(data)),
        GAIN_MAP: _xmp.has_gain_map(xmp),
        APPENDED: any(body.startswith(b"MPF\0") for _, body in segments) and not _xmp.has_gain_map(xmp),
        MOTION: _xmp.has_motion(xmp),
        EXTENDED: any(body.startswith(b"http://ns.adobe.com/xmp/extension/\0") for _, body in segments),
    }
    losses = tuple(text for text, is_there in found.items() if is_there)
    return Metadata(exif or None, image.info.get("icc_profile"), _as_bytes(xmp), iptc or None, losses)


def of_tiff(page: tifffile.TiffPage, exif: bytes | None) -> Metadata:
    """Return the metadata of a TIFF file's first page."""
    xmp, iptc = (_tag_bytes(page, tag) for tag in (XMP_TAG, IPTC_TAG))
    return Metadata(exif, page.iccprofile, xmp, iptc, (C2PA,) if C2PA_TAG in page.tags else ())


def of_heif(info: dict[str, Any], exif: bytes | None, data: bytes) -> Metadata:
    """Return the metadata of a HEIC file; `info` is that of pillow-heif."""
    xmp = _as_bytes(info.get("xmp"))
    # The first box of a file with several pictures lists them.
    found = {
        C2PA: C2PA_BOX in data,
        GAIN_MAP: _xmp.has_gain_map(xmp) or any(mark in data[: 2**16] for mark in HEIF_GAIN_MAPS),
        MOTION: _xmp.has_motion(xmp),
    }
    losses = tuple(text for text, is_there in found.items() if is_there)
    return Metadata(exif, info.get("icc_profile"), xmp, None, losses)


def _as_bytes(xmp: bytes | str | None) -> bytes | None:
    return (xmp.encode() if isinstance(xmp, str) else xmp) or None


def _tag_bytes(page: tifffile.TiffPage, number: int) -> bytes | None:
    tag = page.tags.get(number)
    if tag is None:
        return None
    file = page.parent.filehandle
    file.seek(tag.valueoffset)
    return bytes(file.read(min(tag.valuebytecount, directories.LARGEST))) or None


def _riff_chunks(data: bytes) -> list[bytes]:
    """Return the names of the chunks of a WebP file."""
    names, place = [], 12
    while place + 8 <= len(data):
        names.append(data[place : place + 4])
        size = int.from_bytes(data[place + 4 : place + 8], "little")
        place += 8 + size + size % 2
    return names


def _png_iptc(text: str | bytes | None) -> bytes | None:
    """Return the IPTC record in a text chunk of ImageMagick's form: a name, a length, hexadecimal digits."""
    words = (text.decode("latin-1") if isinstance(text, bytes) else text or "").split(maxsplit=2)
    if len(words) < 3:
        return None
    digits = re.sub(r"\s", "", words[2])
    try:
        record = bytes.fromhex(digits)
    except ValueError:
        return None
    # Some programs wrap it into a resource of Photoshop.
    start = record.find(b"8BIM\x04\x04\0\0") if b"8BIM" in record[:32] else -1
    if start < 0:
        return record
    size = int.from_bytes(record[start + 8 : start + 12], "big")
    return record[start + 12 : start + 12 + size] or None


def png_iptc(record: bytes) -> bytes:
    """Return the text of a PNG chunk for an IPTC record."""
    digits = record.hex()
    lines = "\n".join(digits[i : i + 72] for i in range(0, len(digits), 72))
    return f"\niptc\n{len(record):8d}\n{lines}\n".encode()


def renewed(old: Metadata, pixels: NDArray[Any], *, transfer: str, with_thumbnail: bool = True) -> Metadata:
    """Return the metadata for a result.

    Parameters
    ----------
    old : Metadata
        The metadata of the input.
    pixels : ndarray, shape (H, W) or (H, W, C)
        The result as it is stored.
    transfer : {"srgb", "linear"}
        How its values encode light.
    with_thumbnail : bool
        Whether the result is known, so that a thumbnail can be drawn if the input has one.

    Warns
    -----
    RsdeblurWarning
        If a part of the input is left out: a gain map, a C2PA manifest, a damaged XMP packet.
    """
    height, width = pixels.shape[:2]
    when = _exif_renewal.now()
    exif, xmp, losses = old.exif, old.xmp, old.losses
    if exif:
        draw = with_thumbnail and _exif_renewal.has_thumbnail(exif)
        exif = directories.renewed(exif, width, height)
        exif = _exif_renewal.renewed(exif, AGENT, when, _thumbnail(pixels, transfer) if draw else None)
    if xmp:
        try:
            xmp = _xmp.renewed(xmp, width, height, when)
        except ValueError as error:
            xmp, losses = None, (*losses, f"the XMP packet, which is damaged ({error})")
    if losses:
        warnings.warn(f"left out of the result: {'; '.join(losses)}", RsdeblurWarning, stacklevel=4)
    return replace(old, exif=exif, xmp=xmp, losses=())


def _thumbnail(pixels: NDArray[Any], transfer: str) -> bytes:
    """Return a small JPEG of a picture."""
    step = max(1, max(pixels.shape[:2]) // (4 * max(THUMBNAIL)))
    small = pixels[::step, ::step]
    if small.dtype.kind == "u":
        small = small / np.float32(np.iinfo(small.dtype).max)
    small = np.clip(small, 0.0, 1.0)
    if small.ndim == 3:
        small = small[..., :3] if small.shape[2] > 2 else small[..., 0]
    if transfer == "linear":
        from rsdeblur.image.transfer import from_linear

        small = from_linear(small, "srgb")
    image = Image.fromarray(np.rint(255 * small).astype(np.uint8))
    image.thumbnail(THUMBNAIL)
    buffer = BytesIO()
    image.save(buffer, "JPEG", quality=QUALITY)
    return buffer.getvalue()
