"""Seeds with metadata: EXIF blocks with times, XMP packets, and pictures with parts that no copy can keep."""

from __future__ import annotations

import struct
from datetime import UTC, datetime
from io import BytesIO
from typing import Any

from PIL import Image
from PIL.PngImagePlugin import PngInfo
from PIL.TiffImagePlugin import IFDRational

from rsdeblur.io import picture_output
from rsdeblur.io._metadata import PNG_IPTC, Picture, png_iptc
from tests._util import files

NAMESPACES = " ".join(
    f'xmlns:{prefix}="{uri}"'
    for prefix, uri in {
        "xmp": "http://ns.adobe.com/xap/1.0/",
        "xmpMM": "http://ns.adobe.com/xap/1.0/mm/",
        "stEvt": "http://ns.adobe.com/xap/1.0/sType/ResourceEvent#",
        "tiff": "http://ns.adobe.com/tiff/1.0/",
        "exif": "http://ns.adobe.com/exif/1.0/",
        "hdrgm": "http://ns.adobe.com/hdr-gain-map/1.0/",
        "GCamera": "http://ns.google.com/photos/1.0/camera/",
        "Container": "http://ns.google.com/photos/1.0/container/",
    }.items()
)
RECORD = b"\x1c\x02\x78\x00\x05hello"
RESOURCE = b"8BIM\x04\x04\0\0" + struct.pack(">I", len(RECORD)) + RECORD


def _packet(attributes: str, content: str) -> bytes:
    return (
        '<?xpacket begin="" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF '
        f'xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description rdf:about="" {NAMESPACES} '
        f'{attributes}>{content}</rdf:Description></rdf:RDF></x:xmpmeta><?xpacket end="w"?>'
    ).encode()


PACKETS = [
    _packet(
        'xmp:ModifyDate="2024-05-06T07:08:09" tiff:ImageWidth="20" hdrgm:Version="1.0" GCamera:MotionPhoto="1"',
        "<tiff:ImageLength>12</tiff:ImageLength><Container:Directory><rdf:Seq/></Container:Directory><xmpMM:History>"
        '<rdf:Seq><rdf:li stEvt:action="saved"/></rdf:Seq></xmpMM:History>',
    ),
    _packet('exif:PixelXDimension="20" xmpMM:History=""', "<xmp:MetadataDate/><xmpMM:InstanceID>a</xmpMM:InstanceID>"),
    _packet("", "text"),
    _packet("", "<xmpMM:History/>"),
    b'<x xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:RDF/></x>',
    b'<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>',
    b"<a",
    # Longer than a segment of a JPEG.
    *(_packet("", "a" * (70_000 + k)) for k in range(5)),
]


def timed_exif(zone: str | None = "+01:00", fix: float | None = 29.0, width: int = 4000) -> bytes:
    """Return an EXIF block with the time of the logs, its time zone, the seconds of a GPS fix, and a thumbnail."""
    when = datetime.fromtimestamp(files.EPOCH // 10**9, UTC)
    block = Image.Exif()
    block[271], block[274], block[306] = "Maker", 1, when.strftime("%Y:%m:%d %H:%M:%S")
    texts = {0x9003: block[306], 0x9291: "427", 0x9290: "427"} | ({0x9010: zone, 0x9011: zone} if zone else {})
    planes = dict.fromkeys((0xA20E, 0xA20F), IFDRational(8000))
    block.get_ifd(0x8769).update({**texts, **planes, 0xA002: width, 0xA003: 3000, 0xA210: 3})
    block.get_ifd(0x8769).update({0xA404: IFDRational(2), 0xA405: 26})
    if fix is not None:
        block.get_ifd(0x8825).update({7: (float(when.hour), float(when.minute), fix), 29: when.strftime("%Y:%m:%d")})
    return with_thumbnail(block.tobytes(), files.encoded("JPEG", files.picture((6, 8), "uint8")))


def with_thumbnail(exif: bytes, thumbnail: bytes) -> bytes:
    """Return a block of Pillow's, in big-endian order, with a second directory behind it."""
    data = exif.removeprefix(b"Exif\0\0")
    end = _end(data)
    heads = ((259, 3, 6 << 16), (513, 4, len(data) + 42), (514, 4, len(thumbnail)))
    second = struct.pack(">H", 3) + b"".join(struct.pack(">HHII", *head[:2], 1, head[2]) for head in heads) + bytes(4)
    return b"Exif\0\0" + data[:end] + struct.pack(">I", len(data)) + data[end + 4 :] + second + thumbnail


def _end(data: bytes) -> int:
    """Return the place of the pointer to the second directory."""
    (start,) = struct.unpack_from(">I", data, 4)
    return int(start + 2 + 12 * struct.unpack_from(">H", data, start)[0])


def exifs() -> list[bytes]:
    """Return EXIF blocks of several kinds."""
    blocks = [files.exif(), timed_exif(), timed_exif(None), timed_exif(None, None), timed_exif(None, 450), b""]
    # A resolution that divides by zero, or beyond what 32 bits carry.
    for block, value in ((blocks[1], (8000, 0)), (timed_exif(width=1), (2**32 - 1, 1))):
        (place,) = struct.unpack_from(">I", block, block.index(struct.pack(">HHI", 0xA20E, 5, 1)) + 8)
        blocks.append(block[: 6 + place] + struct.pack(">II", *value) + block[14 + place :])
    # A thumbnail, and a second directory, beyond the block.
    place = blocks[1].index(struct.pack(">HHI", 514, 4, 1)) + 8
    blocks.append(blocks[1][:place] + b"\0\1\0\0" + blocks[1][place + 4 :])
    end = 6 + _end(blocks[1][6:])
    blocks.append(blocks[1][:end] + b"\xff" * 4 + blocks[1][end + 4 :])
    return [*blocks, *(blocks[1] + bytes(k) for k in range(1, 5))]


def jpegs() -> list[bytes]:
    """Return JPEGs with metadata."""
    plain = files.jpeg(xmp=PACKETS[0])
    segments = [
        (0xE1, b"http://ns.adobe.com/xmp/extension/\0" + bytes(40)),
        (0xE2, b"MPF\0II*\0\x08\0\0\0\0\0"),
        (0xEB, b"JP\0\1\0\0\0\1\0\0\0\x1bjumb\0\0\0\x13jumdc2pa\0\0\0"),
    ]
    marked = b"".join(struct.pack(">BBH", 0xFF, marker, len(body) + 2) + body for marker, body in segments)
    rotated = files.encoded("JPEG", files.picture((12, 20, 3), "uint8"), exif=timed_exif(), xmp=PACKETS[1])
    iptc = files.jpeg(xmp=PACKETS[0], extra=picture_output.iptc_segment(RECORD))
    return [iptc, plain[:2] + marked + plain[2:], rotated]


def pngs() -> list[bytes]:
    """Return PNGs with metadata."""
    pixels, found = files.picture((12, 20, 3), "uint8"), []
    profile = b"\0" * 16 + b"GRAY" + b"\0" * 108
    grey = Picture(files.picture((12, 20), "uint16"), timed_exif(), profile, xmp=PACKETS[0], iptc=RECORD)
    for text in (png_iptc(RESOURCE).decode(), png_iptc(RECORD).decode()[:-2], "iptc", ""):
        info, buffer = PngInfo(), BytesIO()
        info.add_text(PNG_IPTC, text)
        info.add(b"caBX", b"jumdc2pa", after_idat=False)
        Image.fromarray(pixels).save(buffer, "PNG", pnginfo=info)
        found.append(buffer.getvalue())
    return [*found, picture_output.encode("PNG", grey)]


def webps() -> list[bytes]:
    """Return a WebP with metadata."""
    data = files.encoded("WebP", files.picture((12, 20, 3), "uint8"), lossless=True, xmp=PACKETS[0])
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
        picture_output.encode("TIFF", Picture(rgb, timed_exif(), xmp=PACKETS[0], iptc=RECORD)),
        files.tiff(rgb, photometric="rgb", extratags=manifest),
    ]


def heics() -> list[bytes]:
    """Return HEIC pictures with metadata, one of 10 bits."""
    import pillow_heif

    found = []
    for mode, dtype in (("RGB", "uint8"), ("RGB;16", "uint16")):
        buffer = BytesIO()
        picture = pillow_heif.from_bytes(mode, (24, 16), files.picture((16, 24, 3), dtype).tobytes())
        picture.save(buffer, quality=50, xmp=PACKETS[0])
        found.append(buffer.getvalue())
    return found
