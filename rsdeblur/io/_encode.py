"""Encoding of pictures with their metadata into files of each format."""

from __future__ import annotations

import struct
import zlib
from io import BytesIO
from typing import Any

import imagecodecs
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rsdeblur.io import _jpeg, _tiff
from rsdeblur.io._exif_block import PREFIX
from rsdeblur.io._metadata import PNG_IPTC, Metadata, png_iptc

PNG_HEADER = 33  # Length of the magic number and IHDR; colour profile and metadata may follow.


def quantised(image: NDArray[Any], bits: int) -> NDArray[Any]:
    """Return values in [0, 1] as samples of `bits` bits; 32 is float32."""
    if image.dtype.kind == "u":
        if 8 * image.dtype.itemsize == bits:
            return image
        image = image / np.float32(np.iinfo(image.dtype).max)
    if bits == 32:
        return image.astype(np.float32)
    # float16 cannot represent 65535.
    clipped: NDArray[Any] = np.clip(image, 0.0, 1.0).astype(np.promote_types(image.dtype, np.float32))
    clipped *= 2**bits - 1
    levels: NDArray[Any] = np.rint(clipped, out=clipped).astype(np.uint8 if bits == 8 else np.uint16)
    return levels


def encode(kind: str, pixels: NDArray[Any], metadata: Metadata) -> bytes:
    """Return the file of a picture, with metadata that its format can hold."""
    if kind == "TIFF":
        return _tiff.encode(pixels, metadata)
    if kind == "PNG":
        return _encode_png(pixels, metadata)
    if kind == "NumPy":
        buffer = BytesIO()
        np.save(buffer, pixels, allow_pickle=False)
        return buffer.getvalue()
    options: dict[str, Any] = {"quality": 95, "subsampling": 0}
    if kind == "WebP":
        # The fastest lossless method; the slower ones save 3 % for 3 times the time.
        options = {"lossless": True, "exact": True, "method": 0}
    blocks = {"exif": metadata.exif, "xmp": metadata.xmp, "icc_profile": metadata.icc_profile}
    buffer = BytesIO()
    Image.fromarray(pixels).save(
        buffer, format=kind, **options, **{name: block for name, block in blocks.items() if block}
    )
    data = buffer.getvalue()
    return _jpeg.with_iptc(data, metadata.iptc) if kind == "JPEG" and metadata.iptc else data


def _encode_png(pixels: NDArray[Any], metadata: Metadata) -> bytes:
    # zlib's default, 6, makes photographs 3 % smaller in 3 times the time.
    data = bytes(imagecodecs.png_encode(pixels, level=2))
    extra = b""
    if metadata.icc_profile:
        extra += _png_chunk(b"iCCP", b"ICC profile\0\0" + zlib.compress(metadata.icc_profile))
    if metadata.exif:
        extra += _png_chunk(b"eXIf", metadata.exif.removeprefix(PREFIX))
    if metadata.xmp:
        extra += _png_chunk(b"iTXt", b"XML:com.adobe.xmp" + bytes(5) + metadata.xmp)
    if metadata.iptc:
        extra += _png_chunk(b"zTXt", PNG_IPTC.encode() + bytes(2) + zlib.compress(png_iptc(metadata.iptc)))
    return data[:PNG_HEADER] + extra + data[PNG_HEADER:]


def _png_chunk(name: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
