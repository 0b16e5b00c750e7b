"""XMP packets: what is no longer true is removed, sizes and dates are renewed, and the history gets an entry.

The rest of a packet stays as it is, prefixes included; only comments and padding outside its root are lost.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from uuid import NAMESPACE_URL, uuid5
from xml.dom import minidom
from xml.parsers.expat import ExpatError

RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
XMP = "http://ns.adobe.com/xap/1.0/"
MEDIA, EVENT = "http://ns.adobe.com/xap/1.0/mm/", "http://ns.adobe.com/xap/1.0/sType/ResourceEvent#"
TIFF, EXIF = "http://ns.adobe.com/tiff/1.0/", "http://ns.adobe.com/exif/1.0/"
XMLNS = "http://www.w3.org/2000/xmlns/"
GOOGLE = "http://ns.google.com/photos/"
PREFIXES = {RDF: "rdf", XMP: "xmp", MEDIA: "xmpMM", EVENT: "stEvt"}

# Properties of pictures, videos and sounds behind the picture, whose places and lengths they give: gain maps, depth
# maps, motion photos. `None` means all names; else a name starts with one of these.
BEHIND: dict[str, tuple[str, ...] | None] = {
    f"{GOOGLE}1.0/container/": None,
    f"{GOOGLE}1.0/camera/": ("MotionPhoto", "MicroVideo"),
    **dict.fromkeys((f"{GOOGLE}1.0/{kind}/" for kind in ("depthmap", "image", "audio")), None),
    f"{GOOGLE}dd/1.0/device/": None,
    "http://ns.adobe.com/hdr-gain-map/1.0/": None,
    "http://ns.apple.com/HDRGainMap/1.0/": None,
    "http://ns.adobe.com/xmp/note/": ("HasExtendedXMP",),
    # A picture of the blurred photo, and the address of a C2PA manifest.
    XMP: ("Thumbnails",),
    "http://purl.org/dc/terms/": ("provenance",),
}
# Texts in packets of pictures with a gain map: prefixes of its properties, and its name in a list of pictures.
GAIN_MAP = (b"hdrgm:", b"HDRGainMap:", b'"GainMap"', b">GainMap<")
# Most bytes of a packet that is edited: 64 kB fit into a JPEG, and a tree in memory takes some thirty times its text.
LARGEST = 2**22

EMPTY = (
    f'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="{RDF}"><rdf:Description rdf:about=""/>'
    "</rdf:RDF></x:xmpmeta>"
)
HEAD = '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>\n'
TAIL = '\n<?xpacket end="w"?>'


def _parsed(packet: bytes | None) -> minidom.Document:
    """Return the tree of a packet; raise ValueError if it is damaged, too long, or declares entities."""
    text = (packet or EMPTY.encode()).rstrip(b"\0 \r\n")
    if len(text) > LARGEST or b"<!DOCTYPE" in text:
        raise ValueError("it is too long, or declares a document type")
    try:
        tree = minidom.parseString(text)
    except (ExpatError, UnicodeError, LookupError, RecursionError) as error:
        raise ValueError(str(error)) from error
    if not _descriptions(tree):
        raise ValueError("it contains no rdf:Description")
    return tree


def _packet(tree: minidom.Document) -> bytes:
    assert tree.documentElement is not None
    return (HEAD + tree.documentElement.toxml() + TAIL).encode()


def _descriptions(tree: minidom.Document) -> list[minidom.Element]:
    """Return the elements that hold the properties of the picture."""
    return [
        node
        for root in tree.getElementsByTagNameNS(RDF, "RDF")
        for node in root.childNodes
        if isinstance(node, minidom.Element) and (node.namespaceURI, node.localName) == (RDF, "Description")
    ]


def _properties(tree: minidom.Document) -> Iterator[tuple[minidom.Element, minidom.Element | minidom.Attr]]:
    """Yield each property, an attribute or an element, with the description that it belongs to."""
    for description in _descriptions(tree):
        for attribute in list(description.attributes.values()):
            yield description, attribute
        for node in list(description.childNodes):
            if isinstance(node, minidom.Element):
                yield description, node


def _is_behind(node: minidom.Element | minidom.Attr) -> bool:
    names = BEHIND.get(node.namespaceURI or "", ())
    return names is None or (node.localName or "").startswith(tuple(names))


def has_gain_map(packet: bytes | None) -> bool:
    """Whether a packet describes an HDR gain map."""
    return any(text in (packet or b"") for text in GAIN_MAP)


def has_motion(packet: bytes | None) -> bool:
    """Whether a packet describes the video of a motion photo."""
    return b"MotionPhoto" in (packet or b"") or b"MicroVideo" in (packet or b"")


def renewed(packet: bytes, width: int, height: int, when: datetime) -> bytes:
    """Return a packet that is true of a new picture of that size, written at a time.

    Raises
    ------
    ValueError
        If the packet is damaged.
    """
    tree = _parsed(packet)
    sides = {(TIFF, "ImageWidth"): width, (TIFF, "ImageLength"): height}
    sides |= {(EXIF, "PixelXDimension"): width, (EXIF, "PixelYDimension"): height}
    values = {key: str(side) for key, side in sides.items()}
    identity = uuid5(NAMESPACE_URL, packet.decode("utf-8", "replace") + when.isoformat())
    values[MEDIA, "InstanceID"] = f"xmp.iid:{identity}"
    for description, node in _properties(tree):
        key = node.namespaceURI or "", node.localName or ""
        if _is_behind(node):
            _remove(description, node)
        elif key in values:
            _set(node, values[key])
    for name in ("ModifyDate", "MetadataDate"):
        _put(tree, XMP, name, when.isoformat(timespec="seconds"))
    return _packet(tree)


def with_history(packet: bytes | None, agent: str, parameters: str, when: datetime) -> bytes:
    """Return a packet, a new one if it is missing, whose history ends with an entry for a filtered picture.

    Raises
    ------
    ValueError
        If the packet is damaged.
    """
    tree = _parsed(packet)
    history = next(
        (node for _, node in _properties(tree) if (node.namespaceURI, node.localName) == (MEDIA, "History")), None
    )
    if not isinstance(history, minidom.Element):
        description = _descriptions(tree)[0]
        history = description.appendChild(_element(tree, description, MEDIA, "History"))
    lists = history.getElementsByTagNameNS(RDF, "Seq")
    entries = lists[0] if lists else history.appendChild(_element(tree, history, RDF, "Seq"))
    entry = entries.appendChild(_element(tree, entries, RDF, "li"))
    facts = {"action": "filtered", "when": when.isoformat(timespec="seconds"), "softwareAgent": agent}
    for name, value in {**facts, "changed": "/", "parameters": parameters}.items():
        entry.setAttributeNS(EVENT, f"{_prefix(entry, EVENT)}:{name}", value)
    return _packet(tree)


def _put(tree: minidom.Document, uri: str, name: str, value: str) -> None:
    """Set a simple property, wherever it is."""
    for _, node in _properties(tree):
        if (node.namespaceURI, node.localName) == (uri, name):
            _set(node, value)
            return
    description = _descriptions(tree)[0]
    description.setAttributeNS(uri, f"{_prefix(description, uri)}:{name}", value)


def _set(node: minidom.Element | minidom.Attr, value: str) -> None:
    if isinstance(node, minidom.Attr):
        node.value = value
        return
    while node.firstChild is not None:
        node.removeChild(node.firstChild)
    assert node.ownerDocument is not None
    node.appendChild(node.ownerDocument.createTextNode(value))


def _remove(description: minidom.Element, node: minidom.Element | minidom.Attr) -> None:
    if isinstance(node, minidom.Attr):
        description.removeAttributeNode(node)
    else:
        description.removeChild(node)


def _element(tree: minidom.Document, parent: minidom.Element, uri: str, name: str) -> minidom.Element:
    return tree.createElementNS(uri, f"{_prefix(parent, uri)}:{name}")


def _prefix(element: minidom.Element, uri: str) -> str:
    """Return the prefix of a namespace in an element; declare it there if it has none."""
    node: minidom.Node | None = element
    while isinstance(node, minidom.Element):
        for attribute in node.attributes.values():
            if attribute.namespaceURI == XMLNS and attribute.value == uri and attribute.prefix == "xmlns":
                return str(attribute.localName)
        node = node.parentNode
    element.setAttributeNS(XMLNS, f"xmlns:{PREFIXES[uri]}", uri)
    return PREFIXES[uri]
