"""Mutations of files: random damage, careless programs and malice."""

import random
import re
from collections.abc import Sequence

# Largest size of a mutated file, bytes, so that slowness comes from the reader and not from the size.
LONGEST = 60_000

NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
NUMBERS = (
    *(b"nan", b"-nan", b"inf", b"-Infinity", b"NaN", b"Infinity", b"0", b"-0", b"-1", b"1", b"0.0", b"5e-324"),
    *(b"1e-310", b"1e308", b"1e309", b"-1e999", b"1e-999999999", b"1e999999999", b"1e99999999999999999999"),
    *(b"9223372036854775807", b"9223372036854775808", b"-9223372036854775808", b"-9223372036854775809"),
    *(b"18446744073709551616", b"340282366920938463463374607431768211456", b"1" + b"0" * 400, b"9" * 5000),
    *(b"0x10", b"1_000", b"1,5", b"+", b"-", b".", b"1.", b".5", b"1.2.3", b"1e", b"\xd9\xa3", b"\xef\xbc\x91"),
    *(b'""', b"''", b"null", b"true", b"[]", b"{}", b"[[]]", b"()", b"''''", b"2024-01-01", b"12:30:45", b"!!float x"),
    *(b"[" * 900 + b"1" + b"]" * 900, b'{"a":' * 5000 + b"1", b"{a: " * 900, b"- " * 900, b"1" * 3000, b"nan " * 4),
)
WORDS = (
    *(b"\0", b"\r", b"\r\n", b"\n", b"\n\n\n", b"\t", b" ", b"  ", b";", b",", b",,,,", b":", b"#", b"%", b'"', b"'"),
    *(b"\xef\xbb\xbf", b"\xff\xfe", b"\xfe\xff", b"\xff", b"\xc3", b"\xe2\x80\xa8", b"\xc2\x85", b"\x0b", b"\x0c"),
    *(b"\x1c", b"\x1a", b"\xed\xa0\x80", b"\xf0\x9f\x98\x80", b"[", b"]", b"{", b"}", b"{}", b"[]", b"&a", b"*a"),
    *(b"<<: *a", b"!!python/object/apply:os.system [id]", b"!!binary", b"\\u0000", b"\\ud800", b"=", b"'''", b'"""'),
    *(b"\n# a comment\n", b"\na,b,c,d\n", b"\n1 2 3\n"),
)
INTEGERS = (0, 1, 2, 3, 7, 8, 16, 32, 127, 128, 255, 256, 32767, 32768, 65535, 65536, 2**24, 2**31 - 1, 2**31, 2**63)
FLOATS = tuple(bytes.fromhex(word) for word in ("0000c07f", "0000807f", "000080ff", "01000000", "000000000000f07f"))


def mutated(seed: bytes, rng: random.Random, others: Sequence[bytes], *, text: bool) -> bytes:
    """Return `seed` after one to five mutations; `others` are files to take pieces from."""
    data = bytearray(seed)
    anywhere = ("drop", "double", "flip", "truncate", "splice")
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 5))):
        own = ("number", "number", "number", "word", "word", "line") if text else ("integer", "integer", "float")
        _mutate(data, rng.choice((*anywhere, *own)), rng, others)
        del data[LONGEST:]
    return bytes(data)


def _mutate(data: bytearray, kind: str, rng: random.Random, others: Sequence[bytes]) -> None:
    # The start of a file contains its structure, so most of the damage is done there.
    place = rng.randrange(min(len(data), rng.choice((64, 512, LONGEST))) or 1)
    length = rng.choice((1, 1, 2, 4, 16, 100, 1000))
    if kind == "drop":
        del data[place : place + length]
    elif kind == "double":
        data[place:place] = data[place : place + length] * rng.choice((1, 2, 50))
    elif kind == "flip":
        for k in range(place, min(place + rng.choice((1, 1, 8, 64)), len(data))):
            data[k] ^= 1 << rng.randrange(8)
    elif kind == "truncate":
        del data[rng.randrange(len(data) + 1) :]
    elif kind == "splice":
        other = rng.choice(others)
        start = rng.randrange(len(other))
        data[place : place + rng.choice((0, length))] = other[start : start + length]
    elif kind == "word":
        data[place : place + rng.choice((0, 1))] = rng.choice(WORDS) * rng.choice((1, 1, 1, 3, 2000))
    elif kind == "number" and (numbers := list(NUMBER.finditer(data))):
        # Another extreme, or another number of the file.
        for match in sorted(
            rng.sample(numbers, min(len(numbers), rng.choice((1, 1, 2, 10)))), key=lambda m: -m.start()
        ):
            data[match.start() : match.end()] = rng.choice((*NUMBERS, *8 * (rng.choice(numbers)[0],)))
    elif kind == "line":
        lines = bytes(data).split(b"\n")
        i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
        lines[i : i + rng.choice((0, 1, 3))] = [lines[j]] * rng.choice((0, 1, 100))
        data[:] = b"\n".join(lines)
    elif kind == "integer":
        size = rng.choice((1, 2, 4, 8))
        value = rng.choice(INTEGERS) & (2 ** (8 * size) - 1)
        data[place : place + size] = value.to_bytes(size, rng.choice(("little", "big")))
    elif kind == "float":
        value_bytes = rng.choice(FLOATS)[:: rng.choice((1, -1))]
        data[place : place + len(value_bytes)] = value_bytes
