"""Binary data as text: basE91 (Henke)."""

from __future__ import annotations

BASE91 = b'ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789!#$%&()*+,./:;<=>?@[]^_`{|}~"'


def base91_decode(text: bytes) -> bytes:
    """Decode basE91 (Henke): two characters carry 13 or 14 bits."""
    others = bytes(set(range(256)).difference(BASE91))
    values = text.translate(bytes(max(BASE91.find(code), 0) for code in range(256)), others)
    out, bits, count = bytearray(), 0, 0
    for low, high in zip(values[::2], values[1::2], strict=False):
        pair = low + 91 * high
        bits |= pair << count
        count += 13 if pair & 8191 > 88 else 14
        while count > 7:
            out.append(bits & 255)
            bits >>= 8
            count -= 8
    if len(values) % 2:
        out.append((bits | values[-1] << count) & 255)
    return bytes(out)
