"""TIFF, whose EXIF block is part of the file's own tags.

Pillow supports neither 16-bit nor float colour, and applies a TIFF's orientation tag while loading it. Therefore
tifffile reads and writes the samples.
"""

import logging
import struct
from io import BytesIO
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray
from PIL import Image
from PIL.ExifTags import Base

from rsdeblur._util.binary import LONG, ORIENTATION, Tags, block_of, directory, tags_of
from rsdeblur.errors import FileFormatError
from rsdeblur.io.metadata import Picture

# tifffile logs every oddity of a damaged file; the faults that matter are raised.
logging.getLogger("tifffile").addHandler(logging.NullHandler())

MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
# Tags of an EXIF block's first directory that describe the picture rather than how its samples are stored: description,
# maker, model, orientation, software, time, artist, computer, rating, copyright, and texts of Windows.
DESCRIPTIVE = (270, 271, 272, ORIENTATION, 305, 306, 315, 316, 18246, 18249, 33432, *range(40091, 40096))


def decode(data: bytes, max_pixels: int) -> Picture:
    """Return the first page; the orientation tag is not applied."""
    with tifffile.TiffFile(BytesIO(data)) as file:
        page = file.pages.first
        # page.size counts the samples of all planes of a volume, up to four per pixel, of up to 32 bits.
        if max(page.imagewidth * page.imagelength, page.size // 4, page.nbytes // 16) > max_pixels:
            size = f"{page.imagewidth}x{page.imagelength}"
            raise FileFormatError(f"the picture claims {size} pixels; the limit is {max_pixels}")
        # Strips that share bytes would let a small file claim more pixels than its size makes credible.
        claims = *np.add(page.dataoffsets, page.databytecounts), sum(page.databytecounts), np.prod(page.chunked)
        if max(claims) > len(data):
            raise EOFError("its strips or tiles take more bytes than the file has")
        if tuple(page.extrasamples) == (tifffile.EXTRASAMPLE.ASSOCALPHA,):
            raise FileFormatError("its colours are multiplied by its alpha; save it with plain alpha, or without")
        samples = page.asarray()
        pixels = _plain(page, np.moveaxis(samples, 0, -1) if page.axes.startswith("S") else samples)
        if pixels is None or pixels.ndim > 3 or (pixels.ndim == 3 and pixels.shape[2] not in (2, 3, 4)):
            raise FileFormatError(
                f"TIFF with {page.samplesperpixel} samples of {page.bitspersample} bits ({page.photometric!r}) is not "
                "supported; convert it to grey or RGB of 8 or 16 bits without sign, or float"
            )
        return of_page(page, np.ascontiguousarray(pixels), data)


def _plain(page: tifffile.TiffPage, pixels: NDArray[Any]) -> NDArray[Any] | None:
    """Return `pixels` as grey or RGB in uint8, uint16 or float32; None if their kind is not supported."""
    bits, kind = page.bitspersample, tifffile.PHOTOMETRIC(page.photometric)
    if pixels.dtype.kind == "i":
        return None
    if pixels.dtype.kind == "f":
        # Infinity, or a signalling NaN: refused where it matters.
        with np.errstate(over="ignore", invalid="ignore"):
            pixels = pixels.astype(np.float32)
    elif bits <= 8 and kind != kind.PALETTE:
        pixels = pixels.astype(np.uint8) * np.uint8(255 // (2**bits - 1))
    elif bits not in (8, 16) and kind != kind.PALETTE:
        return None
    if kind in (kind.MINISBLACK, kind.RGB) or (kind == kind.YCBCR and page.compression == tifffile.COMPRESSION.JPEG):
        return pixels
    if kind == kind.MINISWHITE and pixels.dtype.kind == "u":
        inverted: NDArray[Any] = np.invert(pixels)
        return inverted
    if kind == kind.PALETTE and page.colormap is not None:
        colours: NDArray[np.uint8] = (page.colormap.T[pixels] >> 8).astype(np.uint8)
        return colours
    if kind == kind.SEPARATED and pixels.dtype == np.uint8 and pixels.shape[2:] == (4,):
        height, width = pixels.shape[:2]
        return np.array(Image.frombytes("CMYK", (width, height), pixels.tobytes()).convert("RGB"))
    return None


def of_page(page: tifffile.TiffPage, pixels: NDArray[Any], data: bytes) -> Picture:
    """Return a picture with the metadata of a page of a TIFF file, whose descriptive tags become an EXIF block."""
    tags: Tags = {}
    if data[:4] not in MAGIC[2:]:  # offsets in EXIF blocks have 32 bits, those of BigTIFF 64
        tags = tags_of(data, DESCRIPTIVE)
    xmp, iptc = (_tag_bytes(page, tag) for tag in (Base.XMLPacket, Base.IPTCNAA))
    has_parts = 0xCD41 in page.tags  # a C2PA manifest
    return Picture(pixels, block_of(tags) if tags else None, page.iccprofile, xmp, iptc, has_parts)


def _tag_bytes(page: tifffile.TiffPage, number: int) -> bytes | None:
    if (tag := page.tags.get(number)) is None:
        return None
    file = page.parent.filehandle
    file.seek(tag.valueoffset)
    return bytes(file.read(min(tag.valuebytecount, 2**24))) or None


def encode(picture: Picture) -> bytes:
    """Return a deflated TIFF file, at whose end are the tables of the EXIF block."""
    # TIFF's types: bytes, and bytes of no type.
    blocks = ((Base.XMLPacket, 1, picture.xmp), (Base.IPTCNAA, 7, picture.iptc))
    fields: list[Any] = [(tag, kind, len(block), block, True) for tag, kind, block in blocks if block]
    tags = tags_of(picture.exif, DESCRIPTIVE) if picture.exif else {}
    fields += [(tag, *value, True) for tag, value in tags.items() if not isinstance(value, dict)]
    tables = {tag: value for tag, value in tags.items() if isinstance(value, dict)}
    # tifffile does not write pointers to EXIF tables. The tag number below each pointer serves as a placeholder, which
    # keeps the directory in order.
    fields += [(tag - 1, LONG, 1, 0, True) for tag in tables]
    channels = 1 if picture.pixels.ndim == 2 else picture.pixels.shape[2]
    file = BytesIO()
    with tifffile.TiffWriter(file, bigtiff=False, byteorder="<") as writer:
        writer.write(
            picture.pixels,
            compression="zlib",
            predictor=True,
            photometric="rgb" if channels > 2 else "minisblack",
            planarconfig="contig" if channels > 1 else None,
            extrasamples=["unassalpha"] if channels in (2, 4) else None,
            metadata=None,
            software=False,
            iccprofile=picture.icc_profile,
            extratags=fields,
        )
    for tag, table in tables.items():
        file.seek(0)
        with tifffile.TiffFile(file) as tiff:
            placeholder = tiff.pages.first.tags[tag - 1].offset
        start = file.seek(0, 2)
        start += file.write(b"\0" * (start % 2))
        file.write(directory(table, start))
        file.seek(placeholder)
        file.write(struct.pack("<HHII", tag, LONG, 1, start))
    return file.getvalue()
