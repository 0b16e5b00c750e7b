"""Seeds with metadata: EXIF blocks, XMP packets, and pictures with parts that no copy can keep."""

import struct
from io import BytesIO
from typing import Any

from PIL import Image
from PIL.PngImagePlugin import PngInfo

from rsdeblur.io import Picture, picture_output
from tests._util import files

RECORD = b"\x1c\x02\x78\x00\x05hello"
# An XMP packet that describes a gain map and a motion photo, and one that describes nothing of them.
LOST, KEPT = (
    f'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    f'<rdf:Description rdf:about="" {attributes}/></rdf:RDF></x:xmpmeta>'.encode()
    for attributes in (
        'xmlns:hdrgm="http://ns.adobe.com/hdr-gain-map/1.0/" hdrgm:Version="1.0" '
        'xmlns:GCamera="http://ns.google.com/photos/1.0/camera/" GCamera:MotionPhoto="1"',
        'xmlns:xmp="http://ns.adobe.com/xap/1.0/" xmp:ModifyDate="2024-05-06T07:08:09"',
    )
)


def with_thumbnail(exif: bytes, thumbnail: bytes) -> bytes:
    """Return a block of Pillow's, in big-endian order, with a second directory behind it."""
    data = exif.removeprefix(b"Exif\0\0")
    (start,) = struct.unpack_from(">I", data, 4)
    # The place of the pointer to the second directory.
    end = start + 2 + 12 * struct.unpack_from(">H", data, start)[0]
    heads = ((259, 3, 6 << 16), (513, 4, len(data) + 42), (514, 4, len(thumbnail)))
    second = struct.pack(">H", 3) + b"".join(struct.pack(">HHII", *head[:2], 1, head[2]) for head in heads) + bytes(4)
    return b"Exif\0\0" + data[:end] + struct.pack(">I", len(data)) + data[end + 4 :] + second + thumbnail


def exif() -> bytes:
    """Return a big-endian EXIF block with a thumbnail."""
    return with_thumbnail(files.exif(), files.encoded("JPEG", files.picture((6, 8), "uint8")))


def jpegs() -> list[bytes]:
    """Return JPEGs with metadata."""
    plain = files.jpeg(xmp=LOST)
    segments = [
        (0xE1, b"http://ns.adobe.com/xmp/extension/\0" + bytes(40)),
        (0xE2, b"MPF\0II*\0\x08\0\0\0\0\0"),
        (0xEB, b"JP\0\1\0\0\0\1\0\0\0\x1bjumb\0\0\0\x13jumdc2pa\0\0\0"),
    ]
    marked = b"".join(struct.pack(">BBH", 0xFF, marker, len(body) + 2) + body for marker, body in segments)
    rotated = files.encoded("JPEG", files.picture((12, 20, 3), "uint8"), exif=exif(), xmp=KEPT)
    iptc = files.jpeg(xmp=LOST, extra=picture_output.iptc_segment(RECORD))
    return [iptc, plain[:2] + marked + plain[2:], rotated]


def pngs() -> list[bytes]:
    """Return PNGs with metadata."""
    pixels = files.picture((12, 20, 3), "uint8")
    profile = b"\0" * 16 + b"GRAY" + b"\0" * 108
    grey = Picture(files.picture((12, 20), "uint16"), exif(), profile, xmp=LOST, iptc=RECORD)
    info, buffer = PngInfo(), BytesIO()
    info.add(b"caBX", b"jumdc2pa", after_idat=False)
    Image.fromarray(pixels).save(buffer, "PNG", pnginfo=info)
    return [buffer.getvalue(), picture_output.encode("PNG", grey)]


def webps() -> list[bytes]:
    """Return a WebP with metadata."""
    data = files.encoded("WebP", files.picture((12, 20, 3), "uint8"), lossless=True, xmp=LOST)
    data += b"C2PA" + struct.pack("<I", 4) + bytes(4)
    return [data[:4] + struct.pack("<I", len(data) - 8) + data[8:]]


def tiffs() -> list[bytes]:
    """Return TIFFs with metadata, and of floats and of JPEG 2000."""
    rgb = files.picture((12, 20, 3), "uint8")
    manifest: Any = [(0xCD41, 7, 4, bytes(4), True)]
    floats = files.tiff(files.picture((12, 20), "float32"))
    return [
        *(floats + bytes(k) for k in range(5)),
        files.tiff(rgb, photometric="rgb", compression="jpeg2000"),
        picture_output.encode("TIFF", Picture(rgb, exif(), xmp=LOST, iptc=RECORD)),
        files.tiff(rgb, photometric="rgb", extratags=manifest),
    ]


def heics() -> list[bytes]:
    """Return HEIC pictures with metadata, one of 10 bits."""
    import pillow_heif

    found = []
    for mode, dtype in (("RGB", "uint8"), ("RGB;16", "uint16")):
        buffer = BytesIO()
        picture = pillow_heif.from_bytes(mode, (24, 16), files.picture((16, 24, 3), dtype).tobytes())
        picture.save(buffer, quality=50, xmp=LOST)
        found.append(buffer.getvalue())
    return found
