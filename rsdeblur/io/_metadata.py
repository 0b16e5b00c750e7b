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

from rsdeblur.errors import RsdeblurWarning
from rsdeblur.io import _exif_block
from rsdeblur.io._exif_block import PREFIX

# Parts that belong to the original only; the texts are for messages.
C2PA = "the C2PA manifest, which is valid for the bytes of the original only"
GAIN_MAP = "the HDR gain map, which fits the blurred picture"
APPENDED = "the pictures behind the photo (MPF: gain map, preview, depth)"
MOTION = "the video of the motion photo"
EXTENDED = "the extended part of the XMP packet (depth map or original picture)"
DESCRIBES = "the XMP packet, which describes parts of the original that the result does not have"

# Photoshop's numbers of resources, and TIFF's of tags.
IPTC_RESOURCE = 0x0404
XMP_TAG, IPTC_TAG, C2PA_TAG = 700, 33723, 0xCD41
# The type of the box that holds a manifest in a HEIF file.
C2PA_BOX = bytes.fromhex("d8fec3d61b0e483c92975828877ec481")
HEIF_GAIN_MAPS = (b"aux:hdrgainmap", b"tmap")
# Texts in packets of pictures with a gain map, with a video, and with anything else that a result does not have: places
# of depth maps, sounds and extended packets, a thumbnail of the blurred photo, the address of a C2PA manifest.
GAIN_MAP_TEXTS = (b"hdrgm:", b"HDRGainMap:", b'"GainMap"', b">GainMap<")
MOTION_TEXTS = (b"MotionPhoto", b"MicroVideo")
OTHER_TEXTS = (
    *(b"/photos/1.0/container/", b"/photos/1.0/depthmap/", b"/photos/1.0/image/", b"/photos/1.0/audio/"),
    *(b"/photos/dd/1.0/device/", b"HasExtendedXMP", b"xmp:Thumbnails", b"dcterms:provenance"),
)
# The longest EXIF block, XMP packet and IPTC record of a JPEG.
JPEG_MOST = {"exif": 65_533, "xmp": 65_502, "iptc": 65_500}
NAMES = {"exif": "the EXIF block", "xmp": "the XMP packet", "iptc": "the IPTC record"}
PNG_IPTC = "Raw profile type iptc"

# Most bytes of a tag that is read.
LARGEST_TAG = 2**24
# px: the size of a thumbnail that EXIF recommends; and its qualities as a JPEG: some 6 kB, and less for a small place.
THUMBNAIL = 160, 160
QUALITIES = 80, 50, 20
# Most bytes of samples in a classic TIFF: its offsets have 32 bits, and its tags need room too.
CLASSIC_BYTES = 2**32 - 2**24


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
    if exif and not exif.startswith(PREFIX):
        exif = PREFIX + exif
    iptc = resources.get(IPTC_RESOURCE) or _png_iptc(image.info.get(PNG_IPTC))
    segments = getattr(image, "applist", [])
    found = {
        C2PA: any(name == "APP11" and b"jumb" in body and b"c2pa" in body for name, body in segments)
        or any(name == b"caBX" for name, *_ in getattr(image, "private_chunks", []))
        or (image.format == "WEBP" and b"C2PA" in _riff_chunks(data)),
        GAIN_MAP: _describes(xmp, GAIN_MAP_TEXTS),
        APPENDED: any(body.startswith(b"MPF\0") for _, body in segments) and not _describes(xmp, GAIN_MAP_TEXTS),
        MOTION: _describes(xmp, MOTION_TEXTS),
        EXTENDED: any(body.startswith(b"http://ns.adobe.com/xmp/extension/\0") for _, body in segments),
    }
    losses = tuple(text for text, is_there in found.items() if is_there)
    return Metadata(exif or None, image.info.get("icc_profile"), _as_bytes(xmp), iptc or None, losses)


def of_tiff(page: tifffile.TiffPage, exif: bytes | None = None, loss: str = "") -> Metadata:
    """Return the metadata of a TIFF file's first page, whose EXIF block lost something."""
    xmp, iptc = (_tag_bytes(page, tag) for tag in (XMP_TAG, IPTC_TAG))
    found = {C2PA: C2PA_TAG in page.tags, loss: bool(loss)}
    return Metadata(exif, page.iccprofile, xmp, iptc, tuple(text for text, is_there in found.items() if is_there))


def of_heif(info: dict[str, Any], exif: bytes | None, data: bytes) -> Metadata:
    """Return the metadata of a HEIC file; `info` is that of pillow-heif."""
    xmp = _as_bytes(info.get("xmp"))
    # The first box of a file with several pictures lists them.
    found = {
        C2PA: C2PA_BOX in data,
        GAIN_MAP: _describes(xmp, GAIN_MAP_TEXTS) or any(mark in data[: 2**16] for mark in HEIF_GAIN_MAPS),
        MOTION: _describes(xmp, MOTION_TEXTS),
    }
    losses = tuple(text for text, is_there in found.items() if is_there)
    return Metadata(exif, info.get("icc_profile"), xmp, None, losses)


def _describes(xmp: bytes | str | None, texts: tuple[bytes, ...]) -> bool:
    packet = _as_bytes(xmp) or b""
    return any(text in packet for text in texts)


def _as_bytes(xmp: bytes | str | None) -> bytes | None:
    return (xmp.encode() if isinstance(xmp, str) else xmp) or None


def _tag_bytes(page: tifffile.TiffPage, number: int) -> bytes | None:
    tag = page.tags.get(number)
    if tag is None:
        return None
    file = page.parent.filehandle
    file.seek(tag.valueoffset)
    return bytes(file.read(min(tag.valuebytecount, LARGEST_TAG))) or None


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


def renewed(old: Metadata, pixels: NDArray[Any], kind: str, *, transfer: str, is_done: bool = True) -> Metadata:
    """Return the metadata for a result."""
    height, width = pixels.shape[:2]
    losses = list(old.losses)
    if old.exif:
        draw = (lambda most: _thumbnail(pixels, transfer, most)) if is_done else lambda _: None
        old = replace(old, exif=_exif_block.renewed(old.exif, width, height, draw))
    if old.xmp and _describes(old.xmp, GAIN_MAP_TEXTS + MOTION_TEXTS + OTHER_TEXTS):
        old, losses = replace(old, xmp=None), [*losses, DESCRIBES]
    for name, reason in _refused(old, pixels, kind).items():
        without: dict[str, Any] = {name: None}
        old, losses = replace(old, **without), [*losses, f"{NAMES[name]}, {reason}"]
    if kind == "TIFF" and old.exif and (loss := _exif_block.of_block(old.exif).loss):
        losses.append(loss)
    if losses:
        warnings.warn(f"left out of the result: {'; '.join(losses)}", RsdeblurWarning, stacklevel=4)
    return replace(old, losses=())


def _refused(metadata: Metadata, pixels: NDArray[Any], kind: str) -> dict[str, str]:
    """Return the blocks that a file cannot hold, with the reason."""
    blocks = {name: block for name in NAMES if (block := getattr(metadata, name))}
    if kind == "NumPy":
        return dict.fromkeys(blocks, "which NumPy files do not have")
    if kind == "WebP":
        return {"iptc": "which WebP files do not have"} if "iptc" in blocks else {}
    if kind == "JPEG":
        return {
            name: f"whose {len(block)} bytes are too many for JPEG"
            for name, block in blocks.items()
            if len(block) > JPEG_MOST[name]
        }
    if kind == "TIFF" and "exif" in blocks:
        if pixels.nbytes > CLASSIC_BYTES:
            return {"exif": "which a TIFF of more than 4 GB cannot hold"}
        try:
            _exif_block.of_block(blocks["exif"])
        except ValueError as error:
            return {"exif": f"which is damaged: {error}"}
    return {}


def _thumbnail(pixels: NDArray[Any], transfer: str, most: int) -> bytes | None:
    """Return a small JPEG of a picture, of at most `most` bytes; None if it does not fit."""
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
    for quality in QUALITIES:
        buffer = BytesIO()
        image.save(buffer, "JPEG", quality=quality)
        if len(buffer.getvalue()) <= most:
            return buffer.getvalue()
    return None
