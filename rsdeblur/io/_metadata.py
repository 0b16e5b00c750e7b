"""Pictures with their metadata, which are found in files of each format, and renewed for a result."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from numpy.typing import NDArray

from rsdeblur._util.binary import DAMAGE, PREFIX, tags_of
from rsdeblur._util.one_line import one_line
from rsdeblur.errors import RsdeblurWarning
from rsdeblur.image.profile import linear_profile
from rsdeblur.io.exif import renewed as renewed_exif

# Parts that belong to the original only, and bytes that show them in its file or XMP packet.
C2PA = "the C2PA manifest, which is valid for the bytes of the original only"
LOSSES = {
    C2PA: (b"jumdc2pa",),
    "the HDR gain map, which fits the blurred picture": (
        *(b"hdrgm:", b"HDRGainMap:", b'"GainMap"', b">GainMap<", b"aux:hdrgainmap", b"\0\0tmap\0"),
    ),
    "the pictures behind the photo (MPF: gain map, preview, depth)": (b"MPF\0II*\0", b"MPF\0MM\0*"),
    "the video of the motion photo": (b"MotionPhoto", b"MicroVideo"),
    "the extended part of the XMP packet (depth map or original picture)": (b"http://ns.adobe.com/xmp/extension/\0",),
}
# Texts in XMP packets that describe other things that a result does not have: places of depth maps, sounds and extended
# packets, a thumbnail of the blurred photo, the address of a C2PA manifest.
OTHER_TEXTS = (
    *(b"/photos/1.0/container/", b"/photos/1.0/depthmap/", b"/photos/1.0/image/", b"/photos/1.0/audio/"),
    *(b"/photos/dd/1.0/device/", b"HasExtendedXMP", b"xmp:Thumbnails", b"dcterms:provenance"),
)
DESCRIBES = "the XMP packet, which describes parts of the original that the result does not have"
# Blocks of metadata: the name for messages, and the length of the longest in a JPEG.
BLOCKS = {"exif": ("the EXIF block", 65_533), "xmp": ("the XMP packet", 65_502), "iptc": ("the IPTC record", 65_500)}

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


def of_info(info: Mapping[Any, Any], data: bytes, pixels: NDArray[Any], exif: bytes | None) -> Picture:
    """Return the picture of a file, whose metadata are in `info` as Pillow names them."""
    xmp = info.get("xmp")
    xmp = xmp.encode() if isinstance(xmp, str) else xmp
    if exif and not exif.startswith(PREFIX):
        exif = PREFIX + exif
    iptc = info.get("photoshop", {}).get(0x0404)
    profile, losses = info.get("icc_profile"), losses_of(data, xmp)
    return Picture(pixels, exif or None, profile, None, xmp or None, iptc or None, losses)


def losses_of(data: bytes, xmp: bytes | None) -> tuple[str, ...]:
    """Return the parts of a file that a copy cannot keep, in words."""
    return tuple(text for text, marks in LOSSES.items() if any(mark in data or (xmp and mark in xmp) for mark in marks))


def renewed(old: Picture, pixels: NDArray[Any], kind: str) -> Picture:
    """Return a result with the metadata of its original."""
    height, width = pixels.shape[:2]
    losses = list(old.losses)
    new = replace(old, pixels=pixels, icc_profile=fitting_profile(old.icc_profile, pixels, grey=kind != "WebP"))
    if old.exif:
        new = replace(new, exif=renewed_exif(old.exif, width, height))
    if old.xmp and (losses_of(b"", old.xmp) or any(text in old.xmp for text in OTHER_TEXTS)):
        new, losses = replace(new, xmp=None), [*losses, DESCRIBES]
    for name, reason in _refused(new, kind).items():
        without: dict[str, Any] = {name: None}
        new, losses = replace(new, **without), [*losses, f"{BLOCKS[name][0]}, {reason}"]
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
    if kind in ("PNG", "WebP"):
        return {"iptc": f"which {kind} files do not have"} if "iptc" in blocks else {}
    if kind == "JPEG":
        reason = "whose {} bytes are too many for JPEG"
        return {name: reason.format(len(block)) for name, block in blocks.items() if len(block) > BLOCKS[name][1]}
    if kind == "TIFF" and "exif" in blocks:
        if picture.pixels.nbytes > CLASSIC_BYTES:
            return {"exif": "which a TIFF of more than 4 GB cannot hold"}
        try:
            tags_of(blocks["exif"])
        except DAMAGE as error:
            return {"exif": f"which is damaged: {error}"}
    return {}
