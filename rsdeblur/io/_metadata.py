"""Pictures with their metadata, which are found in files of each format, and renewed for a result."""

from __future__ import annotations

import re
import struct
import warnings
from dataclasses import dataclass, replace
from io import BytesIO
from typing import Any, Literal

import numpy as np
import tifffile
from numpy.typing import NDArray
from PIL import Image

from rsdeblur._util.one_line import one_line
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
# Blocks of metadata: the name for messages, and the length of the longest in a JPEG.
BLOCKS = {"exif": ("the EXIF block", 65_533), "xmp": ("the XMP packet", 65_502), "iptc": ("the IPTC record", 65_500)}
PNG_IPTC = "Raw profile type iptc"

# Most bytes of samples in a classic TIFF: its offsets have 32 bits, and its tags need room too.
CLASSIC_BYTES = 2**32 - 2**24


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
            linear = self.pixels.dtype.kind == "f" or self.icc_profile == linear_profile()
        return "linear" if linear else "srgb"


def linear_profile() -> bytes:
    """Return an ICC profile (version 2.1) with sRGB's primaries and linear values."""

    def fixed(*numbers: float) -> bytes:
        return b"XYZ \0\0\0\0" + b"".join(struct.pack(">i", round(number * 65536)) for number in numbers)

    name = b"linear sRGB"
    description = b"desc\0\0\0\0" + struct.pack(">I", len(name) + 1) + name + b"\0" * 79
    # Primaries adapted to D50 (Bradford), as in the profiles of sRGB; an empty curve is the identity.
    tags = {
        b"desc": description,
        b"cprt": b"text\0\0\0\0public domain\0",
        b"wtpt": fixed(0.9642, 1.0, 0.8249),
        b"rXYZ": fixed(0.43607, 0.22249, 0.01392),
        b"gXYZ": fixed(0.38515, 0.71687, 0.09708),
        b"bXYZ": fixed(0.14307, 0.06061, 0.71410),
        **dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"), b"curv\0\0\0\0" + struct.pack(">I", 0)),
    }
    table, body = struct.pack(">I", len(tags)), b""
    start = 128 + 4 + 12 * len(tags)
    for key, value in tags.items():
        table += key + struct.pack(">II", start + len(body), len(value))
        body += value + b"\0" * (-len(value) % 4)
    size = start + len(body)
    header = struct.pack(">I4sI", size, b"\0" * 4, 0x02100000) + b"mntrRGB XYZ "
    header = header.ljust(36, b"\0") + b"acsp"
    header = header.ljust(68, b"\0") + struct.pack(">3i", *(round(v * 65536) for v in (0.9642, 1.0, 0.8249)))
    return header.ljust(128, b"\0") + table + body


def of_image(image: Image.Image, data: bytes, pixels: NDArray[Any]) -> Picture:
    """Return a picture with the metadata of a JPEG, PNG or WebP file, which Pillow has loaded."""
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
    return Picture(
        pixels, exif or None, image.info.get("icc_profile"), None, _as_bytes(xmp), iptc or None, _true(found)
    )


def of_tiff(page: tifffile.TiffPage, pixels: NDArray[Any], exif: bytes | None, loss: str) -> Picture:
    """Return a picture with the metadata of a TIFF file's first page, whose EXIF block lost something."""
    xmp, iptc = (_tag_bytes(page, tag) for tag in (XMP_TAG, IPTC_TAG))
    losses = _true({C2PA: C2PA_TAG in page.tags, loss: bool(loss)})
    return Picture(pixels, exif, page.iccprofile, None, xmp, iptc, losses)


def of_heif(info: dict[str, Any], exif: bytes | None, data: bytes, pixels: NDArray[Any]) -> Picture:
    """Return a picture with the metadata of a HEIC file; `info` is that of pillow-heif."""
    xmp = _as_bytes(info.get("xmp"))
    # The first box of a file with several pictures lists them.
    found = {
        C2PA: C2PA_BOX in data,
        GAIN_MAP: _describes(xmp, GAIN_MAP_TEXTS) or any(mark in data[: 2**16] for mark in HEIF_GAIN_MAPS),
        MOTION: _describes(xmp, MOTION_TEXTS),
    }
    return Picture(pixels, exif, info.get("icc_profile"), None, xmp, None, _true(found))


def _true(found: dict[str, bool]) -> tuple[str, ...]:
    return tuple(text for text, is_there in found.items() if is_there)


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
    return bytes(file.read(min(tag.valuebytecount, 2**24))) or None


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


def renewed(old: Picture, pixels: NDArray[Any], kind: str, *, is_done: bool = True) -> Picture:
    """Return a result with the metadata of its original; it gets a thumbnail only if it `is_done`."""
    height, width = pixels.shape[:2]
    losses = list(old.losses)
    new = replace(old, pixels=pixels, icc_profile=fitting_profile(old.icc_profile, pixels, grey=kind != "WebP"))
    if old.exif:
        draw = (lambda most: _thumbnail(pixels, old.transfer, most)) if is_done else lambda _: None
        new = replace(new, exif=_exif_block.renewed(old.exif, width, height, draw))
    if old.xmp and _describes(old.xmp, GAIN_MAP_TEXTS + MOTION_TEXTS + OTHER_TEXTS):
        new, losses = replace(new, xmp=None), [*losses, DESCRIBES]
    for name, reason in _refused(new, kind).items():
        without: dict[str, Any] = {name: None}
        new, losses = replace(new, **without), [*losses, f"{BLOCKS[name][0]}, {reason}"]
    if kind == "TIFF" and new.exif and (loss := _exif_block.of_block(new.exif).loss):
        losses.append(loss)
    if losses:
        warnings.warn(f"left out of the result: {'; '.join(losses)}", RsdeblurWarning, stacklevel=3)
    return new


def fitting_profile(icc: bytes | None, pixels: NDArray[Any], *, grey: bool = True) -> bytes | None:
    """Return the profile if its colour space (bytes 16 to 20) is that of `pixels`; `grey`: the file can be grey."""
    space = b"GRAY" if grey and (pixels.ndim == 2 or pixels.shape[2] == 2) else b"RGB "
    return icc if icc and icc[16:20] == space else None


def _refused(picture: Picture, kind: str) -> dict[str, str]:
    """Return the blocks that a file cannot hold, with the reason."""
    blocks = {name: block for name in BLOCKS if (block := getattr(picture, name))}
    if kind == "NumPy":
        return dict.fromkeys(blocks, "which NumPy files do not have")
    if kind == "WebP":
        return {"iptc": "which WebP files do not have"} if "iptc" in blocks else {}
    if kind == "JPEG":
        reason = "whose {} bytes are too many for JPEG"
        return {name: reason.format(len(block)) for name, block in blocks.items() if len(block) > BLOCKS[name][1]}
    if kind == "TIFF" and "exif" in blocks:
        if picture.pixels.nbytes > CLASSIC_BYTES:
            return {"exif": "which a TIFF of more than 4 GB cannot hold"}
        try:
            _exif_block.of_block(blocks["exif"])
        except ValueError as error:
            return {"exif": f"which is damaged: {error}"}
    return {}


def _thumbnail(pixels: NDArray[Any], transfer: str, most: int) -> bytes | None:
    """Return a small JPEG of a picture, of at most `most` bytes; None if it does not fit."""
    side = 160  # px: the size that EXIF recommends
    step = max(1, max(pixels.shape[:2]) // (4 * side))
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
    image.thumbnail((side, side))
    for quality in (80, 50, 20):  # some 6 kB, and less for a small place
        buffer = BytesIO()
        image.save(buffer, "JPEG", quality=quality)
        if len(buffer.getvalue()) <= most:
            return buffer.getvalue()
    return None
